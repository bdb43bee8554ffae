//! The wavelengths of the channels of a film, and the transmission of an optical filter and a beam splitter at them.

use crate::efficiency::BANDS;
use crate::error::{SensorError, in_range};
use dunkelfeld_radiometry::Nanometres;

/// Edges of the default bands \[nm\]: red, green and blue.
const EDGES: [[f64; 2]; 3] = [[580.0, 700.0], [490.0, 580.0], [400.0, 490.0]];

/// Transmission of a band-pass filter outside of its band: an optical density of 4.
const BLOCKED: f64 = 1e-4;

/// The wavelength of each channel of a film, and the share of its light that passes the filter of the lens and the beam
/// splitters in front of it.
///
/// By default the channels are [`BANDS`], without a filter. A lamp of one wavelength sets that of its channel. Bands are
/// checked when they are read from a file.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "BandsValues")]
pub struct Bands {
    /// Wavelengths of red, green and blue, from 100 to 20 000 nm.
    pub wavelengths: [Nanometres; 3],
    /// Transmission of filter and beam splitters for red, green and blue, in [0, 1].
    pub transmission: [f64; 3],
}

/// [`Bands`] that are not checked yet.
#[derive(serde::Deserialize)]
struct BandsValues {
    wavelengths: [Nanometres; 3],
    transmission: [f64; 3],
}

impl TryFrom<BandsValues> for Bands {
    type Error = SensorError;

    fn try_from(values: BandsValues) -> Result<Self, SensorError> {
        let BandsValues { wavelengths, transmission } = values;
        for nm in wavelengths {
            in_range("wavelengths", nm.0, 100.0, 20_000.0, "from 100 to 20 000 nm")?;
        }
        for share in transmission {
            in_range("transmission", share, 0.0, 1.0, "from 0 to 1")?;
        }
        Ok(Self { wavelengths, transmission })
    }
}

impl Default for Bands {
    fn default() -> Self {
        Self { wavelengths: BANDS, transmission: [1.0; 3] }
    }
}

impl Bands {
    /// The bands behind a band-pass filter with a centre and a full width \[nm\] and a transmission inside its band. The
    /// transmission outside is 1e-4.
    ///
    /// A channel of one wavelength (`is_line`) passes if the wavelength lies in the band. Of another channel, which
    /// counts as evenly distributed over its band (red 580 to 700 nm, green 490 to 580 nm, blue 400 to 490 nm), the share
    /// in the band of the filter passes. Its wavelength is then the middle of that share.
    pub fn through(mut self, center: f64, width: f64, transmission: f64, is_line: [bool; 3]) -> Self {
        let [low, high] = [center - 0.5 * width, center + 0.5 * width];
        for (channel, is_line) in is_line.into_iter().enumerate() {
            let nm = self.wavelengths[channel].0;
            let share = if is_line {
                f64::from(u8::from((low..=high).contains(&nm)))
            } else {
                let [first, last] = EDGES[channel];
                let [from, to] = [low.max(first), high.min(last)];
                if to > from {
                    self.wavelengths[channel] = Nanometres(0.5 * (from + to));
                }
                ((to - from) / (last - first)).max(0.0)
            };
            self.transmission[channel] *= BLOCKED + (transmission - BLOCKED).max(0.0) * share;
        }
        self
    }

    /// The bands behind a beam splitter that passes a share of the light, in [0, 1], at all wavelengths.
    pub fn behind_splitter(mut self, share: f64) -> Self {
        self.transmission.iter_mut().for_each(|t| *t *= share);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_passes_its_band_only() {
        let mut bands = Bands::default();
        bands.wavelengths[0] = Nanometres(850.0);
        let filtered = bands.through(850.0, 40.0, 0.9, [true, false, false]);
        assert!((filtered.transmission[0] - 0.9).abs() < 1e-12);
        assert_eq!(filtered.transmission[1..], [BLOCKED; 2]);
        assert_eq!(filtered.wavelengths, bands.wavelengths);
        // A wide filter over half of the green band.
        let filtered = Bands::default().through(500.0, 70.0, 1.0, [false; 3]);
        assert!((filtered.transmission[1] - (BLOCKED + (1.0 - BLOCKED) * 0.5)).abs() < 1e-12, "{filtered:?}");
        assert_eq!(filtered.wavelengths[1], Nanometres(512.5));
        assert_eq!(filtered.transmission[0], BLOCKED);
    }
}
