//! The messages between the page and the server, as JSON.

pub(crate) use crate::fault::Fault;
pub(crate) use crate::protocol_measurements::*;

use dunkelfeld::DenoiseMethod;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The knobs of the camera, which need no new samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Camera {
    /// A name of the list of sensors; `None`: no sensor, radiance 1 W/(m² sr) is white.
    pub(crate) sensor: Option<String>,
    /// Exposure time \[s\]; `None`: automatic.
    pub(crate) exposure: Option<f64>,
    /// Factor of the system gain of the sensor.
    pub(crate) gain: f64,
    /// Temperature of the sensor [°C]; `None`: that of the model.
    pub(crate) temperature: Option<f64>,
    /// Grey value without light \[DN\]; `None`: that of the model.
    pub(crate) black_level: Option<f64>,
    pub(crate) noise: Noise,
    /// Seed of the fixed pattern and of the noise. JSON has it as a text if a number would lose digits.
    #[serde(with = "large_number")]
    pub(crate) device: u64,
    pub(crate) denoise: DenoiseMethod,
    pub(crate) vignetting: bool,
    /// f-number of the lens; `None`: that of the job.
    pub(crate) f_number: Option<f64>,
    /// Share of the light in the veiling glare; `None`: that of the job.
    pub(crate) glare: Option<f64>,
    /// Factor of each light, in the mode with a film for each.
    pub(crate) lights: Option<BTreeMap<String, f64>>,
}

#[cfg(test)]
impl Camera {
    /// The settings of tests: automatic exposure, plain noise, no denoiser.
    pub(crate) fn plain(sensor: Option<&str>) -> Self {
        Self {
            sensor: sensor.map(str::to_owned),
            exposure: None,
            gain: 1.0,
            temperature: None,
            black_level: None,
            noise: Noise::Plain,
            device: 0,
            denoise: DenoiseMethod::Off,
            vignetting: false,
            f_number: None,
            glare: None,
            lights: None,
        }
    }
}

impl Camera {
    /// The camera for statistics of the unbiased film, which do not depend on the frame.
    pub(crate) fn without_noise(&self) -> Self {
        Self { noise: Noise::Plain, denoise: DenoiseMethod::Off, device: 0, ..self.clone() }
    }

    /// The camera for results that do not depend on its device.
    pub(crate) fn without_device(&self) -> Self {
        Self { device: 0, ..self.clone() }
    }
}

/// A u64 in JSON: a number, or a text of digits where the numbers of a page (f64) would lose digits.
mod large_number {
    use serde::{Deserialize as _, Deserializer, Serializer, de};

    /// Whole numbers below are exact as f64.
    const EXACT: u64 = 1 << 53;

    #[derive(serde::Deserialize)]
    #[serde(untagged)]
    enum Number {
        Number(u64),
        Text(String),
    }

    pub(super) fn serialize<S: Serializer>(number: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        if *number < EXACT { serializer.serialize_u64(*number) } else { serializer.collect_str(number) }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        match Number::deserialize(deserializer)? {
            Number::Number(number) => Ok(number),
            Number::Text(text) => text.parse().map_err(de::Error::custom),
        }
    }
}

/// The noise of the camera that is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Noise {
    Plain,
    Matched,
    /// The expected grey values.
    None,
}

/// The tone curve of a picture in colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Tone {
    Gamma,
    Linear,
    Log,
}

/// The state of the view.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct State {
    pub(crate) version: &'static str,
    pub(crate) title: String,
    pub(crate) path: String,
    pub(crate) source: SourceKind,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) film: Option<FilmState>,
    pub(crate) render: RenderState,
    pub(crate) error: Option<Fault>,
    pub(crate) notes: Vec<Note>,
    pub(crate) curve: Vec<CurvePoint>,
    pub(crate) forecast: Vec<ForecastPoint>,
    pub(crate) forecast_from: ForecastSource,
    /// The most samples per pixel of a view.
    pub(crate) max_spp: f64,
    pub(crate) target: f64,
    pub(crate) certificate: Option<CertificateState>,
    /// The camera of curve, forecast and certificate, without its noise.
    pub(crate) statistics_of: Camera,
    /// Counts the results for provisional pictures, which are then asked for again.
    pub(crate) prepared: u64,
    pub(crate) sensors: Vec<SensorState>,
    pub(crate) camera: Camera,
    pub(crate) ranges: Ranges,
    /// The frame of the samples.
    pub(crate) frame: u32,
    /// The reason why the exposure is no knob.
    pub(crate) timed: Option<String>,
    pub(crate) lens: LensState,
    pub(crate) scene: Option<SceneState>,
    pub(crate) saved: Vec<String>,
}

/// The origin of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SourceKind {
    Render,
    Film,
    Exr,
}

/// The film that is shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct FilmState {
    pub(crate) id: u64,
    pub(crate) samples: u64,
    pub(crate) spp: f64,
    pub(crate) seconds: f64,
    pub(crate) first: bool,
    /// Is it that of the scene before a change or a restart?
    pub(crate) earlier: bool,
}

/// The state of the render.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct RenderState {
    pub(crate) stage: String,
    pub(crate) fraction: f64,
    pub(crate) elapsed: f64,
    pub(crate) remaining: Option<f64>,
    pub(crate) state: Activity,
    pub(crate) reason: Option<String>,
    pub(crate) restarted: u32,
    pub(crate) samples_per_second: f64,
    /// Processor time of the program over that of all of its threads, in the last seconds of a render.
    pub(crate) processor_share: Option<f64>,
}

/// Does something render?
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Activity {
    #[default]
    Loading,
    Running,
    Paused,
    Finished,
    Failed,
    None,
}

/// A message about the scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Note {
    pub(crate) level: &'static str,
    pub(crate) text: String,
    pub(crate) help: Option<String>,
}

/// The noise at some time of the render.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct CurvePoint {
    pub(crate) seconds: f64,
    pub(crate) spp: f64,
    pub(crate) k99: Option<f64>,
    #[serde(skip)]
    pub(crate) film: u64,
}

/// The expected time of a level of noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct ForecastPoint {
    pub(crate) k: f64,
    pub(crate) seconds: Option<f64>,
    pub(crate) spp: Option<f64>,
}

/// The origin of a forecast.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ForecastSource {
    /// The plan of the render, which is for the camera of the job.
    Plan,
    /// The measured points of the camera.
    Points,
}

/// The certificate of a film.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct CertificateState {
    pub(crate) k: f64,
    pub(crate) hidden: f64,
    pub(crate) median: Option<f64>,
    pub(crate) p99: Option<f64>,
    /// Pixels that are left out because they are saturated beyond doubt.
    pub(crate) saturated: u64,
    pub(crate) film: u64,
}

/// A sensor of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SensorState {
    pub(crate) name: String,
    /// The name with its model, for the list.
    pub(crate) label: String,
    pub(crate) bits: u32,
    pub(crate) colour: bool,
    pub(crate) saturation: f64,
    /// Of the chip \[degrees Celsius\].
    pub(crate) temperature: f64,
    pub(crate) dark_noise: f64,
    pub(crate) pixel: f64,
}

/// The ranges of knobs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Ranges {
    pub(crate) exposure: [f64; 2],
    pub(crate) gain: [f64; 2],
    pub(crate) temperature: [f64; 2],
    pub(crate) f_number: [f64; 2],
    pub(crate) glare: [f64; 2],
}

impl Ranges {
    /// The ranges of all cameras.
    pub(crate) const KNOBS: Self = Self {
        exposure: [1e-9, 1e6],
        gain: [0.01, 100.0],
        temperature: [-100.0, 200.0],
        f_number: [0.5, 1000.0],
        glare: [0.0, 0.5],
    };
}

/// The lens of the job.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct LensState {
    pub(crate) f_number: f64,
    pub(crate) glare: f64,
    /// The reason why the f-number is no knob.
    pub(crate) fixed: Option<&'static str>,
}

/// The parts of the scene that can be changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SceneState {
    pub(crate) cameras: Vec<String>,
    pub(crate) camera: String,
    pub(crate) lights: Vec<LightState>,
    pub(crate) materials: Vec<MaterialState>,
    pub(crate) effects: Vec<EffectState>,
    pub(crate) per_light: PerLight,
}

/// A light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LightState {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) on: bool,
    pub(crate) factor: f64,
    pub(crate) power: String,
    /// Can its power be changed, and can it be switched off?
    pub(crate) has_power: bool,
    pub(crate) has_switch: bool,
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct MaterialState {
    pub(crate) name: String,
    pub(crate) roughness: Option<f64>,
    pub(crate) metallic: Option<f64>,
    pub(crate) color: Option<[f64; 3]>,
    /// The values that are not those of the scene.
    pub(crate) changed: MaterialChange,
}

/// An effect of the scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct EffectState {
    pub(crate) name: String,
    pub(crate) title: String,
    pub(crate) used: bool,
    pub(crate) left_out: bool,
}

/// The mode with a film for each light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct PerLight {
    pub(crate) on: bool,
    pub(crate) bytes: u64,
    pub(crate) lights: usize,
}

/// A request of a frame.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FrameRequest {
    pub(crate) camera: Camera,
    pub(crate) frame: u32,
    pub(crate) tone: Tone,
    /// Wait for the noise and the denoised mean of this film and camera.
    #[serde(default)]
    pub(crate) exact: bool,
    /// Does the camera become that of the statistics?
    #[serde(default = "yes")]
    pub(crate) statistics: bool,
}

fn yes() -> bool {
    true
}

/// How far the noise and the denoised mean that a camera needs are there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Readiness {
    /// The scene has none yet: the picture has plain noise, or is not denoised.
    None,
    /// They are those of an earlier film or another camera.
    Earlier,
    /// They are those of this film and camera, or the camera needs none.
    Exact,
}

/// The description of a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct FrameHeader {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) format: &'static str,
    pub(crate) white: f64,
    pub(crate) black: f64,
    pub(crate) film: u64,
    pub(crate) exposure: Option<f64>,
    pub(crate) no_light: bool,
    /// Nearly no pixel receives a photo-electron.
    pub(crate) is_black: bool,
    pub(crate) saturated: f64,
    pub(crate) matched: Option<f64>,
    pub(crate) analysis: Readiness,
    pub(crate) mean_value: f64,
    pub(crate) mean_electrons: f64,
    pub(crate) compute: f64,
}

/// A request of a map.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MapRequest {
    pub(crate) camera: Camera,
    pub(crate) map: MapKind,
}

/// The maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MapKind {
    Ratio,
    Samples,
    Recent,
    FirstLight,
    RenderSigma,
    CameraSigma,
}

/// The description of a map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct MapHeader {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) format: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) film: u64,
    pub(crate) compute: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// A request of a path.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PathRequest {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) index: Option<u32>,
    /// The camera with the factors of the lights.
    pub(crate) camera: Camera,
}

/// A path.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct PathAnswer {
    pub(crate) index: u32,
    pub(crate) luminance: f64,
    pub(crate) vertices: Vec<PathVertex>,
}

/// A vertex of a path, with its place on the film \[pixels\], the index of the vertex before it, and the luminance that it
/// adds [W/(m^2 sr)].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct PathVertex {
    pub(crate) before: Option<usize>,
    pub(crate) luminance: f64,
    pub(crate) x: Option<f64>,
    pub(crate) y: Option<f64>,
    pub(crate) object: Option<String>,
    pub(crate) event: String,
}

/// A change of the scene. Keys that are left out stay, and so do lights, materials, values of a material, and effects; `None`
/// as a light or a material is that of the job.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneRequest {
    pub(crate) camera: Option<String>,
    pub(crate) lights: Option<BTreeMap<String, Option<LightChange>>>,
    /// Is the effect part of the render?
    pub(crate) effects: Option<BTreeMap<String, bool>>,
    pub(crate) materials: Option<BTreeMap<String, Option<MaterialChange>>>,
    pub(crate) per_light: Option<bool>,
}

/// A change of a light.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LightChange {
    pub(crate) on: bool,
    pub(crate) factor: f64,
}

/// A change of a material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaterialChange {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) roughness: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) metallic: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) color: Option<[f64; 3]>,
}

/// Control of the render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RenderRequest {
    pub(crate) action: Action,
}

/// The actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Action {
    Pause,
    Resume,
    Restart,
}

/// A level of noise.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TargetRequest {
    pub(crate) k: f64,
}

/// A request of files.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SaveRequest {
    pub(crate) what: Vec<SaveKind>,
    /// The stem of the names.
    pub(crate) name: String,
    pub(crate) camera: Camera,
    pub(crate) frame: u32,
}

/// The kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SaveKind {
    Png,
    Tiff,
    Exr,
    Film,
    Job,
}

/// The files that were written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Saved {
    pub(crate) files: Vec<String>,
    /// A difference between the files.
    pub(crate) note: Option<String>,
}
