//! Queries of rays against a compiled scene.

pub mod intersect;
pub mod shading;
pub(crate) mod surface;
