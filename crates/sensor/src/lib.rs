//! The EMVA 1288 camera: from the radiance on the film to the grey values of a frame.
//!
//! The way of a pixel, as the standard draws it (EMVA 1288 release 4.0, Linear):
//!
//! 1. [`Response`]: radiance -> irradiance through the lens -> photons on the pixel -> expected electrons;
//! 2. [`Device::expose`]: photon and dark noise, fixed pattern, read noise, full well, gain, offset, one rounding -> DN;
//! 3. [`display`]: DN -> the 8-bit gamma-2.2 picture, which is for looking at, never for measuring.
//!
//! Behind a colour filter array a frame stays a raw mosaic; only the picture has three channels.
//!
//! A rendered mean has noise of its own; [`Device::expose_rows_matched`] draws of the camera's noise only what is missing.
//!
//! Everything is a pure function: a grey value depends on (model, device seed, frame seed, frame, pixel, expected
//! electrons) and on nothing else, so rows may be exposed on any number of threads.

#![forbid(unsafe_code)]

mod data_sheet;
mod demosaic;
pub mod display;
mod efficiency;
mod error;
mod expose;
mod matched;
mod model;
mod optics;
mod pattern;
mod poisson;
mod presets;
mod random;

pub use data_sheet::{ChannelSheet, DataSheet, Figure, data_sheet};
pub use efficiency::{BANDS, BayerPattern, ColorFilter, Efficiency, FilterColor, QuantumEfficiency};
pub use error::SensorError;
pub use expose::{Device, FrameKey};
pub use matched::{ExposureNoise, LeftOut, holds, left_out, matched_where};
pub use model::{DarkCurrent, Published, SensorModel, SensorSpec};
pub use optics::{Exposure, MeanElectrons, Optics, Response, Weights, auto_exposure, electrons};
pub use pattern::{Defects, FixedPattern, PixelPattern};
pub use poisson::poisson;
pub use presets::PRESETS;
