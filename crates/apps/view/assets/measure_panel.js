// The measurements: regions, line profile, light path and photon transfer.

import { drawPlot, rangeOf } from "./chart.js";
import { box, button, byId, element, input, select, setText, setValue, show, svg } from "./dom.js";
import { count, fourNumbers, number, percent, plain, quantity } from "./format.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./measurements.js").Measurements} Measurements */

const WIDTH = 352;
const LOW = 150; // heights of the plots
const HIGH = 170;

/** @param {number} value */
const grey = (value) => plain(value, 5);

/**
 * @param {Store} store
 * @param {Measurements} measurements
 * @param {import("./problems.js").Problems} problems
 */
export function measurePanel(store, measurements, problems) {
  followTexts(store, problems);
  input("histogram-log").addEventListener("change", () => drawHistogram(measurements));
  input("transfer-on").addEventListener("change", () => {
    measurements.wantTransfer(input("transfer-on").checked);
  });
  select("measure-channel").addEventListener("change", () => {
    store.setChannel(/** @type {import("./protocol").Channel} */ (select("measure-channel").value));
  });
  store.on(["camera", "state"], () => show(box("measure-channel-row"), store.measuredChannel !== null));
  const update = () => {
    showShapes(store);
    showRegions(measurements);
    showPath(store);
    // A hidden plot is drawn when its panel is shown.
    if (box("panel-measure").hidden) return;
    drawHistogram(measurements);
    drawProfile(measurements);
    drawTransfer(measurements);
  };
  store.on(["shapes", "measures"], update);
  store.on("path", () => showPath(store));
  update();
  return update;
}

/**
 * Texts with coordinates: the way to a region or a line without a pointer. A text that is none is taken back with a message.
 * @param {Store} store
 * @param {import("./problems.js").Problems} problems
 */
function followTexts(store, problems) {
  /**
   * @param {string} id
   * @param {string} help
   * @param {(corners: [number, number, number, number] | null) => string | null} change the problem, if it is refused
   */
  const field = (id, help, change) => {
    input(id).addEventListener("change", () => {
      const text = input(id).value.trim();
      const corners = fourNumbers(text);
      const problem = text === "" || corners ? change(corners) : `"${text}" is not four whole numbers.`;
      problems.setText(id, problem === null ? null : { problem, place: null, help });
      if (problem !== null) showShapes(store, true);
    });
  };
  const size = () => `${store.server?.width ?? 0} x ${store.server?.height ?? 0} pixels`;
  for (const index of /** @type {const} */ ([0, 1])) {
    const id = `region${index + 1}`;
    const help = `Type left, top, right and bottom of region ${index + 1}, for example 10 10 60 60. The last two are exclusive.`;
    field(id, help, (corners) => {
      if (corners) {
        const [x0, y0, x1, y1] = corners;
        if (x0 >= x1 || y0 >= y1) return `Region ${index + 1} contains no pixel.`;
        if (!isInside(store, x0, y0) || !isInside(store, x1 - 1, y1 - 1)) {
          return `Region ${index + 1} is not inside of the image of ${size()}.`;
        }
      }
      store.setRegion(index, corners);
      return null;
    });
    button(`${id}-clear`).addEventListener("click", () => store.setRegion(index, null));
  }
  field("line", "Type the first and the last pixel of the line, for example 10 10 60 60.", (corners) => {
    if (!corners) {
      store.setLine(null);
      return null;
    }
    const [x0, y0, x1, y1] = corners;
    if (!isInside(store, x0, y0) || !isInside(store, x1, y1)) return `The line is not inside of the image of ${size()}.`;
    store.setLine({ from: { x: x0, y: y0 }, to: { x: x1, y: y1 } });
    return null;
  });
  button("line-clear").addEventListener("click", () => store.setLine(null));
  // A shape that is drawn, removed or typed without a fault takes the messages along.
  store.on("shapes", () => ["region1", "region2", "line"].forEach((id) => problems.clear(id)));
}

/**
 * @param {Store} store
 * @param {number} x
 * @param {number} y
 */
function isInside(store, x, y) {
  const pixel = store.clamp({ x, y });
  return pixel.x === x && pixel.y === y;
}

/**
 * @param {Store} store
 * @param {boolean} force
 */
function showShapes(store, force = false) {
  /**
   * @param {string} id
   * @param {string} value
   */
  const write = (id, value) => {
    if (force) input(id).value = value;
    else setValue(input(id), value);
  };
  store.regions.forEach((region, index) => write(`region${index + 1}`, region?.join(" ") ?? ""));
  const { line } = store;
  write("line", line ? `${line.from.x} ${line.from.y} ${line.to.x} ${line.to.y}` : "");
}

/** @param {Measurements} measurements */
function showRegions(measurements) {
  const { regions, regionIndices } = measurements;
  for (const index of [0, 1]) {
    const place = regionIndices.indexOf(index);
    const region = place >= 0 ? regions?.regions[place] : undefined;
    /**
     * @param {string} name
     * @param {string} text
     */
    const cell = (name, text) => setText(box(`region${index + 1}-${name}`), text);
    cell("pixels", count(region?.pixels));
    cell("mean", number(region?.mean, 5));
    cell("variance", number(region?.variance, 4));
    cell("span", region ? `${grey(region.min)}, ${grey(region.max)}` : number(null));
    cell("snr", number(region?.snr, 4));
    cell("saturated", percent(region?.saturated));
  }
  setText(box("contrast"), quantity(regions?.contrast, "DN", 4));
  setText(box("cnr"), number(regions?.cnr, 4));
}

/**
 * A plot without data states the way to get some.
 * @param {SVGSVGElement} target
 * @param {number} height
 * @param {string} text
 */
function drawEmpty(target, height, text) {
  target.setAttribute("viewBox", `0 0 ${WIDTH} ${height}`);
  target.setAttribute("aria-label", text);
  target.replaceChildren(
    svg("rect", { class: "frame", x: 0.5, y: 0.5, width: WIDTH - 1, height: height - 1 }),
    svg("text", { class: "empty", x: WIDTH / 2, y: height / 2, "text-anchor": "middle" }, text),
  );
}

/** @param {Measurements} measurements */
function drawHistogram(measurements) {
  const target = byId("histogram", SVGSVGElement);
  const { regions, regionIndices } = measurements;
  if (!regions || regions.regions.length === 0) {
    drawEmpty(target, LOW, "Draw a region on the image, or type its corners.");
    return;
  }
  const edges = regions.regions.flatMap(({ histogram: { low, width, counts } }) => [low, low + width * counts.length]);
  // Regions of different size are compared by the share of their pixels.
  const shares = regions.regions.map(({ histogram, pixels }) => histogram.counts.map((n) => (100 * n) / Math.max(1, pixels)));
  const [low, high] = rangeOf(edges, 0.02);
  const log = input("histogram-log").checked;
  const least = Math.min(100, ...shares.flat().filter((share) => share > 0));
  drawPlot(target, {
    width: WIDTH, height: LOW,
    x: { low, high, log: false, label: "grey value [DN]", format: grey },
    y: { low: log ? least / 2 : 0, high: Math.max(1e-6, ...shares.flat()) * 1.08, log, label: "% of the pixels per bin", format: (v) => plain(v, 2) },
    series: regions.regions.map(({ histogram }, place) => ({
      kind: /** @type {const} */ ("bars"), style: `bars${(regionIndices[place] ?? 0) + 1}`,
      x: histogram.counts.map((_, index) => histogram.low + index * histogram.width),
      y: shares[place] ?? [],
    })),
    summary: regions.regions.map((region, place) =>
      `Region ${(regionIndices[place] ?? 0) + 1}: mean ${number(region.mean)} DN, variance ${number(region.variance)}.`).join(" "),
  });
}

/** @param {Measurements} measurements */
function drawProfile(measurements) {
  const target = byId("profile", SVGSVGElement);
  const { line } = measurements;
  if (!line || line.values.length === 0) {
    drawEmpty(target, HIGH, "Draw a line on the image, or type its ends.");
    return;
  }
  const { values, expected, sigma, length } = line;
  const step = values.length > 1 ? length / (values.length - 1) : 1;
  const x = values.map((_, index) => index * step);
  const bottom = expected.map((value, index) => value - (sigma[index] ?? 0));
  const top = expected.map((value, index) => value + (sigma[index] ?? 0));
  const [low, high] = rangeOf([...values, ...bottom, ...top]);
  drawPlot(target, {
    width: WIDTH, height: HIGH,
    x: { low: 0, high: Math.max(1, (values.length - 1) * step), log: false, label: "distance [pixels]", format: grey },
    y: { low, high, log: false, label: "grey value [DN]", format: grey },
    series: [
      { kind: "band", style: "band", x, y: bottom, top },
      { kind: "line", style: "value", x, y: values },
      { kind: "line", style: "expected", x, y: expected },
    ],
    summary: `Grey values along ${number(length)} pixels, from ${number(Math.min(...values))} to ${number(Math.max(...values))} DN.`,
  });
}

/** @param {Measurements} measurements */
function drawTransfer(measurements) {
  const target = byId("transfer", SVGSVGElement);
  const { transfer } = measurements;
  setText(box("transfer-gain"), quantity(transfer?.gain, "DN/e⁻", 4));
  setText(box("transfer-slope"), quantity(transfer?.line.slope, "DN/e⁻", 4));
  setText(box("transfer-dark"), quantity(transfer?.dark, "DN", 4));
  if (!transfer || transfer.points.length === 0) {
    drawEmpty(target, HIGH, transfer ? "The picture has no regions for it." : "Not computed yet.");
    return;
  }
  const means = transfer.points.map(({ mean }) => mean);
  const variances = transfer.points.map(({ variance }) => variance);
  const [, right] = rangeOf([0, ...means]);
  const [, top] = rangeOf([0, ...variances]);
  const { slope, offset } = transfer.line;
  // The line of the model has the slope K and passes through the dark signal.
  const dark = offset + slope * transfer.dark;
  const ends = [Math.max(0, transfer.dark), right];
  drawPlot(target, {
    width: WIDTH, height: HIGH,
    x: { low: 0, high: right, log: false, label: "mean [DN]", format: grey },
    y: { low: 0, high: top, log: false, label: "variance [DN²]", format: grey },
    series: [
      { kind: "points", style: "point", x: means, y: variances },
      { kind: "line", style: "model", x: ends, y: ends.map((mean) => dark + transfer.gain * (mean - transfer.dark)) },
    ],
    summary: `Photon transfer: slope ${number(slope, 4)}, model ${number(transfer.gain, 4)} DN per electron.`,
  });
}

/** @param {Store} store */
function showPath(store) {
  const path = store.showPath ? store.path : null;
  setText(box("path-facts"), path
    ? `Sample ${count(path.index)}, luminance ${number(path.luminance)}, ${path.vertices.length} vertices.`
    : store.showPath ? "Move the cursor to a pixel, or pin one." : "Switch on the tool Path and pin a pixel.");
  box("path-list").replaceChildren(...(path?.vertices ?? []).map(({ x, before, event, object }, index) =>
    element("li", {}, `${event}${object ? `: ${object}` : ""}${before !== null && before + 1 < index ? ` (from ${before})` : ""}${x === null ? " (behind the camera)" : ""}`)));
}
