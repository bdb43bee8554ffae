//! Which random numbers serve which decision. Each decision has its own dimension set, so that paths of different shape
//! stay aligned, and no number is used twice.

/// Place on the pixel (2).
pub(crate) const CAMERA: u32 = 0;

/// Sets that one vertex of a path uses.
const PER_VERTEX: u32 = 2;

/// Lobe (1), direction (2), roulette (1) of the vertex with this number.
#[inline]
pub(crate) const fn scatter(vertex: u32) -> u32 {
    1 + PER_VERTEX * vertex
}

/// Choice of a light (1), place on it (2), and which of two things the surface is (1).
#[inline]
pub(crate) const fn light(vertex: u32) -> u32 {
    2 + PER_VERTEX * vertex
}
