// Plots as SVG: axes, ticks, lines, bands, bars, points.

import { svg } from "./dom.js";

/**
 * @typedef {{ low: number, high: number, log: boolean, label: string, steps?: number[],
 *   format: (value: number) => string }} Axis `steps`: the only values that ticks may have
 * @typedef {{ kind: "line" | "points" | "band" | "bars", style: string, x: number[], y: number[],
 *   top?: number[] }} Series `top`: the upper edge of a band
 * @typedef {{ width: number, height: number, x: Axis, y: Axis, series: Series[], summary: string }} Plot
 * @typedef {{ left: number, right: number, top: number, bottom: number }} Area
 */

const MARGIN = { left: 50, right: 10, top: 8, bottom: 32 };

/**
 * The area of the data in a plot.
 * @param {number} width
 * @param {number} height
 * @returns {Area}
 */
export function plotArea(width, height) {
  return {
    left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom,
  };
}

/**
 * @param {Axis} axis
 * @param {number} from place of `low`
 * @param {number} to place of `high`
 * @returns {(value: number) => number}
 */
export function placer(axis, from, to) {
  const at = axis.log ? (/** @type {number} */ v) => Math.log(Math.max(v, 1e-12)) : (/** @type {number} */ v) => v;
  const low = at(axis.low);
  const span = at(axis.high) - low || 1;
  return (value) => from + ((at(value) - low) / span) * (to - from);
}

/**
 * Values of the ticks of an axis.
 * @param {Axis} axis
 * @param {number} most
 * @returns {number[]}
 */
export function ticks(axis, most) {
  if (axis.steps) {
    const inside = axis.steps.filter((value) => value >= axis.low && value <= axis.high);
    const skip = Math.ceil(inside.length / most);
    return inside.filter((_, index) => index % skip === 0);
  }
  return axis.log ? logTicks(axis.low, axis.high, most) : linearTicks(axis.low, axis.high, most);
}

/**
 * @param {number} low
 * @param {number} high
 * @param {number} most
 */
function linearTicks(low, high, most) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => span / size <= most) ?? span;
  const found = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index += 1) {
    found.push(index * step);
  }
  return found;
}

/**
 * @param {number} low
 * @param {number} high
 * @param {number} most
 */
function logTicks(low, high, most) {
  for (const factors of [[1, 2, 5], [1, 3], [1]]) {
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
      for (const factor of factors) {
        const value = factor * 10 ** power;
        if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
      }
    }
    if (found.length <= most) return found;
    if (factors.length === 1) {
      const skip = Math.ceil(found.length / most);
      return found.filter((_, index) => index % skip === 0);
    }
  }
  return [];
}

/**
 * Draws a plot into an SVG element.
 * @param {SVGSVGElement} target
 * @param {Plot} plot
 */
export function drawPlot(target, plot) {
  const { width, height } = plot;
  const area = plotArea(width, height);
  const atX = placer(plot.x, area.left, area.right);
  const atY = placer(plot.y, area.bottom, area.top);
  target.setAttribute("viewBox", `0 0 ${width} ${height}`);
  target.setAttribute("aria-label", plot.summary);
  const clip = `${target.id}-clip`;
  const data = svg("g", { "clip-path": `url(#${clip})` });
  for (const series of plot.series) data.append(...drawSeries(series, atX, atY, area));
  target.replaceChildren(
    svg("clipPath", { id: clip }, svg("rect", {
      x: area.left, y: area.top, width: area.right - area.left, height: area.bottom - area.top,
    })),
    ...drawAxes(plot, atX, atY, area),
    data,
  );
}

/**
 * @param {Plot} plot
 * @param {(value: number) => number} atX
 * @param {(value: number) => number} atY
 * @param {Area} area
 */
function drawAxes(plot, atX, atY, area) {
  /** @type {SVGElement[]} */
  const parts = [];
  let free = -Infinity;
  for (const value of ticks(plot.x, 7)) {
    const x = atX(value);
    parts.push(svg("line", { class: "grid", x1: x, x2: x, y1: area.top, y2: area.bottom }));
    const text = plot.x.format(value);
    const half = text.length * 2.9 + 1;
    // Labels never overlap and are never cut: a label without room is left out.
    if (x - half < free || x + half > plot.width) continue;
    free = x + half;
    parts.push(svg("text", { class: "tick", x, y: area.bottom + 13, "text-anchor": "middle" }, text));
  }
  for (const value of ticks(plot.y, 6)) {
    const y = atY(value);
    parts.push(svg("line", { class: "grid", x1: area.left, x2: area.right, y1: y, y2: y }));
    parts.push(svg("text", { class: "tick", x: area.left - 5, y: y + 3.5, "text-anchor": "end" },
      plot.y.format(value)));
  }
  parts.push(svg("rect", {
    class: "frame", x: area.left, y: area.top, width: area.right - area.left, height: area.bottom - area.top,
  }));
  parts.push(svg("text", {
    class: "axis", x: (area.left + area.right) / 2, y: plot.height - 4, "text-anchor": "middle",
  }, plot.x.label));
  parts.push(svg("text", {
    class: "axis", transform: `translate(10 ${(area.top + area.bottom) / 2}) rotate(-90)`,
    "text-anchor": "middle",
  }, plot.y.label));
  return parts;
}

/**
 * @param {Series} series
 * @param {(value: number) => number} atX
 * @param {(value: number) => number} atY
 * @param {Area} area
 * @returns {SVGElement[]}
 */
function drawSeries(series, atX, atY, area) {
  const { kind, style, x, y } = series;
  /** @param {number} index */
  const point = (index) => `${atX(x[index] ?? 0).toFixed(1)} ${atY(y[index] ?? 0).toFixed(1)}`;
  if (kind === "points") {
    return x.map((value, index) => svg("circle", {
      class: style, cx: atX(value).toFixed(1), cy: atY(y[index] ?? 0).toFixed(1), r: 2.5,
    }));
  }
  if (x.length === 0) return [];
  if (kind === "bars") {
    // One path for all bars: a histogram has up to some hundred of them.
    const step = x.length > 1 ? (x[1] ?? 0) - (x[0] ?? 0) : 1;
    const path = x.map((value, index) => {
      const left = atX(value).toFixed(1);
      const right = atX(value + step).toFixed(1);
      return `M${left} ${area.bottom}V${atY(y[index] ?? 0).toFixed(1)}H${right}V${area.bottom}Z`;
    });
    return [svg("path", { class: style, d: path.join("") })];
  }
  const line = x.map((_, index) => `${index === 0 ? "M" : "L"}${point(index)}`).join("");
  if (kind === "line") return [svg("path", { class: style, d: line })];
  const top = series.top ?? y;
  const back = x.map((value, index) => `L${atX(value).toFixed(1)} ${atY(top[index] ?? 0).toFixed(1)}`);
  return [svg("path", { class: style, d: `${line}${back.reverse().join("")}Z` })];
}

/**
 * The range of values, with a margin.
 * @param {number[]} values
 * @param {number} margin share of the range
 * @returns {[number, number]}
 */
export function rangeOf(values, margin = 0.05) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [0, 1];
  const room = (high - low) * margin || Math.abs(high) * 0.05 || 1;
  return [low - room, high + room];
}
