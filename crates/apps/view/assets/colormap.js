// Colour maps as tables of control points, linear between them.

// viridis: Smith and van der Walt (2015), the default map of matplotlib 2.
const VIRIDIS = [
  "440154", "482475", "414487", "355f8d", "2a788e", "21918c", "22a884", "44bf70", "7ad151",
  "bddf26", "fde725",
];
// cividis: Nunez, Anderton and Renslow (2018), made for readers with a colour vision deficiency.
const CIVIDIS = [
  "00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55",
  "fee838",
];
// Purple and orange, safe for readers with a colour vision deficiency: Harrower and Brewer (2003). The ratio has a jump of hue
// at the target, so the boundary is visible without a contour.
const BELOW = ["2d004b", "542788", "8073ac", "b2abd2"];
const ABOVE = ["fdb863", "e08214", "b35806", "7f3b08"];

/** @typedef {"viridis" | "cividis" | "ratio"} ColourMap */

const STEPS = 256;

/**
 * @param {string[]} points
 * @param {number} share in [0, 1]
 * @returns {number} little-endian RGBA
 */
function colourAt(points, share) {
  const place = Math.min(1, Math.max(0, share)) * (points.length - 1);
  const index = Math.min(points.length - 2, Math.floor(place));
  const part = place - index;
  const low = parseInt(points[index] ?? "0", 16);
  const high = parseInt(points[index + 1] ?? "0", 16);
  /** @param {number} shift */
  const mix = (shift) => Math.round(((low >> shift) & 255) * (1 - part) + ((high >> shift) & 255) * part);
  return (0xff000000 | (mix(0) << 16) | (mix(8) << 8) | mix(16)) >>> 0;
}

/**
 * @param {ColourMap} name
 * @returns {Uint32Array} 256 colours, little-endian RGBA
 */
export function colourTable(name) {
  const table = new Uint32Array(STEPS);
  for (let step = 0; step < STEPS; step += 1) {
    const share = step / (STEPS - 1);
    if (name === "ratio") {
      table[step] = share < 0.5 ? colourAt(BELOW, share * 2) : colourAt(ABOVE, share * 2 - 1);
    } else {
      table[step] = colourAt({ viridis: VIRIDIS, cividis: CIVIDIS }[name], share);
    }
  }
  return table;
}

/**
 * The scale of a map: the range of values and the way to a share of the colour table.
 * @typedef {{ colours: ColourMap, low: number, high: number, log: boolean }} Scale
 */

/**
 * @param {import("./protocol").MapName} map
 * @param {import("./protocol").MapHeader} header
 * @param {number} target
 * @param {"viridis" | "cividis"} colours
 * @returns {Scale}
 */
export function mapScale(map, header, target, colours) {
  const { low, high } = header;
  if (map === "ratio") {
    // The target is the middle of the table. Both sides span the same factor.
    const factor = Math.min(32, Math.max(4, high / target, target / Math.max(low, 1e-6)));
    return { colours: "ratio", low: target / factor, high: target * factor, log: true };
  }
  if (low > 0 && high / low > 20) return { colours, low, high, log: true };
  return { colours, low, high: high > low ? high : low + 1e-6, log: false };
}

/**
 * The share of the colour table at a value.
 * @param {Scale} scale
 * @param {number} value
 */
export function shareOf(scale, value) {
  if (scale.log) return Math.log(Math.max(value, 1e-30) / scale.low) / Math.log(scale.high / scale.low);
  return (value - scale.low) / (scale.high - scale.low);
}

/**
 * The value at a share of the colour table: the inverse of `shareOf`.
 * @param {Scale} scale
 * @param {number} share
 */
export function valueAt(scale, share) {
  if (scale.log) return scale.low * (scale.high / scale.low) ** share;
  return scale.low + (scale.high - scale.low) * share;
}

/**
 * Paints a map on a canvas of its size. Unknown values stay transparent.
 * @param {import("./protocol").FilmMap} map
 * @param {Scale} scale
 * @param {HTMLCanvasElement} canvas
 */
export function paintMap(map, scale, canvas) {
  const { width, height } = map.header;
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  if (!context) return;
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const table = colourTable(scale.colours);
  for (let at = 0; at < pixels.length; at += 1) {
    const value = map.values[at] ?? NaN;
    if (!Number.isFinite(value)) continue;
    const share = shareOf(scale, value);
    // The target itself counts as hidden, so the upper half starts above it.
    const index = scale.colours === "ratio" && share <= 0.5
      ? Math.floor(Math.max(0, share) * 2 * 127)
      : Math.ceil(Math.min(1, Math.max(0, share)) * (STEPS - 1));
    pixels[at] = table[index] ?? 0;
  }
  context.putImageData(image, 0, 0);
}

/**
 * Paints the scale as a vertical bar, the largest value at the top.
 * @param {Scale} scale
 * @param {HTMLCanvasElement} canvas
 */
export function paintScale(scale, canvas) {
  const context = canvas.getContext("2d");
  if (!context) return;
  const { width, height } = canvas;
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const table = colourTable(scale.colours);
  for (let row = 0; row < height; row += 1) {
    const colour = table[Math.round((1 - row / (height - 1)) * (STEPS - 1))] ?? 0;
    pixels.fill(colour, row * width, (row + 1) * width);
  }
  context.putImageData(image, 0, 0);
}
