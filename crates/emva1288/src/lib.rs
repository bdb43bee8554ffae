//! An EMVA 1288 analyser: from frames of grey values to the figures of a camera.
//!
//! It sees grey values and nothing else, and shares no code with the simulator: what it finds in simulated frames is
//! evidence. Units: grey values in DN, variances in DN^2. Every result is a [`Quantity`] with its standard error.
//!
//! 1. [`TemporalAccumulator`] or [`FramePair`]: mean and temporal variance, per pixel or per level;
//! 2. [`PhotonTransfer`]: variance against mean, by levels (the standard) or by unit-wide bins (from one scene);
//! 3. [`PhotonTransfer::gain`] and [`PhotonTransfer::line`]: the overall system gain K and the dark noise.

#![forbid(unsafe_code)]

mod frame;
mod photon_transfer;
mod quantity;
mod temporal;

pub use frame::{AnalysisError, Frame};
pub use photon_transfer::{LineFit, PhotonTransfer, TransferPoint};
pub use quantity::Quantity;
pub use temporal::{FramePair, TemporalAccumulator, TemporalStatistics};
