// Keeps the pictures A and B and the map up to date: one request in flight, the newest knobs count.

import { Fault, isEarly, requestFrame, requestMap, Withdrawn } from "./api.js";
import { mapScale, paintMap } from "./colormap.js";
import { tracked } from "./requests.js";
import { paintFrame } from "./tone.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").Camera} Camera */

const FRAME_INTERVAL = 100; // ms: the live view shows 10 frames a second
const REFUSED = 422; // status of a camera that the server refuses
const RATE_WINDOW = 2000; // ms over which the rate of the live view is measured

export class Pictures {
  /**
   * Keys of the content that is shown.
   * @type {{ a: string, b: string, map: string }}
   */
  #shown = { a: "", b: "", map: "" };
  /** Keys whose requests failed; they are not sent again until something changes. */
  #failed = { a: "", b: "", map: "" };
  /** The knobs of the last picture A that were sent to become those of the statistics. */
  #measured = "";
  /** Knobs that the server refused: a new content of the film does not make them valid. */
  #refused = { a: "", b: "", map: "" };
  /** @type {ReturnType<typeof setInterval> | null} */
  #timer = null;
  /**
   * The request of the picture A that is in flight, and its knobs.
   * @type {{ camera: Camera, abort: AbortController } | null}
   */
  #inFlight = null;
  /**
   * Arrival times of the frames of the live view.
   * @type {number[]}
   */
  #arrivals = [];

  /**
   * @param {Store} store
   * @param {import("./viewer.js").Viewer} viewer
   * @param {import("./requests.js").Lane} lane
   * @param {{ set(key: string, error: unknown): void, clear(key: string): void }} problems
   */
  constructor(store, viewer, lane, problems) {
    this.store = store;
    this.viewer = viewer;
    this.lane = lane;
    this.problems = problems;
    store.on("session", () => this.#forget());
    store.on("camera", () => this.#withdraw());
    store.on(["state", "connection", "camera", "kept", "frame", "mapChoice"], () => this.refresh());
    store.on("view", () => {
      this.#repaint();
      this.#followLive();
      this.refresh();
    });
    store.on("mapChoice", () => {
      this.#shown.map = "";
      if (store.map === "none") {
        viewer.mapPicture = null;
        viewer.invalidate();
      }
      store.emit("map");
    });
  }

  /** Requests what is not shown yet. */
  refresh() {
    const { store } = this;
    if (!store.connected || !store.camera || !store.server?.film) return;
    this.#want("a", () => this.#frameKey(store.camera), () => this.#fetchFrame("a"));
    if (store.compare && store.kept) {
      this.#want("b", () => this.#frameKey(store.kept), () => this.#fetchFrame("b"));
    }
    if (store.map !== "none") this.#want("map", () => this.#mapKey(), () => this.#fetchMap());
  }

  /** Another server may count its films from the start again, and may have films of another size. */
  #forget() {
    const { store, viewer } = this;
    this.#shown = { a: "", b: "", map: "" };
    this.#failed = { a: "", b: "", map: "" };
    this.#refused = { a: "", b: "", map: "" };
    this.#measured = "";
    for (const kind of ["a", "b", "map"]) this.problems.clear(kind);
    viewer.pictureB = null;
    viewer.mapPicture = null;
    if (!store.frameA) {
      viewer.pictureA = null;
      viewer.fit();
    }
    viewer.invalidate();
    store.emit("map");
    store.emit("picture");
  }

  /**
   * Withdraws the request of a new film or frame with the knobs that are shown, so that a knob does not wait for it. A
   * request with knobs that are not shown yet goes on, so that a knob that keeps moving has pictures.
   */
  #withdraw() {
    const flight = this.#inFlight;
    if (!flight) return;
    const { camera, frameA } = this.store;
    const [asked, shown, wanted] = [flight.camera, frameA?.camera, camera].map((knobs) => JSON.stringify(knobs));
    if (asked === shown && asked !== wanted) flight.abort.abort();
  }

  /**
   * @param {"a" | "b" | "map"} kind
   * @param {() => string} key
   * @param {() => Promise<void>} fetch
   */
  #want(kind, key, fetch) {
    const wanted = key();
    if (wanted === this.#failed[kind] || this.#knobs(kind) === this.#refused[kind]) return;
    if (wanted === this.#shown[kind]) {
      // A refused knob was moved back.
      this.#failed[kind] = "";
      this.problems.clear(kind);
      return;
    }
    this.lane.request(kind, async () => {
      // The newest wish counts: it may have been fulfilled while this one waited.
      const now = key();
      if (now === this.#shown[kind] || now === this.#failed[kind] || !this.store.connected) return;
      const knobs = this.#knobs(kind);
      const { session } = this.store;
      try {
        await fetch();
        if (session !== this.store.session) return;
        this.#failed[kind] = "";
        this.#refused[kind] = "";
        this.problems.clear(kind);
      } catch (error) {
        // The answer of an earlier server says nothing about this one.
        if (session !== this.store.session || error instanceof Withdrawn) return;
        // The next film makes another key, and is asked for.
        this.#failed[kind] = now;
        if (isEarly(error)) return;
        if (error instanceof Fault && error.status === REFUSED) this.#refused[kind] = knobs;
        this.problems.set(kind, error);
      }
    });
  }

  /**
   * The choices of the user. A render that starts again may have other layers, so it counts too.
   * @param {"a" | "b" | "map"} kind
   */
  #knobs(kind) {
    const { store } = this;
    return JSON.stringify([
      kind === "b" ? store.kept : store.camera, kind === "map" ? store.map : "",
      store.server?.render.restarted,
    ]);
  }

  /**
   * @param {Camera | null} camera
   * @param {number} [film]
   */
  #frameKey(camera, film = this.store.server?.film?.id ?? 0) {
    if (!camera) return "";
    const tone = this.store.isColour(camera) ? this.store.tone : "";
    // A provisional picture is asked for again when there are newer results.
    const prepared = camera.noise === "matched" || camera.denoise !== "off" ? this.store.server?.prepared : 0;
    return JSON.stringify([film, this.store.frameNumber, tone, camera, prepared]);
  }

  /** @param {number} [film] */
  #mapKey(film = this.store.server?.film?.id ?? 0) {
    const { map, camera } = this.store;
    return JSON.stringify([film, map, camera]);
  }

  /** @param {"a" | "b"} kind */
  async #fetchFrame(kind) {
    const { store, viewer } = this;
    const camera = kind === "a" ? store.camera : store.kept;
    if (!camera) return;
    const { frameNumber, tone, session } = store;
    const asked = this.#frameKey(camera);
    const film = store.server?.film?.id ?? 0;
    const abort = new AbortController();
    if (kind === "a") this.#inFlight = { camera, abort };
    // The statistics are those of the page whose knobs have changed last.
    const knobs = JSON.stringify(camera);
    const statistics = kind === "a" && knobs !== this.#measured;
    let frame;
    try {
      frame = await requestFrame({ camera, frame: frameNumber, tone, statistics }, abort.signal);
    } finally {
      if (kind === "a") this.#inFlight = null;
    }
    if (session !== store.session) return;
    if (statistics) this.#measured = knobs;
    // The film may have grown since the request. The picture counts for the film that it shows, if
    // that is newer: the event that announces this film then needs no second request.
    this.#shown[kind] = frame.header.film > film
      ? asked.replace(`[${film},`, `[${frame.header.film},`)
      : asked;
    const canvas = (kind === "a" ? viewer.pictureA : viewer.pictureB) ?? document.createElement("canvas");
    const first = kind === "a" && (viewer.pictureA === null || canvas.width !== frame.header.width
      || canvas.height !== frame.header.height);
    // The tone may have changed since the request.
    paintFrame(frame, store.tone, canvas);
    if (kind === "a") {
      store.frameA = frame;
      viewer.pictureA = canvas;
      if (first) viewer.fit();
      this.#countFrame();
    } else {
      store.frameB = frame;
      viewer.pictureB = canvas;
    }
    viewer.invalidate();
    store.emit("picture");
  }

  async #fetchMap() {
    const { store, viewer } = this;
    const { map, camera, session } = store;
    if (map === "none" || !camera) return;
    const asked = this.#mapKey();
    const filmMap = await requestMap({ camera, map });
    if (session !== store.session || map !== store.map) return;
    this.#shown.map = asked;
    store.filmMap = filmMap;
    this.paintMap();
    viewer.invalidate();
  }

  /** Paints the map with the colours and the target of this moment. */
  paintMap() {
    const { store, viewer } = this;
    if (store.map === "none" || !store.filmMap) return;
    const canvas = viewer.mapPicture ?? document.createElement("canvas");
    const target = store.server?.target ?? 0.5;
    paintMap(store.filmMap, mapScale(store.map, store.filmMap.header, target, store.mapColours), canvas);
    viewer.mapPicture = canvas;
    viewer.invalidate();
    store.emit("map");
  }

  #paintedTone = "gamma";

  /** Grey frames get their tone here, without a request. */
  #repaint() {
    const { store, viewer } = this;
    if (this.#paintedTone !== store.tone) {
      this.#paintedTone = store.tone;
      if (store.frameA?.header.format === "gray16" && viewer.pictureA) {
        paintFrame(store.frameA, store.tone, viewer.pictureA);
      }
      if (store.frameB?.header.format === "gray16" && viewer.pictureB) {
        paintFrame(store.frameB, store.tone, viewer.pictureB);
      }
    }
    viewer.invalidate();
  }

  #followLive() {
    if (this.store.live && this.#timer === null) {
      this.#arrivals = [];
      // The number of the frame follows the clock. The lane takes the newest number when it is
      // free, so a slow server skips numbers and never gets a queue.
      this.#timer = setInterval(() => void tracked(async () => this.store.stepFrame()), FRAME_INTERVAL);
    } else if (!this.store.live && this.#timer !== null) {
      clearInterval(this.#timer);
      this.#timer = null;
    }
  }

  #countFrame() {
    if (!this.store.live) return;
    const now = performance.now();
    this.#arrivals = [...this.#arrivals.filter((time) => now - time < RATE_WINDOW), now];
    const span = now - (this.#arrivals[0] ?? now);
    this.store.framesPerSecond = span > 0 ? ((this.#arrivals.length - 1) * 1000) / span : 0;
  }
}
