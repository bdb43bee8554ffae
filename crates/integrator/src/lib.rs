//! Radiance of a camera sample: unidirectional path tracing with next-event estimation.
//!
//! [`estimator`] contains the whole estimator of a sample; `path` traces a ray through the scene.

#![forbid(unsafe_code)]

mod dimensions;
mod direct;
mod dispatch;
pub mod estimator;
pub mod learned_roulette;
mod mnee;
mod path;
mod pixel_ids;
mod ray_state;
mod recorder;
mod scatterer;
mod training;
mod vertex;
mod wavefront;

pub use estimator::{Estimator, PixelSample};
pub use learned_roulette::LearnedRoulette;
pub use pixel_ids::{Crossing, Passage, PixelIds, crossings, pixel_ids};
pub use recorder::{ConnectionTally, PathTrace, TraceConnection, TraceScattering, TraceVertex};
pub use training::TrainingBatch;
pub use wavefront::Wavefront;
