//! Dimensions of the random numbers of each decision. Each decision has its own dimension set. So paths of different
//! shape stay aligned, and no number is used twice.

use dunkelfeld_scene::Scene;

/// Place on the pixel (2), and its distance beyond the pixel in front of a lens that blurs (2).
pub(crate) const CAMERA: u32 = 0;

/// Place on the lens (2), for a finite aperture. No path has so many vertices that their sets reach this one,
/// or the one of the time.
pub(crate) const LENS: u32 = u32::MAX;

/// Time of the exposure (1), in scenes with a shutter.
pub(crate) const TIME: u32 = LENS - 1;

/// Sets that one vertex of a path uses.
const PER_VERTEX: u32 = 3;

/// Each further light sample has a block of sets of its own, so that it does not change the numbers of other decisions.
/// No path is so long that its vertices fill a block.
const PER_LIGHT_SAMPLE: u32 = 1 << 28;

/// Direction (2, the best pair of a set), lobe (1), roulette (1) of the vertex with this number.
#[inline]
pub(crate) const fn scatter(vertex: u32) -> u32 {
    1 + PER_VERTEX * vertex
}

/// Place on a light (2), choice of the light (1), for each light sample of the vertex.
#[inline]
pub(crate) const fn light(vertex: u32, index: u32) -> u32 {
    const { assert!(Scene::MAX_LIGHT_SAMPLES <= u32::MAX / PER_LIGHT_SAMPLE) };
    2 + PER_VERTEX * vertex + PER_LIGHT_SAMPLE * index
}

/// Roulette of the light sample of a vertex that takes a sample of one light (1). It is the set of a second light
/// sample, which such a vertex does not have.
#[inline]
pub(crate) const fn single_light_roulette(vertex: u32) -> u32 {
    light(vertex, 1)
}

/// Kind of a stochastic surface (1): present or absent, sheet or solid. Event in the medium before the surface (3):
/// distance, channel, further digits of the distance.
#[inline]
pub(crate) const fn surface_kind(vertex: u32) -> u32 {
    3 + PER_VERTEX * vertex
}
