//! Radiometric quantities: linear RGB, units as types, the path from watts to photons.

#![forbid(unsafe_code)]

mod rgb;

pub use rgb::Rgb;
