//! Means and temporal variances, from stacks of frames (per pixel) and from pairs (per level).
//!
//! Grey values are integers, so all sums are exact integers without cancellation errors.

use crate::frame::{AnalysisError, Frame};
use crate::quantity::Quantity;

/// Largest number of frames. Its product with the sum of the squares of this number of 16-bit values stays below 2^64.
const MAX_FRAMES: u64 = 65_535;

/// Accumulates a stack of frames one by one, so that the stack need not be in memory.
#[derive(Clone, Debug)]
pub struct TemporalAccumulator {
    width: u32,
    height: u32,
    frames: u64,
    sums: Vec<PixelSums>,
}

/// Sums of one pixel: number of its frames, sum of its values and sum of their squares.
#[derive(Clone, Copy, Debug, Default)]
struct PixelSums {
    frames: u64,
    sum: u64,
    squares: u64,
}

impl TemporalAccumulator {
    /// An empty stack of frames of the given size.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, frames: 0, sums: vec![PixelSums::default(); width as usize * height as usize] }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: Frame<'_>) -> Result<(), AnalysisError> {
        self.add_pixels(frame, std::iter::repeat(true))
    }

    /// Adds the pixels of a frame for which `counts` is true. `counts` has one entry for each pixel.
    pub fn add_where(&mut self, frame: Frame<'_>, counts: &[bool]) -> Result<(), AnalysisError> {
        if counts.len() != frame.values().len() {
            return Err(AnalysisError::Mask { got: counts.len(), pixels: frame.values().len() });
        }
        self.add_pixels(frame, counts.iter().copied())
    }

    fn add_pixels(&mut self, frame: Frame<'_>, counts: impl Iterator<Item = bool>) -> Result<(), AnalysisError> {
        frame.same_size(self.width, self.height)?;
        if self.frames == MAX_FRAMES {
            return Err(AnalysisError::TooManyFrames(MAX_FRAMES));
        }
        self.frames += 1;
        let counted = self.sums.iter_mut().zip(frame.values()).zip(counts).filter(|(_, counts)| *counts);
        for ((sums, &y), _) in counted {
            let y = u64::from(y);
            sums.frames += 1;
            sums.sum += y;
            sums.squares += y * y;
        }
        Ok(())
    }

    /// Mean and variance per pixel. It needs at least two frames. A pixel that counts in fewer has the variance NaN.
    pub fn finish(&self) -> Result<TemporalStatistics, AnalysisError> {
        let n = self.frames;
        if n < 2 {
            return Err(AnalysisError::TooFewFrames { got: n, needed: 2 });
        }
        let mean = self.sums.iter().map(|p| p.sum as f64 / p.frames as f64).collect();
        // n sum(y^2) - (sum y)^2 is not negative (Cauchy and Schwarz), and exact.
        let variance = |p: &PixelSums| {
            (p.frames * p.squares - p.sum * p.sum) as f64 / (p.frames * p.frames.saturating_sub(1)) as f64
        };
        Ok(TemporalStatistics {
            width: self.width,
            height: self.height,
            frames: n,
            counts: self.sums.iter().map(|p| p.frames as u32).collect(),
            mean,
            variance: self.sums.iter().map(variance).collect(),
        })
    }
}

/// Mean and temporal variance of every pixel of a stack of frames.
#[derive(Clone, Debug, PartialEq)]
pub struct TemporalStatistics {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Number of frames in the stack.
    pub frames: u64,
    /// Number of frames that each pixel counts in.
    pub counts: Vec<u32>,
    /// Mean per pixel \[DN\].
    pub mean: Vec<f64>,
    /// Unbiased variance per pixel \[DN^2\].
    pub variance: Vec<f64>,
}

impl TemporalStatistics {
    /// Statistics of a stack that is in memory.
    pub fn from_frames(frames: &[Frame<'_>]) -> Result<Self, AnalysisError> {
        let first = frames.first().ok_or(AnalysisError::TooFewFrames { got: 0, needed: 2 })?;
        let mut stack = TemporalAccumulator::new(first.width(), first.height());
        frames.iter().try_for_each(|frame| stack.add(*frame))?;
        stack.finish()
    }
}

/// Mean and temporal variance of a homogeneous level, from two frames taken under the same conditions.
///
/// The difference of the frames does not contain the fixed pattern, so the light need not be uniform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePair {
    /// Mean grey value of both frames.
    pub mean: Quantity,
    /// Temporal variance of one frame.
    pub variance: Quantity,
    /// The part of the variance that the pixels of a row share, and its standard error \[DN^2\]. Negative by chance, NaN
    /// for a single row or column.
    pub row_variance: [f64; 2],
    /// Number of pixels.
    pub pixels: u64,
    /// Fraction of the values that are zero. The variance of a clipped signal is too small.
    pub at_zero: f64,
    /// The largest value of both frames \[DN\].
    pub largest: u16,
    /// Fraction of the values that are the largest.
    pub at_largest: f64,
    /// Variance of the values over both frames, temporal and spatial together \[DN^2\].
    pub spread: f64,
    /// The largest number that divides all values; 0 if all are zero.
    pub step: u16,
}

impl FramePair {
    /// mu_y = mean((a + b) / 2) and sigma_y^2 = mean((a - b)^2) / 2 - (mean a - mean b)^2 / 2
    /// (EMVA 1288 release 4.0, Linear).
    pub fn from_frames(a: Frame<'_>, b: Frame<'_>) -> Result<Self, AnalysisError> {
        b.same_size(a.width(), a.height())?;
        if a.values().is_empty() {
            return Err(AnalysisError::Empty);
        }
        let mut all = PairSums::default();
        let (mut zeros, mut largest, mut at_largest, mut squares) = (0u64, 0u16, 0u64, 0u64);
        let (mut means, mut variances) = (RowSpread::default(), RowSpread::default());
        let width = a.width() as usize;
        for (a, b) in a.values().chunks_exact(width).zip(b.values().chunks_exact(width)) {
            let mut row = PairSums::default();
            for (&a, &b) in a.iter().zip(b) {
                row.add(a, b);
                squares += u64::from(a) * u64::from(a) + u64::from(b) * u64::from(b);
                for y in [a, b] {
                    zeros += u64::from(y == 0);
                    if y > largest {
                        (largest, at_largest) = (y, 0);
                    }
                    at_largest += u64::from(y == largest);
                }
            }
            means.add(row.difference as f64 / width as f64);
            variances.add(row.second as f64 / width as f64);
            all.merge(&row);
        }
        let n = a.values().len() as f64;
        let (second, fourth) = (all.second as f64 / n, all.fourth as f64 / n);
        let variance = 0.5 * second - 0.5 * (all.difference as f64 / n).powi(2);
        // The spread of the squared differences gives the standard error of their mean, without an assumption on their
        // distribution. If whole rows flicker, pixels are not independent, and the spread of the rows gives the
        // standard error.
        let variance_error = 0.5 * variances.error(((fourth - second * second).max(0.0) / n).sqrt());
        let mean_error = 0.5 * means.error((2.0 * variance.max(0.0) / n).sqrt());
        let mean = all.sum as f64 / (2.0 * n);
        // The mean over N pixels of a row has the variance sigma_row^2 + (sigma_y^2 - sigma_row^2) / N.
        let (of_means, alone) = (0.5 * means.variance(), 1.0 / width as f64);
        let row_variance = [of_means - variance * alone, of_means * (2.0 / (means.rows - 1.0)).sqrt()];
        Ok(Self {
            mean: Quantity {
                symbol: "mu_y",
                name: "mean grey value",
                value: mean,
                standard_error: mean_error,
                unit: "DN",
                section: "EMVA 1288 release 4.0 Linear, mean of two frames",
            },
            variance: Quantity {
                symbol: "sigma_y^2",
                name: "temporal variance",
                value: variance,
                standard_error: variance_error,
                unit: "DN^2",
                section: "EMVA 1288 release 4.0 Linear, variance of two frames",
            },
            row_variance: row_variance.map(|v| v / (1.0 - alone)),
            pixels: a.values().len() as u64,
            at_zero: zeros as f64 / (2.0 * n),
            largest,
            at_largest: at_largest as f64 / (2.0 * n),
            spread: (squares as f64 / (2.0 * n) - mean * mean).max(0.0),
            step: b.step(a.step(0)),
        })
    }

    /// The pair with values in units of a step.
    pub(crate) fn in_steps(mut self, step: u16) -> Self {
        let unit = f64::from(step);
        for (q, unit) in [(&mut self.mean, unit), (&mut self.variance, unit * unit)] {
            (q.value, q.standard_error) = (q.value / unit, q.standard_error / unit);
        }
        self.row_variance = self.row_variance.map(|v| v / (unit * unit));
        self.spread /= unit * unit;
        (self.largest, self.step) = (self.largest / step, self.step / step);
        self
    }
}

/// Exact sums over a pair.
#[derive(Default)]
struct PairSums {
    sum: u64,
    difference: i64,
    second: u64,
    fourth: u128,
}

impl PairSums {
    fn add(&mut self, a: u16, b: u16) {
        let d = i64::from(a) - i64::from(b);
        let square = (d * d) as u64;
        self.sum += u64::from(a) + u64::from(b);
        self.difference += d;
        self.second += square;
        self.fourth += u128::from(square) * u128::from(square);
    }

    fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.difference += other.difference;
        self.second += other.second;
        self.fourth += other.fourth;
    }
}

/// The scatter of means over rows, and the standard error of the mean over all rows.
#[derive(Default)]
struct RowSpread {
    rows: f64,
    sum: f64,
    squares: f64,
}

impl RowSpread {
    fn add(&mut self, v: f64) {
        self.rows += 1.0;
        self.sum += v;
        self.squares += v * v;
    }

    /// The variance of the rows.
    fn variance(&self) -> f64 {
        let mean = self.sum / self.rows;
        (self.squares / self.rows - mean * mean).max(0.0) * self.rows / (self.rows - 1.0)
    }

    /// The standard error of the mean. It is `independent`, which assumes independent pixels, unless rows scatter by
    /// five of their own standard errors more than that allows.
    fn error(&self, independent: f64) -> f64 {
        if self.rows < 2.0 {
            return independent;
        }
        let variance = self.variance() / self.rows;
        let limit = independent * independent * (1.0 + 5.0 * (2.0 / (self.rows - 1.0)).sqrt());
        if variance > limit { variance.sqrt() } else { independent }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(values: &[u16]) -> Frame<'_> {
        Frame::new(values.len() as u32, 1, values).expect("the length is the width")
    }

    #[test]
    fn a_stack_by_hand() {
        let s =
            TemporalStatistics::from_frames(&[frame(&[1, 100, 65_535]), frame(&[2, 100, 0]), frame(&[6, 100, 65_535])])
                .expect("three frames");
        assert_eq!(s.mean, [3.0, 100.0, 43_690.0]);
        // (4 + 1 + 9) / 2; 0; (2 * 21845^2 + 43690^2) / 2.
        assert_eq!(s.variance, [7.0, 0.0, 1_431_612_075.0]);
    }

    #[test]
    fn a_stack_of_pixels_that_count_by_hand() {
        let mut stack = TemporalAccumulator::new(3, 1);
        for (values, counts) in
            [([1, 7, 9], [true, true, false]), ([3, 9, 9], [true, false, false]), ([8, 4, 5], [true; 3])]
        {
            stack.add_where(frame(&values), &counts).expect("fits");
        }
        let s = stack.finish().expect("three frames");
        assert_eq!((s.frames, s.counts), (3, vec![3, 2, 1]));
        // 1, 3, 8; 7, 4; 5 alone.
        assert_eq!((&s.mean[..], &s.variance[..2]), (&[4.0, 5.5, 5.0][..], &[13.0, 4.5][..]));
        assert!(s.variance[2].is_nan());
        let short = stack.add_where(frame(&[1, 2, 3]), &[true]);
        assert_eq!(short, Err(AnalysisError::Mask { got: 1, pixels: 3 }));
    }

    #[test]
    fn a_pair_by_hand() {
        let p = FramePair::from_frames(frame(&[10, 12, 14, 0]), frame(&[12, 12, 10, 2])).expect("two frames");
        assert_eq!(p.mean.value, 9.0);
        // Differences -2, 0, 4, -2: mean square 6, mean 0.
        assert_eq!(p.variance.value, 3.0);
        // Fourth powers 16, 0, 256, 16: mean 72; sqrt((72 - 36) / 4) / 2.
        assert_eq!(p.variance.standard_error, 1.5);
        assert_eq!(p.at_zero, 0.125);
    }

    #[test]
    fn a_drift_of_the_light_between_the_frames_does_not_count_as_noise() {
        let a: Vec<u16> = (0..1000).map(|i| 100 + i % 7).collect();
        let b: Vec<u16> = a.iter().map(|v| v + 50).collect();
        let pair = FramePair::from_frames(frame(&a), frame(&b)).expect("two frames");
        assert_eq!(pair.variance.value, 0.0);
    }
}
