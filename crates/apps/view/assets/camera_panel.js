// The settings of the camera: they change the picture without new samples.

import { allow, box, button, element, input, select, setOptions, setText, setValue, show } from "./dom.js";
import { count, exposure, number, parseExposure, percent, plain, quantity } from "./format.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").Camera} Camera */

/** @type {[number, number]} */
const EXPOSURE_SLIDER = [1e-6, 100]; // s: other times can be typed
/** @type {[number, number]} */
const F_SLIDER = [1, 32]; // others can be typed
const GLARE_SLIDER = 0.1; // likewise
const LARGEST_SEED = 2n ** 63n - 1n; // of a job
const LIGHT_RANGE = 2; // decades on each side of the factor 1 of a light
const LARGEST_FACTOR = 1e6; // of a light

/**
 * @param {Store} store
 * @param {import("./problems.js").Problems} problems
 */
export function cameraPanel(store, problems) {
  followKnobs(store, problems);
  store.on(["camera", "state"], () => showKnobs(store));
  store.on(["kept", "camera"], () => showKept(store));
  store.on("state", () => {
    if (store.server?.timed === null) problems.clear("exposure-returned");
  });
  // A message about a text is outdated when a knob has moved.
  store.on("camera", () => {
    for (const key of ["exposure", "exposure-returned", "gain", "f-number", "glare", "temperature", "black-level", "device", "light-factor", "lights"]) problems.clear(key);
  });
  store.on("returned", () => showReturned(store, problems));
  store.on("picture", () => {
    showFrame(store);
    showExposure(store);
  });
}

/**
 * States the knobs that a change of the job has taken back.
 * @param {Store} store
 * @param {import("./problems.js").Problems} problems
 */
function showReturned(store, problems) {
  const { returned, server } = store;
  if (!server) return;
  if (returned.includes("exposure") && server.camera.exposure !== null) {
    problems.setText("exposure-returned", {
      problem: `The exposure time is that of the job again, ${exposure(server.camera.exposure)}.`,
      place: null, help: `It is fixed, because ${server.timed}. Change it in the job.`,
    });
  }
  if (returned.includes("lights")) {
    problems.setText("lights", {
      problem: "The factors of the lights of A and B are 1 again.",
      place: null, help: "There is one film for all lights. The power of the lights is in the panel Scene.",
    });
  }
}

/**
 * @param {Store} store
 * @param {import("./problems.js").Problems} problems
 */
function followKnobs(store, problems) {
  /**
   * @param {string} id
   * @param {"input" | "change"} event
   * @param {(value: string) => Partial<Camera> | null} change null: the text is no value
   */
  const knob = (id, event, change) => {
    const target = box(id);
    target.addEventListener(event, () => {
      const value = target instanceof HTMLInputElement || target instanceof HTMLSelectElement ? target.value : "";
      const next = change(value);
      if (next) store.changeCamera(next);
      else showKnobs(store, true);
    });
  };
  /**
   * The number if it is in the range of its knob, and otherwise null with a message.
   * @param {string} key
   * @param {string} name
   * @param {number} value
   * @param {[number, number] | undefined} range
   */
  const within = (key, name, value, range) => {
    const [low, high] = range ?? [-Infinity, Infinity];
    if (value >= low && value <= high) {
      problems.clear(key);
      return value;
    }
    problems.setText(key, {
      problem: `${name} ${number(value)} is out of range.`, place: null, help: `Type ${number(low)} to ${number(high)}.`,
    });
    return null;
  };
  knob("sensor", "change", (value) => ({ sensor: value === "" ? null : value }));
  knob("exposure", "input", (value) => ({ exposure: rounded(10 ** Number(value)) }));
  knob("exposure-value", "change", (value) => {
    const seconds = parseExposure(value);
    const [low, high] = store.server?.ranges.exposure ?? [0, Infinity];
    if (seconds !== null && seconds >= low && seconds <= high) {
      problems.clear("exposure");
      return { exposure: seconds };
    }
    problems.setText("exposure", {
      problem: seconds === null ? `"${value}" is no exposure time.` : `The exposure time ${exposure(seconds)} is out of range.`,
      place: null,
      help: `Type ${exposure(low)} to ${exposure(high)}, for example 2 ms, 350 us or 0.1 s.`,
    });
    return null;
  });
  knob("exposure-auto", "change", () => ({
    exposure: input("exposure-auto").checked ? null : shownExposure(store),
  }));
  knob("gain", "input", (value) => ({ gain: rounded(10 ** Number(value)) }));
  knob("gain-value", "change", (value) => {
    const gain = within("gain", "The gain", Number(value), store.server?.ranges.gain);
    return gain === null ? null : { gain };
  });
  knob("f-number", "input", (value) => ({ f_number: rounded(10 ** Number(value)) }));
  knob("f-number-value", "change", (value) => {
    if (value === "") return { f_number: null };
    const f_number = within("f-number", "The f-number", Number(value), store.server?.ranges.f_number);
    return f_number === null ? null : { f_number };
  });
  knob("glare", "input", (value) => ({ glare: Number(value) }));
  knob("glare-value", "change", (value) => {
    if (value === "") return { glare: null };
    const [low, high] = store.server?.ranges.glare ?? [0, 0.5];
    const glare = within("glare", "The glare", Number(value), [100 * low, 100 * high]);
    return glare === null ? null : { glare: rounded(glare / 100) };
  });
  knob("temperature", "input", (value) => ({ temperature: Number(value) }));
  knob("temperature-value", "change", (value) => {
    const temperature = value === "" ? null
      : within("temperature", "The temperature", Number(value), store.server?.ranges.temperature);
    return temperature === null ? null : { temperature };
  });
  knob("temperature-model", "change", () => ({
    temperature: input("temperature-model").checked ? null
      : store.sensorOf(store.camera)?.temperature ?? Number(input("temperature").value),
  }));
  knob("black-level", "change", (value) => {
    const isLevel = value !== "" && Number(value) >= 0;
    problems.setText("black-level", isLevel ? null : {
      problem: `"${value}" is no black level.`, place: null, help: "Type 0 or a positive number of grey values.",
    });
    return isLevel ? { black_level: Number(value) } : null;
  });
  knob("black-level-model", "change", () => ({
    black_level: input("black-level-model").checked ? null : store.frameA?.header.black ?? 0,
  }));
  knob("noise", "change", (value) => ({ noise: /** @type {Camera["noise"]} */ (value) }));
  knob("device", "change", (value) => {
    const number = wholeNumber(value);
    problems.setText("device", number !== null ? null : {
      problem: `"${value}" is no device.`, place: null, help: `Type a whole number from 0 to ${LARGEST_SEED}.`,
    });
    return number === null ? null : { device: number };
  });
  // Before the row takes the text back.
  box("light-factors-list").addEventListener("change", ({ target }) => {
    if (!(target instanceof HTMLInputElement) || target.type !== "number") return;
    problems.setText("light-factor", isFactor(target.value) ? null : {
      problem: `The factor "${target.value}" of a light is out of range.`, place: null, help: `Type 0 to ${LARGEST_FACTOR}.`,
    });
  }, { capture: true });
  knob("denoise", "change", (value) => ({ denoise: /** @type {Camera["denoise"]} */ (value) }));
  knob("vignetting", "change", () => ({ vignetting: input("vignetting").checked }));
  button("device-next").addEventListener("click", () => {
    const next = BigInt(store.camera?.device ?? 0) + 1n;
    store.changeCamera({ device: wholeNumber(String(next)) ?? 0 });
  });
  button("camera-reset").addEventListener("click", () => {
    if (store.server) store.changeCamera(structuredClone(store.server.camera));
  });
}

/**
 * A seed: a text of digits where a number would lose digits.
 * @param {string} text
 * @returns {number | string | null}
 */
function wholeNumber(text) {
  if (!/^\s*\d+\s*$/.test(text)) return null;
  const value = BigInt(text.trim());
  if (value > LARGEST_SEED) return null;
  return value <= BigInt(Number.MAX_SAFE_INTEGER) ? Number(value) : String(value);
}

/** @param {string} text */
function isFactor(text) {
  return text !== "" && Number(text) >= 0 && Number(text) <= LARGEST_FACTOR;
}

/**
 * A slider gives more digits than it has steps.
 * @param {number} value
 */
function rounded(value) {
  return Number(value.toPrecision(4));
}

/**
 * The exposure that the picture has now: the start of a manual exposure.
 * @param {Store} store
 */
function shownExposure(store) {
  const [low, high] = store.server?.ranges.exposure ?? [1e-6, 1];
  return rounded(store.camera?.exposure ?? store.frameA?.header.exposure ?? Math.sqrt(low * high));
}

/**
 * @param {Store} store
 * @param {boolean} force also writes to the control that the user edits
 */
function showKnobs(store, force = false) {
  const { camera, server } = store;
  if (!camera || !server) return;
  /**
   * @param {string} id
   * @param {string} value
   */
  const write = (id, value) => {
    if (force) input(id).value = value;
    else setValue(input(id), value);
  };
  setOptions(select("sensor"), [
    ...server.sensors.map(({ name, label }) => ({ value: name, text: label })),
    { value: "", text: "none: radiance 1 is white" },
  ]);
  setValue(select("sensor"), camera.sensor ?? "");
  const sensor = server.sensors.find(({ name }) => name === camera.sensor);
  setText(box("sensor-facts"), sensor
    ? `${sensor.bits} bits, ${sensor.colour ? "colour" : "grey"}, saturation ${count(sensor.saturation)} e⁻, dark noise ${number(sensor.dark_noise)} e⁻, pixel ${number(sensor.pixel)} µm`
    : "No sensor: no noise of the camera, no grey values.");

  showExposure(store, force);
  input("exposure-auto").checked = camera.exposure === null;

  setRange("gain", ...logarithms(server.ranges.gain), 200);
  write("gain", String(Math.log10(camera.gain)));
  write("gain-value", String(camera.gain));
  input("gain").setAttribute("aria-valuetext", `factor ${number(camera.gain)}`);

  const { lens } = server;
  setRange("f-number", ...logarithms(F_SLIDER), 150);
  const f_number = camera.f_number ?? lens.f_number;
  write("f-number", String(Math.log10(f_number)));
  write("f-number-value", String(rounded(f_number)));
  input("f-number").setAttribute("aria-valuetext", `f/${number(f_number)}`);
  setRange("glare", 0, GLARE_SLIDER, 100);
  const glare = camera.glare ?? lens.glare;
  write("glare", String(glare));
  write("glare-value", String(rounded(100 * glare)));
  input("glare").setAttribute("aria-valuetext", `${number(100 * glare)} %`);

  const [coldest, hottest] = server.ranges.temperature;
  setRange("temperature", coldest, hottest, hottest - coldest);
  const temperature = camera.temperature ?? sensor?.temperature;
  if (temperature !== undefined) write("temperature", String(temperature));
  write("temperature-value", camera.temperature === null ? "" : String(camera.temperature));
  input("temperature-model").checked = camera.temperature === null;
  write("black-level", camera.black_level === null
    ? String(sensor ? store.frameA?.header.black ?? "" : "")
    : String(camera.black_level));
  input("black-level-model").checked = camera.black_level === null;
  setValue(select("noise"), camera.noise);
  write("device", String(camera.device));
  setValue(select("denoise"), camera.denoise);
  input("vignetting").checked = camera.vignetting;

  for (const id of ["exposure", "exposure-value", "exposure-auto", "gain", "gain-value", "glare", "glare-value",
    "temperature", "temperature-value", "temperature-model", "black-level", "black-level-model", "device"]) {
    input(id).disabled = camera.sensor === null;
  }
  for (const id of ["exposure", "exposure-value", "exposure-auto"]) {
    allow(input(id), server.timed === null ? null : `Fixed, because ${server.timed}. Change it in the job`);
    input(id).disabled ||= camera.sensor === null;
  }
  for (const id of ["f-number", "f-number-value"]) {
    allow(input(id), lens.fixed === null ? null : `Fixed, because ${lens.fixed}. Set it in the job`);
    input(id).disabled ||= camera.sensor === null;
  }
  const isExr = server.source === "exr";
  allow(select("denoise"), isExr ? "An EXR is shown as it is: denoise it by `dunkelfeld denoise`" : null);
  const vignetting = input("vignetting");
  allow(vignetting, isExr ? "The lens is that of the EXR" : null, vignetting.closest("label") ?? vignetting);
  vignetting.disabled ||= camera.sensor === null;
  select("noise").disabled = camera.sensor === null;
  button("device-next").disabled = camera.sensor === null;
  showLights(store);
}

/**
 * @param {Store} store
 * @param {boolean} force
 */
function showExposure(store, force = false) {
  const { camera, server } = store;
  if (!camera || !server) return;
  const seconds = camera.exposure ?? store.frameA?.header.exposure ?? null;
  setRange("exposure", ...logarithms(EXPOSURE_SLIDER), 400);
  const text = seconds === null ? "" : exposure(seconds);
  if (seconds !== null && document.activeElement !== input("exposure")) {
    input("exposure").value = String(Math.log10(seconds));
  }
  if (force) input("exposure-value").value = text;
  else setValue(input("exposure-value"), text);
  input("exposure").setAttribute("aria-valuetext", camera.exposure === null ? `automatic, ${text}` : text);
}

/**
 * @param {[number, number]} range
 * @returns {[number, number]}
 */
function logarithms([low, high]) {
  return [Math.log10(low), Math.log10(high)];
}

/**
 * @param {string} id
 * @param {number} low
 * @param {number} high
 * @param {number} steps
 */
function setRange(id, low, high, steps) {
  const target = input(id);
  if (target.min === String(low) && target.max === String(high)) return;
  target.min = String(low);
  target.max = String(high);
  target.step = String((high - low) / Math.max(1, Math.round(steps)));
}

/**
 * Sliders for the films of the lights. They are made again only when the lights change.
 * @param {Store} store
 */
function showLights(store) {
  const { camera, server } = store;
  const lights = server?.scene?.per_light.on ? server.scene.lights : [];
  show(box("light-factors"), lights.length > 0);
  const list = box("light-factors-list");
  const names = JSON.stringify(lights.map(({ name }) => name));
  if (list.dataset["names"] !== names) {
    list.dataset["names"] = names;
    list.replaceChildren(...lights.map(({ name }, index) => lightRow(store, name, index)));
  }
  lights.forEach(({ name, on }, index) => {
    const factor = camera?.lights?.[name] ?? 1;
    const reason = on ? null : "This light is off, so it has no film: switch it on in the panel Scene";
    for (const id of [`light-factor-${index}`, `light-factor-value-${index}`]) allow(input(id), reason);
    setValue(input(`light-factor-${index}`), String(factor > 0 ? Math.log10(factor) : -LIGHT_RANGE));
    setValue(input(`light-factor-value-${index}`), String(factor));
  });
}

/**
 * @param {Store} store
 * @param {string} name
 * @param {number} index
 */
function lightRow(store, name, index) {
  /** @param {number} factor */
  const change = (factor) => {
    const lights = store.server?.scene?.lights ?? [];
    const all = Object.fromEntries(lights.map((light) => [light.name, store.camera?.lights?.[light.name] ?? 1]));
    store.changeCamera({ lights: { ...all, [name]: factor } });
  };
  const slider = element("input", {
    id: `light-factor-${index}`, type: "range", min: -LIGHT_RANGE, max: LIGHT_RANGE, step: 0.02, value: 0,
    title: "Factor of this light on a logarithmic scale. The render is not started again",
  });
  const value = element("input", {
    id: `light-factor-value-${index}`, type: "number", min: 0, step: "any", class: "number",
    "aria-label": `Factor of the light ${name}`, title: "Factor of this light. 0 switches it off",
  });
  slider.addEventListener("input", () => change(rounded(10 ** Number(slider.value))));
  value.addEventListener("change", () => {
    if (isFactor(value.value)) change(Number(value.value));
    else showKnobs(store, true);
  });
  return element("div", { class: "row" },
    element("label", { for: slider.id, title: name }, name), slider, value);
}

/**
 * The analysis of a picture with matched noise or the denoiser.
 * @type {Record<import("./protocol").FrameHeader["analysis"], (store: Store) => string>}
 */
const ANALYSES = {
  exact: () => "of this picture",
  earlier: () => "of an earlier one",
  none: (store) => store.camera?.denoise === "off" ? "not ready: plain noise" : "not ready: not denoised",
};

/** @param {Store} store */
function showFrame(store) {
  const header = store.frameA?.header;
  if (!header) {
    const ids = ["exposure", "mean", "electrons", "saturated", "matched", "analysis", "compute"];
    for (const id of ids) setText(box(`frame-${id}`), number(null));
    return;
  }
  const sensor = store.sensorOf(store.camera);
  setText(box("frame-exposure"), header.no_light ? "no light in the image"
    : header.exposure === null ? number(null) : exposure(header.exposure));
  // Colour sensors have grey values too; without a sensor, the picture has none.
  setText(box("frame-mean"), sensor ? quantity(header.mean_value, "DN") : number(null));
  setText(box("frame-electrons-name"), sensor && header.mean_electrons > sensor.saturation
    ? "Mean electrons before saturation" : "Mean electrons");
  setText(box("frame-electrons"), quantity(header.mean_electrons, "e⁻"));
  setText(box("frame-saturated"), percent(header.saturated));
  setText(box("frame-matched"), header.matched === null ? number(null) : percent(header.matched));
  const isAnalysed = store.camera?.noise === "matched" || (store.camera !== null && store.camera.denoise !== "off");
  setText(box("frame-analysis"), !isAnalysed ? number(null)
    : ANALYSES[header.analysis](store));
  setText(box("frame-compute"), quantity(header.compute * 1e3, "ms", 2));
  if (store.camera?.black_level === null && store.camera.sensor !== null) {
    setValue(input("black-level"), String(header.black));
  }
}

/**
 * The factors of lights that B has and A has not.
 * @param {Camera} camera
 * @param {Camera} kept
 */
function keptLights(camera, kept) {
  const names = new Set([...Object.keys(camera.lights ?? {}), ...Object.keys(kept.lights ?? {})]);
  const factor = (/** @type {Camera} */ { lights }, /** @type {string} */ name) => lights?.[name] ?? 1;
  return [...names].filter((name) => factor(camera, name) !== factor(kept, name))
    .map((name) => `${name} × ${plain(factor(kept, name))}`).join(", ");
}

/**
 * Lists the settings of B that differ from A.
 * @param {Store} store
 */
function showKept(store) {
  const { camera, kept } = store;
  if (!camera || !kept) {
    setText(box("kept-facts"), number(null));
    return;
  }
  /** @type {Record<keyof Camera, string>} */
  const texts = {
    sensor: store.sensorOf(kept)?.label ?? kept.sensor ?? "no sensor",
    exposure: kept.exposure === null ? "automatic exposure" : exposure(kept.exposure),
    gain: `gain ${number(kept.gain)}`,
    temperature: kept.temperature === null ? "temperature of the model" : `${number(kept.temperature)} °C`,
    black_level: kept.black_level === null ? "black level of the model" : `black level ${kept.black_level}`,
    noise: `noise ${kept.noise}`,
    device: `device ${kept.device}`,
    denoise: `denoiser ${kept.denoise}`,
    f_number: kept.f_number === null ? "f-number of the job" : `f/${number(kept.f_number)}`,
    glare: kept.glare === null ? "glare of the job" : `glare ${percent(kept.glare)}`,
    vignetting: kept.vignetting ? "vignetting" : "no vignetting",
    lights: keptLights(camera, kept),
  };
  const keys = /** @type {(keyof Camera)[]} */ (Object.keys(texts));
  const different = keys.filter((key) => JSON.stringify(camera[key]) !== JSON.stringify(kept[key]));
  const facts = different.map((key) => texts[key]).filter((text) => text !== "");
  setText(box("kept-facts"), facts.length === 0 ? "the same as A" : facts.join(", "));
}
