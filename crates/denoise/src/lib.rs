//! Denoising: what every denoiser takes and gives, and the one that does nothing.
//!
//! A denoised image is cosmetic. It stands beside the unbiased mean and never replaces it: no statistic, no certificate
//! and no grey value that is measured is made from it.

// `oidn` calls a library in C, `builtin` enters code for wider registers; nothing else here may be unsafe.
#![deny(unsafe_code)]

mod builtin;
mod denoiser;
mod off;
pub mod oidn;
mod settings;

pub use builtin::Builtin;
pub use denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Executor, Serial, Triples};
pub use off::Off;
pub use oidn::Oidn;
pub use settings::{DenoiseMethod, DenoiseSettings, OIDN_VARIABLE};
