// The types of the contract between the page and the server (version 1).
// The server does not need this file to serve the page; it types the modules.

export interface Fault { problem: string; place: string | null; help: string | null }

export interface Note { level: "warning" | "info"; text: string; help: string | null }

export interface CurvePoint { seconds: number; spp: number; k99: number | null }
export interface ForecastPoint { k: number; seconds: number | null; spp: number | null }

export type Channel = "red" | "green" | "blue";

export interface Sensor {
  name: string; label: string; bits: number; colour: boolean;
  saturation: number; dark_noise: number; pixel: number;
  /** That of the model [degrees Celsius]. */
  temperature: number;
}

export interface Light {
  name: string; kind: string; on: boolean; factor: number; power: string;
  /** False for a light from infinitely far away. */
  has_power: boolean;
  /** False for an environment. */
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
  per_light: { on: boolean; bytes: number; lights: number };
}

export interface Render {
  stage: string; fraction: number; elapsed: number; remaining: number | null;
  state: "loading" | "running" | "paused" | "finished" | "failed" | "none";
  reason: string | null; restarted: number; samples_per_second: number;
  /** Processor time of the program over that of all of its threads; null: not measured yet. */
  processor_share: number | null;
}

export interface Film {
  id: number; samples: number; spp: number; seconds: number; first: boolean;
  /** Is it that of the scene before a change or a restart? */
  earlier: boolean;
}

export interface Certificate {
  k: number; hidden: number; median: number | null; p99: number | null;
  saturated: number; film: number;
}

export interface State {
  version: string; title: string; path: string;
  source: "render" | "film" | "exr";
  width: number; height: number;
  film: Film | null;
  render: Render;
  error: Fault | null;
  notes: Note[];
  curve: CurvePoint[];
  forecast: ForecastPoint[];
  forecast_from: "plan" | "points";
  max_spp: number;
  target: number;
  certificate: Certificate | null;
  /** The camera of curve, forecast and certificate, without its noise. */
  statistics_of: Camera;
  /** Counts the results for provisional pictures. */
  prepared: number;
  sensors: Sensor[];
  camera: Camera;
  ranges: {
    exposure: [number, number]; gain: [number, number]; temperature: [number, number];
    f_number: [number, number]; glare: [number, number];
  };
  /** The frame of the samples. */
  frame: number;
  /** The reason why the exposure is no knob. */
  timed: string | null;
  /** The lens of the job. */
  lens: Lens;
  scene: Scene | null;
  saved: string[];
}

export interface Lens {
  f_number: number; glare: number;
  /** The reason why the f-number is no knob. */
  fixed: string | null;
}

export type Noise = "plain" | "matched" | "none";
export type Denoise = "off" | "auto" | "builtin" | "oidn";
export type Tone = "gamma" | "linear" | "log";
export type MapName =
  "ratio" | "samples" | "recent" | "first_light" | "render_sigma" | "camera_sigma";

/** The knobs that need no new samples. */
export interface Camera {
  sensor: string | null;
  exposure: number | null;
  gain: number;
  temperature: number | null;
  black_level: number | null;
  noise: Noise;
  /** A text of digits where a number would lose digits. */
  device: number | string;
  denoise: Denoise;
  vignetting: boolean;
  /** Null: that of the job. */
  f_number: number | null;
  /** The share of the light; null: that of the job. */
  glare: number | null;
  lights: Record<string, number> | null;
}

export interface FrameHeader {
  width: number; height: number;
  format: "gray16" | "rgb8";
  white: number; black: number;
  film: number;
  exposure: number | null; no_light: boolean; is_black: boolean;
  saturated: number; matched: number | null;
  /** Are noise or denoised mean those of an earlier film or another camera? */
  /** Noise or denoised mean of this film and camera, of an earlier one, or missing: plain noise, not denoised. */
  analysis: "exact" | "earlier" | "none";
  mean_value: number; mean_electrons: number;
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
