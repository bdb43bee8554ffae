//! The transmission lobe: refraction at the facets of a rough boundary (Walter, Marschner, Li and Torrance 2007).
//!
//! `wo` lies above the boundary and `wi` below; `eta` is the index of refraction below over the one above.

use crate::fresnel;
use crate::microfacet::Ggx;
use dunkelfeld_lanes::{Lanes, V3};

/// Properties of the facets that refract one direction into another.
#[derive(Clone, Copy, Debug)]
pub struct Refraction<F: Lanes = f32> {
    /// True if some facet does. Else nothing here has a meaning.
    pub is_possible: F::Mask,
    /// Cosine between `wo` and the facet, above zero.
    pub cos_o: F,
    /// Cosine between `wi` and the back of the facet, above zero.
    pub cos_i: F,
    /// Share of the light that the facets reflect.
    pub fresnel: F,
    /// Density of `wi` for visible normals if all of them refract [1/sr].
    pub density: F,
    /// The lobe without its colour, times `|cos wi|` [1/sr]; radiance falls by `eta^2`.
    pub value: F,
}

/// The lobe for a pair of directions.
#[inline(always)]
pub fn eval_refraction<F: Lanes>(ggx: &Ggx<F>, wo: V3<F>, wi: V3<F>, eta: F) -> Refraction<F> {
    let (m, is_possible) = half_vector(wo, wi, eta);
    let (cos_o, cos_i) = (wo.dot(m), -wi.dot(m));
    let fresnel = fresnel::from_cosines(cos_o, cos_i, eta);
    let density = ggx.pdf_visible(wo, m) * jacobian(cos_o, cos_i, eta);
    let value = fresnel.one_minus() * density * ggx.g1(-wi) / (eta * eta);
    Refraction { is_possible, cos_o, cos_i, fresnel, density, value }
}

/// Refracts `w` at a unit normal `m` with `w.m > 0`; `cos_t` is the cosine of the angle of refraction.
#[inline(always)]
pub fn refract<F: Lanes>(w: V3<F>, m: V3<F>, eta: F, cos_t: F) -> V3<F> {
    let inv = eta.recip();
    (m * (inv * w.dot(m) - cos_t) - w * inv).normalize()
}

/// The normal, facing up, that refracts `wo` into `wi`, and whether there is one.
#[inline(always)]
pub fn half_vector<F: Lanes>(wo: V3<F>, wi: V3<F>, eta: F) -> (V3<F>, F::Mask) {
    let (h, zero) = (wo + wi * eta, eta.constant(0.0));
    let (m, is_some) = V3::select(h.z.lt(zero), -h, h).try_normalize();
    // The front of the facet must face wo and its back wi, as for the surface.
    (m, is_some & m.z.is_positive() & wo.dot(m).is_positive() & wi.dot(m).lt(zero))
}

/// Solid angle of normals per solid angle of refracted directions (Walter et al. 2007, equation 17), by the cosines between
/// the directions and the facet's two sides.
#[inline(always)]
pub fn jacobian<F: Lanes>(cos_o: F, cos_i: F, eta: F) -> F {
    let d = cos_o - eta * cos_i;
    eta * eta * cos_i / (d * d)
}
