//! Denoising: the input and output of every denoiser.
//!
//! A denoised image is cosmetic. It is an addition to the unbiased mean and never replaces it. Statistics, certificates
//! and measured grey values never use it.

// `oidn` calls a library in C; nothing else here may be unsafe.
#![deny(unsafe_code)]

mod builtin;
mod denoiser;
#[cfg(feature = "oidn")]
pub mod oidn;
mod settings;

pub use builtin::Builtin;
pub use denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Executor, Serial, Triples};
#[cfg(feature = "oidn")]
pub use oidn::Oidn;
pub use settings::{DenoiseMethod, DenoiseSettings, OIDN_VARIABLE};
