//! File formats of images, layers and data sets.

pub mod emva_descriptor;
pub mod exr;
pub mod gray;
pub mod jpeg;
pub mod layers;
pub mod picture;
pub mod png;
pub mod tiff;
