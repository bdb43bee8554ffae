//! Settings of a photon transfer.

use derive_setters::Setters;
use dunkelfeld::adaptive::MAX_SPP;
use dunkelfeld::{DenoiseMethod, DenoiseSettings, Error};
use std::path::PathBuf;

/// Frames of the paper, and the samples per pixel of its two series.
const PAPER_FRAMES: u32 = 50;
const PAPER_SPP: [u32; 2] = [64, 2500];
/// Share of the pixels that count as strong edges.
const EDGES: f64 = 0.2;
/// Minimum number of frames for a variance with its standard error.
const MIN_FRAMES: u32 = 4;
const MAX_FRAMES: u32 = 10_000;
/// Maximum number of series of samples per pixel.
const MAX_SERIES: usize = 8;

/// Settings of a photon transfer, as the command line and Python name them. An empty list and `None` mean the default.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", into)]
#[non_exhaustive]
pub struct PtcSettings {
    /// Frames of each series, 4 to 10 000; by default the 50 of the paper.
    pub frames: Option<u32>,
    /// Samples per pixel of the series, ascending; by default the 64 and 2500 of the paper.
    pub spp: Vec<u32>,
    /// Denoiser of the pictures of the paper's series, which are also evaluated without denoising. The default is `Auto`, or
    /// `Oidn` if its library is named.
    pub denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise: the library or its folder.
    pub oidn: Option<PathBuf>,
    /// Share of the pixels with the steepest gradient that count as strong edges, in \[0, 1); by default a fifth.
    pub edges: Option<f64>,
    /// Leaves out the frames of the sensor, with samples allocated by its noise and with plain and noise-matched exposure.
    /// Without a sensor there are none.
    pub pictures_only: bool,
    /// For frames of files: the grey value without light \[DN\]; by default 0.
    pub dark: Option<f64>,
    /// For frames of files: the grey value of saturation \[DN\]. The default is the largest value of the smallest bit depth,
    /// at least 8, that contains all grey values of the frames.
    pub saturation: Option<f64>,
}

impl PtcSettings {
    pub(super) fn frames(&self) -> u32 {
        self.frames.unwrap_or(PAPER_FRAMES)
    }

    pub(super) fn spp(&self) -> &[u32] {
        if self.spp.is_empty() { &PAPER_SPP } else { &self.spp }
    }

    pub(super) fn edges(&self) -> f64 {
        self.edges.unwrap_or(EDGES)
    }

    pub(super) fn denoise(&self) -> DenoiseSettings {
        let usual = if self.oidn.is_some() { DenoiseMethod::Oidn } else { DenoiseMethod::Auto };
        DenoiseSettings::default().with_method(self.denoise.unwrap_or(usual)).with_oidn(self.oidn.clone())
    }

    /// Refuses settings with which a scene cannot be measured.
    ///
    /// # Errors
    /// A setting outside its range or for frames of files, with help.
    pub fn check(&self) -> Result<(), Error> {
        for (name, value) in [("dark", self.dark), ("saturation", self.saturation)] {
            if value.is_some() {
                let problem = "is for frames; with a scene, the sensor has that value";
                return Err(Error::setting(name, problem, "leave it out, or give frames"));
            }
        }
        if !(MIN_FRAMES..=MAX_FRAMES).contains(&self.frames()) {
            let problem = match self.frames() {
                n if n < MIN_FRAMES => format!("{n} frames are too few to measure how much a pixel varies"),
                n => format!("{n} frames are more than are measured"),
            };
            return Err(Error::setting("frames", problem, format!("use {MIN_FRAMES} to {MAX_FRAMES}")));
        }
        let s = self.spp();
        let in_order = s.windows(2).all(|w| w[0] < w[1]);
        if s.len() > MAX_SERIES || s[0] == 0 || !in_order || s[s.len() - 1] > MAX_SPP {
            let help = format!("give 1 to {MAX_SERIES} ascending numbers below 1e9, as in 64,2500");
            return Err(Error::setting("spp", format!("{s:?} are no samples per pixel of series"), help));
        }
        self.check_edges()
    }

    /// Refuses settings that frames of files do not have.
    pub(super) fn check_of_frames(&self) -> Result<(), Error> {
        let of_render = [
            ("frames", self.frames.is_some()),
            ("spp", !self.spp.is_empty()),
            ("denoise", self.denoise.is_some() || self.oidn.is_some()),
            ("pictures_only", self.pictures_only),
        ];
        match of_render.into_iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => Err(of_render_only(name)),
            None => self.check_edges(),
        }
    }

    fn check_edges(&self) -> Result<(), Error> {
        let edges = self.edges();
        if (0.0..1.0).contains(&edges) {
            return Ok(());
        }
        let problem = format!("{edges} is no share of the pixels that leaves some");
        Err(Error::setting("edges", problem, "use a number from 0 up to below 1, such as 0.2"))
    }
}

/// The error of a setting of a render for frames of files.
pub fn of_render_only(name: &str) -> Error {
    Error::setting(name, "is a setting of a render, and the input is frames", "leave it out, or give a scene")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_measured_are_errors() {
        type Change = fn(&mut PtcSettings);
        PtcSettings::default().check().expect("the paper's");
        let cases: [(&str, Change); 8] = [
            ("frames", |s| s.frames = Some(3)),
            ("frames", |s| s.frames = Some(u32::MAX)),
            ("dark", |s| s.dark = Some(0.0)),
            ("spp", |s| s.spp = vec![0]),
            ("spp", |s| s.spp = vec![64, 64]),
            ("spp", |s| s.spp = vec![u32::MAX]),
            ("edges", |s| s.edges = Some(1.0)),
            ("edges", |s| s.edges = Some(f64::NAN)),
        ];
        for (name, change) in cases {
            let mut settings = PtcSettings::default();
            change(&mut settings);
            match settings.check() {
                Err(Error::Setting { what, .. }) => assert_eq!(what, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }
}
