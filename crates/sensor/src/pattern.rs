//! What distinguishes the pixels of one device from each other in every frame: offsets, responses, hot and dead pixels.
//!
//! The spread over the pixels is split as EMVA 1288 release 4.0 does it, s^2 = s_row^2 + s_column^2 + s_pixel^2: a part that
//! the pixels of a row share, one of columns, and the rest.

use dunkelfeld_radiometry::Electrons;
use dunkelfeld_sampling::hash_u64;
use rand_core::Rng as _;
use rand_distr::{Distribution, StandardNormal};

use crate::error::{SensorError, in_range};
use crate::random::stream;

/// What random numbers are for; streams of different purposes are independent.
const PATTERN: u64 = 0x7061_7474;
const ROWS: u64 = 0x0072_6f77;
const COLUMNS: u64 = 0x0063_6f6c;
const DEFECTS: u64 = 0x6465_6665;
/// Sums of squares may exceed their total by this share: that of numbers which were rounded for a data sheet.
const ROUNDED: f64 = 2e-3;

/// Differences between pixels that are the same in every frame, as standard deviations.
///
/// The totals are what data sheets call DSNU1288 and PRNU1288. Parts of rows and columns are parts of these; what they leave is
/// that of single pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FixedPattern {
    /// Dark signal non-uniformity, DSNU1288 \[e-\]: all of it.
    pub dsnu: Electrons,
    /// What of it rows have in common, DSNU1288.row \[e-\].
    pub dsnu_row: Electrons,
    /// What of it columns have in common, DSNU1288.col \[e-\].
    pub dsnu_column: Electrons,
    /// Photo response non-uniformity, PRNU1288, as a fraction of the signal: all of it.
    pub prnu: f64,
    /// What of it rows have in common, PRNU1288.row.
    pub prnu_row: f64,
    /// What of it columns have in common, PRNU1288.col.
    pub prnu_column: f64,
}

impl FixedPattern {
    /// What of the DSNU single pixels have, DSNU1288.pixel \[e-\].
    pub fn dsnu_pixel(&self) -> Electrons {
        rest(self.dsnu, &[self.dsnu_row, self.dsnu_column])
    }

    /// What of the PRNU single pixels have, PRNU1288.pixel, as a fraction.
    pub fn prnu_pixel(&self) -> f64 {
        rest(Electrons(self.prnu), &[Electrons(self.prnu_row), Electrons(self.prnu_column)]).0
    }

    /// Ranges, and parts that together are not more than the whole.
    pub(crate) fn check(&self, full_well: Electrons) -> Result<(), SensorError> {
        let left = |total: f64, row: f64| (total * total * (1.0 + ROUNDED) - row * row).max(0.0).sqrt();
        in_range("dsnu", self.dsnu.0, 0.0, full_well.0, "from 0 electrons to the full well")?;
        in_range("prnu", self.prnu, 0.0, 1.0, "from 0 to 100 %")?;
        let part = "from 0 to the total, whose part it is";
        let second = "from 0 to what the part of the rows leaves of the total, by squares";
        in_range("dsnu_row", self.dsnu_row.0, 0.0, self.dsnu.0, part)?;
        in_range("dsnu_column", self.dsnu_column.0, 0.0, left(self.dsnu.0, self.dsnu_row.0), second)?;
        in_range("prnu_row", self.prnu_row, 0.0, self.prnu, part)?;
        in_range("prnu_column", self.prnu_column, 0.0, left(self.prnu, self.prnu_row), second)
    }
}

/// Pixels that are not as the others. Which ones follows from the seed of the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defects {
    /// Share of hot pixels, which have more dark current, 0 to 0.1.
    pub hot: f64,
    /// So many times the dark current of the others, 1 to 1e6.
    pub hot_factor: f64,
    /// Share of dead pixels, which do not see light, 0 to 0.1.
    pub dead: f64,
}

impl Default for Defects {
    /// None; a hot pixel would have a hundred times the dark current.
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

/// What independent parts leave of a standard deviation, by squares; the whole itself without parts.
pub(crate) fn rest(whole: Electrons, parts: &[Electrons]) -> Electrons {
    let taken: f64 = parts.iter().map(|p| p.0 * p.0).sum();
    // The root of a square is not always what was squared.
    if taken == 0.0 { whole } else { Electrons((whole.0 * whole.0 - taken).max(0.0).sqrt()) }
}

/// How a pixel of one device differs from that of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPattern {
    /// Dark signal beyond that of the others \[e-\].
    pub dark: f32,
    /// Response to light over that of the model; 0 of a dead pixel.
    pub response: f32,
}

impl PixelPattern {
    /// A pixel as the model has it.
    pub(crate) const NONE: Self = Self { dark: 0.0, response: 1.0 };
}

/// The pattern of one device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pattern {
    /// Row by row; empty if no pixel differs.
    pixels: Vec<PixelPattern>,
    /// Numbers of the hot pixels, row by row, ascending.
    hot: Vec<u64>,
}

impl Pattern {
    /// The pattern that the seed picks.
    pub(crate) fn draw(differences: &FixedPattern, defects: &Defects, seed: u64, width: u32, height: u32) -> Self {
        let p = differences;
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
            pixels.reserve_exact(count as usize);
            for (row, y) in rows.iter().zip(0u64..) {
                pixels.extend(columns.iter().zip(0u64..).map(|(column, x)| {
                    let [dark, response] = normals(key, y * u64::from(width) + x, own);
                    PixelPattern {
                        dark: (dark + row[0] + column[0]) as f32,
                        response: (1.0 + response + row[1] + column[1]).max(0.0) as f32,
                    }
                }));
            }
        }
        let mut hot = Vec::new();
        if defects.hot > 0.0 || defects.dead > 0.0 {
            let key = hash_u64([seed, DEFECTS]);
            if is_flat && defects.dead > 0.0 {
                pixels = vec![PixelPattern::NONE; count as usize];
            }
            for pixel in 0..count {
                // 53 bits of a uniform number.
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

    /// The pixels with these numbers; empty if none differs.
    pub(crate) fn pixels(&self, range: std::ops::Range<usize>) -> &[PixelPattern] {
        self.pixels.get(range).unwrap_or(&[])
    }

    /// Numbers of the hot ones among these pixels.
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
