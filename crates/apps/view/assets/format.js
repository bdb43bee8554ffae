// Numbers as text and text as numbers.

/** The sign for a value that is unknown. */
export const UNKNOWN = "\u2013";

/**
 * A number with a fixed count of significant digits, without an exponent where it is readable.
 * @param {number | null | undefined} value
 * @param {number} digits
 * @returns {string}
 */
export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e7 || size < 1e-4) return value.toExponential(digits - 1).replace("e+", "e");
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(decimals, 12)).replace("-", "\u2212");
}

/**
 * A number without zeros at its end: for ticks, and for values that are whole numbers by nature.
 * @param {number | null | undefined} value
 * @param {number} digits
 */
export function plain(value, digits = 3) {
  const text = number(value, digits);
  return text.includes(".") && !text.includes("e") ? text.replace(/\.?0+$/, "") : text;
}

/**
 * @param {number | null | undefined} value
 * @param {string} unit
 * @param {number} digits
 */
export function quantity(value, unit, digits = 3) {
  const text = number(value, digits);
  return text === UNKNOWN ? text : `${text} ${unit}`;
}

/**
 * A count with thin spaces between the thousands.
 * @param {number | null | undefined} value
 */
export function count(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  return Math.round(value).toString().replace(/\B(?=(\d{3})+(?!\d))/g, "\u2009");
}

/**
 * A count with three digits: 3.70 million, 1 470.
 * @param {number} value
 */
export function bigCount(value) {
  return value >= 1e6 ? `${number(value / 1e6, 3)} million` : count(Number(value.toPrecision(3)));
}

/**
 * A share in [0, 1] in per cent. Shares next to 0 or 1 keep the digits that differ.
 * @param {number | null | undefined} share
 */
export function percent(share) {
  if (share === null || share === undefined || !Number.isFinite(share)) return UNKNOWN;
  const value = share * 100;
  const decimals = value > 0 && value < 0.95 ? 2 : 1;
  // 99.96 % must not be shown as 100.0 %.
  const shown = value < 100 ? Math.min(value, 99.9) : value;
  return `${(value > 99.9 && value < 100 ? shown : value).toFixed(decimals)} %`;
}

/**
 * An exposure time: 12.5 ms.
 * @param {number} seconds
 */
export function exposure(seconds) {
  if (seconds >= 1) return `${plain(seconds, 4)} s`;
  if (seconds >= 1e-3) return `${plain(seconds * 1e3, 4)} ms`;
  return `${plain(seconds * 1e6, 4)} \u00b5s`;
}

const UNITS = new Map([
  ["s", 1], ["ms", 1e-3], ["us", 1e-6], ["\u00b5s", 1e-6], ["\u03bcs", 1e-6], ["min", 60],
]);

/**
 * The exposure time that a text states, in seconds; null where it states none. A number without
 * a unit is in milliseconds, the usual unit of exposure times.
 * @param {string} text
 * @returns {number | null}
 */
export function parseExposure(text) {
  const match = /^\s*([0-9]*[.,]?[0-9]+(?:e[+-]?[0-9]+)?)\s*([a-z\u00b5\u03bc]*)\s*$/i.exec(text);
  if (!match) return null;
  const factor = UNITS.get(match[2] === "" ? "ms" : (match[2] ?? "").toLowerCase());
  const value = Number((match[1] ?? "").replace(",", "."));
  return factor === undefined || !(value > 0) ? null : value * factor;
}

/**
 * A duration for reading: 0.4 s, 41 s, 3 min 20 s, 2 h 5 min.
 * @param {number | null | undefined} seconds
 */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return UNKNOWN;
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 90) return `${whole} s`;
  if (whole < 600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  // Rounded before it is divided: 7190 s are 2 h 0 min and not 1 h 60 min.
  const minutes = Math.round(whole / 60);
  if (minutes < 60) return `${minutes} min`;
  if (minutes < 48 * 60) return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
  return `${Math.round(whole / 86400)} days`;
}

/** @param {number} value */
export function bytes(value) {
  if (value >= 1e9) return `${number(value / 1e9, 3)} GB`;
  if (value >= 1e6) return `${number(value / 1e6, 3)} MB`;
  return `${number(value / 1e3, 3)} kB`;
}

/**
 * The four whole numbers of a text, with blanks, commas or semicolons between them.
 * @param {string} text
 * @returns {[number, number, number, number] | null} null: the text has others, or something else
 */
export function fourNumbers(text) {
  const words = text.split(/[\s,;]+/).filter((word) => word !== "");
  const [a, b, c, d] = words.every((word) => /^-?\d{1,9}$/.test(word)) ? words.map(Number) : [];
  if (words.length !== 4 || a === undefined || b === undefined || c === undefined || d === undefined) return null;
  return [a, b, c, d];
}

/**
 * Linear light in [0, 1] to the sRGB value of a colour control (IEC 61966-2-1, 1999).
 * @param {number} value
 */
export function toSrgb(value) {
  const clamped = Math.min(1, Math.max(0, value));
  return clamped <= 0.0031308 ? 12.92 * clamped : 1.055 * clamped ** (1 / 2.4) - 0.055;
}

/**
 * The inverse of `toSrgb`.
 * @param {number} value
 */
export function fromSrgb(value) {
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}

/** @param {import("./protocol").Colour} linear */
export function toHex(linear) {
  return `#${linear.map((v) => Math.round(toSrgb(v) * 255).toString(16).padStart(2, "0")).join("")}`;
}

/**
 * @param {string} hex
 * @returns {import("./protocol").Colour}
 */
export function fromHex(hex) {
  /** @param {number} at */
  const channel = (at) => fromSrgb(parseInt(hex.slice(at, at + 2), 16) / 255);
  return [channel(1), channel(3), channel(5)];
}
