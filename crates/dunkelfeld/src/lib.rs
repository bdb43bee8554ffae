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
//! sink and a cancellation switch: see `examples/unrolled.rs`. The modules below re-export the types that such a
//! program needs. The engine itself is in the crates `dunkelfeld-*`.
//!
//! Features, all on by default: `gltf` and `obj` read scenes of these formats, `oidn` loads the denoiser Intel Open
//! Image Denoise. A program without one of them refuses such a scene or denoiser with an error that names the feature.

#![forbid(unsafe_code)]

mod black_image;
mod camera_fit;
mod commands;
mod denoising;
mod expose_options;
mod exposer;
mod exr_image;
mod film_files;
mod film_part;
mod frame;
pub mod guard;
pub mod guide;
mod image_noise;
mod inspect;
mod light_layers;
mod memory;
mod noise_compensation;
mod oidn_library;
mod options;
mod outliers;
mod outputs;
mod project;
mod sensor_hazards;
mod sensor_sheet;
mod shutter;
mod stations;
mod stats;
mod traced_sample;
mod views;

pub use black_image::black_image;
pub use commands::denoise::{DenoisePlanes, DenoisedFile, check_denoise_output, denoise_exr, denoise_planes};
pub use commands::expose::{ExposeOutputs, ExposeSettings, ExposedFile, OfImage, expose_exr};
pub use commands::init::{init, init_text};
pub use commands::merge::{MergeSettings, Merged, merge};
pub use denoising::{Denoised, PoolExecutor, denoise_film, find_denoiser, select_denoiser, why_builtin};
pub use expose_options::{ImageOptions, expose_image, expose_radiance};
pub use exposer::{Exposer, through_lens};
pub use exr_image::{ExrImage, LensSource};
pub use film_files::{save_film, save_film_files};
pub use frame::{Frame, Picture, SensorFrame, develop, develop_behind_lens, develop_film, show_denoised};
pub use guard::DefaultPath;
pub use image_noise::ImageNoise;
pub use inspect::{
    CameraEntry, CoverEntry, CoverLayerEntry, EffectEntry, Inspection, LightEntry, MaterialEntry, ObjectEntry, inspect,
};
pub use light_layers::{add_light_layers, sum_of_means};
pub use memory::{KeptFilms, MemoryAccount, MemoryItem, MemoryStats, check_image_memory};
pub use noise_compensation::Matched;
pub use options::{
    ExposeOptions, ExposureOption, RenderOptions, ReplayOption, SensorOption, certify_film, denoise_saved, expose_film,
    picture_of_film, select_sensor,
};
pub use outliers::HeavySample;
pub use outputs::{
    Align, OutputPaths, SavedPlan, encode_layers, encode_picture, load_plan, load_plan_recorded, save_exr, save_linear,
    save_new, save_picture, save_plan, save_text,
};
pub use project::{
    Project, ProjectOptions, ProjectResult, find_sensor, find_sensor_recorded, read_scene, removable_effects,
};
pub use sensor_sheet::sensor_sheet;
pub use shutter::TimedExposure;
pub use stations::{STATIONS, Station};
pub use stats::{CertificateStats, DenoiseStats, PartStats, STATS_VERSION, SensorStats, Stats};

pub use dunkelfeld_denoise::{DenoiseError, Denoiser};
pub use dunkelfeld_film::NO_ID;
pub use dunkelfeld_io::job::DEFAULT_SENSOR;
pub use dunkelfeld_render::film_noise::Certified;
pub use dunkelfeld_render::parallel::{mean_image, mean_without_gaps};
pub use dunkelfeld_render::{
    Budget, Cancel, CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, DEFAULT_F_NUMBER, DEFAULT_PILOT_SPP, DEFAULT_SPP,
    DenoiseMethod, DenoiseSettings, Error, FORECAST_LEVELS, Forecast, ForecastCourse, ForecastLevel, MAX_NICE,
    MAX_PIXELS, MAX_SIDE, MAX_THREADS, OIDN_VARIABLE, Progress, ProgressState, RenderSettings, RenderedFilm, Rendering,
    ResumedWork, SavedFilm, SensorChoice, Session, Silent, Stage, camera, program_seconds, render, written,
};

pub use dunkelfeld_io::InputError;
pub use dunkelfeld_io::import::{EmissiveUnit, ImportOptions};
pub use dunkelfeld_io::input::{InputFiles, Role as InputRole};

/// Allocation of samples, and the certificate of a render.
pub mod adaptive {
    pub use dunkelfeld_adaptive::budget::{MAX_MEAN_SPP, NOISE_LEVELS, SHARES};
    pub use dunkelfeld_adaptive::plan::MAX_SPP;
    pub use dunkelfeld_adaptive::{Certificate, StopReason, Strategy, UnknownStrategy};
}

/// Sums of samples per pixel, and images.
pub mod film {
    pub use dunkelfeld_film::{Accumulate, Film, FilmError, FilmLayers, MeanImage, PixelSums, Plane, Sample};
}

/// Meshes, and the vectors and transforms of `glam`.
pub mod geometry {
    pub use dunkelfeld_geometry::{
        Aabb, DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3, LocalDir, Mat3, Mesh, Quat, RigidMotion, Spin, Transform,
        TransformError, Vec2, Vec3, Vec4,
    };
}

/// Files of sensors, quantities with units, and text that a terminal can print.
pub mod io {
    pub use dunkelfeld_io::job::{literal_pattern, matches};
    pub use dunkelfeld_io::private_file::PrivateFile;
    pub use dunkelfeld_io::quantity::{Factor, Length, Memory, QuantityError, Time};
    pub use dunkelfeld_io::sensor_file;
    pub use dunkelfeld_io::toml_file::toml_text;
    pub use dunkelfeld_io::visible::{visible, visible_json, visible_line};
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
        AlphaMode, Aperture, Blades, BuildCache, BuildError, BuildReport, Camera, CameraError, ChannelTexture,
        ColorEncoding, Distortion, Effect, Effects, Environment, EnvironmentSource, FilmWindow, Filter, Finding, Image,
        ImageId, Instance, Lens, LightInfo, LightProfile, LineScan, Material, MeshPart, ObjectInfo, Opening, PartInfo,
        ProfileError, Projection, PunctualKind, PunctualLight, RayGenerator, Scene, SceneBuilder, SceneSummary,
        Severity, Shutter, Surface, Texels, Texture, TextureTransform, ThinLens, Vignetting, Volume, Wrap,
        framing_camera, look_at, shapes,
    };
}

/// EMVA 1288 sensors, lenses and exposures.
pub mod sensor {
    pub use dunkelfeld_sensor::{
        BayerPattern, ChannelSheet, ColorFilter, DarkCurrent, DataSheet, Device, Efficiency, Exposure, ExposureNoise,
        Figure, FilterColor, FrameKey, ImageExposure, LensBlur, MtfCurve, MtfTable, Optics, PRESETS, Psf, Published,
        QuantumEfficiency, Readout, SensorError, SensorModel, SensorSpec, auto_exposure, data_sheet, display,
    };
}

/// Single samples, to find the cause of a wrong pixel.
pub mod trace {
    pub use crate::traced_sample::{TracedConnection, TracedSample, TracedScattering, TracedVertex};
    pub use dunkelfeld_bsdf::Lobe;
    pub use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelIds, PixelSample, TraceConnection};
    pub use dunkelfeld_render::train;
}
