//! Whether and how the picture of a render is denoised.

use derive_setters::Setters;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The variable of the environment that names Intel Open Image Denoise.
pub const OIDN_VARIABLE: &str = "DUNKELFELD_OIDN";

/// Assumed duration of a denoiser until it has been measured [s of one thread per megapixel]: on the safe side for machines of the
/// last ten years.
const OIDN_PER_MEGAPIXEL: f64 = 14.0;
const BUILTIN_PER_MEGAPIXEL: f64 = 8.0;
/// And whatever the size: loading the library, making its device.
const OIDN_START: f64 = 0.6;

/// Which denoiser.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DenoiseMethod {
    /// None.
    #[default]
    Off,
    /// Intel Open Image Denoise if this machine has it, else the built-in filter.
    Auto,
    /// Intel Open Image Denoise.
    Oidn,
    /// The built-in filter.
    Builtin,
}

impl DenoiseMethod {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Off, Self::Auto, Self::Oidn, Self::Builtin];

    /// Its name on the command line and in jobs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Auto => "auto",
            Self::Oidn => "oidn",
            Self::Builtin => "builtin",
        }
    }
}

/// Whether and how an image is denoised.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[serde(deny_unknown_fields, default)]
pub struct DenoiseSettings {
    /// Which denoiser.
    pub method: DenoiseMethod,
    /// Intel Open Image Denoise: the library or the folder that it is in. `None`: the path in [`OIDN_VARIABLE`], then
    /// where systems have it.
    #[setters(into)]
    pub oidn: Option<PathBuf>,
}

impl DenoiseSettings {
    /// Time to reserve for denoising this number of pixels \[s\], before it has been measured.
    pub fn expected_seconds(&self, pixels: u64, threads: usize) -> f64 {
        let (start, per_megapixel) = match self.method {
            DenoiseMethod::Off => return 0.0,
            DenoiseMethod::Auto | DenoiseMethod::Oidn => (OIDN_START, OIDN_PER_MEGAPIXEL),
            DenoiseMethod::Builtin => (0.0, BUILTIN_PER_MEGAPIXEL),
        };
        start + per_megapixel * pixels as f64 * 1e-6 / threads.max(1) as f64
    }
}
