//! Queries of rays against a compiled scene.

mod coincident;
pub mod intersect;
pub mod shading;
pub(crate) mod surface;
pub(crate) mod surface_points;
