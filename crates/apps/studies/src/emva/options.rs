//! Options of an analysis, as the command line and Python name them.

use super::findings::Findings;
use super::measurement::ReadMeasurement;
use derive_setters::Setters;
use dunkelfeld::Error;
use dunkelfeld_emva1288::{AnalysisSettings, Release};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Distances of pixels \[um\] that an analysis accepts.
pub const PIXEL_PITCHES: RangeInclusive<f64> = 0.1..=1000.0;
/// Wavelengths \[nm\] that an analysis accepts.
pub const WAVELENGTHS: RangeInclusive<f64> = 100.0..=20_000.0;

/// Options of an analysis.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct AnalyseOptions {
    /// Release of the standard.
    pub release: Release,
    /// The general module, for cameras that are not linear.
    pub general: bool,
    /// Distance of the pixels \[um\], for figures per area and for the sensor file.
    pub pixel_pitch: Option<f64>,
    /// Wavelength of the light \[nm\], for the sensor file.
    pub wavelength: Option<f64>,
    /// The sensor file to write.
    #[setters(into)]
    pub sensor: Option<PathBuf>,
    /// Maps of the pixels are written beside the sensor file, which names them.
    pub maps: bool,
}

impl AnalyseOptions {
    /// Checks the options, before any frame is read.
    ///
    /// # Errors
    /// A distance of the pixels or a wavelength out of range, a sensor file without them or of a camera that is not
    /// linear, maps without a sensor file.
    pub fn check(&self) -> Result<(), Error> {
        for (name, unit, value, range) in
            [("pixel pitch", "um", self.pixel_pitch, PIXEL_PITCHES), ("wavelength", "nm", self.wavelength, WAVELENGTHS)]
        {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                let help = format!("choose {} to {} {unit}", range.start(), range.end());
                return Err(Error::setting(name, format!("{value} {unit} is out of range"), help));
            }
        }
        if self.maps && self.sensor.is_none() {
            return Err(Error::setting(
                "maps",
                "the maps belong to a sensor file",
                "name one, as in --sensor mine.toml",
            ));
        }
        if self.sensor.is_some() && self.general {
            let problem = "the general module finds neither K nor eta, which a sensor file needs";
            return Err(Error::setting("sensor", problem, "use raw frames of a linear camera, without --general"));
        }
        if self.sensor.is_some() && (self.pixel_pitch.is_none() || self.wavelength.is_none()) {
            let problem = "the frames contain neither the pixel pitch nor the wavelength of the light";
            return Err(Error::setting("sensor", problem, "add both, as in --pixel-pitch 3.45 --wavelength 545"));
        }
        Ok(())
    }

    /// The sensor file and its maps.
    pub(super) fn sensor_files(&self) -> Vec<PathBuf> {
        self.sensor.as_ref().map_or_else(Vec::new, |path| super::sensor_file::files_of(path, self.maps))
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
