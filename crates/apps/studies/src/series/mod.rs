//! Many renders as one long computation. Each is stored in a folder as soon as it is finished, so that interrupted work
//! continues. All share one progress and one exposure.

mod camera_view;
mod campaign;
mod progress;
pub(crate) mod statistics;
mod store;

pub(crate) use camera_view::{View, exposure_words};
pub use campaign::StudyOutcome;
pub(crate) use campaign::{Made, render_missing};
pub(crate) use progress::Meter;
pub(crate) use store::{Kept, UNITS, hash_text, push_plane, study_key};
