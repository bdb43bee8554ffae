//! Commands on files: merge, expose and denoise of earlier renders, init of a job.

pub(crate) mod denoise;
pub(crate) mod expose;
pub(crate) mod init;
pub(crate) mod merge;
