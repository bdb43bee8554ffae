// Regions, line, pinned pixel and light path, drawn over the image.

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./viewer.js").Viewer} Viewer */

// Colours that readers with a colour vision deficiency can keep apart, each over a dark halo.
export const REGION_COLOURS = /** @type {const} */ (["#ffb000", "#7ea6ff"]);
export const LINE_COLOUR = "#ff6fb5";
const PATH_COLOUR = "#3ddbc4";

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Viewer} viewer
 * @param {Store} store
 */
export function drawShapes(context, viewer, store) {
  const unit = viewer.ratio;
  /** @param {number} x */
  const atX = (x) => viewer.x + x * viewer.scale;
  /** @param {number} y */
  const atY = (y) => viewer.y + y * viewer.scale;
  context.lineJoin = "round";
  context.font = `600 ${12 * unit}px system-ui, sans-serif`;
  context.textAlign = "left";
  context.textBaseline = "bottom";

  store.regions.forEach((region, index) => {
    if (!region) return;
    const [x0, y0, x1, y1] = region;
    const colour = REGION_COLOURS[index] ?? "#fff";
    context.beginPath();
    context.rect(atX(x0), atY(y0), (x1 - x0) * viewer.scale, (y1 - y0) * viewer.scale);
    strokeWithHalo(context, colour, 1.5 * unit);
    textWithHalo(context, String(index + 1), atX(x0) + 3 * unit, atY(y0) - 2 * unit, colour, unit);
  });

  if (store.line) {
    const { from, to } = store.line;
    context.beginPath();
    context.moveTo(atX(from.x + 0.5), atY(from.y + 0.5));
    context.lineTo(atX(to.x + 0.5), atY(to.y + 0.5));
    strokeWithHalo(context, LINE_COLOUR, 1.5 * unit);
    context.beginPath();
    context.arc(atX(from.x + 0.5), atY(from.y + 0.5), 3.5 * unit, 0, 2 * Math.PI);
    strokeWithHalo(context, LINE_COLOUR, 1.5 * unit);
  }

  if (store.showPath && store.path) {
    drawPath(context, store.path.vertices, atX, atY, unit);
  }

  if (store.pin) drawPin(context, store.pin, viewer, unit);
}

/**
 * Vertices behind the camera have no place on the film, so the line has a gap there.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./protocol").PathVertex[]} vertices
 * @param {(x: number) => number} atX
 * @param {(y: number) => number} atY
 * @param {number} unit
 */
function drawPath(context, vertices, atX, atY, unit) {
  context.beginPath();
  for (const { x, y, before } of vertices) {
    const from = before === null ? undefined : vertices[before];
    if (!from || from.x === null || from.y === null || x === null || y === null) continue;
    context.moveTo(atX(from.x), atY(from.y));
    context.lineTo(atX(x), atY(y));
  }
  strokeWithHalo(context, PATH_COLOUR, 1.5 * unit);
  vertices.forEach(({ x, y }, index) => {
    if (x === null || y === null) return;
    context.beginPath();
    context.arc(atX(x), atY(y), 3.5 * unit, 0, 2 * Math.PI);
    context.fillStyle = PATH_COLOUR;
    context.fill();
    strokeWithHalo(context, "#fff", unit);
    textWithHalo(context, String(index), atX(x) + 6 * unit, atY(y) - 4 * unit, PATH_COLOUR, unit);
  });
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {import("./store.js").Pixel} pin
 * @param {Viewer} viewer
 * @param {number} unit
 */
function drawPin(context, pin, viewer, unit) {
  const size = Math.max(viewer.scale, 3 * unit);
  const x = viewer.x + (pin.x + 0.5) * viewer.scale;
  const y = viewer.y + (pin.y + 0.5) * viewer.scale;
  const reach = size / 2 + 9 * unit;
  context.beginPath();
  context.rect(x - size / 2, y - size / 2, size, size);
  for (const [dx, dy] of /** @type {const} */ ([[1, 0], [-1, 0], [0, 1], [0, -1]])) {
    context.moveTo(x + (dx * size) / 2, y + (dy * size) / 2);
    context.lineTo(x + dx * reach, y + dy * reach);
  }
  strokeWithHalo(context, "#fff", 1.5 * unit);
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} colour
 * @param {number} width
 */
function strokeWithHalo(context, colour, width) {
  context.strokeStyle = "rgba(0, 0, 0, 0.7)";
  context.lineWidth = width * 2.4;
  context.stroke();
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {string} text
 * @param {number} x
 * @param {number} y
 * @param {string} colour
 * @param {number} unit
 */
function textWithHalo(context, text, x, y, colour, unit) {
  context.strokeStyle = "rgba(0, 0, 0, 0.8)";
  context.lineWidth = 3 * unit;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}
