// The image on the canvas: pan, zoom, the layers of the picture, and their drawing.

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./store.js").Pixel} Pixel */

// Steps of the zoom by keys. From 100 % on they are whole numbers, so all pixels have one size.
const LADDER = [
  1 / 32, 1 / 16, 1 / 8, 1 / 6, 1 / 4, 1 / 3, 1 / 2, 2 / 3, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96,
];
const LARGEST = 96;
/** Width of a pixel on the screen from which its grey value is written into it. */
const VALUE_SIZE = 44;

export class Viewer {
  /** Device pixels for each pixel of the film. */
  scale = 1;
  /** Device pixels from the corner of the canvas to the corner of the film. */
  x = 0;
  y = 0;
  /** True while the whole image follows the size of the view. */
  fitted = true;

  /** @type {HTMLCanvasElement | null} */
  pictureA = null;
  /** @type {HTMLCanvasElement | null} */
  pictureB = null;
  /** @type {HTMLCanvasElement | null} */
  mapPicture = null;
  /**
   * Draws the shapes of the tools.
   * @type {(context: CanvasRenderingContext2D) => void}
   */
  drawShapes = () => {};
  /** @type {() => void} */
  onView = () => {};

  #exactX = 0;
  #exactY = 0;
  #scheduled = false;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Store} store
   */
  constructor(canvas, store) {
    this.canvas = canvas;
    this.store = store;
    new ResizeObserver(() => this.#resize()).observe(canvas);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      // A wheel with lines or pages sends small numbers; both are scaled to about one notch.
      // A pinch on a touch pad arrives as a wheel with Ctrl and small steps.
      const delta = (event.deltaMode === 0 ? event.deltaY : event.deltaY * 40) * (event.ctrlKey ? 5 : 1);
      this.zoomTo(this.scale * Math.exp(-delta * 0.0018), event.clientX, event.clientY);
    }, { passive: false });
  }

  get ratio() {
    return window.devicePixelRatio || 1;
  }

  get filmWidth() {
    return this.pictureA?.width ?? this.store.server?.width ?? 1;
  }

  get filmHeight() {
    return this.pictureA?.height ?? this.store.server?.height ?? 1;
  }

  /**
   * The place on the film, in pixels, of a place in the window.
   * @param {number} clientX
   * @param {number} clientY
   * @returns {Pixel}
   */
  toFilm(clientX, clientY) {
    const bounds = this.canvas.getBoundingClientRect();
    return {
      x: ((clientX - bounds.left) * this.ratio - this.x) / this.scale,
      y: ((clientY - bounds.top) * this.ratio - this.y) / this.scale,
    };
  }

  /**
   * The pixel of the film in the middle of the view.
   * @returns {Pixel}
   */
  centre() {
    return {
      x: (this.canvas.width / 2 - this.x) / this.scale,
      y: (this.canvas.height / 2 - this.y) / this.scale,
    };
  }

  /** Shows the whole image. */
  fit() {
    this.fitted = true;
    const { width, height } = this.canvas;
    const scale = Math.min(width / this.filmWidth, height / this.filmHeight);
    this.scale = Math.min(LARGEST, Math.max(1e-3, scale));
    this.#changed();
  }

  /**
   * Sets the scale, and keeps the place under a point of the window.
   * @param {number} scale
   * @param {number} [clientX] the middle of the view if left out
   * @param {number} [clientY]
   */
  zoomTo(scale, clientX, clientY) {
    const bounds = this.canvas.getBoundingClientRect();
    const x = ((clientX ?? bounds.left + bounds.width / 2) - bounds.left) * this.ratio;
    const y = ((clientY ?? bounds.top + bounds.height / 2) - bounds.top) * this.ratio;
    const next = Math.min(LARGEST, Math.max(LADDER[0] ?? 0, scale));
    this.#exactX = x - ((x - this.#exactX) / this.scale) * next;
    this.#exactY = y - ((y - this.#exactY) / this.scale) * next;
    this.scale = next;
    this.fitted = false;
    this.#changed();
  }

  /**
   * One step of the ladder.
   * @param {1 | -1} direction
   */
  zoomStep(direction) {
    const steps = direction > 0 ? LADDER : [...LADDER].reverse();
    const next = steps.find((step) => (direction > 0 ? step > this.scale * 1.01 : step < this.scale * 0.99));
    if (next !== undefined) this.zoomTo(next);
  }

  /**
   * @param {number} dx CSS pixels
   * @param {number} dy
   */
  pan(dx, dy) {
    this.#exactX += dx * this.ratio;
    this.#exactY += dy * this.ratio;
    this.fitted = false;
    this.#changed();
  }

  invalidate() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      this.#draw();
    });
  }

  #resize() {
    const width = Math.max(1, Math.round(this.canvas.clientWidth * this.ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * this.ratio));
    if (width !== this.canvas.width || height !== this.canvas.height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (this.fitted) this.fit();
    else this.#changed();
    // A changed size clears the canvas: it is drawn now and not in the next frame, without a flash.
    this.#draw();
  }

  #changed() {
    this.#exactX = clampOffset(this.#exactX, this.filmWidth * this.scale, this.canvas.width);
    this.#exactY = clampOffset(this.#exactY, this.filmHeight * this.scale, this.canvas.height);
    // Whole device pixels: a pixel of the film then has sharp edges, and the pointer meets the same
    // pixel that is drawn. The exact offsets stay, so that many steps of the zoom do not drift.
    this.x = Math.round(this.#exactX);
    this.y = Math.round(this.#exactY);
    this.invalidate();
    this.onView();
  }

  #draw() {
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const { width, height } = this.canvas;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    context.imageSmoothingEnabled = this.scale < 1;
    context.imageSmoothingQuality = "high";
    const edge = this.store.divider * width;
    const divided = this.store.compare && this.pictureB !== null;
    if (this.pictureA) this.#layer(context, this.pictureA, 0, divided ? edge : width);
    if (this.pictureB && divided) this.#layer(context, this.pictureB, edge, width);
    if (this.mapPicture) {
      context.globalAlpha = this.store.mapOpacity;
      // A map is that of the camera A.
      this.#layer(context, this.mapPicture, 0, divided ? edge : width);
      context.globalAlpha = 1;
    }
    if (this.scale >= VALUE_SIZE * this.ratio) this.#drawValues(context, divided ? edge : width);
    this.drawShapes(context);
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {HTMLCanvasElement} picture
   * @param {number} from device pixels
   * @param {number} to
   */
  #layer(context, picture, from, to) {
    if (to <= from) return;
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, this.canvas.height);
    context.clip();
    const { filmWidth, filmHeight, scale } = this;
    context.drawImage(picture, this.x, this.y, filmWidth * scale, filmHeight * scale);
    context.restore();
  }

  /**
   * Writes the grey values into the pixels of A.
   * @param {CanvasRenderingContext2D} context
   * @param {number} edge
   */
  #drawValues(context, edge) {
    const frame = this.store.frameA;
    if (!frame || frame.header.format !== "gray16") return;
    const { width, height, white } = frame.header;
    const x0 = Math.max(0, Math.floor(-this.x / this.scale));
    const y0 = Math.max(0, Math.floor(-this.y / this.scale));
    const x1 = Math.min(width, Math.ceil((edge - this.x) / this.scale));
    const y1 = Math.min(height, Math.ceil((this.canvas.height - this.y) / this.scale));
    context.font = `${11 * this.ratio}px ui-monospace, monospace`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (let y = y0; y < y1; y += 1) {
      for (let x = x0; x < x1; x += 1) {
        const value = frame.values[y * width + x] ?? 0;
        context.fillStyle = this.store.map === "none" && value > 0.2 * white ? "#000" : "#fff";
        context.fillText(String(value), this.x + (x + 0.5) * this.scale, this.y + (y + 0.5) * this.scale);
      }
    }
  }
}

/**
 * Centres a film that is smaller than the view, and keeps a part of a larger one in it.
 * @param {number} offset
 * @param {number} size
 * @param {number} view
 */
function clampOffset(offset, size, view) {
  if (size <= view) return (view - size) / 2;
  const margin = view / 2;
  return Math.min(margin, Math.max(view - size - margin, offset));
}
