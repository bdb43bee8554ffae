//! What is done to files of earlier renders: join parts, expose, denoise.

pub(crate) mod denoise;
pub(crate) mod expose;
pub(crate) mod merge;
