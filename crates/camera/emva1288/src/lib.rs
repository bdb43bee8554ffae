//! An EMVA 1288 analyser: from frames of grey values to the figures of a camera.
//!
//! It uses grey values and nothing else, and shares no code with the simulator. So its results for simulated frames are
//! an independent check. Units: grey values in DN, variances in DN^2. Every result is a [`Quantity`] with its standard
//! error.
//!
//! 1. [`FramePair`] and [`StackAccumulator`]: statistics of frames, which are read one at a time and not kept;
//! 2. [`Measurement`]: levels of light, dark levels and stacks;
//! 3. [`analyse`]: all figures of a linear camera; [`analyse_general`]: the figures of any camera.
//!
//! [`measured_maps`] are the pixels one by one, for a simulator. [`slanted_edge`] is the MTF from an image of an edge.
//!
//! [`TemporalAccumulator`] and [`PhotonTransfer`] are for frames of any scene, without a measurement of the standard.
//! They give the variance against the mean by unit-wide bins.

#![forbid(unsafe_code)]

mod analysis;
mod bound;
mod frame;
mod general;
mod hidden;
mod histogram;
mod linearity;
mod maps;
mod measurement;
mod photon_transfer;
mod profile;
mod propagate;
mod quantity;
mod saturation;
mod shortcomings;
mod slanted_edge;
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
pub use maps::{MeasuredMaps, measured_maps};
pub use measurement::{AnalysisSettings, Level, Measurement, Release, StackLevel};
pub use photon_transfer::{LineFit, PhotonTransfer, TransferPoint};
pub use profile::Profile;
pub use quantity::Quantity;
pub use slanted_edge::{EdgeMtf, MtfPoint, slanted_edge};
pub use spectrum::Spectrogram;
pub use stack::{SpatialStack, StackAccumulator};
pub use temporal::{FramePair, TemporalAccumulator, TemporalStatistics};
