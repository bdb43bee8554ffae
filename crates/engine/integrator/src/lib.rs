//! Radiance of a camera sample: unidirectional path tracing with next-event estimation.
//!
//! [`Wavefront`] computes many samples together; [`estimator`] has the inputs of a sample.

#![forbid(unsafe_code)]

mod dimensions;
mod direct;
pub mod estimator;
pub mod learned_roulette;
mod mnee;
mod observer;
mod path;
mod pixel_ids;
mod ray_state;
mod scatterer;
mod training;
mod wavefront;

pub use estimator::{Estimator, PixelSample};
pub use learned_roulette::LearnedRoulette;
pub use observer::{ConnectionTally, PathTrace, TraceConnection, TraceScattering, TraceVertex};
pub use pixel_ids::{Crossing, Passage, PixelIds, crossings, pixel_ids, pixel_ids_of_row};
pub use training::TrainingBatch;
pub use wavefront::{LaneUse, Wavefront};
