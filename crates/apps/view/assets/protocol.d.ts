// The types of the contract between the page and the server (version 1); docs/view-protocol.md has the requests.
// The server does not need this file to serve the page; it types the modules.
// Times are seconds, DN is a digital number, e a photo-electron. Null: not known.

export interface Fault { problem: string; place: string | null; help: string | null }

export interface Note { level: "warning" | "info"; text: string; help: string | null }

/** Measured so far; `k99`: level at which 99 % of the pixels are hidden. */
export interface CurvePoint { seconds: number; spp: number; k99: number | null }
/** Foretold time of a level, without pauses; `seconds` null: a view does not reach the level. */
export interface ForecastPoint { k: number; seconds: number | null; spp: number | null }

/** The filter of a pixel of a colour sensor. */
export type Channel = "red" | "green" | "blue";

export interface Sensor {
  name: string;
  /** With its model: "as in the job (imx250)". */
  label: string;
  bits: number; colour: boolean;
  /** [e] */
  saturation: number; dark_noise: number;
  /** [um] */
  pixel: number;
  /** That of the model [degrees Celsius]. */
  temperature: number;
}

export interface Light {
  name: string; kind: string; on: boolean;
  /** Of its power. */
  factor: number;
  /** For example "0.25 W". */
  power: string;
  /** False for a light from infinitely far away, whose factor is fixed. */
  has_power: boolean;
  /** False for an environment, which is always on. */
  has_switch: boolean;
}
export type Colour = [number, number, number];
export interface Material {
  name: string; roughness: number | null; metallic: number | null; color: Colour | null;
  /** The values that are not those of the scene. */
  changed: MaterialChange;
}
export interface MaterialChange { roughness?: number; metallic?: number; color?: Colour }
export interface Effect { name: string; title: string; used: boolean; left_out: boolean }

export interface Scene {
  cameras: string[]; camera: string;
  lights: Light[]; materials: Material[]; effects: Effect[];
  /** `bytes`: memory that the mode needs; `lights`: number that are on. */
  per_light: { on: boolean; bytes: number; lights: number };
}

export interface Render {
  stage: string; fraction: number; elapsed: number; remaining: number | null;
  state: "loading" | "running" | "paused" | "finished" | "failed" | "none";
  /** A sentence: why it ended. */
  reason: string | null;
  /** How often the scene was started again. */
  restarted: number;
  samples_per_second: number;
  /** Processor time of the program over that of all of its threads; null: not measured yet. */
  processor_share: number | null;
}

export interface Film {
  /** Grows with each new content. */
  id: number; samples: number; spp: number; seconds: number;
  /** A coarse first picture. */
  first: boolean;
  /** That of the scene before a change or a restart that is asked for, being made or has no picture yet. */
  earlier: boolean;
}

export interface Certificate {
  k: number; hidden: number; median: number | null; p99: number | null;
  /** Pixels left out, beyond doubt. */
  saturated: number;
  /** The id that it was computed from. */
  film: number;
}

export interface State {
  /** Of the program. */
  version: string;
  /** The file name of scene, job, film or EXR. */
  title: string;
  /** As the user gave it. */
  path: string;
  /** "film" and "exr": nothing renders, scene knobs are absent. */
  source: "render" | "film" | "exr";
  width: number; height: number;
  /** Null before the first picture. */
  film: Film | null;
  render: Render;
  /** Of the scene or render. */
  error: Fault | null;
  notes: Note[];
  curve: CurvePoint[];
  /** Empty until the end of the pilot; levels above 1 by the root law. */
  forecast: ForecastPoint[];
  /** The plan of the render, for the camera of the job; or the measured points of the camera. */
  forecast_from: "plan" | "points";
  /** The most samples per pixel of a view. */
  max_spp: number;
  /** The k of the certificate. */
  target: number;
  certificate: Certificate | null;
  /** The camera of curve, forecast, certificate and progress, without its noise: of the last frame with `statistics`, or of the job. */
  statistics_of: Camera;
  /** Counts the results for provisional pictures. */
  prepared: number;
  /** Presets, the file of the job first. */
  sensors: Sensor[];
  /** The settings of the job: the start of the knobs; without its denoiser if this machine lacks it. */
  camera: Camera;
  ranges: {
    exposure: [number, number]; gain: [number, number]; temperature: [number, number];
    f_number: [number, number]; glare: [number, number];
  };
  /** The frame of the samples. */
  frame: number;
  /** The reason why the exposure is no knob: moving objects, rows that are scanned, strobes. */
  timed: string | null;
  /** The lens of the job. */
  lens: Lens;
  scene: Scene | null;
  /** Files that were saved in this run. */
  saved: string[];
}

export interface Lens {
  f_number: number; glare: number;
  /** The reason why the f-number is no knob: depth of field, or a sharp image. */
  fixed: string | null;
}

export type Noise = "plain" | "matched" | "none";
export type Denoise = "off" | "auto" | "builtin" | "oidn";
export type Tone = "gamma" | "linear" | "log";
export type MapName =
  "ratio" | "samples" | "recent" | "first_light" | "render_sigma" | "camera_sigma";

/** The knobs that need no new samples. */
export interface Camera {
  /** Null: no sensor, radiance 1 is white. */
  sensor: string | null;
  /** Null: automatic. */
  exposure: number | null;
  /** A factor, 1 = as the model. */
  gain: number;
  /** [degrees Celsius]; null: as the model. */
  temperature: number | null;
  /** [DN]; null: as the model. */
  black_level: number | null;
  noise: Noise;
  /** The seed of the fixed pattern; a text of digits where a number would lose digits. */
  device: number | string;
  denoise: Denoise;
  vignetting: boolean;
  /** Of the lens: the light that passes and the disc of diffraction; null: that of the job. */
  f_number: number | null;
  /** The share of the light in the veiling glare; null: that of the job. */
  glare: number | null;
  /** With per_light: the factor of each light, 0 to 1e6; 1 for those left out, and for null. */
  lights: Record<string, number> | null;
}

export interface FrameHeader {
  width: number; height: number;
  /** gray16: u16 DN, row by row; rgb8: 3 bytes a pixel, with the tone (colour sensors, no sensor). */
  format: "gray16" | "rgb8";
  /** gray16: DN of saturation, which need not be an integer, and of darkness (black level). */
  white: number; black: number;
  /** The id of the film. */
  film: number;
  exposure: number | null; no_light: boolean;
  /** 99.9 % of the pixels receive less than one photo-electron. */
  is_black: boolean;
  /** The share of the pixels. */
  saturated: number;
  /** The share of the pixels for which matched noise holds. */
  matched: number | null;
  /** Noise or denoised mean of this film and camera, of an earlier one, or missing: plain noise, not denoised. */
  analysis: "exact" | "earlier" | "none";
  mean_value: number; mean_electrons: number;
  /** Seconds that the server took. */
  compute: number;
}

export interface MapHeader {
  width: number; height: number; format: "f32"; unit: string;
  film: number; compute: number; low: number; high: number;
}

/** `camera`: the knobs of the request. */
export interface Frame { header: FrameHeader; values: Uint16Array | Uint8Array; camera: Camera }
export interface FilmMap { header: MapHeader; values: Float32Array }

export interface Probe {
  x: number; y: number;
  channel: Channel | null;
  value: number | null; electrons: number | null; radiance: Colour;
  camera_sigma: number | null; render_sigma: number | null; ratio: number | null;
  /** Null for a picture without samples. */
  samples: number | null;
  object: string | null; material: string | null; depth: number | null;
  heaviest: { index: number; share: number } | null;
}

export interface Region {
  pixels: number; mean: number; variance: number; min: number; max: number;
  snr: number | null; saturated: number;
  histogram: { low: number; width: number; counts: number[] };
}
export interface Regions { regions: Region[]; contrast: number | null; cnr: number | null }

export interface Line { values: number[]; expected: number[]; sigma: number[]; length: number }

export interface PathVertex { before: number | null; luminance: number; x: number | null; y: number | null; object: string | null; event: string }
export interface LightPath { index: number; luminance: number; vertices: PathVertex[] }

export interface PhotonTransfer {
  points: { mean: number; variance: number }[];
  gain: number; line: { slope: number; offset: number }; dark: number;
}

export interface SceneChange {
  camera?: string;
  lights?: Record<string, { on: boolean; factor: number }>;
  effects?: Record<string, boolean>;
  materials?: Record<string, MaterialChange | null>;
  per_light?: boolean;
}

export type SaveKind = "png" | "tiff" | "exr" | "film" | "job";

declare global {
  interface Window {
    dunkelfeld: { readonly state: State | null; frame(): Frame | null; idle(): Promise<void> };
  }
}
