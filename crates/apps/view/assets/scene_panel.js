// The settings of the scene: each change starts the render again.

import { allow, box, element, input, select, setOptions, setText, setValue, show } from "./dom.js";
import { bytes, fromHex, number, toHex } from "./format.js";
import { Debounce } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").Scene} Scene */
/** @typedef {import("./protocol").SceneChange} SceneChange */

const DELAY = 400; // ms without a further change before the render starts again
const HOLD = 1500; // ms in which states from before a change must not move the controls back
const FILTER_FROM = 8; // materials from which a filter helps
const LARGEST_FACTOR = 1e6; // of the power of a light
const NO_POWER = "This light comes from infinitely far away, and has no power: change it in the job";
const NO_SWITCH = "The environment has no switch: write `radiance = 0` or `scale = 0` in [environment] of the job";

// Short explanations; docs/effects.md has the whole ones.
const EFFECTS = new Map([
  ["textures", "Images on surfaces. Without them, each texture is its mean"],
  ["vertex-colors", "Colours of the vertices of a mesh. Without them, white"],
  ["normal-maps", "Directions of a surface from an image. Without them, the surface's own normals"],
  ["smooth-normals", "Normals between the vertices of a mesh. Without them, flat triangles"],
  ["coverage", "Surfaces that are cut out, or exist with some probability. Without it, they are opaque"],
  ["thin-sheets", "Clear sheets without thickness. Without it, light passes straight and without reflection"],
  ["diffuse-transmission", "Light that is scattered through a surface. Without it, it is scattered back"],
  ["smooth-refraction", "Clear solids with a smooth surface. Without it, light passes straight"],
  ["rough-refraction", "Clear solids with a rough surface. Without it, light passes straight"],
  ["nesting", "Solids that touch, overlap or lie in one another. It cannot be left out"],
  ["absorption", "Solids that absorb light"],
  ["scattering", "Solids that scatter light inside"],
  ["anisotropy", "Highlights that are stretched along a direction. Without it, they are round"],
  ["sheen", "The sheen of cloth"],
  ["clearcoat", "Clear coats over a material"],
  ["energy-compensation", "Light that is reflected several times between the facets of a rough surface"],
  ["finite-aperture", "Depth of field: a lens with a finite aperture. Without it, a pinhole"],
  ["distortion", "Lenses that distort. Without it, an ideal image"],
  ["motion", "Objects that move during the exposure. Without it, they are at rest"],
  ["line-scan", "Rows that are exposed one after the other. Without it, all at once"],
  ["environment", "Light from all directions, from infinitely far away. Without it, dark"],
  ["punctual-lights", "Lights without extent: points, spots and suns. Without it, dark"],
  ["light-profiles", "Lights with a measured profile (IES). Without it, dark"],
  ["emission-profiles", "Lamps that emit more in some directions. Without it, the same power in all directions"],
  ["many-lights", "A tree that chooses among more than 64 lights. It cannot be left out"],
  ["color", "Surfaces or lights that are not grey. It cannot be left out"],
  ["every-light", "A technique that changes the noise only: each surface takes a sample of each light. Without it, one light at a time, by its estimated contribution"],
  ["cover-connection", "A technique that changes the noise only: light behind clear covers is connected to directly. Without it, paths find it by chance"],
  ["learned-roulette", "A technique that changes the noise only: training paths learn which paths are worth continuing. Without it, their throughput decides"],
]);

/**
 * True for an effect that the user can switch: one of the scene, or one that is left out.
 * @param {import("./protocol").Effect} effect
 */
function isChoice(effect) {
  return effect.used || effect.left_out;
}

/**
 * The entries of a part of the scene that differ from those before the changes of the user. Another page may change other
 * entries at the same moment, and values that nobody changed follow the files of the scene.
 * @template {{ name: string }} T
 * @param {T[]} parts
 * @param {T[]} before
 * @param {(keyof T)[]} keys
 * @returns {Map<string, Partial<T>>}
 */
function differences(parts, before, keys) {
  /** @type {Map<string, Partial<T>>} */
  const found = new Map();
  for (const part of parts) {
    const old = before.find(({ name }) => name === part.name);
    const moved = keys.filter((key) => JSON.stringify(part[key]) !== JSON.stringify(old?.[key]));
    if (moved.length > 0) found.set(part.name, /** @type {Partial<T>} */ (Object.fromEntries(moved.map((key) => [key, part[key]]))));
  }
  return found;
}

/**
 * The request for the changes of the user: it contains what they change, and nothing if the knobs are where they were.
 * @param {Scene} scene
 * @param {Scene} base the scene before them
 * @param {ReadonlySet<keyof SceneChange>} keys
 * @returns {SceneChange}
 */
function changeOf(scene, base, keys) {
  /** @type {SceneChange} */
  const change = {};
  if (keys.has("camera") && scene.camera !== base.camera) change.camera = scene.camera;
  const lights = differences(scene.lights, base.lights, ["on", "factor"]);
  if (keys.has("lights") && lights.size > 0) {
    change.lights = Object.fromEntries(scene.lights
      .filter(({ name }) => lights.has(name)).map(({ name, on, factor }) => [name, { on, factor }]));
  }
  const materials = differences(scene.materials, base.materials, ["roughness", "metallic", "color"]);
  if (keys.has("materials") && materials.size > 0) {
    change.materials = /** @type {SceneChange["materials"]} */ (Object.fromEntries(materials));
  }
  const effects = differences(scene.effects, base.effects, ["left_out"]);
  if (keys.has("effects") && effects.size > 0) {
    change.effects = Object.fromEntries([...effects].map(([name, { left_out }]) => [name, !left_out]));
  }
  if (keys.has("per_light") && scene.per_light.on !== base.per_light.on) change.per_light = scene.per_light.on;
  return change;
}

export class ScenePanel {
  /**
   * The state that the user wants. It follows the server while no change waits.
   * @type {Scene | null}
   */
  #scene = null;
  /**
   * The state before the changes of the user.
   * @type {Scene | null}
   */
  #base = null;
  /**
   * Keys of the contract that changed.
   * @type {Set<keyof SceneChange>}
   */
  #changed = new Set();
  #heldUntil = 0;
  #send = new Debounce(DELAY, () => void this.#sendChange());
  #shape = "";

  /**
   * @param {Store} store
   * @param {(path: string, body: unknown) => Promise<boolean>} act
   * @param {import("./problems.js").Problems} problems
   */
  constructor(store, act, problems) {
    this.store = store;
    this.act = act;
    this.problems = problems;
    store.on("session", () => {
      // A change for an earlier server means nothing to this one.
      this.#heldUntil = 0;
      problems.clear("scene-number");
    });
    store.on("state", () => this.show());
    select("scene-camera").addEventListener("change", () => {
      this.#change("camera", (scene) => {
        scene.camera = select("scene-camera").value;
      });
    });
    input("per-light").addEventListener("change", () => {
      this.#change("per_light", (scene) => {
        scene.per_light.on = input("per-light").checked;
      });
    });
    input("material-filter").addEventListener("input", () => this.#filter());
  }

  /**
   * @param {keyof SceneChange} key
   * @param {(scene: Scene) => void} edit
   */
  #change(key, edit) {
    if (!this.#scene) return;
    // A message about a text is outdated when a knob has moved.
    this.problems.clear("scene-number");
    edit(this.#scene);
    this.#changed.add(key);
    this.#send.call();
  }

  async #sendChange() {
    const { scene, base, changed } = { scene: this.#scene, base: this.#base, changed: this.#changed };
    if (!scene || !base) return;
    const change = changeOf(scene, base, changed);
    changed.clear();
    if (Object.keys(change).length === 0) {
      // The knobs are where they were.
      this.show();
      return;
    }
    this.#base = structuredClone(scene);
    this.#heldUntil = Infinity;
    const accepted = await this.act("/api/scene", change);
    // A refused change is taken back at once: the controls show the state of the server again.
    this.#heldUntil = accepted ? performance.now() + HOLD : 0;
    this.show();
  }

  show() {
    const state = this.store.server;
    if (!state) return;
    show(box("scene-none"), state.scene === null);
    setText(box("scene-none"), state.source !== "render"
      ? "Nothing renders here: the file contains finished samples. So the scene cannot change."
      : state.error ? "The scene was not loaded: the message over the image states the reason."
        : "The scene is being loaded.");
    show(box("scene-knobs"), state.scene !== null);
    const times = state.render.restarted;
    setText(box("scene-restarts"), `Started again ${times} ${times === 1 ? "time" : "times"}.`);
    if (!state.scene) return;
    const held = this.#send.waiting || performance.now() < this.#heldUntil;
    const scene = held && this.#scene ? this.#scene : structuredClone(state.scene);
    if (scene !== this.#scene) this.#base = state.scene;
    this.#scene = scene;
    this.#write(scene);
  }

  /** @param {Scene} scene */
  #write(scene) {
    const shape = JSON.stringify([
      scene.lights.map(({ name }) => name),
      scene.materials.map(({ name, roughness, metallic, color }) => [name, roughness === null, metallic === null, color === null]),
      scene.effects.map((effect) => [effect.name, effect.title, isChoice(effect)]),
    ]);
    if (shape !== this.#shape) {
      this.#shape = shape;
      this.#build(scene);
    }
    setOptions(select("scene-camera"), scene.cameras.map((name) => ({ value: name, text: name })));
    setValue(select("scene-camera"), scene.camera);
    scene.lights.forEach((light, index) => {
      const on = input(`light-on-${index}`);
      on.checked = light.on;
      allow(on, light.has_switch === false ? NO_SWITCH : null, on.closest("label") ?? on);
      for (const id of [`light-power-${index}`, `light-power-${index}-value`]) {
        allow(input(id), light.has_power === false ? NO_POWER : null);
      }
      // The text of the power may follow the factor, so it must not build the list again.
      setText(box(`light-facts-${index}`), `${light.kind}, ${light.power}`);
      this.#writePair(`light-power-${index}`, light.factor > 0 ? Math.log10(light.factor) : -2, light.factor);
    });
    input("per-light").checked = scene.per_light.on;
    const { bytes: memory, lights } = scene.per_light;
    setText(box("per-light-memory"),
      `It needs ${bytes(memory)} of memory for ${lights} ${lights === 1 ? "light" : "lights"}, and it starts the render again.`);
    scene.materials.forEach((material, index) => this.#writeMaterial(material, index));
    scene.effects.forEach((effect, index) => {
      input(`effect-${index}`).checked = !effect.left_out;
      input(`effect-${index}`).disabled = !effect.used && !effect.left_out;
    });
  }

  /**
   * A slider with a number beside it.
   * @param {string} id
   * @param {number} place
   * @param {number} value
   */
  #writePair(id, place, value) {
    if (document.activeElement?.id !== id) setValue(input(id), String(place));
    setValue(input(`${id}-value`), String(value));
  }

  /**
   * @param {import("./protocol").Material} material
   * @param {number} index
   */
  #writeMaterial({ roughness, metallic, color }, index) {
    if (roughness !== null) this.#writePair(`material-roughness-${index}`, roughness, roughness);
    if (metallic !== null) this.#writePair(`material-metallic-${index}`, metallic, metallic);
    if (color === null) return;
    setValue(input(`material-colour-${index}`), toHex(color));
    box(`material-chip-${index}`).style.background = toHex(color);
    setText(box(`material-linear-${index}`), color.map((value) => number(value, 2)).join(", "));
  }

  /** @param {Scene} scene */
  #build(scene) {
    box("lights").replaceChildren(...scene.lights.map((light, index) => this.#lightItem(light, index)));
    box("materials").replaceChildren(...scene.materials.map((material, index) => this.#materialItem(material, index)));
    this.#buildEffects(scene);
    show(input("material-filter"), scene.materials.length >= FILTER_FROM);
    this.#filter();
  }

  /**
   * @param {import("./protocol").Light} light
   * @param {number} index
   */
  #lightItem(light, index) {
    const on = element("input", { type: "checkbox", id: `light-on-${index}` });
    on.addEventListener("change", () => this.#change("lights", (scene) => {
      const found = scene.lights[index];
      if (found) found.on = on.checked;
    }));
    return element("div", { class: "item" },
      element("div", { class: "head" },
        element("label", { class: "check", title: `Switches the light ${light.name} on or off. The render starts again` },
          on, light.name),
        element("span", { class: "facts number", id: `light-facts-${index}` })),
      ...this.#pair({
        id: `light-power-${index}`, label: "Power ×", name: light.name, low: -2, high: 2, log: true,
        title: "Factor of the power of this light on a logarithmic scale. The render starts again",
        get: () => this.#scene?.lights[index]?.factor,
        set: (value) => this.#change("lights", (scene) => {
          const found = scene.lights[index];
          if (found) found.factor = value;
        }),
      }));
  }

  /**
   * @param {import("./protocol").Material} material
   * @param {number} index
   */
  #materialItem(material, index) {
    const item = element("details", { class: "item", "data-name": material.name.toLowerCase() },
      element("summary", { title: "Shows the values of this material" }, material.name,
        ...(material.color ? [element("span", { class: "chip", id: `material-chip-${index}` })] : [])));
    /**
     * @param {"roughness" | "metallic"} key
     * @param {string} label
     * @param {string} title
     */
    const slider = (key, label, title) => {
      if (material[key] === null) return;
      item.append(...this.#pair({
        id: `material-${key}-${index}`, label, name: material.name, low: 0, high: 1, log: false, title,
        get: () => this.#scene?.materials[index]?.[key],
        set: (value) => this.#change("materials", (scene) => {
          const found = scene.materials[index];
          if (!found) return;
          found[key] = value;
        }),
      }));
    };
    slider("roughness", "Roughness", "0 is a mirror, 1 is matt. The render starts again");
    slider("metallic", "Metallic", "0 is a dielectric, 1 is a metal. The render starts again");
    if (material.color) item.append(this.#colourRow(material.name, index));
    if (material.roughness === null && material.metallic === null && material.color === null) {
      item.append(element("p", { class: "facts" }, "Textures set all values of this material."));
    }
    return item;
  }

  /**
   * @param {string} name
   * @param {number} index
   */
  #colourRow(name, index) {
    const colour = element("input", {
      type: "color", id: `material-colour-${index}`, "aria-label": `Colour of ${name}`,
      title: "Base colour. The render starts again",
    });
    colour.addEventListener("input", () => this.#change("materials", (scene) => {
      const found = scene.materials[index];
      if (!found) return;
      const color = fromHex(colour.value);
      found.color = color;
      this.#writeMaterial(found, index);
    }));
    return element("div", { class: "row colour" },
      element("label", { for: colour.id }, "Colour"), colour,
      element("span", { class: "facts number", id: `material-linear-${index}`, title: "Linear red, green and blue" }));
  }

  /**
   * @param {import("./protocol").Effect} effect
   * @param {number} index
   */
  #effectItem(effect, index) {
    const on = element("input", { type: "checkbox", id: `effect-${index}`, "data-effect": effect.name });
    on.addEventListener("change", () => this.#change("effects", (scene) => {
      const found = scene.effects[index];
      if (found) found.left_out = !on.checked;
    }));
    return element("label", {
      class: "check", title: `${EFFECTS.get(effect.name) ?? effect.title}. ${isChoice(effect)
        ? "Without a tick, the render leaves it out and starts again" : "The scene does not use it"}`,
    }, on, effect.title);
  }

  /**
   * The effects of the scene, and the others behind a fold. Their ids have the order of the state.
   * @param {Scene} scene
   */
  #buildEffects(scene) {
    const all = scene.effects.map((effect, index) => ({ effect, item: this.#effectItem(effect, index) }));
    const items = (/** @type {boolean} */ used) => all.filter(({ effect }) => isChoice(effect) === used).map(({ item }) => item);
    const unused = items(false);
    const isOpen = document.querySelector("#effects-unused[open]") !== null;
    box("effects").replaceChildren(...items(true), ...(unused.length > 0 ? [element("details",
      { class: "item", id: "effects-unused", open: isOpen },
      element("summary", { title: "Shows the effects that the program knows and the scene does not use" },
        `${unused.length} ${unused.length === 1 ? "effect" : "effects"} that the scene does not use`),
      ...unused)] : []));
  }

  /**
   * @param {{ id: string, label: string, name: string, low: number, high: number, log: boolean,
   *   title: string, get: () => number | null | undefined, set: (value: number) => void }} options
   * @returns {HTMLElement[]}
   */
  #pair({ id, label, name, low, high, log, title, get, set }) {
    const slider = element("input", { id, type: "range", min: low, max: high, step: (high - low) / 200, title });
    const value = element("input", {
      id: `${id}-value`, type: "number", step: "any", min: 0, class: "number", title,
      "aria-label": `${label} of ${name}`,
    });
    slider.addEventListener("input", () => {
      const next = Number((log ? 10 ** Number(slider.value) : Number(slider.value)).toPrecision(3));
      value.value = String(next);
      set(next);
    });
    value.addEventListener("change", () => {
      const next = Number(value.value);
      const largest = log ? LARGEST_FACTOR : high;
      if (value.value === "" || !(next >= 0 && next <= largest)) {
        this.problems.setText("scene-number", {
          problem: `${label.replace(" ×", "")} of ${name}: ${value.value === "" ? "this is not a number" : `${value.value} is out of range`}.`,
          place: null, help: `Type 0 to ${largest}.`,
        });
        // Also while the field has the focus.
        value.value = String(get() ?? "");
        return;
      }
      slider.value = String(log ? Math.log10(Math.max(next, 1e-9)) : next);
      set(next);
    });
    return [element("div", { class: "row" }, element("label", { for: id }, label), slider, value)];
  }

  #filter() {
    const text = input("material-filter").value.trim().toLowerCase();
    for (const item of box("materials").children) {
      if (item instanceof HTMLElement) show(item, (item.dataset["name"] ?? "").includes(text));
    }
  }
}
