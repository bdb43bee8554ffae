// The legend of a map: colours, unit, values, opacity.

import { mapScale, paintScale, shareOf, valueAt } from "./colormap.js";
import { box, byId, element, input, select, setText, setValue, show } from "./dom.js";
import { percent, plain } from "./format.js";

/** @typedef {import("./store.js").Store} Store */

const TITLES = {
  ratio: "Ratio k: render σ / camera σ",
  samples: "Samples in a pixel",
  recent: "Samples since the last picture",
  first_light: "Share of first light",
  render_sigma: "Render σ",
  camera_sigma: "Camera σ",
};

/**
 * @param {Store} store
 * @param {import("./pictures.js").Pictures} pictures
 * @param {() => void} redraw
 */
export function legend(store, pictures, redraw) {
  let target = 0;
  store.on("map", () => showLegend(store));
  store.on("view", () => showTitle(store));
  store.on("state", () => {
    // A new target moves the boundary of the ratio, without a request.
    if (store.server && store.server.target !== target) {
      target = store.server.target;
      if (store.map === "ratio") pictures.paintMap();
    }
  });
  input("map-opacity").addEventListener("input", () => {
    store.mapOpacity = Number(input("map-opacity").value);
    redraw();
  });
  select("map-colours").addEventListener("change", () => {
    store.mapColours = select("map-colours").value === "cividis" ? "cividis" : "viridis";
    pictures.paintMap();
  });
}

/**
 * Steps of the opacity by key.
 * @param {Store} store
 * @param {() => void} redraw
 */
export function stepOpacity(store, redraw) {
  store.mapOpacity = store.mapOpacity > 0.75 ? 0.6 : store.mapOpacity > 0.45 ? 0.3 : 1;
  setValue(input("map-opacity"), String(store.mapOpacity));
  redraw();
}

/** @param {Store} store */
function showLegend(store) {
  const { map, filmMap } = store;
  show(box("legend"), map !== "none");
  if (map === "none") return;
  showTitle(store);
  select("map-colours").disabled = map === "ratio";
  if (!filmMap) {
    setText(box("legend-note"), "Waiting for the map.");
    box("legend-ticks").replaceChildren();
    return;
  }
  const target = store.server?.target ?? 0.5;
  const scale = mapScale(map, filmMap.header, target, store.mapColours);
  paintScale(scale, byId("legend-bar", HTMLCanvasElement));
  const all = [0, 0.25, 0.5, 0.75, 1].map((share) => valueAt(scale, share));
  // A map of one value has one tick.
  const values = new Set(all.map((value) => plain(value, 3))).size > 1 ? all : all.slice(0, 1);
  box("legend-ticks").replaceChildren(...values.map((value) => {
    const middle = map === "ratio" && value === values[2];
    const tick = element("span", middle ? { class: "target" } : {},
      `${plain(value, 3)}${middle ? " target" : ""}`);
    tick.style.top = `${(1 - shareOf(scale, value)) * 100}%`;
    return tick;
  }));
  setText(box("legend-note"), noteOf(map, filmMap.values, target));
}

/** @param {Store} store */
function showTitle({ map, filmMap, compare }) {
  if (map === "none") return;
  const unit = filmMap?.header.unit ?? "";
  const hasUnit = unit !== "" && unit !== "1" && !TITLES[map].toLowerCase().includes(unit.toLowerCase());
  // The picture B has no map.
  setText(box("legend-title"), `${TITLES[map]}${hasUnit ? ` [${unit}]` : ""}${compare ? ", of A" : ""}`);
}

/**
 * @param {string} map
 * @param {Float32Array} values
 * @param {number} target
 */
function noteOf(map, values, target) {
  let known = 0;
  let leftOut = 0;
  let hidden = 0;
  for (const value of values) {
    if (Number.isNaN(value)) leftOut += 1;
    if (!Number.isFinite(value)) continue;
    known += 1;
    if (value <= target) hidden += 1;
  }
  const share = (/** @type {number} */ pixels) => percent(pixels / values.length);
  if (map !== "ratio") return known < values.length ? `No colour: unknown (${share(values.length - known)}).` : "";
  // As in the certificate: saturated pixels do not count, and pixels of unknown noise are above the target.
  const counted = values.length - leftOut;
  const rest = [
    ...(leftOut > 0 ? [`saturated (${share(leftOut)})`] : []),
    ...(counted > known ? [`unknown (${share(counted - known)})`] : []),
  ].join(", ");
  return `${percent(counted > 0 ? hidden / counted : 1)} at or below the target.${rest ? ` No colour: ${rest}.` : ""}`;
}
