//! Geometry of the triangles that rays hit.

pub(crate) mod normal_differential;
pub(crate) mod triangle_data;
