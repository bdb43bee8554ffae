//! One file for each command.

pub(crate) mod bench;
pub(crate) mod campaign;
pub(crate) mod denoise;
pub(crate) mod emva;
pub(crate) mod expose;
pub(crate) mod inspect;
pub(crate) mod merge;
pub(crate) mod ptc;
pub(crate) mod render;
pub(crate) mod sensors;
