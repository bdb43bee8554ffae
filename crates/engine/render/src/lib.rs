//! The engine: pilot, sample plan and rounds within a budget, on the threads of one pool, with checkpoints that later
//! processes continue.
//!
//! [`render()`] takes a compiled scene and [`RenderSettings`] and returns a [`Rendering`]: exact sums per pixel, ids
//! and the course of the render. It writes no file but its checkpoint. [`film_noise`] contains the noise of a film
//! relative to a sensor. Plans, noise-matched exposure and certificates are computed from it.

#![forbid(unsafe_code)]

mod checkpoint;
mod driver;
mod error;
pub mod film_noise;
pub mod lens_image;
mod load;
mod merge;
pub mod parallel;
mod plan;
mod progress;
mod render_key;
mod rendered_film;
mod round;
mod saved_film;
mod session;
mod settings;
mod stage;
mod training;
mod validate;
mod view;

pub use checkpoint::ResumedWork;
pub use driver::{OutputDryRun, Rendering, render, render_with_dry_run, thread_count};
pub use error::{Error, ErrorParts, camera_help, written};
pub use load::program_seconds;
pub use merge::{JoinedParts, PartSummary};
pub use plan::forecast::{FORECAST_LEVELS, Forecast, ForecastCourse, ForecastLevel};
pub use progress::{Cancel, Progress, ProgressState, Silent};
pub use render_key::RenderKey;
pub use rendered_film::RenderedFilm;
pub use round::TILE;
pub use saved_film::SavedFilm;
pub use session::{MAX_NICE, MAX_THREADS, Session, check_threads};
pub use settings::{
    Budget, Capture, CaptureRows, CheckpointSettings, DEFAULT_CHECKPOINT_SECONDS, DEFAULT_F_NUMBER, DEFAULT_PILOT_SPP,
    DEFAULT_SPP, DenoiseMethod, DenoiseSettings, MAX_PIXELS, MAX_SIDE, MAX_TRAINING_PATHS, MIN_TRAINED_PIXELS,
    MIN_TRAINED_SECONDS, OIDN_VARIABLE, PIXELS_PER_TRAINING_PATH, RenderSettings, RunSettings, SensorChoice,
    TRAINING_PATHS, UNKNOWN_SPP, lock,
};
pub use stage::Stage;
pub use training::train;
pub use validate::validate;
pub use view::{camera, find_camera};
