//! Denoising: what every denoiser takes and gives, and the one that does nothing.
//!
//! A denoised image is cosmetic. It stands beside the unbiased mean and never replaces it: no statistic, no certificate
//! and no exposure reads it.

#![forbid(unsafe_code)]

mod builtin;
mod denoiser;
mod off;

pub use builtin::Builtin;
pub use denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Executor, Serial, Triples};
pub use off::Off;
