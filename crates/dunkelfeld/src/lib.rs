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
//! The stages can also be called one by one ([`render()`], [`develop_film()`]), with a scene built in code, a progress
//! sink and a cancellation switch: see `examples/unrolled.rs`. The crates below are re-exported under their folder's
//! name.
//!
//! Features, all on by default: `gltf` and `obj` read scenes of these formats, `oidn` loads the denoiser Intel Open Image
//! Denoise. A program without one of them refuses such a scene or denoiser with an error that names the feature.

#![forbid(unsafe_code)]

mod camera_fit;
mod commands;
mod denoising;
mod frame;
pub mod guard;
mod inspect;
mod memory;
mod noise_compensation;
mod oidn_library;
mod outliers;
mod outputs;
mod project;
mod stats;

pub use commands::denoise::{DenoisedFile, check_denoise_output, denoise_exr};
pub use commands::expose::{ExposeOutputs, ExposeSettings, ExposedFile, Exposer, expose_exr};
pub use commands::merge::{MergeSettings, Merged, merge};
pub use denoising::{Denoised, PoolExecutor, denoise_film, find_denoiser};
pub use frame::{Frame, Picture, SensorFrame, certify, develop, develop_film, show_denoised};
pub use guard::DefaultPath;
pub use inspect::{
    CameraEntry, CoverEntry, CoverLayerEntry, EffectEntry, Inspection, LightEntry, MaterialEntry, inspect,
};
pub use memory::{MemoryAccount, MemoryItem, MemoryStats};
pub use noise_compensation::Matched;
pub use outliers::HeavySample;
pub use outputs::{
    OutputPaths, SavedPlan, encode_layers, load_plan, load_plan_recorded, save_exr, save_linear, save_picture,
    save_plan, save_text,
};
pub use project::{Project, ProjectResult, find_sensor, find_sensor_recorded, read_scene};
pub use stats::{CertificateStats, DenoiseStats, PartStats, STATS_VERSION, SensorStats, Stats};

pub use dunkelfeld_film::NO_ID;
pub use dunkelfeld_io::job::DEFAULT_SENSOR;
pub use dunkelfeld_render::film_noise::Certified;
pub use dunkelfeld_render::{
    Budget, Cancel, CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, DEFAULT_PILOT_SPP, DEFAULT_SPP, DenoiseMethod,
    DenoiseSettings, Error, FORECAST_LEVELS, Forecast, ForecastLevel, MAX_PIXELS, MAX_SIDE, OIDN_VARIABLE, Progress,
    ProgressState, RenderSettings, RenderedFilm, Rendering, ResumedWork, SensorChoice, Session, Silent, Stage, camera,
    render, written,
};

pub use dunkelfeld_adaptive as adaptive;
pub use dunkelfeld_bsdf as bsdf;
pub use dunkelfeld_bvh as bvh;
pub use dunkelfeld_denoise as denoise;
pub use dunkelfeld_film as film;
pub use dunkelfeld_geometry as geometry;
pub use dunkelfeld_integrator as integrator;
pub use dunkelfeld_io as io;
pub use dunkelfeld_radiometry as radiometry;
pub use dunkelfeld_render as engine;
pub use dunkelfeld_sampling as sampling;
pub use dunkelfeld_scene as scene;
pub use dunkelfeld_sensor as sensor;
