//! Geometry of the triangles that rays hit.

pub(crate) mod normal_differential;
pub(crate) mod rounded_edges;
pub(crate) mod triangle_data;

use dunkelfeld_geometry::DVec3;
use dunkelfeld_lanes::{Lanes, V3};

/// A vector in all lanes.
#[inline(always)]
pub(crate) fn splat<F: Lanes>(token: F::Token, v: DVec3) -> V3<F::Double> {
    V3::<F>::splat_double(token, V3::new(v.x, v.y, v.z))
}
