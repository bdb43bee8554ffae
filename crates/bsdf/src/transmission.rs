//! The transmission lobe: refraction at the facets of a rough boundary (Walter, Marschner, Li and Torrance 2007).
//!
//! `wo` lies above the boundary and `wi` below; `eta` is the index of refraction below over the one above.

use crate::fresnel;
use crate::microfacet::Ggx;
use dunkelfeld_geometry::{LocalDir, Vec3};

/// Properties of the facets that refract one direction into another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refraction {
    /// Cosine between `wo` and the facet, above zero.
    pub cos_o: f32,
    /// Cosine between `wi` and the back of the facet, above zero.
    pub cos_i: f32,
    /// Share of the light that the facets reflect.
    pub fresnel: f32,
    /// Density of `wi` for visible normals if all of them refract [1/sr].
    pub density: f32,
    /// The lobe without its colour, times `|cos wi|` [1/sr]; radiance falls by `eta^2`.
    pub value: f32,
}

/// The lobe for a pair of directions; `None` if no facet refracts one into the other.
#[inline]
pub fn eval_refraction(ggx: &Ggx, wo: LocalDir, wi: LocalDir, eta: f32) -> Option<Refraction> {
    let m = half_vector(wo, wi, eta)?;
    let (cos_o, cos_i) = (wo.0.dot(m), -wi.0.dot(m));
    let fresnel = fresnel::from_cosines(cos_o, cos_i, eta);
    let density = ggx.pdf_visible(wo, m) * jacobian(cos_o, cos_i, eta);
    let value = (1.0 - fresnel) * density * ggx.g1(-wi) / (eta * eta);
    Some(Refraction { cos_o, cos_i, fresnel, density, value })
}

/// Refracts `w` at a unit normal `m` with `w.m > 0`; `cos_t` is the cosine of the angle of refraction.
#[inline]
pub fn refract(w: LocalDir, m: Vec3, eta: f32, cos_t: f32) -> LocalDir {
    let inv = 1.0 / eta;
    LocalDir((m * (inv * w.0.dot(m) - cos_t) - w.0 * inv).normalize())
}

/// The normal, facing up, that refracts `wo` into `wi`; `None` if there is none.
#[inline]
pub fn half_vector(wo: LocalDir, wi: LocalDir, eta: f32) -> Option<Vec3> {
    let h = wo.0 + wi.0 * eta;
    let m = (if h.z < 0.0 { -h } else { h }).try_normalize()?;
    // The front of the facet must face wo and its back wi, as for the surface.
    (m.z > 0.0 && wo.0.dot(m) > 0.0 && wi.0.dot(m) < 0.0).then_some(m)
}

/// Solid angle of normals per solid angle of refracted directions (Walter et al. 2007, equation 17), by the cosines between
/// the directions and the facet's two sides.
#[inline]
pub fn jacobian(cos_o: f32, cos_i: f32, eta: f32) -> f32 {
    let d = cos_o - eta * cos_i;
    eta * eta * cos_i / (d * d)
}
