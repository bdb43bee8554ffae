// Problems over the image: faults of requests and of the render. They never move the layout.

import { Fault, Unreachable } from "./api.js";
import { box, element } from "./dom.js";

/** @typedef {import("./protocol").Fault} FaultText */

const SHOWN_FOR = 20_000; // ms
const MOST = 3; // messages at the same time
/** Faults that are there until the server or a picture without the fault ends them. */
const LASTING = new Set(["render", "a", "b", "map"]);

export class Problems {
  /** @type {Map<string, FaultText>} */
  #list = new Map();
  /**
   * Texts that the user closed; they stay closed until they change.
   * @type {Map<string, string>}
   */
  #closed = new Map();
  /** @type {Map<string, ReturnType<typeof setTimeout>>} */
  #timers = new Map();

  /**
   * @param {string} key
   * @param {unknown} error
   */
  set(key, error) {
    // The header states a lost connection already.
    if (error instanceof Unreachable) return;
    if (error instanceof Fault) this.setText(key, error.text);
    else this.setText(key, { problem: String(error instanceof Error ? error.message : error), place: null, help: null });
  }

  /**
   * @param {string} key
   * @param {FaultText | null} text
   */
  setText(key, text) {
    if (!text) {
      this.clear(key);
      return;
    }
    clearTimeout(this.#timers.get(key));
    if (!LASTING.has(key)) this.#timers.set(key, setTimeout(() => this.clear(key), SHOWN_FOR));
    if (JSON.stringify(this.#list.get(key)) === JSON.stringify(text)) return;
    if (this.#closed.get(key) === JSON.stringify(text)) return;
    // The newest message is the last one.
    this.#list.delete(key);
    this.#list.set(key, text);
    this.#show();
  }

  /** @param {string} key */
  clear(key) {
    this.#closed.delete(key);
    if (this.#list.delete(key)) this.#show();
  }

  /** @param {string} key */
  #close(key) {
    const text = this.#list.get(key);
    if (text && this.#list.delete(key)) this.#closed.set(key, JSON.stringify(text));
    this.#show();
  }

  /** Requests with the same fault need one message. Of many faults, the newest are shown. */
  #show() {
    /** @type {Map<string, string[]>} */
    const keys = new Map();
    for (const [key, text] of this.#list) {
      keys.set(text.problem, [...(keys.get(text.problem) ?? []), key]);
    }
    const more = keys.size - MOST;
    const rest = more > 0 ? [element("div", { class: "problem more" }, `${more} earlier ${more === 1 ? "message" : "messages"}`)] : [];
    box("problems").replaceChildren(...rest, ...[...keys].slice(-MOST).map(([problem, list]) => {
      const { place, help } = this.#list.get(list.at(-1) ?? "") ?? { place: null, help: null };
      const close = element("button", { type: "button", title: "Closes this message" }, "Close");
      close.addEventListener("click", () => list.forEach((key) => this.#close(key)));
      return element("div", { class: "problem" }, element("b", {}, problem), close,
        ...(place ? [element("span", {}, place)] : []),
        ...(help ? [element("span", {}, help)] : []));
    }));
  }
}
