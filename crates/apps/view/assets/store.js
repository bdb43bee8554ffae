// The state of the page. Modules change it through methods and listen to topics.

/** @typedef {import("./protocol").State} State */
/** @typedef {import("./protocol").Camera} Camera */
/** @typedef {import("./protocol").Frame} Frame */
/** @typedef {import("./protocol").FilmMap} FilmMap */
/** @typedef {import("./protocol").MapName} MapName */
/** @typedef {import("./protocol").Tone} Tone */
/** @typedef {"move" | "region1" | "region2" | "line"} Tool */
/** @typedef {{ x: number, y: number }} Pixel */
/** @typedef {[number, number, number, number]} Box x0, y0, x1, y1; x1 and y1 are exclusive */
/** @typedef {{ from: Pixel, to: Pixel }} Segment */
/**
 * @typedef {"state" | "connection" | "camera" | "kept" | "view" | "frame" | "picture" | "map"
 *   | "mapChoice" | "tool" | "shapes" | "pin" | "cursor" | "probe" | "path" | "measures" | "session" | "returned"} Topic
 * `session`: the first state of a server has arrived, and what was measured at an earlier one is dropped.
 * `returned`: a change of the job has taken back knobs of the user (`returned` of the store).
 */

/**
 * The knobs after a change of the job: those that were as in the job stay so.
 * @param {Camera} knobs
 * @param {Camera} before
 * @param {Camera} after
 * @returns {Camera}
 */
function follow(knobs, before, after) {
  const keys = /** @type {(keyof Camera)[]} */ (Object.keys(after));
  const moved = keys.filter((key) => JSON.stringify(knobs[key]) !== JSON.stringify(before[key]));
  return { ...structuredClone(after), ...Object.fromEntries(moved.map((key) => [key, knobs[key]])) };
}

/**
 * A sensor that the server does not have gives way to that of the job.
 * @param {Camera} knobs
 * @param {State} state
 * @returns {Camera}
 */
function withKnownSensor(knobs, state) {
  const isKnown = knobs.sensor === null || state.sensors.length === 0
    || state.sensors.some(({ name }) => name === knobs.sensor);
  return isKnown ? knobs : { ...knobs, sensor: state.camera.sensor };
}

/**
 * A camera with the exposure of the job, where the samples are made for it.
 * @param {Camera} knobs
 * @param {State} state
 * @returns {Camera}
 */
function withTimedExposure(knobs, state) {
  // Also for knobs without a sensor: they may get one at any time.
  const isOther = state.timed !== null && state.camera.exposure !== null && knobs.exposure !== state.camera.exposure;
  return isOther ? { ...knobs, exposure: state.camera.exposure } : knobs;
}

/**
 * A camera with the f-number of the job, where the samples are those of its aperture.
 * @param {Camera} knobs
 * @param {State} state
 * @returns {Camera}
 */
function withFixedLens(knobs, state) {
  return knobs.f_number !== null && state.lens.fixed !== null ? { ...knobs, f_number: null } : knobs;
}

/**
 * A camera without factors of lights, where these have no films of their own.
 * @param {Camera} knobs
 * @param {State} state
 * @returns {Camera}
 */
function withoutUnusedLights(knobs, state) {
  return knobs.lights && !state.scene?.per_light.on ? { ...knobs, lights: null } : knobs;
}

/**
 * True where a light has another factor than in the scene.
 * @param {Camera | null} knobs
 */
function hasFactors(knobs) {
  return Object.values(knobs?.lights ?? {}).some((factor) => factor !== 1);
}

/**
 * The place of the knobs in the storage of the tab, for a page that is loaded again.
 * @param {State} state
 */
function placeOf(state) {
  return `knobs of ${state.path}`;
}

/**
 * @param {State | null} state
 * @param {Camera} camera
 */
function keepKnobs(state, camera) {
  if (!state) return;
  try {
    sessionStorage.setItem(placeOf(state), JSON.stringify({ job: state.camera, camera }));
  } catch {
    // The storage of a browser may be switched off or full: the knobs then start as in the job.
  }
}

/**
 * The knobs that this tab had, if the job has not changed since.
 * @param {State} state
 * @returns {Camera | null}
 */
function knobsOf(state) {
  if (state.width === 0) return null;
  try {
    // The text may be that of another version, or broken.
    const found = JSON.parse(sessionStorage.getItem(placeOf(state)) ?? "null");
    const isSame = JSON.stringify(found?.job) === JSON.stringify(state.camera);
    return isSame && hasKeysOf(found.camera, state.camera) ? found.camera : null;
  } catch {
    return null;
  }
}

/**
 * @param {object} found
 * @param {Camera} camera
 */
function hasKeysOf(found, camera) {
  return JSON.stringify(Object.keys(found).sort()) === JSON.stringify(Object.keys(camera).sort());
}

export class Store {
  /**
   * The newest state of the server; null until the first one of a connection.
   * @type {State | null}
   */
  server = null;
  /**
   * The settings of the job that the knobs follow. They outlive a connection.
   * @type {Camera | null}
   */
  #job = null;
  /** The frame of the job, which the number of the frame follows. */
  #jobFrame = 0;
  /**
   * The knobs that a change of the job has taken back.
   * @type {("exposure" | "lights")[]}
   */
  returned = [];
  /**
   * Size of the film of the shapes [pixels].
   * @type {[number, number]}
   */
  #size = [0, 0];
  connected = false;
  /** Counts the connections: answers of an earlier server are outdated. */
  session = 0;

  /**
   * The knobs of the picture A.
   * @type {Camera | null}
   */
  camera = null;
  /**
   * The kept knobs of the picture B.
   * @type {Camera | null}
   */
  kept = null;
  /** The number of the frame of the camera: the seed of its temporal noise. */
  frameNumber = 0;
  /** @type {Tone} */
  tone = "gamma";
  live = false;
  compare = false;
  /** Position of the line between A and B, as a share of the width of the view. */
  divider = 0.5;

  /** @type {MapName | "none"} */
  map = "none";
  mapOpacity = 1;
  /** @type {"viridis" | "cividis"} */
  mapColours = "viridis";

  /** @type {Frame | null} */
  frameA = null;
  /** @type {Frame | null} */
  frameB = null;
  /** @type {FilmMap | null} */
  filmMap = null;
  framesPerSecond = 0;

  /** @type {Tool} */
  tool = "move";
  /**
   * The filter of a colour sensor whose pixels the regions and the line measure.
   * @type {import("./protocol").Channel}
   */
  channel = "green";
  showPath = false;
  /** @type {[Box | null, Box | null]} */
  regions = [null, null];
  /** @type {Segment | null} */
  line = null;
  /** @type {Pixel | null} */
  pin = null;
  /** @type {Pixel | null} */
  cursor = null;
  /** @type {import("./protocol").Probe | null} */
  probe = null;
  /** @type {import("./protocol").LightPath | null} */
  path = null;

  /** @type {Map<Topic, (() => void)[]>} */
  #listeners = new Map();

  /**
   * @param {Topic | Topic[]} topics
   * @param {() => void} listener
   */
  on(topics, listener) {
    for (const topic of Array.isArray(topics) ? topics : [topics]) {
      const list = this.#listeners.get(topic) ?? [];
      list.push(listener);
      this.#listeners.set(topic, list);
    }
  }

  /** @param {Topic} topic */
  emit(topic) {
    for (const listener of this.#listeners.get(topic) ?? []) listener();
  }

  /** @param {State} state */
  setServer(state) {
    const isFirst = this.server === null;
    const wasLoading = this.server?.width === 0;
    const before = this.#job;
    this.server = state;
    this.#job = state.camera;
    if (isFirst) {
      this.#forget(state);
      this.emit("session");
    }
    this.#fitShapes(state);
    // The knobs start from the job. Later states must not move a knob of the user. The other knobs follow a job that has
    // been loaded or has changed.
    const isFirstJob = this.camera === null || !before;
    if ((isFirstJob || this.frameNumber === this.#jobFrame) && this.frameNumber !== state.frame) {
      this.frameNumber = state.frame;
      this.emit("frame");
    }
    this.#jobFrame = state.frame;
    if (this.camera === null || !before) {
      this.camera = knobsOf(state) ?? structuredClone(state.camera);
      this.emit("camera");
    } else if (wasLoading && JSON.stringify(this.camera) === JSON.stringify(before) && knobsOf(state)) {
      // The page was loaded again before the job was: its knobs are those of this job.
      this.camera = knobsOf(state);
      this.emit("camera");
    } else if (JSON.stringify(before) !== JSON.stringify(state.camera)) {
      this.camera = follow(this.camera, before, state.camera);
      // A job that is not loaded must not replace the knobs of the one that is.
      if (state.width > 0) keepKnobs(state, this.camera);
      if (this.kept) {
        this.kept = follow(this.kept, before, state.camera);
        this.emit("kept");
      }
      this.emit("camera");
    }
    this.#fitKnobs(state);
    this.emit("state");
  }

  /**
   * Takes back the knobs that the server of this state refuses: each picture with them would be refused.
   * @param {State} state
   */
  #fitKnobs(state) {
    /** @param {Camera} knobs */
    const fit = (knobs) => [withKnownSensor, withoutUnusedLights, withFixedLens, withTimedExposure]
      .reduce((fitted, step) => step(fitted, state), knobs);
    const { camera, kept } = this;
    const [nextCamera, nextKept] = [camera && fit(camera), kept && fit(kept)];
    if (nextCamera !== camera) {
      this.camera = nextCamera;
      if (nextCamera) keepKnobs(state, nextCamera);
      this.emit("camera");
    }
    if (nextKept !== kept) {
      this.kept = nextKept;
      this.emit("kept");
    }
    const pairs = /** @type {const} */ ([[camera, nextCamera], [kept, nextKept]]);
    const hasLost = pairs.some(([before, after]) => hasFactors(before) && !hasFactors(after));
    const isTimed = pairs.some(([before, after]) => before?.exposure !== after?.exposure);
    this.returned = [];
    if (isTimed) this.returned.push("exposure");
    if (hasLost) this.returned.push("lights");
    if (this.returned.length > 0) this.emit("returned");
  }

  /** @param {boolean} connected */
  setConnected(connected) {
    if (connected) {
      this.session += 1;
      // The state of the server before says nothing about this one.
      this.server = null;
    }
    this.connected = connected;
    this.emit("connection");
  }

  /**
   * Drops what was measured at another server. Its picture stays only where a new one of this size comes at once.
   * @param {State} state
   */
  #forget(state) {
    const { width, height } = this.frameA?.header ?? { width: 0, height: 0 };
    if (!state.film || width !== state.width || height !== state.height) this.frameA = null;
    this.frameB = null;
    this.filmMap = null;
    this.probe = null;
    this.path = null;
  }

  /**
   * Shapes outside of a film measure nothing, so they are dropped with a film of another size.
   * @param {State} state
   */
  #fitShapes({ width, height }) {
    if (width === 0 || (width === this.#size[0] && height === this.#size[1])) return;
    this.#size = [width, height];
    /** @param {Pixel | null} pixel */
    const isInside = (pixel) => pixel !== null && pixel.x < width && pixel.y < height;
    const regions = /** @type {[Box | null, Box | null]} */ (
      this.regions.map((region) => (region && region[2] <= width && region[3] <= height ? region : null)));
    const line = this.line && isInside(this.line.from) && isInside(this.line.to) ? this.line : null;
    if (line !== this.line || regions.some((region, index) => region !== this.regions[index])) {
      this.regions = regions;
      this.line = line;
      this.emit("shapes");
    }
    if (this.cursor && !isInside(this.cursor)) {
      this.cursor = null;
      this.emit("cursor");
    }
    if (this.pin && !isInside(this.pin)) this.setPin(null);
  }

  /** @param {Partial<Camera>} change */
  changeCamera(change) {
    if (!this.camera) return;
    this.camera = { ...this.camera, ...change };
    keepKnobs(this.server, this.camera);
    this.emit("camera");
  }

  /** Keeps the knobs of this moment as B. */
  keep() {
    if (!this.camera) return;
    this.kept = structuredClone(this.camera);
    this.emit("kept");
  }

  /** Exchanges the knobs of A and B. */
  swap() {
    if (!this.camera || !this.kept) return;
    [this.camera, this.kept] = [this.kept, this.camera];
    keepKnobs(this.server, this.camera);
    this.emit("camera");
    this.emit("kept");
  }

  /** @param {boolean} compare */
  setCompare(compare) {
    if (compare && !this.kept) this.keep();
    this.compare = compare;
    this.emit("view");
  }

  /** @param {number} share */
  setDivider(share) {
    this.divider = Math.min(1, Math.max(0, share));
    this.emit("view");
  }

  /** @param {boolean} live */
  setLive(live) {
    this.live = live;
    this.framesPerSecond = 0;
    this.emit("view");
  }

  /** @param {Tone} tone */
  setTone(tone) {
    this.tone = tone;
    this.emit("view");
  }

  /** @param {number} step */
  stepFrame(step = 1) {
    this.frameNumber += step;
    this.emit("frame");
  }

  /** @param {MapName | "none"} map */
  setMap(map) {
    if (this.map === map) return;
    this.map = map;
    this.filmMap = null;
    this.emit("mapChoice");
  }

  /** @param {Tool} tool */
  setTool(tool) {
    this.tool = tool;
    this.emit("tool");
  }

  /**
   * @param {0 | 1} index
   * @param {Box | null} region
   */
  setRegion(index, region) {
    this.regions[index] = region;
    this.emit("shapes");
  }

  /** @param {Segment | null} line */
  setLine(line) {
    this.line = line;
    this.emit("shapes");
  }

  /** @param {Pixel | null} pin */
  setPin(pin) {
    this.pin = pin && this.clamp(pin);
    // The values of the removed pin are not those of the pixel under the cursor.
    if (!pin) this.dropProbe();
    this.emit("pin");
  }

  /** @param {Pixel | null} cursor */
  setCursor(cursor) {
    this.cursor = cursor;
    if (!cursor && !this.pin) this.dropProbe();
    this.emit("cursor");
  }

  /** Removes the values of a pixel. */
  dropProbe() {
    this.probe = null;
    this.path = null;
    this.emit("probe");
    this.emit("measures");
  }

  /** @param {import("./protocol").Channel} channel */
  setChannel(channel) {
    this.channel = channel;
    this.emit("shapes");
  }

  /**
   * The nearest pixel of the film.
   * @param {Pixel} pixel
   * @returns {Pixel}
   */
  clamp(pixel) {
    const { width, height } = this.server ?? { width: 1, height: 1 };
    return {
      x: Math.min(width - 1, Math.max(0, Math.floor(pixel.x))),
      y: Math.min(height - 1, Math.max(0, Math.floor(pixel.y))),
    };
  }

  /**
   * True where the answer is a colour picture, with the tone applied by the server.
   * @param {Camera} camera
   */
  isColour(camera) {
    return camera.sensor === null || (this.sensorOf(camera)?.colour ?? false);
  }

  /**
   * The sensor of a camera, if it has one.
   * @param {Camera | null} camera
   */
  sensorOf(camera) {
    return this.server?.sensors.find((sensor) => sensor.name === camera?.sensor) ?? null;
  }

  /** The colour that is measured: null for a sensor without a filter. */
  get measuredChannel() {
    return this.sensorOf(this.camera)?.colour ? this.channel : null;
  }
}
