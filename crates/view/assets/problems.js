// Problems over the image: faults of requests and of the render. They never move the layout.

import { Fault, Unreachable } from "./api.js";
import { box, element } from "./dom.js";

/** @typedef {import("./protocol").Fault} FaultText */

export class Problems {
  /** @type {Map<string, FaultText>} */
  #list = new Map();
  /**
   * Texts that the user closed; they stay closed until they change.
   * @type {Map<string, string>}
   */
  #closed = new Map();

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
    if (JSON.stringify(this.#list.get(key)) === JSON.stringify(text)) return;
    if (this.#closed.get(key) === JSON.stringify(text)) return;
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

  /** Two requests with the same fault need one message. */
  #show() {
    /** @type {Map<string, string[]>} */
    const keys = new Map();
    for (const [key, text] of this.#list) {
      const content = JSON.stringify(text);
      keys.set(content, [...(keys.get(content) ?? []), key]);
    }
    box("problems").replaceChildren(...[...keys].map(([content, list]) => {
      /** @type {FaultText} */
      const { problem, place, help } = JSON.parse(content);
      const close = element("button", { type: "button", title: "Closes this message" }, "Close");
      close.addEventListener("click", () => list.forEach((key) => this.#close(key)));
      return element("div", { class: "problem" }, element("b", {}, problem), close,
        ...(place ? [element("span", {}, place)] : []),
        ...(help ? [element("span", {}, help)] : []));
    }));
  }
}
