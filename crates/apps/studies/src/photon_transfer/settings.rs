//! Settings of the photon transfer of a scene.

use derive_setters::Setters;
use dunkelfeld::adaptive::MAX_SPP;
use dunkelfeld::{DenoiseMethod, DenoiseSettings, Error};

/// Frames of the paper, and the samples per pixel of its two series.
const PAPER_FRAMES: u32 = 50;
const PAPER_SPP: [u32; 2] = [64, 2500];
/// Minimum number of frames for a variance with its standard error.
const MIN_FRAMES: u32 = 4;
const MAX_FRAMES: u32 = 10_000;
/// Maximum number of series of samples per pixel.
const MAX_SERIES: usize = 8;

/// Settings of the photon transfer of a scene.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct PtcSettings {
    /// Frames of each series, 4 to 10 000.
    pub frames: u32,
    /// Samples per pixel of the series, ascending.
    pub spp: Vec<u32>,
    /// Denoiser of the pictures of the paper's series, which are also evaluated without denoising.
    pub denoise: DenoiseSettings,
    /// Share of the pixels with the steepest gradient that count as strong edges, in \[0, 1).
    pub edges: f64,
    /// Does the study include frames of the sensor, with samples allocated by its noise and with plain and
    /// noise-matched exposure? Without a sensor there are none.
    pub camera: bool,
}

impl Default for PtcSettings {
    /// Settings of the paper: 50 frames at 64 and at 2500 samples per pixel; strong edges are the steepest fifth.
    fn default() -> Self {
        Self {
            frames: PAPER_FRAMES,
            spp: PAPER_SPP.to_vec(),
            denoise: DenoiseSettings::default().with_method(DenoiseMethod::Auto),
            edges: 0.2,
            camera: true,
        }
    }
}

impl PtcSettings {
    /// Refuses settings that cannot be measured.
    ///
    /// # Errors
    /// A setting outside its range, with help.
    pub fn check(&self) -> Result<(), Error> {
        if !(MIN_FRAMES..=MAX_FRAMES).contains(&self.frames) {
            let problem = match self.frames {
                n if n < MIN_FRAMES => format!("{n} frames are too few to measure how much a pixel varies"),
                n => format!("{n} frames are more than are measured"),
            };
            return Err(Error::setting("frames", problem, format!("use {MIN_FRAMES} to {MAX_FRAMES}")));
        }
        let s = &self.spp;
        let in_order = s.windows(2).all(|w| w[0] < w[1]);
        if s.is_empty() || s.len() > MAX_SERIES || s[0] == 0 || !in_order || s[s.len() - 1] > MAX_SPP {
            let help = format!("give 1 to {MAX_SERIES} ascending numbers below 1e9, as in 64,2500");
            return Err(Error::setting("spp", format!("{s:?} are no samples per pixel of series"), help));
        }
        if !(0.0..1.0).contains(&self.edges) {
            let problem = format!("{} is no share of the pixels that leaves some", self.edges);
            return Err(Error::setting("edges", problem, "use a number from 0 up to below 1, such as 0.2"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_measured_are_errors() {
        type Change = fn(&mut PtcSettings);
        PtcSettings::default().check().expect("the paper's");
        let cases: [(&str, Change); 8] = [
            ("frames", |s| s.frames = 3),
            ("frames", |s| s.frames = u32::MAX),
            ("spp", |s| s.spp = vec![]),
            ("spp", |s| s.spp = vec![0]),
            ("spp", |s| s.spp = vec![64, 64]),
            ("spp", |s| s.spp = vec![u32::MAX]),
            ("edges", |s| s.edges = 1.0),
            ("edges", |s| s.edges = f64::NAN),
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
