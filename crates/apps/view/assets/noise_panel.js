// The verdict, and the plot of the noise level against time with its target.

import {
  forecastNote, foretoldLevels, isFinished, levelMeaning, levelNow, measuredLevels, ownStatistics, timeOfLevel,
  timeSentence, verdict,
} from "./accuracy.js";
import { drawPlot, placer, plotArea } from "./chart.js";
import { box, button, byId, input, setText, setValue, svg } from "./dom.js";
import { bigCount, count, number, percent, plain } from "./format.js";
import { Debounce } from "./requests.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./protocol").State} State */

const WIDTH = 352;
const HEIGHT = 220;
const LOWEST = 0.05;
const HIGHEST = 4;
// Times that people use: a decimal tick of 200 s would read "3 min 20 s".
const TIMES = [
  0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 18000, 36000, 86400, 172800,
];
const KEY_STEP = 1.1; // one key press changes the target by 10 %

/**
 * The short text of a time of `TIMES`.
 * @param {number} seconds
 */
function timeLabel(seconds) {
  if (seconds < 60) return `${plain(seconds, 2)} s`;
  return seconds < 3600 ? `${seconds / 60} min` : `${seconds / 3600} h`;
}

/** @typedef {{ x: number, k: number }} Place a point of the plot: seconds, or samples per pixel of a file */

/**
 * @param {State} state
 * @returns {{ measured: Place[], foretold: Place[] }}
 */
function timesOfRender(state) {
  const place = (/** @type {import("./accuracy.js").Level} */ { seconds, k }) => ({ x: seconds, k });
  const measured = measuredLevels(state).map(place);
  const last = measured.at(-1);
  return { measured, foretold: foretoldLevels(state).map(place).filter((point) => !last || point.x > last.x) };
}

/**
 * The level of the samples of a file, and the root law up to the target.
 * @param {State} state
 * @returns {{ measured: Place[], foretold: Place[] }}
 */
function samplesOfFile(state) {
  const k = levelNow(state);
  const spp = state.film?.spp ?? 0;
  if (k === null || !(spp > 0)) return { measured: [], foretold: [] };
  const foretold = k > state.target ? [{ x: spp * (k / state.target) ** 2, k: state.target }] : [];
  return { measured: [{ x: spp, k }], foretold };
}

export class NoisePanel {
  /**
   * The target while it is dragged, before the server has it.
   * @type {number | null}
   */
  #pending = null;
  #send = new Debounce(150, () => void this.#sendTarget());
  #plot = byId("curve", SVGSVGElement);
  /** @type {(value: number) => number} */
  #toLevel = () => 1;

  /**
   * @param {Store} store
   * @param {import("./problems.js").Problems} problems
   * @param {(path: string, body: unknown) => Promise<boolean>} act
   */
  constructor(store, problems, act) {
    this.store = store;
    this.act = act;
    store.on("state", () => this.show());
    store.on("picture", () => {
      const shown = this.#shown();
      if (shown) this.#showVerdict(shown);
    });
    input("target").addEventListener("change", () => {
      const text = input("target").value;
      const k = Number(text);
      const isLevel = text !== "" && k >= LOWEST && k <= HIGHEST;
      problems.setText("target", isLevel ? null : {
        problem: text === "" ? "The target is not a number." : `The target ${number(k)} is out of range.`,
        place: null, help: `Type ${LOWEST} to ${HIGHEST}.`,
      });
      if (isLevel) this.setTarget(k);
      else input("target").value = String(this.target);
    });
    button("target-reset").addEventListener("click", () => this.setTarget(0.5));
    this.#followDrag();
  }

  get target() {
    return this.#pending ?? this.store.server?.target ?? 0.5;
  }

  /**
   * The state with the target of this moment and the statistics of the picture A.
   * @returns {State | null}
   */
  #shown() {
    const { server, camera, frameA } = this.store;
    return server && { ...ownStatistics(server, [camera, frameA?.camera ?? null]), target: this.target };
  }

  /** @param {number} k */
  setTarget(k) {
    if (!Number.isFinite(k)) return;
    this.#pending = Number(Math.min(HIGHEST, Math.max(LOWEST, k)).toPrecision(3));
    this.show();
    this.#send.call();
  }

  /** @param {1 | -1} direction */
  stepTarget(direction) {
    this.setTarget(this.target * KEY_STEP ** direction);
  }

  async #sendTarget() {
    const sent = this.#pending;
    if (sent === null) return;
    await this.act("/api/target", { k: sent });
    // The state events bring the new target; until then the line must not jump back.
    setTimeout(() => {
      if (this.#pending !== sent) return;
      this.#pending = null;
      this.show();
    }, 800);
  }

  show() {
    const shown = this.#shown();
    if (!shown) return;
    this.#showVerdict(shown);
    this.#showNumbers(shown);
    if (!box("panel-noise").hidden) this.#drawCurve(shown);
  }

  /** @param {State} state */
  #showVerdict(state) {
    const { level, title, text, isVoid } = verdict(state, this.store.frameA?.header);
    box("verdict").dataset["level"] = level;
    const k = levelNow(state);
    // The level changes with each event; a screen reader reads only the verdict itself.
    setText(box("verdict-name"), title);
    setText(box("verdict-k"), k === null || isVoid ? "" : `(k = ${number(k, 2)})`);
    setText(box("verdict-text"), text);
    setText(box("verdict-time"), isVoid ? "" : timeSentence(state, state.target));
  }

  /** @param {State} state */
  #showNumbers(state) {
    setValue(input("target"), String(state.target));
    setText(box("target-time"), timeSentence(state, state.target));
    setText(box("target-meaning"), levelMeaning(state.target));
    setText(box("forecast-note"), forecastNote(state));
    const { certificate, film, render } = state;
    setText(box("noise-k99"), number(levelNow(state)));
    // The certificate may still be that of an earlier target.
    setText(box("noise-hidden"), percent(certificate?.k === state.target ? certificate.hidden : null));
    setText(box("noise-median"), number(certificate?.median));
    setText(box("noise-saturated"), count(certificate?.saturated));
    setText(box("noise-spp"), film ? number(film.spp, 4) : number(null));
    setText(box("noise-rate"), render.samples_per_second > 0
      ? bigCount(render.samples_per_second) : number(null));
  }

  /** @param {State} state */
  #drawCurve(state) {
    const finished = isFinished(state);
    const { measured, foretold } = finished ? samplesOfFile(state) : timesOfRender(state);
    const last = measured.at(-1);
    const all = [...measured, ...foretold];
    const places = all.map((point) => point.x);
    const levels = [...all.map((point) => point.k), state.target];
    const x = {
      low: all.length > 0 ? Math.min(...places) / 1.15 : 0.1,
      high: all.length > 0 ? Math.max(...places) * 1.3 : 100,
      log: true,
      ...(finished
        ? { label: "samples per pixel", format: (/** @type {number} */ spp) => plain(spp, 2) }
        : { label: "time of the render", steps: TIMES, format: timeLabel }),
    };
    // The limits of the level move in coarse steps, so that the plot does not jump with each event.
    const y = {
      low: Math.min(0.2, ...levels.map((k) => 2 ** Math.floor(Math.log2(k / 1.1)))),
      high: Math.max(2, ...levels.map((k) => 2 ** Math.ceil(Math.log2(k * 1.1)))),
      log: true, label: "noise level k", format: (/** @type {number} */ k) => plain(k, 1),
    };
    /** @param {Place[]} points */
    const columns = (points) => ({ x: points.map((p) => p.x), y: points.map((p) => p.k) });
    // The line is made again with the plot, so its focus moves to the new one.
    const focused = document.activeElement?.id === "target-line";
    const joined = last ? [last, ...foretold] : foretold;
    drawPlot(this.#plot, {
      width: WIDTH, height: HEIGHT, x, y,
      summary: timeSentence(state, state.target),
      series: [
        { kind: "line", style: "foretold", ...columns(joined) },
        { kind: "points", style: "foretold-point", ...columns(foretold) },
        { kind: "line", style: "measured", ...columns(measured) },
        { kind: "points", style: "measured-point", ...columns(measured) },
      ],
    });
    this.#drawTarget(state, x, y, focused);
  }

  /**
   * @param {State} state
   * @param {import("./chart.js").Axis} x
   * @param {import("./chart.js").Axis} y
   * @param {boolean} focused
   */
  #drawTarget(state, x, y, focused) {
    const area = plotArea(WIDTH, HEIGHT);
    const level = placer(y, area.bottom, area.top)(state.target);
    const factor = y.high / y.low;
    this.#toLevel = (place) => y.low * factor ** ((area.bottom - place) / (area.bottom - area.top));
    const time = timeOfLevel(state, state.target);
    const at = placer(x, area.left, area.right)(time.seconds);
    const isKnown = !isFinished(state) && (time.kind === "since" || time.kind === "after");
    if (isKnown && at >= area.left && at <= area.right) {
      this.#plot.append(svg("line", { class: "target-time", x1: at, x2: at, y1: level, y2: area.bottom }));
    }
    const line = svg("g", {
      id: "target-line", role: "slider", tabindex: 0, "aria-label": "Target of the noise level k",
      "aria-valuemin": LOWEST, "aria-valuemax": HIGHEST, "aria-valuenow": state.target,
      "aria-orientation": "vertical",
    },
    svg("title", {}, "Drag the target, or use the arrow keys"),
    svg("rect", {
      x: area.left, width: area.right - area.left, y: level - 9, height: 18, fill: "transparent",
    }),
    svg("line", { class: "target", x1: area.left, x2: area.right, y1: level, y2: level }),
    svg("rect", { class: "target-grip", x: area.right - 16, y: level - 5, width: 12, height: 10, rx: 2 }),
    svg("text", { class: "target-text", x: area.left + 5, y: level > area.top + 20 ? level - 5 : level + 13 },
      `k = ${plain(state.target, 2)}`));
    this.#plot.append(line);
    if (focused) line.focus();
  }

  /** The plot is drawn again during a drag, so the pointer is captured by the plot and not by the line. */
  #followDrag() {
    const plot = this.#plot;
    let dragged = false;
    /** @param {PointerEvent} event */
    const level = (event) => {
      const bounds = plot.getBoundingClientRect();
      return this.#toLevel(((event.clientY - bounds.top) / bounds.height) * HEIGHT);
    };
    plot.addEventListener("pointerdown", (event) => {
      if (!(event.target instanceof Element) || !event.target.closest("#target-line")) return;
      dragged = true;
      plot.setPointerCapture(event.pointerId);
      byId("target-line", SVGGElement).focus();
      event.preventDefault();
    });
    plot.addEventListener("pointermove", (event) => {
      if (dragged) this.setTarget(level(event));
    });
    for (const end of /** @type {const} */ (["pointerup", "pointercancel"])) {
      plot.addEventListener(end, () => {
        dragged = false;
      });
    }
    plot.addEventListener("keydown", (event) => {
      const direction = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
      if (direction === undefined) return;
      this.stepTarget(direction > 0 ? 1 : -1);
      event.preventDefault();
      event.stopPropagation();
    });
  }
}
