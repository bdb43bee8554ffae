//! Scattering at one point of a surface in each lane.

use dunkelfeld_lanes::{Lanes, V3};
use dunkelfeld_radiometry::Rgb;

/// Surfaces seen from `wo`, one for each lane. Directions are in the frames of shading.
pub trait View<F: Lanes> {
    /// The BSDF times `|cos wi|` [1/sr] and the density of `wi` [1/sr]. Delta lobes are excluded.
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F);

    /// Samples a direction; `u_lobe` chooses the lobe, `u` the direction in it, all in `[0, 1)`.
    fn sample(&self, u_lobe: F, u: [F; 2]) -> BsdfSamples<F>;

    /// See [`crate::Bsdf::albedo`].
    fn albedo(&self, wo: V3<F>) -> Rgb<F>;
}

/// A sampled direction in each lane.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSamples<F: Lanes> {
    /// The sampled direction, a unit vector away from the surface.
    pub wi: V3<F>,
    /// `eval / pdf`; for a delta lobe its coefficient over the probability of taking it.
    pub weight: Rgb<F>,
    /// Density per unit solid angle [1/sr]; for a delta lobe the discrete probability of taking it. Zero where the light
    /// is absorbed.
    pub pdf: F,
    /// The bits of the [`Lobe`](crate::Lobe) from which the direction was drawn.
    pub lobe: F::Word,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 unless the light was refracted.
    pub eta: F,
}
