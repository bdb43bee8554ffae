//! Radiometric quantities: linear RGB, units as types, the path from watts to photons.

#![forbid(unsafe_code)]

mod number;
pub mod photon;
mod rgb;
mod units;

pub use number::Number;
pub use photon::PHOTOPIC;
pub use rgb::Rgb;
pub use units::{Celsius, DigitalNumber, Electrons, Irradiance, Metres, Nanometres, Radiance, Seconds};
