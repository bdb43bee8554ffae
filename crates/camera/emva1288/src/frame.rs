//! Frames of grey values, and the errors of their analysis.

/// The reason why an analysis is not possible.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AnalysisError {
    /// The number of values is not that of the pixels.
    #[error("a frame of {width} x {height} pixels has {got} values")]
    Length {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Number of values.
        got: usize,
    },
    /// Frames differ in size.
    #[error("the frames differ in size: {} x {} and {} x {} pixels", .0[0], .0[1], .0[2], .0[3])]
    SizeMismatch([u32; 4]),
    /// A mask does not have one entry per pixel.
    #[error("the mask has {got} entries, the frames have {pixels} pixels")]
    Mask {
        /// Entries of the mask.
        got: usize,
        /// Pixels of the frames.
        pixels: usize,
    },
    /// Too few frames.
    #[error("{got} frames are given, {needed} are needed")]
    TooFewFrames {
        /// Number of given frames.
        got: u64,
        /// Number of required frames.
        needed: u64,
    },
    /// The number of frames is so large that the exact sums could overflow.
    #[error("more than {0} frames in one stack")]
    TooManyFrames(u64),
    /// There are too few different grey levels for the regression.
    #[error("{got} different grey levels lie in the range of the regression, {needed} are needed")]
    TooFewLevels {
        /// Number of given levels.
        got: usize,
        /// Number of required levels.
        needed: usize,
    },
    /// The frames have no pixels, or too few.
    #[error("the frames have too few pixels")]
    Empty,
    /// The measurement is incomplete or invalid.
    #[error("{problem}")]
    Unfit {
        /// The missing or wrong part.
        problem: String,
        /// Help for the user.
        help: String,
    },
}

impl AnalysisError {
    pub(crate) fn unfit(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Unfit { problem: problem.into(), help: help.into() }
    }

    /// Help for the user.
    pub fn help(&self) -> &str {
        match self {
            Self::Length { .. } | Self::Empty => "use frames with pixels, three rows and columns at least",
            Self::SizeMismatch(_) => "use frames of one size",
            Self::Mask { .. } => "use a mask of the size of the frames",
            Self::TooFewFrames { .. } => "add frames",
            Self::TooManyFrames(_) => "use fewer frames",
            Self::TooFewLevels { .. } => "add levels of light, evenly spread from dark to saturation",
            Self::Unfit { help, .. } => help,
        }
    }
}

/// Grey values \[DN\] of one frame, row by row. 8-bit values are widened, not scaled.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    width: u32,
    height: u32,
    values: &'a [u16],
}

impl<'a> Frame<'a> {
    /// A frame over `width * height` values.
    pub fn new(width: u32, height: u32, values: &'a [u16]) -> Result<Self, AnalysisError> {
        if values.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(AnalysisError::Length { width, height, got: values.len() });
        }
        Ok(Self { width, height, values })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The grey values.
    pub fn values(&self) -> &'a [u16] {
        self.values
    }

    /// The largest number that divides `step` and all values. 0 divides by nothing but itself.
    pub(crate) fn step(&self, step: u16) -> u16 {
        self.values.iter().fold(step, |step, &y| if step == 1 { 1 } else { common_step(y, step) })
    }

    pub(crate) fn same_size(&self, width: u32, height: u32) -> Result<(), AnalysisError> {
        if (self.width, self.height) == (width, height) {
            Ok(())
        } else {
            Err(AnalysisError::SizeMismatch([width, height, self.width, self.height]))
        }
    }
}

/// The greatest common divisor, by Euclid; with 0 the other number.
pub(crate) fn common_step(mut a: u16, mut b: u16) -> u16 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
