// The pointer on the image: pan, pinch, pin, regions, line, and the line between A and B.

import { box } from "./dom.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./store.js").Pixel} Pixel */
/** @typedef {import("./viewer.js").Viewer} Viewer */

const CLICK_DISTANCE = 4; // CSS pixels: a shorter drag is a click

/**
 * @param {Viewer} viewer
 * @param {Store} store
 */
export function followPointer(viewer, store) {
  const canvas = viewer.canvas;
  /**
   * Pointers that are down.
   * @type {Map<number, { x: number, y: number }>}
   */
  const pointers = new Map();
  /** @type {{ x: number, y: number, pixel: Pixel, moved: boolean } | null} */
  let start = null;

  canvas.addEventListener("pointerdown", (event) => {
    // The middle button pans with every tool.
    if (event.button !== 0 && event.button !== 1) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const pixel = store.clamp(viewer.toFilm(event.clientX, event.clientY));
    start = { x: event.clientX, y: event.clientY, pixel, moved: false };
  });

  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    const place = viewer.toFilm(event.clientX, event.clientY);
    if (!last) {
      hover(place);
      return;
    }
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pointers.size === 2) {
      pinch(event.pointerId, last);
      return;
    }
    if (!start) return;
    const distance = Math.hypot(event.clientX - start.x, event.clientY - start.y);
    if (!start.moved && distance < CLICK_DISTANCE) return;
    // The first move of a drag contains the way that could still have been a click.
    const from = start.moved ? last : start;
    start.moved = true;
    if (store.tool === "move" || (event.buttons & 4) !== 0) {
      viewer.pan(event.clientX - from.x, event.clientY - from.y);
    } else {
      drawShape(start.pixel, store.clamp(place));
    }
  });

  /** @param {PointerEvent} event */
  const release = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (start && !start.moved && event.type === "pointerup" && store.tool === "move" && event.button === 0) {
      click(start.pixel, viewer.toFilm(start.x, start.y));
    }
    if (pointers.size === 0) start = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => {
    store.setCursor(null);
  });

  /** @param {Pixel} place */
  function inside(place) {
    const { width, height } = store.server ?? { width: 0, height: 0 };
    return place.x >= 0 && place.y >= 0 && place.x < width && place.y < height;
  }

  /** @param {Pixel} place */
  function hover(place) {
    const next = inside(place) ? store.clamp(place) : null;
    if (next?.x === store.cursor?.x && next?.y === store.cursor?.y) return;
    store.setCursor(next);
  }

  /**
   * @param {Pixel} pixel
   * @param {Pixel} place
   */
  function click(pixel, place) {
    const same = store.pin !== null && store.pin.x === pixel.x && store.pin.y === pixel.y;
    store.setPin(same || !inside(place) ? null : pixel);
  }

  /**
   * @param {Pixel} from
   * @param {Pixel} to
   */
  function drawShape(from, to) {
    if (store.tool === "line") {
      store.setLine({ from, to });
      return;
    }
    const index = store.tool === "region1" ? 0 : 1;
    store.setRegion(index, [
      Math.min(from.x, to.x), Math.min(from.y, to.y),
      Math.max(from.x, to.x) + 1, Math.max(from.y, to.y) + 1,
    ]);
  }

  /**
   * Two fingers zoom and pan.
   * @param {number} id the pointer that moved
   * @param {{ x: number, y: number }} last its earlier place
   */
  function pinch(id, last) {
    // The finger that stays after a pinch must not draw a shape.
    start = null;
    const moved = pointers.get(id);
    const other = [...pointers].find(([key]) => key !== id)?.[1];
    if (!moved || !other) return;
    const before = Math.hypot(last.x - other.x, last.y - other.y);
    const after = Math.hypot(moved.x - other.x, moved.y - other.y);
    if (before > 0) {
      viewer.zoomTo((viewer.scale * after) / before, (moved.x + other.x) / 2, (moved.y + other.y) / 2);
    }
    viewer.pan((moved.x - last.x) / 2, (moved.y - last.y) / 2);
  }
}

/**
 * The line between the pictures A and B.
 * @param {Store} store
 */
export function followDivider(store) {
  const divider = box("divider");
  const stage = box("stage");
  const place = () => {
    divider.toggleAttribute("hidden", !store.compare);
    divider.style.left = `${store.divider * 100}%`;
    divider.setAttribute("aria-valuenow", String(Math.round(store.divider * 100)));
  };
  divider.addEventListener("pointerdown", (event) => {
    divider.setPointerCapture(event.pointerId);
    divider.focus();
    event.preventDefault();
  });
  divider.addEventListener("pointermove", (event) => {
    if (!divider.hasPointerCapture(event.pointerId)) return;
    const bounds = stage.getBoundingClientRect();
    store.setDivider((event.clientX - bounds.left) / bounds.width);
  });
  divider.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 0.1 : 0.01;
    if (event.key === "ArrowLeft") store.setDivider(store.divider - step);
    else if (event.key === "ArrowRight") store.setDivider(store.divider + step);
    else if (event.key === "Home") store.setDivider(0);
    else if (event.key === "End") store.setDivider(1);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  store.on("view", place);
  place();
}
