// Saving of files.

import { postJson } from "./api.js";
import { allow, box, button, element, input, setText, setValue } from "./dom.js";
import { tracked } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").SaveKind} SaveKind */

/** @type {SaveKind[]} */
const KINDS = ["png", "tiff", "exr", "film", "job"];

/**
 * The reason why files of a kind cannot be saved; null where they can.
 * @param {SaveKind} kind
 * @param {import("./protocol").State | null} state
 * @returns {string | null}
 */
function refusal(kind, state) {
  if (state?.source === "exr" && kind !== "png" && kind !== "tiff") return "An EXR has no samples and no scene";
  if (kind === "film" && state?.source === "film") return "Nothing renders here: the file that is shown has all samples";
  if (kind === "job" && state?.source === "film") return "A saved film has no scene, so there is no job";
  return null;
}

/**
 * @param {SaveKind} kind
 * @param {string | null} reason
 */
function allowKind(kind, reason) {
  const target = input(`save-${kind}`);
  allow(target, reason, target.closest("label") ?? target);
  if (reason !== null) target.checked = false;
}

/**
 * @param {Store} store
 * @param {{ set(key: string, error: unknown): void, clear(key: string): void }} problems
 */
export function savePanel(store, problems) {
  /** The name that was suggested: a name of the user stays. */
  let suggested = "";
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
    if (store.server && input("save-name").value === suggested) {
      // The stem alone is the name of the job, which is never replaced.
      suggested = `${store.server.title.replace(/\.[^.]*$/, "")}-view`;
      setValue(input("save-name"), suggested);
    }
    for (const kind of KINDS) allowKind(kind, refusal(kind, store.server));
    showSaved();
  });
  store.on("session", () => {
    answered = [];
  });

  const save = async () => {
    // A message of the attempt before is outdated.
    problems.clear("save");
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
      /** @type {{ files: string[], note: string | null }} */
      const { files, note } = await postJson("/api/save", {
        what, name, camera: store.camera, frame: store.frameNumber,
      });
      answered = [...answered, ...files];
      setText(box("save-result"), `Saved ${files.length} ${files.length === 1 ? "file" : "files"}.${note === null ? "" : ` ${note}`}`);
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
