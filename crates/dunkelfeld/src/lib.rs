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
//! Or the same stages one by one ([`render()`], [`develop_film()`]), with a scene built in code, a progress sink and a switch to
//! cancel: see `examples/unrolled.rs`. The crates below are re-exported under their folder's name.

#![forbid(unsafe_code)]

pub mod bench;
mod campaign;
mod check;
mod checkpoint;
mod denoise_file;
mod denoising;
mod develop;
pub mod emva;
mod error;
mod expose_file;
mod forecast;
mod guard;
mod heavy;
mod identity;
mod inspect;
mod lens;
mod look;
mod matched;
mod memory;
mod merge;
mod noise;
mod outputs;
mod parallel;
mod pass;
mod planner;
mod progress;
mod project;
pub mod ptc;
mod render;
mod report;
mod round;
mod settings;
mod stats;
mod trend;

pub use checkpoint::{CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, Earlier};
pub use denoise_file::{DenoisedFile, check_denoise_output, denoise_exr};
pub use denoising::{
    DenoiseMethod, DenoiseSettings, Denoised, OIDN_VARIABLE, PoolExecutor, denoise_film, find_denoiser,
};
pub use develop::{Frame, Picture, SensorFrame, develop, develop_film, show_denoised};
pub use error::Error;
pub use expose_file::{ExposeOutputs, ExposeSettings, ExposedFile, Exposer, expose_exr};
pub use forecast::{FORECAST_LEVELS, Forecast, ForecastLevel};
pub use guard::DefaultPath;
pub use heavy::HeavySample;
pub use inspect::{
    CameraEntry, CoverEntry, CoverLayerEntry, EffectEntry, Inspection, LightEntry, MaterialEntry, inspect,
};
pub use matched::Matched;
pub use memory::{MemoryAccount, MemoryItem, MemoryStats};
pub use merge::{MergeSettings, Merged, merge};
pub use noise::{Certified, certify};
pub use outputs::{
    NO_ID, OutputPaths, SavedPlan, encode_layers, load_plan, load_plan_recorded, save_exr, save_linear, save_picture,
    save_plan, save_text,
};
pub use progress::{Cancel, Progress, ProgressState, Silent, Stage};
pub use project::{Project, ProjectResult, find_sensor, find_sensor_recorded, read_scene};
pub use render::{Rendering, camera, render, thread_pool};
pub use settings::{Budget, DEFAULT_PILOT_SPP, DEFAULT_SPP, MAX_PIXELS, MAX_SIDE, RenderSettings, SensorChoice};
pub use stats::{CertificateStats, DenoiseStats, PartStats, STATS_VERSION, SensorStats, Stats};

pub use dunkelfeld_io::job::DEFAULT_SENSOR;

pub use dunkelfeld_adaptive as adaptive;
pub use dunkelfeld_bsdf as bsdf;
pub use dunkelfeld_bvh as bvh;
pub use dunkelfeld_denoise as denoise;
pub use dunkelfeld_emva1288 as emva1288;
pub use dunkelfeld_film as film;
pub use dunkelfeld_geometry as geometry;
pub use dunkelfeld_integrator as integrator;
pub use dunkelfeld_io as io;
pub use dunkelfeld_radiometry as radiometry;
pub use dunkelfeld_sampling as sampling;
pub use dunkelfeld_scene as scene;
pub use dunkelfeld_sensor as sensor;
