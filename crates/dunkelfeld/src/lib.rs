//! Dunkelfeld: a CPU path tracer with a built-in EMVA 1288 camera sensor.
//!
//! One call, from a scene file to an exposed frame on disk:
//!
//! ```no_run
//! let mut project = dunkelfeld::Project::open("scene.glb")?;
//! project.settings.budget.spp = Some(64.0);
//! let result = project.render()?;
//! result.save_image("frame.png")?;
//! # Ok::<(), dunkelfeld::Error>(())
//! ```
//!
//! [`guide`] has an example for each task: arrays of pixels, exposures, poses, scenes in code. A [`Project`] can be rendered
//! as often as needed, with other settings and with changes of its scene.
//!
//! The stages can also be called one by one ([`render()`], [`develop_film()`]), with a scene built in code, a progress
//! sink and a cancellation switch: see `examples/unrolled.rs`. The root of the crate has the names of the usual way
//! from a scene to an image. The modules have the rest, by subject:
//!
//! | modules | contents |
//! |---|---|
//! | [`scene`], [`geometry`], [`inspect`] | scenes and their parts |
//! | [`film`], [`adaptive`], [`trace`], [`light_layers`] | sums of samples, plans, single samples, groups of lights |
//! | [`sensor`], [`denoising`] | the way from radiance to an image |
//! | [`outputs`], [`stats`], [`io`], [`guard`] | files, statistics, texts |
//! | [`commands`] | the commands of the program on files |
//! | [`radiometry`], [`limits`], [`memory`] | units, limits of settings, memory |
//!
//! Features, all on by default: `gltf` and `obj` read scenes of these formats, `oidn` loads the denoiser Intel Open
//! Image Denoise. A program without one of them refuses such a scene or denoiser with an error that names the feature.

#![forbid(unsafe_code)]

mod black_image;
mod camera_fit;
pub mod commands;
mod default_settings;
pub mod denoising;
mod expose_options;
mod exposer;
mod exr_image;
mod film_files;
mod film_part;
mod frame;
pub mod guard;
pub mod guide;
mod image_noise;
pub mod inspect;
pub mod light_layers;
pub mod memory;
mod noise_compensation;
mod oidn_library;
mod options;
mod outliers;
pub mod outputs;
mod project;
mod sensor_hazards;
mod sensor_sheet;
mod shutter;
mod stations;
pub mod stats;
mod traced_sample;
mod views;

pub use commands::expose::ExposeSettings;
pub use default_settings::default_settings;
pub use expose_options::ExposeOptions;
pub use exposer::Exposer;
pub use frame::{Frame, Picture, develop, develop_behind_lens, develop_film};
pub use inspect::Inspection;
pub use options::{RenderOptions, ReplayOption};
pub use outputs::{OutputPaths, save_picture};
pub use project::{GivenSensor, Project, ProjectOptions, ProjectResult, find_sensor};
pub use stats::Stats;

pub use dunkelfeld_io::InputError;
pub use dunkelfeld_io::input::InputFiles;
pub use dunkelfeld_render::{
    Budget, Cancel, DenoiseMethod, DenoiseSettings, Error, Progress, ProgressState, RenderSettings, RenderedFilm,
    Rendering, SavedFilm, SensorChoice, Session, Silent, Stage, camera, render,
};

/// Allocation of samples, forecasts, and the certificate of a render.
pub mod adaptive {
    pub use dunkelfeld_adaptive::budget::{MAX_MEAN_SPP, NOISE_LEVELS, SHARES};
    pub use dunkelfeld_adaptive::plan::MAX_SPP;
    pub use dunkelfeld_adaptive::sobel;
    pub use dunkelfeld_adaptive::{Certificate, StopReason, Strategy, UnknownStrategy};
    pub use dunkelfeld_render::{FORECAST_LEVELS, Forecast, ForecastCourse, ForecastLevel};
}

/// Sums of samples per pixel, images, checkpoints, and the steps after a saved film.
pub mod film {
    pub use crate::options::{certify_film, denoise_saved, expose_film, picture_of_film};
    pub use dunkelfeld_film::{Accumulate, Film, FilmError, FilmLayers, MeanImage, NO_ID, PixelSums, Plane, Sample};
    pub use dunkelfeld_render::film_noise::{Certified, FilmNoise, SignalModel};
    pub use dunkelfeld_render::lens_image::LensImage;
    pub use dunkelfeld_render::parallel::mean_image;
    pub use dunkelfeld_render::{CheckpointSettings, RenderKey, ResumedWork};
}

/// Meshes, and the vectors and transforms of `glam`.
pub mod geometry {
    pub use dunkelfeld_geometry::{
        Aabb, DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, LocalDir, Mat3, Mesh, Quat, RigidMotion, Spin, Transform,
        TransformError, Vec2, Vec3, Vec4,
    };
}

/// Defaults and limits of settings.
pub mod limits {
    pub use dunkelfeld_io::job::DEFAULT_SENSOR;
    pub use dunkelfeld_render::{
        DEFAULT_CHECKPOINT_SECONDS, DEFAULT_F_NUMBER, DEFAULT_PILOT_SPP, DEFAULT_SPP, MAX_NICE, MAX_PIXELS, MAX_SIDE,
        MAX_THREADS,
    };
}

/// Files of scenes and sensors, quantities with units, and text that a terminal can print.
pub mod io {
    pub use dunkelfeld_io::import::{EmissiveUnit, ImportOptions};
    pub use dunkelfeld_io::input::Role as InputRole;
    pub use dunkelfeld_io::job::{literal_pattern, matches};
    pub use dunkelfeld_io::keys::{KEYS, Key, Kind, OF_FILM, OF_IMAGE, OF_LENS, OF_MERGE, OF_RENDER, OF_STUDY};
    pub use dunkelfeld_io::private_file::PrivateFile;
    pub use dunkelfeld_io::quantity::{Factor, Length, Memory, QuantityError, Time};
    pub use dunkelfeld_io::sensor_file;
    pub use dunkelfeld_io::toml_file::toml_text;
    pub use dunkelfeld_io::visible::{visible, visible_json, visible_line};
    pub use dunkelfeld_render::program_seconds;
}

/// Units of light and of the sensor.
pub mod radiometry {
    pub use dunkelfeld_radiometry::{
        Celsius, DigitalNumber, Electrons, Irradiance, Metres, Nanometres, Number, Radiance, Rgb, Seconds, photon,
    };
}

/// Scenes, built in code or from a file: meshes, materials, lights, cameras.
pub mod scene {
    pub use dunkelfeld_scene::{
        AlphaMode, Anisotropy, Aperture, Blades, BuildCache, BuildError, BuildReport, Camera, CameraError, Clearcoat,
        ColorEncoding, DiffuseTransmission, Distortion, Effect, Effects, Environment, EnvironmentSource, FilmWindow,
        Filter, Finding, Finish, Grain, HeightField, HeightImage, Image, ImageId, Instance, Lens, LightInfo,
        LightProfile, LineScan, Material, MeshPart, NormalMap, ObjectInfo, Opening, Parameter, PartInfo, Process,
        ProfileError, Projection, PunctualKind, PunctualLight, RayGenerator, Scene, SceneBuilder, SceneSummary,
        Severity, Sheen, Shutter, Specular, Surface, Texels, Texture, TextureTransform, ThinLens, Vignetting, Volume,
        Wrap, framing_camera, look_at, shapes,
    };
}

/// EMVA 1288 sensors, lenses and exposures.
pub mod sensor {
    pub use crate::exposer::through_lens;
    pub use crate::frame::SensorFrame;
    pub use crate::image_noise::ImageNoise;
    pub use crate::noise_compensation::Matched;
    pub use crate::shutter::TimedExposure;
    pub use dunkelfeld_sensor::{
        BayerPattern, ChannelSheet, ColorFilter, DarkCurrent, DataSheet, Device, Efficiency, Exposure, ExposureNoise,
        Figure, FilterColor, FrameKey, ImageExposure, LensBlur, MtfCurve, MtfTable, Optics, PRESETS, Psf, Published,
        QuantumEfficiency, Readout, Response, SensorError, SensorModel, SensorSpec, auto_exposure, data_sheet, display,
        electrons,
    };
}

/// Single samples, to find the cause of a wrong pixel.
pub mod trace {
    pub use crate::traced_sample::{TracedConnection, TracedSample, TracedScattering, TracedVertex};
    pub use dunkelfeld_bsdf::Lobe;
    pub use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelIds, PixelSample, TraceConnection};
    pub use dunkelfeld_render::train;
}
