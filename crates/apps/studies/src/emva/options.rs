//! Options of an analysis, as the command line and Python name them.

use super::findings::Findings;
use super::measurement::ReadMeasurement;
use derive_setters::Setters;
use dunkelfeld::Error;
use dunkelfeld_emva1288::{AnalysisSettings, Release};
use std::ops::RangeInclusive;

/// Distances of pixels \[um\] that an analysis accepts.
pub const PIXEL_PITCHES: RangeInclusive<f64> = 0.1..=1000.0;

/// Options of an analysis.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct AnalyseOptions {
    /// Release of the standard.
    pub release: Release,
    /// The general module, for cameras that are not linear.
    pub general: bool,
    /// Distance of the pixels \[um\], for figures per area.
    pub pixel_pitch: Option<f64>,
}

impl AnalyseOptions {
    /// Checks the options, before any frame is read.
    ///
    /// # Errors
    /// A distance of the pixels out of range.
    pub fn check(&self) -> Result<(), Error> {
        match self.pixel_pitch.filter(|pitch| !PIXEL_PITCHES.contains(pitch)) {
            None => Ok(()),
            Some(pitch) => {
                let help = format!("choose {} to {} um", PIXEL_PITCHES.start(), PIXEL_PITCHES.end());
                Err(Error::setting("pixel pitch", format!("{pitch} um is out of range"), help))
            }
        }
    }

    /// Analyses a data set.
    ///
    /// # Errors
    /// Those of [`AnalyseOptions::check`], and the shortcomings of the data set.
    pub fn analyse(&self, read: &ReadMeasurement) -> Result<Findings, Error> {
        self.check()?;
        let settings = AnalysisSettings::default().with_release(self.release).with_pixel_pitch(self.pixel_pitch);
        if self.general { Findings::general(read, &settings) } else { Findings::linear(read, &settings) }
    }
}
