//! The job file: all settings of one render in one TOML text. The doc comments of the fields are its reference.
//!
//! ```toml
//! scene = "inspection.glb"
//! camera = "above"
//!
//! [film]
//! width = 1024
//! height = 1024
//!
//! [budget]
//! time = "20s"
//!
//! [sensor]
//! model = "imx250"
//! exposure = "auto"
//!
//! [[material]]
//! name = "cover"
//! ior = 1.49
//!
//! [[light]]
//! name = "rear light"
//! power = "3W"
//! ```
//!
//! Unknown keys are errors. Times, lengths, angles and powers have a unit (`"5ms"`, `"12mm"`, `"30deg"`, `"3W"`).
//! Colours are linear Rec. 709, `[r, g, b]` or one number for all three.

mod cameras;
mod capture;
mod change_materials;
mod change_objects;
pub(crate) mod check;
mod film;
mod finish;
mod lamp_values;
mod lamps;
mod lens;
mod light;
mod lights;
mod load_scene;
mod materials;
mod motion;
mod move_objects;
mod objects;
mod overlay;
mod overrides;
mod patterns;
pub(crate) mod place;
mod place_cameras;
mod primitives;
mod psf;
mod scene_files;
mod sensor;
mod strobes;

pub use cameras::{CameraSettings, Cameras};
pub use capture::Capture;
pub use film::FilmSettings;
pub use lamp_values::{LedCount, Strength, Wavelength};
pub use lens::{FilterSettings, LensProjection, LensSettings};
pub use light::{Lamp, LampKind, Light, LightChange, light_keys};
pub use materials::{AlphaKind, DielectricChange, InteriorChange, LayerChange, MaterialOverride, material_keys};
pub use motion::{LineScanSettings, RotationSettings};
pub use objects::{Grid, ObjectOverride, Pivot, Placement, object_keys};
pub use patterns::{literal_pattern, matches};
pub use place::Place;
pub use psf::{PsfSettings, load_mtf};
pub use scene_files::{SceneFile, SceneFiles};
pub use sensor::{DEFAULT_SENSOR, Exposure, SensorChoice, SensorSettings};

use crate::error::InputError;
use crate::import::options::{EmissiveUnit, UpAxis};
use crate::input::{InputFiles, Role};
use crate::toml_file::TomlFile;
use crate::toml_keys::read_later;
use dunkelfeld_adaptive::Strategy;
use dunkelfeld_denoise::{DenoiseMethod, DenoiseSettings};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::PrincipledModel;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The problem of an exposure without a sensor.
const NO_SENSOR: &str = "there is no sensor to expose";

/// A job. Input paths in it are resolved (relative ones against the job file's folder); output paths are as written, so
/// relative to the current folder.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The scene files (`.glb`, `.gltf`, `.obj`, `.stl`, `.ply`), relative to the job file. Required.
    pub scene: SceneFiles,
    /// Name of the camera, or the definition of cameras.
    #[serde(default)]
    pub camera: Cameras,
    /// Seed of all random numbers; the same seed gives the same image. Default 0.
    #[serde(default, deserialize_with = "check::seed")]
    pub seed: u64,
    /// Number of the frame; frames of one seed have independent noise. Default 0.
    #[serde(default, deserialize_with = "check::frame")]
    pub frame: u32,
    /// Settings of the import of the scene file.
    #[serde(default)]
    pub import: ImportSettings,
    /// The lens of the camera.
    #[serde(default)]
    pub lens: LensSettings,
    /// Size of the image.
    #[serde(default)]
    pub film: FilmSettings,
    /// Limits at which the render stops.
    #[serde(default)]
    pub budget: BudgetSettings,
    /// Allocation of the samples.
    #[serde(default)]
    pub allocate: AllocateSettings,
    /// The camera's sensor.
    #[serde(default)]
    pub sensor: SensorSettings,
    /// The line-scan camera. Without it, all rows are exposed at once.
    pub line_scan: Option<LineScanSettings>,
    /// Effects of light transport that are modelled.
    #[serde(default)]
    pub render: TransportSettings,
    /// The denoiser of the picture.
    #[serde(default)]
    pub denoise: DenoiseSettings,
    /// Files to write.
    #[serde(default)]
    pub output: OutputSettings,
    /// Light from all directions. It replaces the environment of the scene.
    pub environment: Option<EnvironmentSettings>,
    /// `[[object]]`: changes to objects and new ones, applied in order, before those to materials.
    #[serde(default, rename = "object", deserialize_with = "read_later")]
    pub objects: Vec<ObjectOverride>,
    /// `[[material]]`: changes to materials, applied in order.
    #[serde(default, rename = "material", deserialize_with = "read_later")]
    pub materials: Vec<MaterialOverride>,
    /// `[[light]]`: changes to lights, applied in order, after those to materials.
    #[serde(default, rename = "light", deserialize_with = "read_later")]
    pub lights: Vec<Light>,
    /// `[[capture]]`: images of one render with other lights.
    #[serde(default, rename = "capture")]
    pub captures: Vec<Capture>,
    /// The text of the job, for later errors.
    #[serde(skip)]
    source: TomlFile,
    #[serde(skip)]
    inputs: InputFiles,
    /// Width and height of the render \[pixels\] that overrides set. The film of the job, with its region and with the pixels
    /// to which the intrinsics of cameras refer, stays as it is.
    #[serde(skip)]
    pub size: [Option<u32>; 2],
}

/// The film of a text that has other keys too.
#[derive(Deserialize)]
struct FilmSection {
    #[serde(default)]
    film: FilmSettings,
}

/// `[import]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImportSettings {
    /// Unit of the emissive factors of a glTF file: `"nit"` (as in the format; default) or `"W/(m2 sr)"`. OBJ's `Ke` is
    /// always W/(m^2 sr).
    #[serde(default, deserialize_with = "check::emissive_unit")]
    pub emissive_unit: EmissiveUnit,
    /// Memory limit \[B\] for the decoded images of the scene and of the environment together; written as `"2GiB"`. By
    /// default 1 GiB, see [`Limits`](crate::loader::Limits).
    #[serde(default, deserialize_with = "check::memory")]
    pub texture_memory: Option<u64>,
    /// Length \[m\] of the unit of the coordinates in the scene files, written as `"mm"`. Default: that of the format.
    #[serde(default, deserialize_with = "check::length_unit")]
    pub unit: Option<f64>,
    /// A factor of all lengths of the scene files, above zero, beside the unit. Default 1.
    #[serde(default, deserialize_with = "check::import_scale")]
    pub scale: Option<f64>,
    /// The upward axis of the scene files: `"y"` or `"z"`. Default: that of the format.
    pub up: Option<UpAxis>,
    /// Time \[s\] of the animation of a glTF file. Default 0.
    #[serde(default, deserialize_with = "motion::animation_time")]
    pub animation_time: f64,
}

/// `[budget]`: with several limits, the first one that is reached ends the render.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BudgetSettings {
    /// Wall clock for the whole command, from start to files written: `"20s"`, `"2min"`.
    #[serde(deserialize_with = "check::duration")]
    pub time: Option<Duration>,
    /// Mean number of samples per pixel, above 0, at most 1e9.
    #[serde(deserialize_with = "check::spp")]
    pub spp: Option<f64>,
    /// The k at which 99 % of the unsaturated pixels must be hidden by the noise of the sensor.
    #[serde(deserialize_with = "check::noise")]
    pub noise: Option<f64>,
    /// The share of these pixels \[%\] that must be hidden, instead of 99. It needs `noise`.
    #[serde(deserialize_with = "check::hidden_share")]
    pub share: Option<f64>,
    /// Memory limit of the run \[bytes\]: `"6GB"`. A run that needs more does not begin.
    #[serde(deserialize_with = "check::memory")]
    pub memory: Option<u64>,
}

/// `[allocate]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AllocateSettings {
    /// `"uniform"`, `"sobel"` or `"sensor"`. By default `"sensor"` with a sensor, `"uniform"` without.
    pub strategy: Option<Strategy>,
    /// Samples per pixel of the uniform pilot, from which the plan is computed. Default 16.
    #[serde(deserialize_with = "check::pilot_spp")]
    pub pilot_spp: u32,
    /// Lower bound of the Sobel magnitude of a pixel, as a share of the mean magnitude of the image, 0 to 1. Regions
    /// without edges get this share. Default 0.25.
    #[serde(deserialize_with = "check::share")]
    pub floor: f64,
}

impl Default for AllocateSettings {
    fn default() -> Self {
        Self { strategy: None, pilot_spp: 16, floor: 0.25 }
    }
}

/// `[render]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransportSettings {
    /// Compensates the energy loss of rough metal, glass and sheets, which the microfacet model loses between facets
    /// (Turquin 2019). Default false: the model of other renderers.
    pub energy_compensation: bool,
    /// `"layered"` (default) conserves energy; `"mitsuba"` adds the lobes as Mitsuba's `principled`, for comparisons.
    pub principled: PrincipledModel,
}

/// `[output]`: paths relative to the current folder. A file without a path is not written.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputSettings {
    /// 8-bit PNG with gamma 2.2.
    pub image: Option<PathBuf>,
    /// 16-bit linear image, `.png` or `.tif`.
    pub linear: Option<PathBuf>,
    /// EXR with mean, variance and the other planes.
    pub exr: Option<PathBuf>,
    /// Statistics, JSON.
    pub stats: Option<PathBuf>,
    /// The plan of samples per pixel, for a replay.
    pub plan: Option<PathBuf>,
    /// The place of the bits in the 16 of the linear image. Default `"right"`.
    pub align: Align,
}

/// The place of the bits of a grey value in 16 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// The lowest bits: the number is the grey value, as in `Mono12` of GenICam.
    #[default]
    Right,
    /// The highest bits: the number is the grey value times a power of two.
    Left,
}

/// `[environment]`: exactly one of `radiance` and `image`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EnvironmentSettings {
    /// The same radiance [W/(m^2 sr)] from all directions.
    #[serde(deserialize_with = "check::light")]
    pub radiance: Option<Rgb>,
    /// An equirectangular HDR or EXR image, relative to the job file: +y is up, its centre is the direction -z.
    pub image: Option<PathBuf>,
    /// Multiplies the image to give radiance [W/(m^2 sr)]. Default 1.
    #[serde(deserialize_with = "check::light")]
    pub scale: Option<Rgb>,
    /// Turns the image about the +y axis \[rad\]; written as `"90deg"`. Default 0.
    #[serde(deserialize_with = "check::angle")]
    pub rotation: Option<f32>,
}

impl Job {
    /// Reads a job file.
    ///
    /// # Errors
    /// If the file cannot be read or is invalid: with line and caret.
    pub fn from_file(path: &Path) -> Result<Self, InputError> {
        let mut inputs = InputFiles::new();
        let file = TomlFile::read(path, Role::Job, &mut inputs)?;
        let mut job = Self::from_toml(file)?;
        inputs.extend(&job.inputs);
        job.inputs = inputs;
        Ok(job)
    }

    /// Reads a job from a text. `path` appears in messages. Input paths are relative to its folder.
    ///
    /// # Errors
    /// If the text is invalid.
    pub fn from_text(path: impl Into<PathBuf>, text: impl Into<String>) -> Result<Self, InputError> {
        Self::from_toml(TomlFile::from_text(path, text))
    }

    /// The job of a scene file without settings.
    ///
    /// # Errors
    /// A path that is not UTF-8.
    pub fn of_scene(path: &Path) -> Result<Self, InputError> {
        let name = path
            .file_name()
            .and_then(|name| name.to_str())
            .ok_or_else(|| InputError::of_file(path, "is not UTF-8", "rename the file"))?;
        let text = toml::to_string(&BTreeMap::from([("scene", name)]));
        Self::from_toml(TomlFile::from_text(path, text.unwrap_or_default()))
    }

    /// This job with the keys of another TOML text, as if they were at its end: tables are merged key by key, lists of
    /// tables (`[[object]]`) are extended, and every other value is replaced. Keys that belong together are replaced
    /// together: the limits of the budget, and a sensor with its gain. Width and height of the film are the size of the
    /// render ([`Self::size`]).
    ///
    /// # Errors
    /// A text that is not TOML, or keys and values that a job may not have. Lines in messages are those of the combined
    /// text.
    pub fn with_overrides(&self, overrides: &str) -> Result<Self, InputError> {
        let above = TomlFile::from_text("the overrides", overrides);
        let model = above.text_at(&["sensor", "model"]).unwrap_or_default();
        let is_without = model.trim_matches(['"', '\'']) == "none";
        for key in ["exposure", "exposure_noise"].map(|key| ["sensor", key]) {
            if is_without && above.has_key(&key) {
                return Err(above.error_at_key(&key, NO_SENSOR, "name a sensor, or leave this out"));
            }
        }
        let strategy = above.text_at(&["allocate", "strategy"]).unwrap_or_default();
        if is_without && strategy.trim_matches(['"', '\'']) == "sensor" {
            let problem = "the allocation `sensor` needs the noise of a sensor";
            return Err(above.error_at_key(&["allocate", "strategy"], problem, "name a sensor, or write `uniform`"));
        }
        let mut job = Self::from_toml(self.source.with_overrides(&above, overlay::replace_together)?)?;
        let film = above.parse::<FilmSection>()?.film;
        let table = above.parse::<toml::Table>()?;
        if table.get("film").and_then(toml::Value::as_table).is_none_or(overlay::is_size) {
            job.size = [film.width.or(self.size[0]), film.height.or(self.size[1])];
        }
        let mut inputs = self.inputs.clone();
        inputs.extend(&job.inputs);
        job.inputs = inputs;
        Ok(job)
    }

    /// The first section in which another job describes another scene, so that its scene must be built anew. The vignetting
    /// of a lens belongs to the exposure.
    pub fn difference_of_scenes(&self, other: &Self) -> Option<&'static str> {
        let cameras = |job: &Self| {
            let mut cameras = job.camera.clone();
            cameras.defined.iter_mut().filter_map(|c| c.lens.as_mut()).for_each(|lens| lens.vignetting = None);
            cameras
        };
        let same = [
            ("scene", self.scene == other.scene),
            ("import", self.import == other.import),
            ("camera", cameras(self) == cameras(other)),
            ("line_scan", self.line_scan == other.line_scan),
            ("render", self.render == other.render),
            ("environment", self.environment == other.environment),
            ("object", self.objects == other.objects),
            ("material", self.materials == other.materials),
            ("light", self.lights == other.lights),
        ];
        same.into_iter().find_map(|(section, is_same)| (!is_same).then_some(section))
    }

    /// The file of the job, for messages; relative paths in the job are relative to its folder.
    pub fn path(&self) -> &Path {
        self.source.path()
    }

    /// The paths of all keys with values that the text sets.
    pub fn keys(&self) -> Vec<Vec<&str>> {
        self.source.keys()
    }

    /// Does the text set this key?
    pub fn sets(&self, key: &[&str]) -> bool {
        self.source.has_key(key)
    }

    /// The text of the job.
    pub fn text(&self) -> &str {
        self.source.text()
    }

    /// Does another job read the same scene files in the same way?
    pub fn has_scene_of(&self, other: &Self) -> bool {
        self.scene == other.scene && self.import == other.import
    }

    fn from_toml(file: TomlFile) -> Result<Self, InputError> {
        let mut job: Self = file.parse()?;
        job.scene.resolve(&file);
        if let SensorChoice::File(path) = &mut job.sensor.model {
            *path = file.resolve(&path);
        }
        let lenses =
            std::iter::once(&mut job.lens).chain(job.camera.defined.iter_mut().flat_map(|camera| &mut camera.lens));
        lenses.filter_map(LensSettings::mtf_file).for_each(|path| *path = file.resolve(&path));
        lens::check_film(&job.film, &job.sensor.model)
            .map_err(|e| file.error_at_key(&["film", &e.place], e.problem, e.help))?;
        lens::check_lens(&job.lens, &job.film, &job.sensor.model)
            .map_err(|e| file.error_at_key(&["lens", &e.place], e.problem, e.help))?;
        job.check_captures(&file)?;
        job.camera.complete(&file, &job.lens, &job.film, &job.sensor.model)?;
        for key in ["exposure", "exposure_noise", "gain", "temperature", "black_level"].map(|key| ["sensor", key]) {
            if job.sensor.model == SensorChoice::None && file.has_key(&key) {
                return Err(file.error_at_key(&key, NO_SENSOR, "name a [sensor] model, or remove this"));
            }
        }
        if let Some(environment) = &mut job.environment {
            let (radiance, image) = (environment.radiance.is_some(), environment.image.is_some());
            if radiance == image {
                let problem =
                    if image { "`radiance` and `image` exclude each other" } else { "the environment is empty" };
                return Err(file.error_at_key(&["environment"], problem, "write either `radiance` or `image`"));
            }
            if let Some(key) = [("scale", environment.scale.is_some()), ("rotation", environment.rotation.is_some())]
                .iter()
                .find_map(|(key, given)| (radiance && *given).then_some(key))
            {
                let problem = format!("`{key}` has no effect on a constant radiance");
                return Err(file.error_at_key(&["environment", key], problem, "remove it, or give an image"));
            }
            environment.image = environment.image.as_ref().map(|path| file.resolve(path));
        }
        if file.has_key(&["denoise", "oidn"]) && !file.has_key(&["denoise", "method"]) {
            job.denoise.method = DenoiseMethod::Oidn;
        }
        job.denoise.oidn = job.denoise.oidn.as_ref().map(|path| file.resolve(path));
        job.objects = ObjectOverride::read_all(&file)?;
        job.materials = MaterialOverride::read_all(&file)?;
        job.lights = Light::read_all(&job, &file)?;
        job.inputs = job.named_inputs();
        job.source = file;
        Ok(job)
    }

    /// The input files of the job, readable or not, and the job file if the job was read from one.
    pub fn inputs(&self) -> &InputFiles {
        &self.inputs
    }

    fn named_inputs(&self) -> InputFiles {
        let mut inputs = InputFiles::new();
        let lenses = std::iter::once(&self.lens).chain(self.camera.defined.iter().flat_map(|camera| &camera.lens));
        for psf in lenses.flat_map(|lens| &lens.psf) {
            if let PsfSettings::File(path) = psf {
                inputs.add(path, Role::Mtf);
            }
        }
        self.scene.files().iter().for_each(|file| inputs.add(&file.path, Role::Scene));
        if let SensorChoice::File(path) = &self.sensor.model {
            inputs.add(path, Role::Sensor);
        }
        if let Some(path) = self.environment.as_ref().and_then(|e| e.image.as_ref()) {
            inputs.add(path, Role::Environment);
        }
        let heights = self.materials.iter().filter_map(|material| material.layers.height.as_ref());
        heights.for_each(|height| inputs.add(&height.image, Role::Texture));
        self.lights.iter().filter_map(Light::profile).for_each(|path| inputs.add(path, Role::LightProfile));
        inputs
    }

    /// An error of reading the sensor of `[sensor] model`. Without a line of a sensor file, it points at the line of the job.
    pub fn sensor_error(&self, error: InputError) -> InputError {
        if error.source_span.is_some() {
            return error;
        }
        let problem = format!("{}: {}", error.file.display(), error.problem);
        self.source.error_at_key(&["sensor", "model"], problem, error.help)
    }
}
