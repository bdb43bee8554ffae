//! The point spread function of a lens, as its modulation transfer function (MTF).
//!
//! Defocus is not a part of it: the rays of a finite aperture show it.

use crate::error::{SensorError, in_range};
use dunkelfeld_radiometry::{Metres, Nanometres};
use std::f64::consts::{LN_2, PI};
use std::sync::Arc;

/// How a lens spreads the light of a point in focus over the sensor. Values are checked when they are read from a file.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase", try_from = "PsfValues")]
pub enum Psf {
    /// Not at all: the comparison with renderers that have no lens.
    #[default]
    None,
    /// Diffraction at a round aperture: a lens without aberrations, with the f-number and the magnification of its
    /// [`Optics`](crate::Optics) and the wavelength of each channel.
    Diffraction,
    /// A Gaussian of this standard deviation on the sensor, for all wavelengths.
    Gaussian {
        /// The standard deviation, above 0 and at most 1 mm.
        sigma: Metres,
    },
    /// A measured or computed MTF, for all wavelengths.
    Table(Arc<MtfTable>),
}

/// A [`Psf`] that is not checked yet.
#[derive(serde::Deserialize)]
#[serde(rename_all = "lowercase")]
enum PsfValues {
    None,
    Diffraction,
    Gaussian { sigma: Metres },
    Table(Arc<MtfTable>),
}

impl TryFrom<PsfValues> for Psf {
    type Error = SensorError;

    fn try_from(values: PsfValues) -> Result<Self, SensorError> {
        Ok(match values {
            PsfValues::None => Self::None,
            PsfValues::Diffraction => Self::Diffraction,
            PsfValues::Gaussian { sigma } => Self::gaussian(sigma)?,
            PsfValues::Table(table) => Self::Table(table),
        })
    }
}

impl Psf {
    /// A Gaussian of this standard deviation on the sensor.
    ///
    /// # Errors
    /// One of zero or less, or above 1 mm.
    pub fn gaussian(sigma: Metres) -> Result<Self, SensorError> {
        in_range("sigma in um", 1e6 * sigma.0, f64::MIN_POSITIVE, 1e3, "above 0 and at most 1000")?;
        Ok(Self::Gaussian { sigma })
    }

    /// The Gaussian whose MTF is one half at this frequency on the sensor [cycles/m].
    ///
    /// # Errors
    /// A frequency of zero or less, or so low that the standard deviation is above 1 mm.
    pub fn mtf50(frequency: f64) -> Result<Self, SensorError> {
        in_range("mtf50", 1e-3 * frequency, 0.2, 1e6, "from 0.2 to 1 000 000 line pairs per mm")?;
        // exp(-2 pi^2 sigma^2 f^2) = 1/2.
        Self::gaussian(Metres((LN_2 / 2.0).sqrt() / (PI * frequency)))
    }

    /// Field heights of the PSF on the sensor \[m\]: one, or those of its table.
    pub fn heights(&self) -> Vec<f64> {
        match self {
            Self::Table(table) => table.curves.iter().map(|curve| curve.height).collect(),
            _ => vec![0.0],
        }
    }

    /// The MTF at a spatial frequency on the sensor [cycles/m], at a field height by its number in [`Self::heights`], for a
    /// working f-number N (1 + m) and a wavelength.
    pub(crate) fn mtf(&self, frequency: f64, height: usize, working_f_number: f64, wavelength: Nanometres) -> f64 {
        let diffraction = |frequency: f64| diffraction_mtf(frequency * working_f_number * wavelength.0 * 1e-9);
        match self {
            Self::None => 1.0,
            Self::Diffraction => diffraction(frequency),
            Self::Gaussian { sigma } => (-2.0 * (PI * sigma.0 * frequency).powi(2)).exp(),
            Self::Table(table) => table.curves.get(height).map_or(1.0, |curve| curve.at(frequency, diffraction)),
        }
    }
}

/// The MTF of a lens without aberrations with a round aperture, at a frequency as a share of the cutoff 1 / (lambda N):
/// 2/pi (acos x - x sqrt(1 - x^2)) (Goodman 2005).
fn diffraction_mtf(x: f64) -> f64 {
    let x = x.abs().min(1.0);
    2.0 / PI * (x.acos() - x * (1.0 - x * x).sqrt())
}

/// The MTF of a lens over spatial frequency, at one or more field heights: the mean of sagittal and tangential lines.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "Vec<MtfCurve>", into = "Vec<MtfCurve>")]
pub struct MtfTable {
    curves: Vec<MtfCurve>,
}

/// The MTF at one field height.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MtfCurve {
    /// Distance on the sensor from the middle of the whole image \[m\].
    pub height: f64,
    /// Frequencies on the sensor [cycles/m] and the MTF there, without the point (0, 1).
    pub points: Vec<[f64; 2]>,
}

impl TryFrom<Vec<MtfCurve>> for MtfTable {
    type Error = SensorError;

    fn try_from(curves: Vec<MtfCurve>) -> Result<Self, SensorError> {
        Self::new(curves)
    }
}

impl From<MtfTable> for Vec<MtfCurve> {
    fn from(table: MtfTable) -> Self {
        table.curves
    }
}

/// Most field heights of a table.
const MOST_HEIGHTS: usize = 16;

impl MtfTable {
    /// A table of at most 16 field heights in rising order. The MTF falls from 1 at frequency 0, in rising order of frequencies.
    ///
    /// # Errors
    /// No curve, or one that is not an MTF.
    pub fn new(curves: Vec<MtfCurve>) -> Result<Self, SensorError> {
        let fault = |problem: String| Err(SensorError::Mtf(problem));
        if curves.is_empty() || curves.len() > MOST_HEIGHTS {
            return fault(format!("has {} field heights, it must have 1 to {MOST_HEIGHTS}", curves.len()));
        }
        let mut last = -f64::MIN_POSITIVE;
        for MtfCurve { height, points } in &curves {
            let mm = 1e3 * height;
            if !(height.is_finite() && *height > last) {
                return fault(format!("has the field height {mm} mm, and heights rise from 0 or more"));
            }
            last = *height;
            if points.is_empty() {
                return fault(format!("has no frequency at the field height {mm} mm"));
            }
            let mut before = [0.0, 1.0];
            for &[frequency, mtf] in points {
                let place = format!("at the field height {mm} mm and {} line pairs per mm", 1e-3 * frequency);
                if !(frequency.is_finite() && frequency > before[0]) {
                    return fault(format!("{place} has a frequency that does not rise"));
                }
                if !(0.0..=before[1]).contains(&mtf) {
                    return fault(format!("{place} has the MTF {mtf}, which must not be below 0, above 1 or rise"));
                }
                before = [frequency, mtf];
            }
        }
        Ok(Self { curves })
    }
}

impl MtfCurve {
    /// Linear between points. Beyond the last one it falls as that of a lens without aberrations.
    fn at(&self, frequency: f64, diffraction: impl Fn(f64) -> f64) -> f64 {
        let next = self.points.partition_point(|[at, _]| *at < frequency);
        let before = next.checked_sub(1).map_or([0.0, 1.0], |last| self.points[last]);
        if let Some(&[at, mtf]) = self.points.get(next) {
            return before[1] + (mtf - before[1]) * (frequency - before[0]) / (at - before[0]);
        }
        let last = diffraction(before[0]);
        if last > 0.0 { before[1] * diffraction(frequency) / last } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREEN: Nanometres = Nanometres(550.0);

    #[test]
    fn the_mtf_of_diffraction_ends_at_the_cutoff() {
        let psf = Psf::Diffraction;
        let cutoff = 1.0 / (8.0 * 550e-9);
        assert_eq!((psf.mtf(0.0, 0, 8.0, GREEN), psf.mtf(1.01 * cutoff, 0, 8.0, GREEN)), (1.0, 0.0));
        // 0.391 at half of the cutoff.
        assert!((psf.mtf(0.5 * cutoff, 0, 8.0, GREEN) - 0.391).abs() < 1e-3);
    }

    #[test]
    fn tables_are_linear_and_end_as_diffraction() {
        let curve = |height, points: &[[f64; 2]]| MtfCurve { height, points: points.to_vec() };
        let table = MtfTable::new(vec![curve(0.0, &[[50e3, 0.8], [100e3, 0.4]]), curve(4e-3, &[[50e3, 0.5]])]);
        let psf = Psf::Table(Arc::new(table.expect("a table")));
        assert_eq!(psf.heights(), [0.0, 4e-3]);
        assert!((psf.mtf(75e3, 0, 4.0, GREEN) - 0.6).abs() < 1e-12);
        assert!((psf.mtf(25e3, 1, 4.0, GREEN) - 0.75).abs() < 1e-12);
        let beyond = diffraction_mtf(200e3 * 4.0 * 550e-9) / diffraction_mtf(100e3 * 4.0 * 550e-9);
        assert!((psf.mtf(200e3, 0, 4.0, GREEN) - 0.4 * beyond).abs() < 1e-12);
        for bad in [
            vec![],
            vec![curve(0.0, &[])],
            vec![curve(0.0, &[[50e3, 1.1]])],
            vec![curve(0.0, &[[50e3, 0.5], [60e3, 0.6]])],
            vec![curve(0.0, &[[50e3, f64::NAN]])],
            vec![curve(0.0, &[[50e3, 0.5], [50e3, 0.4]])],
            vec![curve(2.0, &[[50e3, 0.5]]), curve(1.0, &[[50e3, 0.5]])],
            vec![curve(f64::NAN, &[[50e3, 0.5]])],
        ] {
            assert!(MtfTable::new(bad.clone()).is_err(), "{bad:?}");
        }
    }
}
