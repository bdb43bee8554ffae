// The header: title, progress, connection, notes, colours.

import { box, button, byId, element, setText, show } from "./dom.js";
import { duration, percent } from "./format.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").Render} Render */
/** @typedef {import("./protocol").Film} Film */

/** Below this share of the time of its threads, a render is slowed by other programs. */
const STARVED = 0.5;
const THEMES = ["system", "light", "dark"];
const THEME_KEY = "dunkelfeld-colours";

/**
 * @param {Store} store
 * @param {(path: string, body: unknown) => Promise<boolean>} act
 * @param {import("./problems.js").Problems} problems
 */
export function header(store, act, problems) {
  store.on("state", () => {
    const state = store.server;
    if (!state) return;
    setText(box("title"), state.title);
    box("title").title = state.path;
    document.title = `${state.title} \u2013 dunkelfeld view`;
    setText(box("version"), `dunkelfeld ${state.version}`);
    showProgress(state.render, state.film);
    showNotes(state.notes);
    problems.setText("render", state.error);
    setText(box("empty"), state.error ? "There is no picture" : `Waiting for the first picture (${state.render.stage})`);
  });
  store.on(["picture", "state"], () => show(box("empty"), store.frameA === null));
  store.on("connection", () => {
    box("connection").dataset["state"] = store.connected ? "on" : "lost";
    setText(box("connection"), store.connected ? "connected" : "disconnected: reconnecting");
  });
  button("pause").addEventListener("click", () => pause(store, act));
  button("restart").addEventListener("click", () => void act("/api/render", { action: "restart" }));
  button("notes-open").addEventListener("click", () => showNotesList(box("notes").hidden));
  button("theme").addEventListener("click", nextTheme);
  applyTheme(readTheme());
}

/** @param {boolean} open */
function showNotesList(open) {
  show(box("notes"), open);
  button("notes-open").setAttribute("aria-expanded", String(open));
}

/**
 * Closes the list of notes.
 * @returns {boolean} true if it was open
 */
export function closeNotes() {
  const open = !box("notes").hidden;
  if (open) showNotesList(false);
  return open;
}

/**
 * Pauses the render or continues it.
 * @param {Store} store
 * @param {(path: string, body: unknown) => Promise<boolean>} act
 */
export function pause(store, act) {
  const paused = store.server?.render.state === "paused";
  if (button("pause").disabled) return;
  void act("/api/render", { action: paused ? "resume" : "pause" });
}

/**
 * @param {Render} render
 * @param {Film | null} film
 */
function showProgress(render, film) {
  const { state, stage, fraction, elapsed, remaining, reason } = render;
  const work = film?.earlier ? `${stage}: earlier picture` : film?.first ? `${stage}: coarse picture` : stage;
  const words = { loading: work, running: work, paused: `paused: ${work}`, finished: reason ?? "finished", failed: reason ?? "failed", none: "finished samples" };
  const { processor_share: share } = render;
  const isStarved = state === "running" && share !== null && share < STARVED;
  box("progress").dataset["starved"] = String(isStarved);
  setText(box("stage-text"), isStarved ? `${work}: slowed to ${percent(share)} by other programs` : words[state]);
  box("progress").title = isStarved
    ? `The threads of the render get ${percent(share)} of their time. End other programs, or start the view with a smaller --nice` : reason ?? "Stage and progress of the render";
  setText(box("time-text"), state === "none" ? ""
    : remaining !== null && state === "running" ? `${duration(elapsed)}, ${duration(remaining)} left` : duration(elapsed));
  byId("progress-bar", HTMLProgressElement).value = state === "none" ? 1 : fraction;
  setText(button("pause"), state === "paused" ? "Continue" : "Pause");
  button("pause").disabled = state !== "running" && state !== "paused";
  button("restart").disabled = state === "none" || state === "loading";
}

/** @param {import("./protocol").Note[]} notes */
function showNotes(notes) {
  setText(box("notes-count"), String(notes.length));
  button("notes-open").disabled = notes.length === 0;
  if (notes.length === 0) showNotesList(false);
  const list = box("notes-list");
  const content = JSON.stringify(notes);
  if (list.dataset["content"] === content) return;
  list.dataset["content"] = content;
  list.replaceChildren(...notes.map(({ level, text, help }) => element("li", { "data-level": level },
    element("b", {}, level === "warning" ? "Warning: " : "Remark: "), text,
    ...(help ? [element("div", { class: "help" }, help)] : []))));
}

/** The storage of a browser may be switched off; the colours then follow the system. */
function readTheme() {
  try {
    return localStorage.getItem(THEME_KEY) ?? "system";
  } catch {
    return "system";
  }
}

/** @param {string} theme */
function applyTheme(theme) {
  const known = THEMES.includes(theme) ? theme : "system";
  document.documentElement.dataset["theme"] = known;
  setText(button("theme"), `Colours: ${known}`);
}

/** Goes to the next choice of the colours. */
export function nextTheme() {
  const now = document.documentElement.dataset["theme"] ?? "system";
  const next = THEMES[(THEMES.indexOf(now) + 1) % THEMES.length] ?? "system";
  applyTheme(next);
  try {
    localStorage.setItem(THEME_KEY, next);
  } catch {
    // Without storage the choice holds until the page is closed.
  }
}
