//! File formats of images, layers, checkpoints and data sets.

pub mod checkpoint;
pub mod emva_descriptor;
pub mod exr;
pub mod gray;
pub mod jpeg;
pub mod layers;
pub mod picture;
pub mod png;
pub mod tiff;
