//! The film: exact sums of samples per pixel, and planes of numbers computed from them.

#![forbid(unsafe_code)]

mod accumulator;
mod columns;
mod estimates;
mod film;
mod footprint;
mod gaps;
mod mean_image;
mod packed;
mod plane;
mod square_sum;
pub mod units;
mod weighted;

/// Value of an id layer in pixels without an object or material.
pub const NO_ID: u32 = u32::MAX;

pub use accumulator::{Accumulate, BATCHES, PixelSums, RadianceSum, Sample};
pub use estimates::{Means, Scatter};
pub use film::{Film, FilmError, FilmLayers, MAX_PIXELS, MAX_SIDE, Needed, OutOfMemory, TileRow};
pub use gaps::fill_gaps;
pub use mean_image::MeanImage;
pub use plane::Plane;
pub use square_sum::SquareSum;
