//! Statistics for tests: is a random result what it should be?
//!
//! Each test gives an [`Outcome`] with a p-value: the probability, if all is well, of a result at least this bad. A
//! test fails below a *stated* false-alarm rate, never at a tolerance chosen to pass. When several results are judged
//! together, [`sidak`] gives the rate for each. [`Claim`] holds a value to four standard errors of its own. Seeds are fixed by
//! the caller, so a failure replays.

#![forbid(unsafe_code)]

mod artefact;
mod chi_squared;
mod compare;
mod density;
mod images;
mod moments;
mod outcome;
mod sampler;
mod sequential_test;

pub use chi_squared::chi_squared;
pub use compare::{student_t_test, welch_test, z_test};
pub use density::{DensityTest, direction_to_square, integrate_square, square_to_direction};
pub use images::{ImageEstimate, ImageTest};
pub use moments::SampleMoments;
pub use outcome::{Outcome, sidak};
pub use sampler::{SamplerCase, check_corners, check_densities, check_inverses, check_names};
pub use sequential_test::{Claim, Estimate};
