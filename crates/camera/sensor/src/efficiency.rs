//! Quantum efficiency of the pixels: one curve for all, or one for each colour of a filter array.

use dunkelfeld_radiometry::Nanometres;

use crate::error::{SensorError, in_range};

/// Representative wavelengths of the channels red, green and blue: about the dominant wavelengths of the Rec. 709
/// primaries, 611, 549 and 464 nm.
pub const BANDS: [Nanometres; 3] = [Nanometres(610.0), Nanometres(550.0), Nanometres(465.0)];

/// Quantum efficiency eta over the wavelength: linear between points, constant beyond the ends.
///
/// With a single point it is constant. Its serialised form is the list of points, which is checked when it is read.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "Vec<(Nanometres, f64)>")]
pub struct QuantumEfficiency(Vec<(Nanometres, f64)>);

impl TryFrom<Vec<(Nanometres, f64)>> for QuantumEfficiency {
    type Error = SensorError;

    fn try_from(points: Vec<(Nanometres, f64)>) -> Result<Self, SensorError> {
        Self::new(points)
    }
}

impl QuantumEfficiency {
    /// A curve through points of ascending wavelength. Efficiencies are fractions in (0, 1].
    pub fn new(points: Vec<(Nanometres, f64)>) -> Result<Self, SensorError> {
        if points.is_empty() {
            return Err(SensorError::Curve("needs at least one point [wavelength in nm, efficiency]"));
        }
        for &(wavelength, efficiency) in &points {
            in_range("quantum_efficiency", wavelength.0, 100.0, 20_000.0, "at wavelengths from 100 to 20 000 nm")?;
            if !(efficiency > 0.0 && efficiency <= 1.0) {
                let allowed = "a fraction above 0 and at most 1";
                return Err(SensorError::OutOfRange { field: "quantum_efficiency", value: efficiency, allowed });
            }
        }
        if points.windows(2).any(|w| w[0].0 >= w[1].0) {
            return Err(SensorError::Curve("wavelengths must ascend"));
        }
        Ok(Self(points))
    }

    /// The efficiency at a wavelength.
    pub fn at(&self, wavelength: Nanometres) -> f64 {
        let after = self.0.partition_point(|p| p.0 <= wavelength);
        match (after.checked_sub(1).and_then(|i| self.0.get(i)), self.0.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * ((wavelength - a.0) / (b.0 - a.0)),
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => 0.0,
        }
    }

    /// The wavelength of the highest efficiency, and the efficiency there. The first of several equal points.
    pub fn peak(&self) -> (Nanometres, f64) {
        self.0.iter().copied().fold((Nanometres(0.0), 0.0), |best, p| if p.1 > best.1 { p } else { best })
    }

    /// The points by ascending wavelength.
    pub fn points(&self) -> &[(Nanometres, f64)] {
        &self.0
    }
}

/// Colours of a filter array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterColor {
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
}

impl FilterColor {
    /// All of them, in the order of the channels of a film.
    pub const ALL: [Self; 3] = [Self::Red, Self::Green, Self::Blue];

    /// Its name for files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
        }
    }
}

/// A Bayer pattern, named by the colours of the first two pixels of the first row and those below them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BayerPattern {
    /// Red, green; green, blue.
    Rggb,
    /// Blue, green; green, red.
    Bggr,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
}

impl BayerPattern {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// Its name for files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rggb => "rggb",
            Self::Bggr => "bggr",
            Self::Grbg => "grbg",
            Self::Gbrg => "gbrg",
        }
    }

    /// The colour of the pixel in column `x` and row `y`.
    #[inline]
    pub const fn color_at(self, x: u32, y: u32) -> FilterColor {
        // Position of the red pixel in each square of four.
        let (red_x, red_y) = match self {
            Self::Rggb => (0, 0),
            Self::Bggr => (1, 1),
            Self::Grbg => (1, 0),
            Self::Gbrg => (0, 1),
        };
        match (x & 1 == red_x, y & 1 == red_y) {
            (true, true) => FilterColor::Red,
            (false, false) => FilterColor::Blue,
            _ => FilterColor::Green,
        }
    }
}

/// A colour filter array over the pixels.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ColorFilter {
    /// The colour of each pixel.
    pub pattern: BayerPattern,
    /// Quantum efficiency of red, green and blue pixels, including their filter.
    pub curves: [QuantumEfficiency; 3],
    /// The channels of a display image are scaled so that grey is neutral. Grey values and statistics are never scaled.
    pub white_balance: bool,
}

impl ColorFilter {
    /// Factors for red, green and blue that give a grey triple the same value in all three channels. They are the
    /// inverse of the electrons of each colour for this triple. The smallest factor is 1, so that pixels that saturate
    /// in all channels stay white.
    pub fn grey_gains(&self) -> [f64; 3] {
        // The number of photons per joule is proportional to the wavelength. All other factors are common to the three.
        let electrons = |curve: &QuantumEfficiency| BANDS.iter().map(|&band| curve.at(band) * band.0).sum::<f64>();
        let [r, g, b] = [0, 1, 2].map(|c: usize| electrons(&self.curves[c]));
        let most = r.max(g).max(b);
        [most / r, most / g, most / b]
    }
}

/// The quantum efficiency of the pixels of a sensor.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Efficiency {
    /// The same curve for all pixels.
    Mono(QuantumEfficiency),
    /// One curve for each colour.
    Mosaic(ColorFilter),
}

impl From<QuantumEfficiency> for Efficiency {
    fn from(curve: QuantumEfficiency) -> Self {
        Self::Mono(curve)
    }
}

impl Efficiency {
    /// The different curves: one, or those of red, green and blue.
    pub fn curves(&self) -> &[QuantumEfficiency] {
        match self {
            Self::Mono(curve) => std::slice::from_ref(curve),
            Self::Mosaic(filter) => &filter.curves,
        }
    }

    /// The curve of the pixel in column `x` and row `y`.
    pub fn of_pixel(&self, x: u32, y: u32) -> &QuantumEfficiency {
        match self {
            Self::Mono(curve) => curve,
            Self::Mosaic(filter) => &filter.curves[filter.pattern.color_at(x, y) as usize],
        }
    }

    /// The filter array. `None` for a monochrome sensor.
    pub fn filter(&self) -> Option<&ColorFilter> {
        match self {
            Self::Mono(_) => None,
            Self::Mosaic(filter) => Some(filter),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_efficiency_is_interpolated_and_held_beyond_the_ends() {
        let nm = Nanometres;
        let curve = QuantumEfficiency::new(vec![(nm(400.0), 0.2), (nm(500.0), 0.6), (nm(700.0), 0.4)]).expect("curve");
        for (at, expected) in
            [(300.0, 0.2), (400.0, 0.2), (450.0, 0.4), (500.0, 0.6), (600.0, 0.5), (700.0, 0.4), (900.0, 0.4)]
        {
            assert!((curve.at(nm(at)) - expected).abs() < 1e-12, "at {at} nm: {}", curve.at(nm(at)));
        }
        for bad in [vec![], vec![(nm(500.0), 0.0)], vec![(nm(500.0), 0.5), (nm(500.0), 0.6)], vec![(nm(f64::NAN), 0.5)]]
        {
            assert!(QuantumEfficiency::new(bad).is_err());
        }
    }
}
