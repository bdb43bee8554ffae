// Requests to the server, and its answers as typed values.

/** @typedef {import("./protocol").Fault} FaultText */

/** An answer of the server that states a problem. */
export class Fault extends Error {
  /**
   * @param {number} status
   * @param {FaultText} text
   */
  constructor(status, text) {
    super(text.problem);
    this.status = status;
    this.text = text;
  }
}

/** The server gave no answer. */
export class Unreachable extends Error {}

/** The page no longer wants the answer. */
export class Withdrawn extends Error {}

const HIDDEN_DELAY = 10_000; // ms after which a hidden page closes its stream of events
const EARLY = 409; // status of a request about a picture before the first one

/**
 * True for a request that the server will answer later, when it has a picture.
 * @param {unknown} error
 */
export function isEarly(error) {
  return error instanceof Fault && error.status === EARLY;
}

/**
 * @param {string} path
 * @param {unknown} body
 * @param {AbortSignal} [signal] withdraws the request
 * @returns {Promise<Response>}
 */
async function post(path, body, signal) {
  let answer;
  try {
    answer = await fetch(path, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify(body),
      ...(signal ? { signal } : {}),
    });
  } catch {
    if (signal?.aborted) throw new Withdrawn("The request was withdrawn.");
    throw new Unreachable("The server does not answer.");
  }
  if (!answer.ok) throw new Fault(answer.status, await readFault(answer));
  return answer;
}

/**
 * A proxy or a crash may answer without the JSON of the contract, so nothing is assumed here.
 * @param {Response} answer
 * @returns {Promise<FaultText>}
 */
async function readFault(answer) {
  const plain = { problem: `The server answered with status ${answer.status}.`, place: null, help: null };
  try {
    const found = await answer.json();
    return typeof found?.problem === "string"
      ? { problem: found.problem, place: found.place ?? null, help: found.help ?? null }
      : plain;
  } catch {
    return plain;
  }
}

/**
 * @template T
 * @param {string} path
 * @param {unknown} body
 * @returns {Promise<T>}
 */
export async function postJson(path, body) {
  const answer = await post(path, body);
  try {
    return /** @type {T} */ (await answer.json());
  } catch {
    throw new Unreachable("The answer of the server ended early.");
  }
}

/**
 * Header and payload of a binary answer.
 * @template H
 * @param {string} path
 * @param {unknown} body
 * @param {AbortSignal} [signal]
 * @returns {Promise<{ header: H, buffer: ArrayBuffer, offset: number }>}
 */
async function postBinary(path, body, signal) {
  const answer = await post(path, body, signal);
  let buffer;
  try {
    buffer = await answer.arrayBuffer();
  } catch {
    if (signal?.aborted) throw new Withdrawn("The request was withdrawn.");
    throw new Unreachable("The answer of the server ended early.");
  }
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  // The payload starts at a multiple of 4, so a typed array can view it without a copy. All
  // platforms with a browser are little-endian, as the payload is.
  return { header, buffer, offset: Math.ceil((4 + length) / 4) * 4 };
}

/**
 * `statistics`: the camera becomes that of the statistics.
 * @param {{ camera: import("./protocol").Camera, frame: number, tone: import("./protocol").Tone, statistics: boolean }} body
 * @param {AbortSignal} signal
 * @returns {Promise<import("./protocol").Frame>}
 */
export async function requestFrame(body, signal) {
  /** @type {{ header: import("./protocol").FrameHeader, buffer: ArrayBuffer, offset: number }} */
  const { header, buffer, offset } = await postBinary("/api/frame", body, signal);
  const pixels = header.width * header.height;
  const values = header.format === "gray16"
    ? new Uint16Array(buffer, offset, pixels)
    : new Uint8Array(buffer, offset, 3 * pixels);
  return { header, values, camera: body.camera };
}

/**
 * @param {{ camera: import("./protocol").Camera, map: import("./protocol").MapName }} body
 * @returns {Promise<import("./protocol").FilmMap>}
 */
export async function requestMap(body) {
  /** @type {{ header: import("./protocol").MapHeader, buffer: ArrayBuffer, offset: number }} */
  const { header, buffer, offset } = await postBinary("/api/map", body);
  return { header, values: new Float32Array(buffer, offset, header.width * header.height) };
}

/**
 * True where the state can be a later one of the same server.
 * @param {import("./protocol").State} state
 * @param {import("./protocol").State | null} before
 */
function isLater(state, before) {
  return before !== null && state.path === before.path && state.render.restarted >= before.render.restarted
    && (state.film?.id ?? 0) >= (before.film?.id ?? 0);
}

/**
 * Follows the state of the server, and connects again by itself. A server counts as connected from its first state on:
 * until then the page knows nothing about its film. A page that nobody sees closes its stream of events after a while,
 * because a browser has six connections to a server, and each stream occupies one. It still counts as connected.
 * @param {(state: import("./protocol").State) => void} onState
 * @param {(connected: boolean) => void} onConnection
 */
export function followState(onState, onConnection) {
  let wait = 500;
  /** @type {EventSource | null} */
  let source = null;
  /**
   * The last state before the stream was closed for a hidden page.
   * @type {import("./protocol").State | null}
   */
  let left = null;
  /** @type {import("./protocol").State | null} */
  let last = null;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let retry;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let leave;
  const connect = () => {
    const opened = new EventSource("/api/events");
    source = opened;
    let received = false;
    /** @param {import("./protocol").State} state */
    const receive = (state) => {
      if (!received && !isLater(state, left)) onConnection(true);
      received = true;
      left = null;
      last = state;
      onState(state);
    };
    opened.addEventListener("open", async () => {
      wait = 500;
      // The events may start with the next change, which can be far away when nothing renders.
      try {
        const answer = await fetch("/api/state");
        const state = await answer.json();
        if (answer.ok && !received && source === opened) receive(state);
      } catch {
        // The source of the events reports a lost connection itself.
      }
    });
    opened.addEventListener("state", (event) => receive(JSON.parse(event.data)));
    opened.addEventListener("error", () => {
      // The browser gives up after some kinds of error, so the page makes a new connection itself.
      opened.close();
      source = null;
      left = null;
      last = null;
      onConnection(false);
      retry = setTimeout(connect, wait);
      wait = Math.min(wait * 1.5, 4000);
    });
  };
  const followVisibility = () => {
    clearTimeout(leave);
    if (document.hidden) {
      leave = setTimeout(() => {
        clearTimeout(retry);
        source?.close();
        source = null;
        left = last;
      }, HIDDEN_DELAY);
    } else if (source === null) {
      clearTimeout(retry);
      connect();
    }
  };
  document.addEventListener("visibilitychange", followVisibility);
  connect();
  followVisibility();
}
