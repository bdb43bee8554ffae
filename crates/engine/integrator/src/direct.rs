//! Next-event estimation along straight lines from a vertex to a light.

use dunkelfeld_lanes::{Lanes, Mask};

/// The gathered roulette applies to light samples whose contribution is below this share of the radiance f that the path has
/// gathered. It adds no more than (f / 32)^2 / 4 to the variance of a sample, which is little also where light is smooth. A
/// limit at f itself would more than double the noise of matt rooms.
pub(crate) const GATHERED_SHARE: f32 = 1.0 / 32.0;

/// Smallest probability of survival in that roulette. It limits the weight of a sample.
pub(crate) const MIN_SURVIVAL: f32 = 1.0 / 16.0;

/// Factor on the light of a light sample with the density `light_pdf`: the MIS weight over the density. `pdf` is the
/// density with which scattering draws its direction; it draws no direction to a light without extent.
#[inline(always)]
pub(crate) fn light_weight<F: Lanes>(light_pdf: F, pdf: F, is_delta: F::Mask) -> F {
    is_delta.select(pdf.constant(1.0), power_heuristic(light_pdf, pdf)) / light_pdf
}

/// The power heuristic with exponent 2 (Veach & Guibas 1995): the weight of the technique with the density `pdf`.
#[inline(always)]
pub(crate) fn power_heuristic<F: Lanes>(pdf: F, other_pdf: F) -> F {
    let one = pdf.constant(1.0);
    // A ratio, so that squares of large densities do not overflow.
    let ratio = other_pdf / pdf;
    pdf.eq(pdf.constant(f32::INFINITY)).select(one, one / (ratio * ratio + 1.0))
}
