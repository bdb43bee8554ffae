// The keys of the page, and their list.

import { box, button, byId, element, input } from "./dom.js";

/**
 * `key`: as `KeyboardEvent.key`; `shown`: the text of the list.
 * @typedef {{ key: string, shown?: string, shift?: boolean, text: string, run: () => unknown }} Key
 */

/**
 * @param {Key[]} keys
 * @param {() => void} save
 */
export function followKeys(keys, save) {
  const dialog = byId("help", HTMLDialogElement);
  const list = [
    ...keys,
    { key: "?", text: "open this list", run: () => dialog.showModal() },
  ];
  box("help-keys").replaceChildren(
    ...list.filter(({ text }) => text !== "").map(({ key, shown, text }) => element("div", {},
      element("dt", {}, shown ?? key), element("dd", {}, text))));
  button("help-open").addEventListener("click", () => dialog.showModal());
  button("help-close").addEventListener("click", () => dialog.close());

  document.addEventListener("keydown", (event) => {
    if (dialog.open) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "s") {
      event.preventDefault();
      save();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (isTaken(event)) return;
    const found = list.find(({ key, shift }) =>
      key.toLowerCase() === event.key.toLowerCase() && (shift === undefined || shift === event.shiftKey));
    if (!found) return;
    // Keys with a name of several letters do not collide with speech input.
    if (found.key.length === 1 && found.key !== "?" && !input("keys-on").checked) return;
    event.preventDefault();
    found.run();
  });
}

/**
 * True where the focused control needs the key itself.
 * @param {KeyboardEvent} event
 */
function isTaken(event) {
  const { target, key } = event;
  if (target instanceof HTMLSelectElement) return key !== "Escape";
  if (target instanceof HTMLInputElement) {
    if (target.type === "range") return key.startsWith("Arrow");
    if (target.type === "checkbox" || target.type === "color") return key === "Enter";
    return key !== "Escape";
  }
  const press = target instanceof HTMLButtonElement || (target instanceof HTMLElement && target.tagName === "SUMMARY");
  return press && key === "Enter";
}
