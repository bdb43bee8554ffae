// Requests of the measurements: probe, light path, regions, line, photon transfer.

import { Fault, isEarly, postJson } from "./api.js";
import { Debounce, Throttle } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */

const CURSOR_DELAY = 80; // ms that the pointer rests before the probe asks
const FRAME_INTERVAL = 400; // ms between measurements of new frames
const TRANSFER_INTERVAL = 2000; // ms: the photon transfer needs two frames of the server
const MEASURED = ["probe", "path", "regions", "line", "transfer"];

export class Measurements {
  /** @type {import("./protocol").Regions | null} */
  regions = null;
  /**
   * Which of the two regions the answer contains.
   * @type {number[]}
   */
  regionIndices = [];
  /** @type {import("./protocol").Line | null} */
  line = null;
  /** @type {import("./protocol").PhotonTransfer | null} */
  transfer = null;
  /** True while the section of the photon transfer is open. */
  transferWanted = false;
  /** The number of restarts of the render that is measured. */
  #restarted = 0;

  #cursor = new Debounce(CURSOR_DELAY, () => this.probe());
  #frame = new Throttle(FRAME_INTERVAL, () => this.refresh());
  #transfer = new Throttle(TRANSFER_INTERVAL, () => this.refreshTransfer());
  #transferKey = "";
  /**
   * Wishes that the server refused, by request: they are not repeated until something of them changes.
   * @type {Map<string, string>}
   */
  #refused = new Map();

  /**
   * @param {Store} store
   * @param {import("./requests.js").Lane} lane
   * @param {{ set(key: string, error: unknown): void, clear(key: string): void }} problems
   */
  constructor(store, lane, problems) {
    this.store = store;
    this.lane = lane;
    this.problems = problems;
    store.on("cursor", () => {
      if (!store.pin && store.cursor) this.#cursor.call();
    });
    store.on(["pin", "path"], () => this.probe());
    store.on("shapes", () => this.refreshShapes());
    store.on("picture", () => {
      if (store.pin || store.cursor || store.line || store.regions.some((region) => region)) this.#frame.call();
      if (this.transferWanted) this.#transfer.call();
    });
    store.on("session", () => this.#forget());
    store.on("state", () => {
      if (store.server?.render.restarted !== this.#restarted) this.#followRestart();
    });
    store.on("camera", () => {
      // The fault of a refused camera is outdated; each new answer states its own.
      for (const key of MEASURED) problems.clear(key);
    });
  }

  /** Drops the values of an earlier server. */
  #forget() {
    this.#refused.clear();
    this.#transferKey = "";
    this.regions = null;
    this.line = null;
    this.transfer = null;
    for (const key of MEASURED) this.problems.clear(key);
    this.#restarted = this.store.server?.render.restarted ?? 0;
    this.store.emit("probe");
    this.store.emit("measures");
  }

  /** A restart may mend what was refused. */
  #followRestart() {
    this.#restarted = this.store.server?.render.restarted ?? 0;
    this.#refused.clear();
    this.#transferKey = "";
    this.refresh();
    this.refreshTransfer();
  }

  /** Measures everything that a new picture can change. */
  refresh() {
    this.refreshShapes();
    this.probe();
  }

  refreshShapes() {
    this.#requestRegions();
    this.#requestLine();
  }

  /** Reads the pinned pixel, or the pixel under the cursor. */
  probe() {
    const { store } = this;
    if (!(store.pin ?? store.cursor)) {
      this.problems.clear("probe");
      this.problems.clear("path");
      return;
    }
    if (!this.#ready()) return;
    const wish = () => JSON.stringify([store.camera, store.pin ?? store.cursor]);
    this.#request("probe", wish, async () => {
      const pixel = store.pin ?? store.cursor;
      if (!pixel) return;
      /** @type {import("./protocol").Probe} */
      const probe = await postJson("/api/probe", { ...this.#camera(), x: pixel.x, y: pixel.y });
      // The pin may have been removed meanwhile.
      if (!(store.pin ?? store.cursor)) return;
      store.probe = probe;
      store.emit("probe");
      if (store.showPath) this.#requestPath();
    }, () => store.dropProbe());
  }

  #requestPath() {
    const { store } = this;
    // The next film may have a sample with light.
    const wish = () => JSON.stringify([store.server?.film?.id, store.pin ?? store.cursor]);
    this.#request("path", wish, async () => {
      const pixel = store.pin ?? store.cursor;
      if (!pixel || !store.showPath) return;
      /** @type {import("./protocol").LightPath} */
      const path = await postJson("/api/path", { x: pixel.x, y: pixel.y, index: null, camera: store.camera });
      if (!(store.pin ?? store.cursor) || !store.showPath) return;
      store.path = path;
      store.emit("measures");
    }, () => {
      store.path = null;
    });
  }

  #requestRegions() {
    const { store } = this;
    const present = store.regions.flatMap((region, index) => (region ? [index] : []));
    if (present.length === 0) {
      this.regions = null;
      this.problems.clear("regions");
      store.emit("measures");
      return;
    }
    if (!this.#ready()) return;
    const wish = () => JSON.stringify([store.camera, store.regions, store.measuredChannel]);
    this.#request("regions", wish, async () => {
      const indices = store.regions.flatMap((region, index) => (region ? [index] : []));
      if (indices.length === 0) return;
      const regions = store.regions.filter((region) => region !== null);
      /** @type {import("./protocol").Regions} */
      const found = await postJson("/api/regions", { ...this.#camera(), regions, channel: store.measuredChannel });
      // A region may have been removed meanwhile.
      if (indices.some((index) => !store.regions[index])) return;
      this.regions = found;
      this.regionIndices = indices;
      store.emit("measures");
    }, () => {
      this.regions = null;
    });
  }

  #requestLine() {
    const { store } = this;
    if (!store.line) {
      this.line = null;
      this.problems.clear("line");
      store.emit("measures");
      return;
    }
    if (!this.#ready()) return;
    const wish = () => JSON.stringify([store.camera, store.line, store.measuredChannel]);
    this.#request("line", wish, async () => {
      if (!store.line) return;
      const { from, to } = store.line;
      /** @type {import("./protocol").Line} */
      const found = await postJson("/api/line", {
        ...this.#camera(), from: [from.x, from.y], to: [to.x, to.y], channel: store.measuredChannel,
      });
      if (!store.line) return;
      this.line = found;
      store.emit("measures");
    }, () => {
      this.line = null;
    });
  }

  /** @param {boolean} wanted */
  wantTransfer(wanted) {
    this.transferWanted = wanted;
    if (wanted) this.refreshTransfer();
  }

  refreshTransfer() {
    const { store } = this;
    const key = JSON.stringify([store.server?.film?.id, store.camera]);
    if (!this.#ready() || !this.transferWanted || key === this.#transferKey) return;
    this.#transferKey = key;
    this.#request("transfer", () => key, async () => {
      this.transfer = await postJson("/api/photon-transfer", { camera: store.camera });
      store.emit("measures");
    }, () => {
      this.transfer = null;
      this.#transferKey = "";
    });
  }

  #ready() {
    return this.store.connected && this.store.camera !== null && this.store.server?.film != null;
  }

  #camera() {
    return { camera: this.store.camera, frame: this.store.frameNumber };
  }

  /**
   * @param {string} key
   * @param {() => string} wish everything that the answer depends on and that the user chooses
   * @param {() => Promise<void>} work
   * @param {() => void} drop removes the values of the answer before, which are not those of this wish
   */
  #request(key, wish, work, drop) {
    if (this.#refused.get(key) === wish()) return;
    this.lane.request(key, async () => {
      const now = wish();
      if (this.#refused.get(key) === now) return;
      const { session } = this.store;
      try {
        await work();
        this.#refused.delete(key);
        this.problems.clear(key);
      } catch (error) {
        if (session !== this.store.session) return;
        drop();
        this.store.emit("measures");
        // Before the first picture: the measurement follows with the picture.
        if (isEarly(error)) return;
        if (error instanceof Fault) this.#refused.set(key, now);
        this.problems.set(key, error);
      }
    });
  }
}
