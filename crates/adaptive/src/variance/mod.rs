//! Estimates of the variance of pixels: from a pixel's own samples, from its neighbours, and from both pooled.

pub mod inputs;
pub mod pixel;
pub mod pooled;
mod similarity;
