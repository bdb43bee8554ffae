//! The clear-coat lobe: a thin, fixed-index lacquer with long tails (Burley 2012: GTR with exponent one).

use crate::fresnel::schlick_weight;
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_sampling::warp::{azimuth, sin_cos_turn};
use std::f32::consts::PI;

/// Share of the coat at full strength: Burley's constant 1/4.
pub const STRENGTH: f32 = 0.25;
/// Reflectance at normal incidence, for an index of 1.5.
const F0: f32 = 0.04;
/// Roughness of the shadowing term, independent of the gloss.
const ALPHA_G: f32 = 0.25;

/// Width of the lobe for a gloss in `[0, 1]`.
#[inline]
pub fn alpha_from_gloss(gloss: f32) -> f32 {
    0.1 + (0.001 - 0.1) * gloss
}

/// Reflectance of the coat for a half-angle of cosine `cos_d`.
#[inline]
pub fn fresnel(cos_d: f32) -> f32 {
    F0 + (1.0 - F0) * schlick_weight(cos_d)
}

/// Density of half vectors times their cosine integrates to one over the hemisphere (Burley 2012, GTR1) [1/sr].
#[inline]
pub fn distribution(m: Vec3, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    // 1 + (a^2 - 1) cos^2 = sin^2 + a^2 cos^2: the sine keeps its digits near the normal.
    let sin2 = m.x * m.x + m.y * m.y;
    (a2 - 1.0) / (PI * a2.ln() * (sin2 + a2 * m.z * m.z))
}

/// The lobe at strength one, times `|cos wi|` [1/sr]; both directions above the surface, `m` their half vector.
#[inline]
pub fn eval_clearcoat(wo: LocalDir, wi: LocalDir, m: Vec3, alpha: f32) -> f32 {
    let g = smith_g1(wo.0.z) * smith_g1(wi.0.z);
    fresnel(m.dot(wi.0)) * distribution(m, alpha) * g * wi.0.z
}

/// Samples a half vector with density `distribution * cos`.
#[inline]
pub fn sample_half_vector([u0, u1]: [f32; 2], alpha: f32) -> Vec3 {
    let a2 = alpha * alpha;
    // The sine is used. At full gloss its square is 1e-6, and 1 - cos^2 would keep one digit of it.
    let sin2 = ((a2.powf(1.0 - u0) - a2) / (1.0 - a2)).clamp(0.0, 1.0);
    let (sin, cos) = (sin2.sqrt(), (1.0 - sin2).sqrt());
    let (s, c) = sin_cos_turn(u1);
    Vec3::new(sin * c, sin * s, cos)
}

/// Density of [`sample_half_vector`] [1/sr].
#[inline]
pub fn pdf_half_vector(m: Vec3, alpha: f32) -> f32 {
    distribution(m, alpha) * m.z
}

/// The random numbers that give a half vector in [`sample_half_vector`].
#[inline]
pub fn invert_half_vector(m: Vec3, alpha: f32) -> [f32; 2] {
    let a2 = alpha * alpha;
    let sin2 = m.x * m.x + m.y * m.y;
    [(1.0 - (sin2 + a2 * m.z * m.z).ln() / a2.ln()).clamp(0.0, 1.0), azimuth(m)]
}

/// Density of the direction that mirrors `wo` at a sampled half vector [1/sr]; `cos_d` is the cosine between them.
#[inline]
pub fn pdf_reflection(m: Vec3, cos_d: f32, alpha: f32) -> f32 {
    pdf_half_vector(m, alpha) / (4.0 * cos_d)
}

/// Smith's masking for GGX of roughness [`ALPHA_G`] (Walter et al. 2007).
#[inline]
fn smith_g1(cos: f32) -> f32 {
    const A2: f32 = ALPHA_G * ALPHA_G;
    2.0 * cos / (cos + (A2 + (1.0 - A2) * cos * cos).sqrt())
}
