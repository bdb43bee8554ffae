// Small helpers for the document. Text is always set as text, never as HTML.

const SVG = "http://www.w3.org/2000/svg";

/**
 * The element of an id. A missing or wrong element is an error of the page itself.
 * @template {Element} T
 * @param {string} id
 * @param {new () => T} type
 * @returns {T}
 */
export function byId(id, type) {
  const found = document.getElementById(id);
  if (!(found instanceof type)) throw new Error(`The page has no ${type.name} with the id ${id}.`);
  return found;
}

/** @param {string} id */
export const input = (id) => byId(id, HTMLInputElement);
/** @param {string} id */
export const select = (id) => byId(id, HTMLSelectElement);
/** @param {string} id */
export const button = (id) => byId(id, HTMLButtonElement);
/** @param {string} id */
export const box = (id) => byId(id, HTMLElement);

/**
 * A new element.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, string | number | boolean>} attributes false leaves an attribute out
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  setAttributes(made, attributes);
  made.append(...children);
  return made;
}

/**
 * A new SVG element.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, string | number | boolean>} attributes
 * @param {...(Node | string)} children
 * @returns {SVGElementTagNameMap[K]}
 */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  setAttributes(made, attributes);
  made.append(...children);
  return made;
}

/**
 * @param {Element} target
 * @param {Record<string, string | number | boolean>} attributes
 */
function setAttributes(target, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false) continue;
    target.setAttribute(name, value === true ? "" : String(value));
  }
}

/**
 * Sets a text only where it changes, so that a screen reader does not read it again.
 * @param {Element} target
 * @param {string} text
 */
export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/**
 * Replaces the options of a select, and keeps the selection.
 * @param {HTMLSelectElement} target
 * @param {{ value: string, text: string }[]} options
 */
export function setOptions(target, options) {
  const now = [...target.options].map((option) => `${option.value}\n${option.text}`).join("\n\n");
  const next = options.map((option) => `${option.value}\n${option.text}`).join("\n\n");
  if (now === next) return;
  const value = target.value;
  target.replaceChildren(...options.map(({ value, text }) => element("option", { value }, text)));
  target.value = value;
}

/**
 * Shows or hides an element.
 * @param {HTMLElement | SVGElement} target
 * @param {boolean} visible
 */
export function show(target, visible) {
  target.toggleAttribute("hidden", !visible);
}

/**
 * Disables a control that has no effect, with the reason as its tooltip.
 * @param {HTMLInputElement | HTMLSelectElement | HTMLOptionElement} target
 * @param {string | null} reason null: the control has an effect
 * @param {HTMLElement} owner the element with the tooltip
 */
export function allow(target, reason, owner = target) {
  owner.dataset["help"] ??= owner.title;
  const title = reason ?? owner.dataset["help"];
  if (owner.title !== title) owner.title = title;
  target.disabled = reason !== null;
}

/**
 * Sets the state of a button that stays pressed.
 * @param {HTMLElement} target
 * @param {boolean} pressed
 */
export function press(target, pressed) {
  target.setAttribute("aria-pressed", String(pressed));
}

/**
 * Writes a value to a control that the user does not edit at this moment.
 * @param {HTMLInputElement | HTMLSelectElement} target
 * @param {string} value
 */
export function setValue(target, value) {
  const typed = document.activeElement === target && target instanceof HTMLInputElement
    && (target.type === "text" || target.type === "number");
  if (!typed && target.value !== value) target.value = value;
}
