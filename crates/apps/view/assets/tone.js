// Grey values to the values of the screen.

/** @typedef {import("./protocol").Tone} Tone */

/**
 * The value of the screen, 0 to 255, of a grey value: the black level is black, as in the saved pictures.
 * @param {number} value DN
 * @param {number} black DN
 * @param {number} white DN
 * @param {Tone} tone
 */
export function toneValue(value, black, white, tone) {
  const share = Math.min(1, Math.max(0, (value - black) / (white - black)));
  if (tone === "linear") return Math.round(255 * share);
  if (tone === "log") return Math.round((255 * Math.log(1 + 1000 * share)) / Math.log(1001));
  return Math.round(255 * share ** (1 / 2.2));
}

/**
 * The tone curve as a table: a picture has millions of pixels but at most 65 536 grey values.
 * @param {number} black
 * @param {number} white
 * @param {Tone} tone
 * @returns {Uint32Array} little-endian RGBA by grey value, up to `white`
 */
function toneTable(black, white, tone) {
  const last = Math.min(65535, Math.max(1, Math.ceil(white)));
  const table = new Uint32Array(last + 1);
  for (let value = 0; value <= last; value += 1) {
    table[value] = 0xff000000 | (toneValue(value, black, white, tone) * 0x010101);
  }
  return table;
}

/** @type {WeakMap<HTMLCanvasElement, ImageData>} */
const images = new WeakMap();

/**
 * Paints a frame on a canvas of its size.
 * @param {import("./protocol").Frame} frame
 * @param {Tone} tone has no effect on rgb8, where the server applies it
 * @param {HTMLCanvasElement} canvas
 */
export function paintFrame(frame, tone, canvas) {
  const { width, height, black, white, format } = frame.header;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  if (!context) return;
  // The live view paints 10 times a second; new memory for each frame would cost more than the tone.
  let image = images.get(canvas);
  if (!image || image.width !== width || image.height !== height) {
    image = context.createImageData(width, height);
    images.set(canvas, image);
  }
  const pixels = new Uint32Array(image.data.buffer);
  const values = frame.values;
  if (format === "gray16") {
    const table = toneTable(black, white, tone);
    const last = table.length - 1;
    for (let at = 0; at < pixels.length; at += 1) {
      const value = values[at] ?? 0;
      pixels[at] = table[value > last ? last : value] ?? 0;
    }
  } else {
    for (let at = 0, from = 0; at < pixels.length; at += 1, from += 3) {
      pixels[at] = 0xff000000 | ((values[from + 2] ?? 0) << 16)
        | ((values[from + 1] ?? 0) << 8) | (values[from] ?? 0);
    }
  }
  context.putImageData(image, 0, 0);
}
