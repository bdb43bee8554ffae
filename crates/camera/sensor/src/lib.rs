//! The EMVA 1288 camera: from the radiance on the film to the grey values of a frame.
//!
//! The steps for a pixel follow the model of the standard (EMVA 1288 release 4.0, Linear):
//!
//! 1. [`Response`]: radiance -> irradiance through the lens -> photons on the pixel -> expected electrons;
//! 2. [`Device::expose`]: photon and dark noise, fixed pattern, read noise, full well, gain, offset, one rounding ->
//!    DN;
//! 3. [`display`]: DN -> the 8-bit gamma-2.2 image, for display only, never for measurement.
//!
//! With a colour filter array a frame stays a raw mosaic. Only the display image has three channels.
//!
//! A rendered mean has noise of its own. [`Device::expose_rows_matched`] draws the camera's noise less the noise of the
//! render.
//!
//! All functions are pure. A grey value depends only on model, device seed, frame seed, frame, pixel and expected
//! electrons, so rows may be exposed on any number of threads.

#![forbid(unsafe_code)]

mod bands;
mod data_sheet;
mod demosaic;
pub mod display;
mod efficiency;
mod error;
mod expose;
mod lens_blur;
mod matched;
mod model;
mod optics;
mod parallel;
mod pattern;
mod poisson;
mod presets;
mod psf;
mod random;

pub use bands::Bands;
pub use data_sheet::{ChannelSheet, DataSheet, Figure, data_sheet};
pub use efficiency::{BANDS, BayerPattern, ColorFilter, Efficiency, FilterColor, QuantumEfficiency};
pub use error::{SensorError, time_in_words};
pub use expose::{Device, FrameKey, Readout};
pub use lens_blur::LensBlur;
pub use matched::{ExposureNoise, LeftOut, holds, largest_variance, left_out, matched_where};
pub use model::{DarkCurrent, Published, SensorModel, SensorSpec};
pub use optics::{
    DARK_EXPOSURE, Exposure, ImageExposure, MeanElectrons, Optics, Response, Weights, auto_exposure, electrons,
};
pub use pattern::{Defects, FixedPattern, PixelPattern};
pub use poisson::poisson;
pub use presets::PRESETS;
pub use psf::{MtfCurve, MtfTable, Psf};
