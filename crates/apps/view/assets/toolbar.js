// The tools above the image and the tabs of the panels.

import { allow, box, button, press, select, setText, setValue, show } from "./dom.js";
import { number } from "./format.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./store.js").Tool} Tool */
/** @typedef {import("./viewer.js").Viewer} Viewer */

/** @type {Tool[]} */
const TOOLS = ["move", "region1", "region2", "line"];
export const TABS = ["camera", "scene", "noise", "measure", "save"];

/**
 * @param {Store} store
 * @param {Viewer} viewer
 */
export function toolbar(store, viewer) {
  for (const tool of TOOLS) button(`tool-${tool}`).addEventListener("click", () => store.setTool(tool));
  store.on("tool", () => {
    for (const tool of TOOLS) press(button(`tool-${tool}`), store.tool === tool);
    viewer.canvas.dataset["tool"] = store.tool;
  });
  button("path").addEventListener("click", () => togglePath(store));
  store.on("path", () => press(button("path"), store.showPath));

  button("zoom-in").addEventListener("click", () => viewer.zoomStep(1));
  button("zoom-out").addEventListener("click", () => viewer.zoomStep(-1));
  button("fit").addEventListener("click", () => viewer.fit());
  button("one-to-one").addEventListener("click", () => viewer.zoomTo(1));
  // Without a picture there is nothing whose scale could be stated.
  viewer.onView = () => setText(box("zoom"), viewer.pictureA
    ? `${number(viewer.scale * 100, viewer.scale < 10 ? 3 : 4)} %` : number(null));

  select("tone").addEventListener("change", () => store.setTone(toneOf(select("tone").value)));
  select("map").addEventListener("change", () => {
    store.setMap(/** @type {import("./protocol").MapName | "none"} */ (select("map").value));
  });
  store.on("mapChoice", () => setValue(select("map"), store.map));
  store.on("state", () => allowMaps(store));

  button("compare").addEventListener("click", () => store.setCompare(!store.compare));
  button("keep").addEventListener("click", () => store.keep());
  button("swap").addEventListener("click", () => store.swap());
  button("live").addEventListener("click", () => store.setLive(!store.live));
  button("next-frame").addEventListener("click", () => store.stepFrame());
  const showView = () => {
    press(button("compare"), store.compare);
    button("swap").disabled = store.kept === null;
    press(button("live"), store.live);
    setValue(select("tone"), store.tone);
    showRate(store);
  };
  store.on(["view", "kept"], showView);
  store.on("picture", () => showRate(store));
  showView();
}

/**
 * Disables the maps that an EXR cannot show.
 * @param {Store} store
 */
function allowMaps(store) {
  const isExr = store.server?.source === "exr";
  const samples = isExr && !store.server?.film?.samples ? "This EXR has no samples" : null;
  const reasons = { samples, recent: samples, first_light: isExr ? "An EXR is shown without the parts of its light" : null };
  for (const [map, reason] of Object.entries(reasons)) {
    const option = select("map").querySelector(`option[value=${map}]`);
    if (option instanceof HTMLOptionElement) allow(option, reason);
    if (reason !== null && store.map === map) store.setMap("none");
  }
}

/** @param {Store} store */
function showRate(store) {
  setText(box("frame-rate"), store.live
    ? `${store.framesPerSecond.toFixed(1)} frames/s` : `frame ${store.frameNumber}`);
}

/**
 * @param {string} value
 * @returns {import("./protocol").Tone}
 */
function toneOf(value) {
  return value === "linear" || value === "log" ? value : "gamma";
}

/** @param {Store} store */
export function nextTone(store) {
  store.setTone(store.tone === "gamma" ? "linear" : store.tone === "linear" ? "log" : "gamma");
}

/**
 * @param {Store} store
 * @param {1 | -1} direction
 */
export function stepMap(store, direction) {
  const names = [...select("map").options].map((option) => option.value);
  const place = names.indexOf(store.map);
  const next = names[(place + direction + names.length) % names.length] ?? "none";
  store.setMap(/** @type {import("./protocol").MapName | "none"} */ (next));
}

/** @param {Store} store */
export function togglePath(store) {
  store.showPath = !store.showPath;
  if (!store.showPath) store.path = null;
  store.emit("path");
}

/**
 * @param {(tab: string) => void} onShow
 * @returns {(tab: string, focus?: boolean) => void}
 */
export function tabs(onShow) {
  /**
   * @param {string} tab
   * @param {boolean} focus
   */
  const choose = (tab, focus = false) => {
    for (const name of TABS) {
      const chosen = name === tab;
      const head = button(`tab-${name}`);
      head.setAttribute("aria-selected", String(chosen));
      // Only the chosen tab is in the order of the Tab key; arrows reach the others.
      head.tabIndex = chosen ? 0 : -1;
      show(box(`panel-${name}`), chosen);
      if (chosen && focus) head.focus();
    }
    onShow(tab);
  };
  TABS.forEach((name, index) => {
    const head = button(`tab-${name}`);
    head.addEventListener("click", () => choose(name));
    head.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      choose(TABS[(index + step + TABS.length) % TABS.length] ?? name, true);
    });
  });
  choose("camera");
  return choose;
}
