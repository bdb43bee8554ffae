// The noise level k of the render, its time, and the verdict in words.

import { count, duration, percent, plain } from "./format.js";

/** @typedef {import("./protocol").State} State */
/** @typedef {"none" | "no" | "look" | "measure"} VerdictLevel */
/** @typedef {{ level: VerdictLevel, title: string, text: string, isVoid?: boolean }} Verdict isVoid: k has no meaning */
/**
 * The time of a level: `since` when it was measured, `after` when it is foretold, `never` when a view has too few samples.
 * @typedef {{ kind: "since" | "after" | "unknown" | "never", seconds: number }} LevelTime
 */
/** @typedef {{ seconds: number, k: number, spp: number | null }} Level */

// At k = 1 the noise of the render is as large as that of the camera: the eye sees no difference.
const LOOK = 1;
// At k = 0.5 the total noise is sqrt(1 + 0.25) = 1.12 times that of the camera alone.
const MEASURE = 0.5;
const MOST = 0.5; // share of saturated pixels from which a verdict about the others says little
const ENOUGH = 4; // measured points from which the level is extrapolated
const PILOT = 32; // samples per pixel of the pilot, after which the plan of the render and the forecast follow

/**
 * The camera without its noise, on which statistics do not depend, as a text that is compared.
 * @param {import("./protocol").Camera} camera
 */
function keyOf(camera) {
  const lights = camera.lights && Object.entries(camera.lights).sort(([a], [b]) => (a < b ? -1 : 1));
  const { sensor, exposure, gain, temperature, black_level, vignetting, f_number, glare } = camera;
  return JSON.stringify([sensor, exposure, gain, temperature, black_level, vignetting, f_number, glare, lights]);
}

/**
 * The state without statistics of a camera that this page does not show.
 * @param {State} state
 * @param {(import("./protocol").Camera | null)[]} shown the cameras of the page
 * @returns {State}
 */
export function ownStatistics(state, shown) {
  const key = keyOf(state.statistics_of);
  if (shown.some((camera) => camera !== null && keyOf(camera) === key)) return state;
  return { ...state, curve: [], forecast: [], certificate: null };
}

/**
 * The measured points with a known level.
 * @param {State} state
 * @returns {Level[]}
 */
export function measuredLevels(state) {
  return state.curve.flatMap(({ seconds, spp, k99 }) =>
    (k99 !== null && k99 > 0 && seconds > 0 ? [{ seconds, k: k99, spp }] : []));
}

/**
 * The foretold points with a known time, the earliest first.
 * @param {State} state
 * @returns {Level[]}
 */
export function foretoldLevels(state) {
  return state.forecast
    .flatMap(({ k, seconds, spp }) => (seconds !== null && seconds > 0 && k > 0 ? [{ seconds, k, spp }] : []))
    .sort((a, b) => a.seconds - b.seconds);
}

/**
 * The level that 99 % of the pixels reach now.
 * @param {State} state
 * @returns {number | null}
 */
export function levelNow(state) {
  // The points of finished samples have no times, but their certificate has the level.
  return measuredLevels(state).at(-1)?.k ?? state.certificate?.p99 ?? null;
}

/**
 * True where the samples are those of a file.
 * @param {State} state
 */
export function isFinished(state) {
  return state.render.state === "none";
}

/**
 * The time at which the level reaches k: the end of the last stretch above k, so that a level that
 * was reached and lost again does not count.
 * @param {State} state
 * @param {number} k
 * @returns {LevelTime}
 */
export function timeOfLevel(state, k) {
  const measured = measuredLevels(state);
  const last = measured.at(-1);
  if (last && last.k <= k) {
    let first = measured.length - 1;
    while (first > 0 && (measured[first - 1]?.k ?? Infinity) <= k) first -= 1;
    const after = measured[first] ?? last;
    const before = measured[first - 1];
    return { kind: "since", seconds: before ? between(before, after, k) : after.seconds };
  }
  if (state.forecast.some((point) => point.seconds === null && point.k >= k && point.k < (last?.k ?? Infinity))) {
    return { kind: "never", seconds: 0 };
  }
  // The forecast starts where the measurement ends.
  const known = foretoldLevels(state).filter(
    (point) => !last || (point.k < last.k && point.seconds > last.seconds));
  const points = last ? [last, ...known] : known;
  const next = points.findIndex((point) => point.k <= k);
  const after = points[next];
  if (after) {
    const before = points[next - 1];
    return { kind: "after", seconds: before ? between(before, after, k) : extend(after, k) };
  }
  const end = points.at(-1);
  // One measured point may be far off, and those of the pilot have other samples than the plan: without a forecast, a few
  // points after the pilot are needed.
  const isEarly = measured.length < ENOUGH || (last?.spp ?? 0) <= PILOT;
  if (!end || (known.length === 0 && isEarly)) return { kind: "unknown", seconds: 0 };
  if (end.spp !== null && end.spp * (end.k / k) ** 2 > state.max_spp) return { kind: "never", seconds: 0 };
  return { kind: "after", seconds: extend(end, k) };
}

/**
 * The time of a level that is not known yet, in words.
 * @param {State} state
 */
function whenKnown(state) {
  const spp = state.curve.at(-1)?.spp ?? state.film?.spp ?? 0;
  if (levelNow(state) === null && spp > PILOT) return "is not known";
  return spp <= PILOT ? `is known after the pilot (${PILOT} samples per pixel)` : "is known after the next points of the curve";
}

/**
 * The samples that the target needs, for samples of a file, which has no times.
 * @param {State} state
 * @param {number} target
 */
function samplesSentence(state, target) {
  const k = levelNow(state);
  if (k === null) return "";
  if (k <= target) return `99 % of the pixels are hidden beneath the camera's noise at k = ${plain(target, 2)}.`;
  return `k = ${plain(target, 2)} needs about ${timesText((k / target) ** 2)} the samples: k falls with the root of their number.`;
}

/** @param {number} factor */
function timesText(factor) {
  return `${factor >= 10 ? count(Number(factor.toPrecision(2))) : plain(factor, 2)} times`;
}

/**
 * Interpolation on the logarithmic scales of the plot.
 * @param {{ seconds: number, k: number }} a
 * @param {{ seconds: number, k: number }} b
 * @param {number} k
 */
function between(a, b, k) {
  if (a.k === b.k) return b.seconds;
  const part = Math.log(k / a.k) / Math.log(b.k / a.k);
  return a.seconds * (b.seconds / a.seconds) ** Math.min(1, Math.max(0, part));
}

/**
 * The standard deviation of a Monte Carlo mean falls with the root of the time.
 * @param {{ seconds: number, k: number }} point
 * @param {number} k
 */
function extend(point, k) {
  return point.seconds * (point.k / k) ** 2;
}

/**
 * The time of the target in words.
 * @param {State} state
 * @param {number} k
 * @returns {string}
 */
export function timeSentence(state, k) {
  if (isFinished(state)) return samplesSentence(state, k);
  const time = timeOfLevel(state, k);
  if (time.kind === "never") {
    return `k = ${plain(k, 2)} is not reached in a view (more than ${count(state.max_spp)} samples per pixel).`;
  }
  const start = `99 % of the pixels are hidden beneath the camera's noise at k = ${plain(k, 2)}`;
  if (time.kind === "since") return `${start} since ${duration(time.seconds)}.`;
  if (time.kind === "unknown") return `The time until 99 % of the pixels are hidden at k = ${plain(k, 2)} ${whenKnown(state)}.`;
  const after = `${start} after about ${duration(time.seconds)}`;
  if (state.render.state === "paused") return `${after} (paused now).`;
  if (state.render.state !== "running" && state.render.state !== "loading") {
    return `${after} (not running).`;
  }
  const left = time.seconds - state.render.elapsed;
  return left > 0.5 ? `${after} (in ${duration(left)}).` : `${after}.`;
}

/**
 * The meaning of a level for the noise of the picture: independent variances add.
 * @param {number} k
 */
export function levelMeaning(k) {
  return `At k = ${plain(k, 2)} or below, the noise of a pixel is at most ${plain(increase(k), 2)} % larger than that of the camera alone.`;
}

/**
 * The increase of the standard deviation by the noise of the render [%].
 * @param {number} k
 */
function increase(k) {
  return (Math.sqrt(1 + k * k) - 1) * 100;
}

/**
 * The origin of the foretold points in words.
 * @param {State} state
 */
export function forecastNote(state) {
  if (isFinished(state)) {
    // The line goes from the level of the samples down to the target.
    const hasLine = (state.film?.spp ?? 0) > 0 && (levelNow(state) ?? 0) > state.target;
    return hasLine ? "The dashed line is the root law: k falls with the root of the number of samples." : "";
  }
  if (foretoldLevels(state).length === 0) return "";
  return state.forecast_from === "plan"
    ? "The foretold points are those of the plan of the render, for the camera of the job."
    : "The foretold points follow from the measured ones by the root law of the samples. The plan is for the camera of the job.";
}

/**
 * @param {State} state
 * @param {{ is_black: boolean, saturated: number } | undefined} picture the picture that is shown
 * @returns {Verdict}
 */
export function verdict(state, picture) {
  const k = levelNow(state);
  const saturated = picture?.saturated ?? 0;
  if (saturated >= MOST) {
    return {
      level: "none", title: "Saturated picture", isVoid: true,
      text: `${percent(saturated)} of the pixels are saturated. Shorten the exposure time, or dim the lights.`,
    };
  }
  if (picture?.is_black) {
    return {
      level: "none", title: "Black picture", isVoid: true,
      text: "Nearly no pixel receives a photo-electron. Check the lights and the exposure time.",
    };
  }
  if (k === null && state.source === "exr" && !state.film?.samples) {
    return {
      level: "none", title: "No verdict",
      text: "This EXR contains no samples and no noise of its pixels, so that the noise of its render is not known.",
    };
  }
  if (k === null) {
    const text = state.certificate
      ? `${percent(state.certificate.hidden)} of the pixels are hidden at k = ${plain(state.certificate.k, 2)}.`
      : "The noise of the render is not measured yet, or there is no sensor to compare it with.";
    return { level: "none", title: "No verdict yet", text };
  }
  if (k <= Math.min(state.target, MEASURE)) {
    return {
      level: "measure", title: "Good enough for measurement",
      text: `In 99 % of the pixels, the noise is at most ${plain(increase(k), 2)} % larger than that of the camera alone.`,
    };
  }
  if (k <= LOOK) {
    return {
      level: "look", title: "Good enough for a look",
      text: "The eye sees only the noise of the camera. Measured variances are still too large.",
    };
  }
  // The median tells how many pixels are meant: one in a hundred, or most of them.
  const share = (state.certificate?.median ?? 0) > LOOK ? "more than half" : "more than 1 %";
  return {
    level: "no", title: "Not yet",
    text: `The noise of the render is larger than the noise of the camera in ${share} of the pixels.`,
  };
}
