//! Commands on files of earlier renders: merge, expose, denoise.

pub(crate) mod denoise;
pub(crate) mod expose;
pub(crate) mod merge;
