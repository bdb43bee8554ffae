//! From a camera sample to radiance: unidirectional path tracing with next-event estimation.
//!
//! [`estimate`] is the whole estimator on one page; `path` follows a ray through the scene.

#![forbid(unsafe_code)]

mod cover;
mod direct;
pub mod estimate;
mod kernel;
mod labels;
mod path;
mod sets;
mod trace;
mod vertex;
mod walk;

pub use estimate::{Estimator, PixelSample};
pub use labels::{Label, label};
pub use trace::{ConnectionTally, PathTrace, TraceConnection, TraceScattering, TraceVertex};
