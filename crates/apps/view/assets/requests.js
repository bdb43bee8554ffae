// Order of the requests: lanes with one request in flight, debounced calls, and the idle state.

let active = 0;
/** @type {(() => void)[]} */
let waiters = [];

function begin() {
  active += 1;
}

function end() {
  active -= 1;
  if (active > 0) return;
  // The wait of one task lets the code behind the answer ask for more first.
  setTimeout(() => {
    if (active > 0) return;
    const ready = waiters;
    waiters = [];
    for (const wake of ready) wake();
  }, 0);
}

/**
 * Resolves when no request is in flight and no debounced call waits.
 * @returns {Promise<void>}
 */
export function idle() {
  return new Promise((resolve) => {
    waiters.push(resolve);
    begin();
    end();
  });
}

/**
 * Counts a piece of work as activity.
 * @template T
 * @param {() => Promise<T>} work
 * @returns {Promise<T>}
 */
export async function tracked(work) {
  begin();
  try {
    return await work();
  } finally {
    end();
  }
}

/**
 * Runs one piece of work at a time. Work that waits is replaced by newer work of the same key, so
 * a slow server never gets a queue of outdated requests. Keys take turns in their order of arrival.
 */
export class Lane {
  /** @type {Map<string, () => Promise<void>>} */
  #waiting = new Map();
  #running = false;
  #onError;

  /** @param {(error: unknown, key: string) => void} onError */
  constructor(onError) {
    this.#onError = onError;
  }

  get busy() {
    return this.#running;
  }

  /**
   * @param {string} key
   * @param {() => Promise<void>} work reads its inputs when it starts, not when it is requested
   */
  request(key, work) {
    this.#waiting.set(key, work);
    if (!this.#running) void this.#run();
  }

  async #run() {
    this.#running = true;
    begin();
    for (;;) {
      const next = this.#waiting.entries().next();
      if (next.done) break;
      const [key, work] = next.value;
      this.#waiting.delete(key);
      try {
        await work();
      } catch (error) {
        this.#onError(error, key);
      }
    }
    this.#running = false;
    end();
  }
}

/** Calls a function once, when a time has passed since the last call. */
export class Debounce {
  #delay;
  #work;
  /** @type {ReturnType<typeof setTimeout> | null} */
  #timer = null;

  /**
   * @param {number} delay ms
   * @param {() => void} work
   */
  constructor(delay, work) {
    this.#delay = delay;
    this.#work = work;
  }

  get waiting() {
    return this.#timer !== null;
  }

  call() {
    if (this.#timer === null) begin();
    else clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.#timer = null;
      this.#work();
      end();
    }, this.#delay);
  }
}

/** Calls a function at once, and again at the end of each interval with further calls. */
export class Throttle {
  #interval;
  #work;
  #last = -Infinity;
  /** @type {ReturnType<typeof setTimeout> | null} */
  #timer = null;

  /**
   * @param {number} interval ms
   * @param {() => void} work
   */
  constructor(interval, work) {
    this.#interval = interval;
    this.#work = work;
  }

  call() {
    if (this.#timer !== null) return;
    const wait = Math.max(0, this.#last + this.#interval - performance.now());
    begin();
    this.#timer = setTimeout(() => {
      this.#timer = null;
      this.#last = performance.now();
      this.#work();
      end();
    }, wait);
  }
}
