// Requests of the measurements: probe, light path, regions, line, photon transfer, ablation.

import { postJson } from "./api.js";
import { Debounce, Throttle } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").Ablation} Ablation */

const CURSOR_DELAY = 80; // ms that the pointer rests before the probe asks
const CAMERA_DELAY = 300; // ms after a knob of the camera before the ablation is read again
const FRAME_INTERVAL = 400; // ms between measurements of new frames
const TRANSFER_INTERVAL = 2000; // ms: the photon transfer needs two frames of the server
const ABLATION_INTERVAL = 400; // ms between questions for the progress

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
  /** @type {{ effect: string, result: Ablation } | null} */
  ablation = null;
  /** True after a restart has made the ablation invalid. */
  ablationIsOld = false;
  /** The number of restarts of the render that is compared. */
  #restarted = 0;

  #cursor = new Debounce(CURSOR_DELAY, () => this.probe());
  #frame = new Throttle(FRAME_INTERVAL, () => this.refresh());
  #transfer = new Throttle(TRANSFER_INTERVAL, () => this.refreshTransfer());
  /** The difference in grey values depends on the camera, so it is read again. */
  #ablation = new Debounce(CAMERA_DELAY, () => this.#askAblation());
  #onAblation = () => {};
  #transferKey = "";

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
    store.on("pin", () => this.probe());
    store.on("path", () => this.probe());
    store.on("shapes", () => this.refreshShapes());
    store.on("picture", () => {
      if (store.pin || store.cursor || store.line || store.regions.some((region) => region)) this.#frame.call();
      if (this.transferWanted) this.#transfer.call();
    });
    store.on("connection", () => {
      this.#transferKey = "";
    });
    store.on("state", () => this.#dropOldAblation());
    store.on("camera", () => {
      // The fault of a refused camera is outdated; each new answer states its own.
      for (const key of ["probe", "path", "regions", "line", "transfer", "ablation"]) problems.clear(key);
      if (this.ablation?.result.state === "finished") this.#ablation.call();
    });
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
    if (!this.#ready() || !(store.pin ?? store.cursor)) return;
    this.#request("probe", async () => {
      const pixel = store.pin ?? store.cursor;
      if (!pixel) return;
      store.probe = await postJson("/api/probe", { ...this.#camera(), x: pixel.x, y: pixel.y });
      store.emit("probe");
      if (store.showPath) this.#requestPath();
    });
  }

  #requestPath() {
    const { store } = this;
    this.#request("path", async () => {
      const pixel = store.pin ?? store.cursor;
      if (!pixel || !store.showPath) return;
      store.path = await postJson("/api/path", { x: pixel.x, y: pixel.y, index: null });
      store.emit("measures");
    });
  }

  #requestRegions() {
    const { store } = this;
    const present = store.regions.flatMap((region, index) => (region ? [index] : []));
    if (present.length === 0) {
      this.regions = null;
      store.emit("measures");
      return;
    }
    if (!this.#ready()) return;
    this.#request("regions", async () => {
      const indices = store.regions.flatMap((region, index) => (region ? [index] : []));
      if (indices.length === 0) return;
      const regions = store.regions.filter((region) => region !== null);
      this.regions = await postJson("/api/regions", { ...this.#camera(), regions });
      this.regionIndices = indices;
      store.emit("measures");
    });
  }

  #requestLine() {
    const { store } = this;
    if (!store.line) {
      this.line = null;
      store.emit("measures");
      return;
    }
    if (!this.#ready()) return;
    this.#request("line", async () => {
      if (!store.line) return;
      const { from, to } = store.line;
      this.line = await postJson("/api/line", {
        ...this.#camera(), from: [from.x, from.y], to: [to.x, to.y],
      });
      store.emit("measures");
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
    this.#request("transfer", async () => {
      this.transfer = await postJson("/api/photon-transfer", { camera: store.camera });
      store.emit("measures");
    });
  }

  /**
   * Renders without an effect, and follows the progress until the difference is known.
   * @param {string} effect
   * @param {() => void} onProgress
   */
  ablate(effect, onProgress) {
    this.ablation = { effect, result: { state: "running", fraction: 0 } };
    this.ablationIsOld = false;
    this.#restarted = this.store.server?.render.restarted ?? 0;
    this.store.ablated = effect;
    this.#onAblation = onProgress;
    onProgress();
    this.#askAblation();
  }

  /** The difference is that of one render: after a restart it is measured again. */
  #dropOldAblation() {
    if (!this.ablation || this.store.server?.render.restarted === this.#restarted) return;
    this.ablation = null;
    this.ablationIsOld = true;
    if (this.store.map === "difference") this.store.setMap("none");
    this.#onAblation();
  }

  #askAblation() {
    this.#request("ablation", async () => {
      const effect = this.ablation?.effect;
      if (effect === undefined) return;
      try {
        /** @type {Ablation} */
        const result = await postJson("/api/ablation", { effect, ...this.#camera() });
        // Another effect may have been chosen meanwhile; it has a request of its own.
        if (this.ablation?.effect !== effect) return;
        this.ablation = { effect, result };
        if (result.state !== "finished") setTimeout(() => this.#askAblation(), ABLATION_INTERVAL);
      } catch (error) {
        this.ablation = null;
        throw error;
      } finally {
        this.#onAblation();
      }
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
   * @param {() => Promise<void>} work
   */
  #request(key, work) {
    this.lane.request(key, async () => {
      try {
        await work();
        this.problems.clear(key);
      } catch (error) {
        this.problems.set(key, error);
      }
    });
  }
}
