//! Random numbers and their transformation: Owen-scrambled Sobol points, keyed PCG streams, warps, distributions.
//!
//! Every number is a pure function of its key; there is no state between samples. Functions follow one naming rule:
//! `sample_x` maps uniform numbers in `[0, 1)` to a point, `pdf_x` is the density of that map, `invert_x` returns the
//! uniform numbers of a point.

#![forbid(unsafe_code)]

mod distribution;
mod hash;
mod pcg;
mod sampler;
mod sobol;
pub mod warp;

pub use distribution::{Choice, Distribution1D, Distribution2D};
pub use hash::{hash_u64, mix64};
pub use pcg::{Pcg, keyed_stream};
pub use sampler::{BATCHES, Numbers, Sampler};
