//! Differences between the pixels of one device that are the same in every frame: offsets, responses, hot and dead
//! pixels.
//!
//! The spread over the pixels is split as in EMVA 1288 release 4.0, s^2 = s_row^2 + s_column^2 + s_pixel^2: a part that
//! the pixels of a row share, a part that those of a column share, and the rest.

use dunkelfeld_radiometry::Electrons;
use dunkelfeld_sampling::hash_u64;
use rand_core::Rng as _;
use rand_distr::{Distribution, StandardNormal};

use crate::error::{SensorError, in_range};
use crate::maps::PixelMaps;
use crate::parallel::for_rows;
use crate::random::stream;

/// Purposes of random numbers. Streams of different purposes are independent.
const PATTERN: u64 = 0x7061_7474;
const ROWS: u64 = 0x0072_6f77;
const COLUMNS: u64 = 0x0063_6f6c;
const DEFECTS: u64 = 0x6465_6665;
/// Sums of squares may exceed their total by this share, since data sheets contain rounded numbers.
const ROUNDED: f64 = 2e-3;

/// Differences between pixels that are the same in every frame, as standard deviations.
///
/// The totals are DSNU1288 and PRNU1288 of data sheets. The parts of rows and columns are parts of these totals. The
/// rest is the part of single pixels.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FixedPattern {
    /// Dark signal non-uniformity, DSNU1288 \[e-\], with all parts.
    pub dsnu: Electrons,
    /// The part of it that the pixels of a row share, DSNU1288.row \[e-\].
    pub dsnu_row: Electrons,
    /// The part of it that the pixels of a column share, DSNU1288.col \[e-\].
    pub dsnu_column: Electrons,
    /// Photo response non-uniformity, PRNU1288, as a fraction of the signal, with all parts.
    pub prnu: f64,
    /// The part of it that the pixels of a row share, PRNU1288.row.
    pub prnu_row: f64,
    /// The part of it that the pixels of a column share, PRNU1288.col.
    pub prnu_column: f64,
    /// The measured pattern of one camera. A map of DSNU or PRNU replaces the one that is drawn by the numbers.
    #[serde(default)]
    pub maps: PixelMaps,
}

impl FixedPattern {
    /// The part of the DSNU of single pixels, DSNU1288.pixel \[e-\].
    pub fn dsnu_pixel(&self) -> Electrons {
        rest(self.dsnu, &[self.dsnu_row, self.dsnu_column])
    }

    /// The part of the PRNU of single pixels, PRNU1288.pixel, as a fraction.
    pub fn prnu_pixel(&self) -> f64 {
        rest(Electrons(self.prnu), &[Electrons(self.prnu_row), Electrons(self.prnu_column)]).0
    }

    /// Checks that all values are in range and that the parts together do not exceed the total.
    pub(crate) fn check(&self, full_well: Electrons, resolution: Option<[u32; 2]>) -> Result<(), SensorError> {
        let left = |total: f64, row: f64| (total * total * (1.0 + ROUNDED) - row * row).max(0.0).sqrt();
        in_range("dsnu", self.dsnu.0, 0.0, full_well.0, "from 0 electrons to the full well")?;
        in_range("prnu", self.prnu, 0.0, 1.0, "from 0 to 100 %")?;
        let part = "from 0 to the total, whose part it is";
        let second = "from 0 to what the part of the rows leaves of the total, by squares";
        in_range("dsnu_row", self.dsnu_row.0, 0.0, self.dsnu.0, part)?;
        in_range("dsnu_column", self.dsnu_column.0, 0.0, left(self.dsnu.0, self.dsnu_row.0), second)?;
        in_range("prnu_row", self.prnu_row, 0.0, self.prnu, part)?;
        in_range("prnu_column", self.prnu_column, 0.0, left(self.prnu, self.prnu_row), second)?;
        self.maps.check(resolution)
    }

    /// The part that a seed draws: without the numbers of the maps.
    fn drawn(&self) -> Self {
        let mut drawn = Self { maps: PixelMaps::default(), ..self.clone() };
        if self.maps.dsnu.is_some() {
            drawn = Self { dsnu: Electrons(0.0), dsnu_row: Electrons(0.0), dsnu_column: Electrons(0.0), ..drawn };
        }
        if self.maps.prnu.is_some() {
            drawn = Self { prnu: 0.0, prnu_row: 0.0, prnu_column: 0.0, ..drawn };
        }
        drawn
    }
}

/// Defect pixels. The seed of the device selects them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Defects {
    /// Share of hot pixels, which have a higher dark current, 0 to 0.1.
    pub hot: f64,
    /// Dark current of a hot pixel over that of a normal one, 1 to 1e6.
    pub hot_factor: f64,
    /// Share of dead pixels, which do not respond to light, 0 to 0.1.
    pub dead: f64,
}

impl Default for Defects {
    /// No defects. A hot pixel would have a hundred times the dark current.
    fn default() -> Self {
        Self { hot: 0.0, hot_factor: 100.0, dead: 0.0 }
    }
}

impl Defects {
    pub(crate) fn check(&self) -> Result<(), SensorError> {
        let share = "from 0 to 100 000 per million";
        in_range("hot", self.hot, 0.0, 0.1, share)?;
        in_range("hot_factor", self.hot_factor, 1.0, 1e6, "from 1 to 1e6")?;
        in_range("dead", self.dead, 0.0, 0.1, share)
    }
}

/// The rest of a standard deviation without its independent parts, by squares. Without parts, the whole.
pub(crate) fn rest(whole: Electrons, parts: &[Electrons]) -> Electrons {
    let taken: f64 = parts.iter().map(|p| p.0 * p.0).sum();
    // The square root of a square may differ from the original number by rounding.
    if taken == 0.0 { whole } else { Electrons((whole.0 * whole.0 - taken).max(0.0).sqrt()) }
}

/// The difference of a pixel of one device from the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPattern {
    /// Dark signal in addition to that of the model \[e-\].
    pub dark: f32,
    /// Response to light over that of the model. 0 for a dead pixel.
    pub response: f32,
}

impl PixelPattern {
    /// A pixel without difference from the model.
    pub(crate) const NONE: Self = Self { dark: 0.0, response: 1.0 };
}

/// The pattern of one device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pattern {
    /// Row by row. Empty if no pixel differs.
    pixels: Vec<PixelPattern>,
    /// Indices of the hot pixels, row by row, ascending.
    hot: Vec<u64>,
}

impl Pattern {
    /// The pattern for a seed.
    pub(crate) fn draw(differences: &FixedPattern, defects: &Defects, seed: u64, width: u32, height: u32) -> Self {
        let p = differences.drawn();
        let count = u64::from(width) * u64::from(height);
        let is_flat = p.dsnu.0 <= 0.0 && p.prnu <= 0.0;
        let mut pixels = Vec::new();
        if !is_flat {
            let lines = |purpose, count: u32, dark: Electrons, response: f64| -> Vec<[f64; 2]> {
                let key = hash_u64([seed, PATTERN, purpose]);
                let scale = [dark.0, response];
                (0..u64::from(count))
                    .map(|line| if scale == [0.0; 2] { scale } else { normals(key, line, scale) })
                    .collect()
            };
            let rows = lines(ROWS, height, p.dsnu_row, p.prnu_row);
            let columns = lines(COLUMNS, width, p.dsnu_column, p.prnu_column);
            let (key, own) = (hash_u64([seed, PATTERN]), [p.dsnu_pixel().0, p.prnu_pixel()]);
            pixels = vec![PixelPattern::NONE; count as usize];
            for_rows(&mut pixels, width, |y, pixels| {
                let row = rows.get(y).copied().unwrap_or_default();
                let first = y as u64 * u64::from(width);
                for ((pixel, column), index) in pixels.iter_mut().zip(&columns).zip(first..) {
                    let [dark, response] = normals(key, index, own);
                    *pixel = PixelPattern {
                        dark: (dark + row[0] + column[0]) as f32,
                        response: (1.0 + response + row[1] + column[1]).max(0.0) as f32,
                    };
                }
                0
            });
        }
        differences.maps.apply(&mut pixels);
        let mut hot = Vec::new();
        if defects.hot > 0.0 || defects.dead > 0.0 {
            let key = hash_u64([seed, DEFECTS]);
            if defects.dead > 0.0 {
                pixels.resize(count as usize, PixelPattern::NONE);
            }
            for pixel in 0..count {
                // A uniform number of 53 bits.
                let u = (stream(key, pixel).next_u64() >> 11) as f64 / (1u64 << 53) as f64;
                if u < defects.dead {
                    if let Some(dead) = pixels.get_mut(pixel as usize) {
                        dead.response = 0.0;
                    }
                } else if u < defects.dead + defects.hot {
                    hot.push(pixel);
                }
            }
        }
        Self { pixels, hot }
    }

    /// The pattern of one row whose pixels are the means of the columns. A pixel is hot if one of its column is.
    pub(crate) fn mean_of_rows(&self, width: u32) -> Self {
        let width = width as usize;
        let rows = self.pixels.len().checked_div(width).unwrap_or(0).max(1) as f32;
        let mut pixels = vec![PixelPattern { dark: 0.0, response: 0.0 }; width.min(self.pixels.len())];
        for (i, pixel) in self.pixels.iter().enumerate() {
            let mean = &mut pixels[i % width];
            mean.dark += pixel.dark / rows;
            mean.response += pixel.response / rows;
        }
        let mut hot: Vec<u64> = self.hot.iter().map(|p| p % (width as u64).max(1)).collect();
        hot.sort_unstable();
        hot.dedup();
        Self { pixels, hot }
    }

    /// The pixels with these indices. Empty if none differs.
    pub(crate) fn pixels(&self, range: std::ops::Range<usize>) -> &[PixelPattern] {
        self.pixels.get(range).unwrap_or(&[])
    }

    /// Indices of the hot pixels among these.
    pub(crate) fn hot(&self, range: std::ops::Range<usize>) -> &[u64] {
        let first = |end: usize| self.hot.partition_point(|&p| p < end as u64);
        self.hot.get(first(range.start)..first(range.end)).unwrap_or(&[])
    }
}

/// Two normal numbers of the given standard deviations.
fn normals(key: u64, index: u64, scale: [f64; 2]) -> [f64; 2] {
    let mut rng = stream(key, index);
    scale.map(|s| {
        let z: f64 = StandardNormal.sample(&mut rng);
        s * z
    })
}
