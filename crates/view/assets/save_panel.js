// Saving of files.

import { postJson } from "./api.js";
import { box, button, element, input, setText } from "./dom.js";
import { tracked } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").SaveKind} SaveKind */

/** @type {SaveKind[]} */
const KINDS = ["png", "tiff", "exr", "checkpoint", "job"];

/**
 * @param {Store} store
 * @param {{ set(key: string, error: unknown): void, clear(key: string): void }} problems
 */
export function savePanel(store, problems) {
  let named = false;
  /**
   * Files of answers that no state event contains yet.
   * @type {string[]}
   */
  let answered = [];

  const showSaved = () => {
    const files = [...new Set([...(store.server?.saved ?? []), ...answered])];
    const list = box("saved");
    if (list.dataset["files"] === JSON.stringify(files)) return;
    list.dataset["files"] = JSON.stringify(files);
    list.replaceChildren(...files.map((file) => element("li", {}, file)));
  };

  store.on("state", () => {
    if (!named && store.server) {
      named = true;
      // The stem of the file is the natural name; an existing file is never replaced.
      input("save-name").value = store.server.title.replace(/\.[^.]*$/, "");
    }
    showSaved();
  });

  const save = async () => {
    const what = KINDS.filter((kind) => input(`save-${kind}`).checked);
    const name = input("save-name").value.trim();
    if (what.length === 0 || name === "") {
      setText(box("save-result"), what.length === 0 ? "Choose at least one file." : "Type a name.");
      return;
    }
    if (/[\\/]/.test(name)) {
      setText(box("save-result"), "The name must not contain a folder.");
      return;
    }
    button("save").disabled = true;
    setText(box("save-result"), "Saving\u2026");
    try {
      /** @type {{ files: string[] }} */
      const { files } = await postJson("/api/save", {
        what, name, camera: store.camera, frame: store.frameNumber,
      });
      answered = [...answered, ...files];
      setText(box("save-result"), `Saved ${files.length} ${files.length === 1 ? "file" : "files"}.`);
      problems.clear("save");
      showSaved();
    } catch (error) {
      setText(box("save-result"), "Nothing was saved.");
      problems.set("save", error);
    } finally {
      button("save").disabled = false;
    }
  };
  button("save").addEventListener("click", () => void tracked(save));
}
