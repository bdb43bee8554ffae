//! An EMVA 1288 analyser: from frames of grey values to the figures of a camera.
//!
//! It sees grey values and nothing else, and shares no code with the simulator: what it finds in simulated frames is
//! evidence. Units: grey values in DN, variances in DN^2. Every result is a [`Quantity`] with its standard error.
//!
//! 1. [`FramePair`] and [`StackAccumulator`]: what frames show, seen one at a time and then forgotten;
//! 2. [`Measurement`]: levels of light, dark levels and stacks;
//! 3. [`analyse`]: all figures of a linear camera; [`analyse_general`]: those that any camera has.
//!
//! For frames that are no measurement of the standard, of any scene: [`TemporalAccumulator`] and [`PhotonTransfer`], the
//! variance against the mean by unit-wide bins.

#![forbid(unsafe_code)]

mod analysis;
mod bound;
mod frame;
mod general;
mod hidden;
mod histogram;
mod linearity;
mod measurement;
mod photon_transfer;
mod profile;
mod propagate;
mod quantity;
mod saturation;
mod shortcomings;
mod spatial;
mod spectrum;
mod stack;
mod summary;
mod temporal;

pub use analysis::{Analysis, DarkPoint, LevelPoint, Nonuniformity, analyse};
pub use bound::{Bound, Side};
pub use frame::{AnalysisError, Frame};
pub use general::{GeneralAnalysis, InputPoint, analyse_general};
pub use histogram::Histogram;
pub use linearity::Linearity;
pub use measurement::{AnalysisSettings, Level, Measurement, Release, StackLevel};
pub use photon_transfer::{LineFit, PhotonTransfer, TransferPoint};
pub use profile::Profile;
pub use quantity::Quantity;
pub use spectrum::Spectrogram;
pub use stack::{SpatialStack, StackAccumulator};
pub use temporal::{FramePair, TemporalAccumulator, TemporalStatistics};
