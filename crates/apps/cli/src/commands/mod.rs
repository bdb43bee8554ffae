//! One file for each command.

pub(crate) mod denoise;
pub(crate) mod expose;
pub(crate) mod init;
pub(crate) mod inspect;
pub(crate) mod merge;
pub(crate) mod render;
pub(crate) mod sensors;
#[cfg(feature = "view")]
pub(crate) mod view;
