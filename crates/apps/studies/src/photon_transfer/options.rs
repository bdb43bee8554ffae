//! Options of the photon transfer of a scene, as the command line and Python name them.

use super::settings::PtcSettings;
use derive_setters::Setters;
use dunkelfeld::{DenoiseMethod, DenoiseSettings};
use std::path::PathBuf;

/// Options of the photon transfer of a scene. An empty list and `None` mean the default of [`PtcSettings`].
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct PtcOptions {
    /// Frames of each series.
    pub frames: Option<u32>,
    /// Mean samples per pixel of the series, ascending.
    pub spp: Vec<u32>,
    /// Denoiser of the pictures. The default is `Auto`, or `Oidn` if its library is named.
    pub denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise: the library or its folder.
    pub oidn: Option<PathBuf>,
    /// Share of the pixels with the steepest gradient that count as strong edges.
    pub edges: Option<f64>,
    /// Leaves out the frames of the sensor.
    pub pictures_only: bool,
}

impl From<PtcOptions> for PtcSettings {
    fn from(options: PtcOptions) -> Self {
        let mut settings = Self::default();
        settings.frames = options.frames.unwrap_or(settings.frames);
        if !options.spp.is_empty() {
            settings.spp = options.spp;
        }
        settings.edges = options.edges.unwrap_or(settings.edges);
        settings.camera = !options.pictures_only;
        let usual = if options.oidn.is_some() { DenoiseMethod::Oidn } else { DenoiseMethod::Auto };
        let mut denoise = DenoiseSettings::default().with_method(options.denoise.unwrap_or(usual));
        denoise.oidn = options.oidn;
        settings.denoise = denoise;
        settings
    }
}
