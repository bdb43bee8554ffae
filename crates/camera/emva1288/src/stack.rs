//! A stack of frames of one scene: its mean image, and the spatial variance that remains when the noise is averaged.

use crate::frame::{AnalysisError, Frame};

/// Largest number of frames. The sums of this number of 16-bit values stay below 2^32.
const MAX_FRAMES: u32 = 65_537;

/// Accumulates a stack frame by frame. The memory does not depend on the number of frames.
#[derive(Clone, Debug)]
pub struct StackAccumulator {
    width: u32,
    height: u32,
    frames: u32,
    sums: Vec<u32>,
    squares: u128,
    step: u16,
}

impl StackAccumulator {
    /// An empty stack of frames of the given size.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, frames: 0, sums: vec![0; width as usize * height as usize], squares: 0, step: 0 }
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// The frame has another size, or there are too many frames.
    pub fn add(&mut self, frame: Frame<'_>) -> Result<(), AnalysisError> {
        frame.same_size(self.width, self.height)?;
        if self.frames == MAX_FRAMES {
            return Err(AnalysisError::TooManyFrames(MAX_FRAMES.into()));
        }
        self.frames += 1;
        self.step = frame.step(self.step);
        for (row, values) in
            self.sums.chunks_mut(self.width.max(1) as usize).zip(frame.values().chunks(self.width.max(1) as usize))
        {
            let mut squares = 0u64;
            for (sum, &y) in row.iter_mut().zip(values) {
                *sum += u32::from(y);
                squares += u64::from(y) * u64::from(y);
            }
            self.squares += u128::from(squares);
        }
        Ok(())
    }

    /// The statistics of the stack. It needs at least two frames, and two rows and columns.
    ///
    /// # Errors
    /// There are too few frames, or too few pixels.
    pub fn finish(self) -> Result<SpatialStack, AnalysisError> {
        if self.frames < 2 {
            return Err(AnalysisError::TooFewFrames { got: self.frames.into(), needed: 2 });
        }
        if self.width < 3 || self.height < 3 {
            return Err(AnalysisError::Empty);
        }
        let pixels = self.sums.len() as f64;
        let l = u128::from(self.frames);
        let (mut sum, mut sum_squares) = (0u128, 0u128);
        for &s in &self.sums {
            sum += u128::from(s);
            sum_squares += u128::from(s) * u128::from(s);
        }
        // Mean over the pixels of the unbiased variance of each: L sum(y^2) - (sum y)^2 over L (L - 1). The value is
        // exact and not negative (Cauchy and Schwarz).
        let temporal = (l * self.squares - sum_squares) as f64 / ((l * (l - 1)) as f64 * pixels);
        let mean = sum as f64 / (self.frames as f64 * pixels);
        Ok(SpatialStack {
            width: self.width,
            height: self.height,
            frames: self.frames,
            sums: self.sums,
            mean,
            temporal_variance: temporal,
            step: self.step,
        })
    }
}

/// The mean image of a stack.
#[derive(Clone, Debug, PartialEq)]
pub struct SpatialStack {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Number of frames L.
    pub frames: u32,
    /// Mean over pixels and frames \[DN\].
    pub mean: f64,
    /// Temporal variance of a frame, averaged over the pixels, sigma_y.stack^2 \[DN^2\].
    pub temporal_variance: f64,
    /// The largest number that divides all values; 0 if all are zero.
    pub step: u16,
    /// Sum over the frames for each pixel, row by row.
    sums: Vec<u32>,
}

impl SpatialStack {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.sums.len()
    }

    /// The mean image \[DN\], row by row.
    pub fn means(&self) -> impl Iterator<Item = f64> + '_ {
        let frames = f64::from(self.frames);
        self.sums.iter().map(move |&s| f64::from(s) / frames)
    }

    /// One row of the mean image \[DN\]. Empty beyond the last row.
    pub fn row(&self, row: u32) -> impl Iterator<Item = f64> + '_ {
        let (width, frames) = (self.width as usize, f64::from(self.frames));
        let start = (row as usize * width).min(self.sums.len());
        let end = (start + width).min(self.sums.len());
        self.sums.get(start..end).unwrap_or(&[]).iter().map(move |&s| f64::from(s) / frames)
    }

    /// Sum over the frames for each pixel, row by row: exact.
    pub fn sums(&self) -> &[u32] {
        &self.sums
    }

    /// The stack with values in units of a step.
    pub(crate) fn in_steps(&self, step: u16) -> Self {
        let unit = f64::from(step);
        Self {
            mean: self.mean / unit,
            temporal_variance: self.temporal_variance / (unit * unit),
            step: self.step / step,
            sums: self.sums.iter().map(|sum| sum / u32::from(step)).collect(),
            ..*self
        }
    }

    pub(crate) fn same_size(&self, other: &Self) -> Result<(), AnalysisError> {
        if (self.width, self.height) == (other.width, other.height) {
            Ok(())
        } else {
            Err(AnalysisError::SizeMismatch([self.width, self.height, other.width, other.height]))
        }
    }

    /// Deviations of the columns' means and of the rows' means from the mean of all \[DN\].
    pub(crate) fn profiles(&self) -> (Vec<f64>, Vec<f64>) {
        let (width, height) = (self.width as usize, self.height as usize);
        let (mut columns, mut rows) = (vec![0u64; width], vec![0u64; height]);
        for (row, total) in self.sums.chunks_exact(width).zip(&mut rows) {
            for (&s, column) in row.iter().zip(&mut columns) {
                *column += u64::from(s);
                *total += u64::from(s);
            }
        }
        let frames = f64::from(self.frames);
        let to = |sums: Vec<u64>, over: usize| -> Vec<f64> {
            sums.into_iter().map(|s| s as f64 / (over as f64 * frames) - self.mean).collect()
        };
        (to(columns, height), to(rows, width))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A stack of two equal frames.
    pub(crate) fn still(width: u32, height: u32, at: impl Fn(u32, u32) -> u16) -> SpatialStack {
        let values: Vec<u16> = (0..width * height).map(|i| at(i % width, i / width)).collect();
        let mut stack = StackAccumulator::new(width, height);
        for _ in 0..2 {
            stack.add(Frame::new(width, height, &values).expect("size")).expect("same size");
        }
        stack.finish().expect("two frames")
    }

    #[test]
    fn a_stack_by_hand() {
        let mut stack = StackAccumulator::new(3, 3);
        for add in [0u16, 2, 4] {
            let values: Vec<u16> = (0..9).map(|i| 10 * (i + 1) + add).collect();
            stack.add(Frame::new(3, 3, &values).expect("nine")).expect("same size");
        }
        let s = stack.finish().expect("three frames");
        // Every pixel takes three values 2 apart: variance 4. Means are 12, 22, ..., 92.
        assert_eq!((s.mean, s.temporal_variance), (52.0, 4.0));
        assert_eq!(s.row(1).collect::<Vec<_>>(), [42.0, 52.0, 62.0]);
        let (columns, rows) = s.profiles();
        assert_eq!(columns, [-10.0, 0.0, 10.0]);
        assert_eq!(rows, [-30.0, 0.0, 30.0]);
    }

    #[test]
    fn the_largest_stack_does_not_overflow() {
        let mut stack = StackAccumulator::new(3, 3);
        for _ in 0..MAX_FRAMES {
            stack.add(Frame::new(3, 3, &[u16::MAX; 9]).expect("nine")).expect("room for it");
        }
        assert!(stack.add(Frame::new(3, 3, &[0; 9]).expect("nine")).is_err());
        let s = stack.finish().expect("frames");
        assert_eq!((s.mean, s.temporal_variance), (65_535.0, 0.0));
    }
}
