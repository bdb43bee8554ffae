//! Estimates of the variance of pixels: from a pixel's own samples, and pooled with those around it.

pub mod inputs;
pub mod pixel;
pub mod pooled;
mod similarity;
