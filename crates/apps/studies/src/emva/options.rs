//! Options of data sets and of their analysis, as the command line and Python name them.

use super::findings::Findings;
use super::measurement::ReadMeasurement;
use super::plan::{DatasetSettings, Vary};
use derive_setters::Setters;
use dunkelfeld::Error;
use dunkelfeld::radiometry::{Nanometres, Seconds};
use dunkelfeld::sensor::FilterColor;
use dunkelfeld_emva1288::{AnalysisSettings, Release};
use std::ops::RangeInclusive;

/// Distances of pixels \[um\] that an analysis accepts.
pub const PIXEL_PITCHES: RangeInclusive<f64> = 0.1..=1000.0;

/// Options of a data set. `None` means the default of [`DatasetSettings`].
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct DatasetOptions {
    /// Levels of light, each a pair of frames.
    pub levels: Option<u32>,
    /// Width and height of the frames \[pixels\].
    pub size: Option<[u32; 2]>,
    /// Wavelength of the light \[nm\].
    pub wavelength: Option<f64>,
    /// Frames in each of the two stacks.
    pub spatial: Option<u32>,
    /// The varied quantity.
    pub vary: Option<Vary>,
    /// The exposure time, or the longest exposure time \[s\].
    pub exposure: Option<f64>,
    /// Bits per grey value instead of those of the sensor.
    pub bit_depth: Option<u32>,
    /// Colour of the measured pixels of a sensor with colour filters.
    pub color: Option<FilterColor>,
    /// Seed of the device and of its noise.
    pub seed: Option<u64>,
}

impl From<DatasetOptions> for DatasetSettings {
    fn from(options: DatasetOptions) -> Self {
        let mut settings = Self::default().with_wavelength(options.wavelength.map(Nanometres));
        settings.levels = options.levels.unwrap_or(settings.levels);
        settings.stack = options.spatial.unwrap_or(settings.stack);
        settings.seed = options.seed.unwrap_or(settings.seed);
        settings.bit_depth = options.bit_depth;
        settings.color = options.color;
        settings.exposure = options.exposure.map_or(settings.exposure, Seconds);
        if let Some([width, height]) = options.size {
            (settings.width, settings.height) = (width, height);
        }
        settings.vary = options.vary.unwrap_or(settings.vary);
        settings
    }
}

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
