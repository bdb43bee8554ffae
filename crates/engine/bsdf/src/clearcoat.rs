//! The clear-coat lobe: a thin, fixed-index lacquer with long tails (Burley 2012: GTR with exponent one).

use crate::fresnel::schlick_weight;
use crate::in_lanes::in_lanes;
use dunkelfeld_lanes::{Lanes, V3, cos_sin_of_turn, exp, ln};
use dunkelfeld_sampling::warp::azimuth;
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
#[inline(always)]
pub fn fresnel<F: Lanes>(cos_d: F) -> F {
    schlick_weight(cos_d) * (1.0 - F0) + F0
}

/// The distribution of half vectors.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coat<F = f32> {
    /// Square of the width.
    a2: F,
    /// Logarithm of it.
    ln_a2: F,
}

in_lanes!(Coat => Coat<F> { a2, ln_a2 });

impl Coat {
    /// From the width of the lobe, in (0, 1).
    #[inline]
    pub fn new(alpha: f32) -> Self {
        Self { a2: alpha * alpha, ln_a2: ln(alpha * alpha) }
    }

    /// The random numbers that give a half vector in [`Self::sample_half_vector`].
    #[inline]
    pub fn invert_half_vector(&self, m: V3<f32>) -> [f32; 2] {
        let sin2 = m.x * m.x + m.y * m.y;
        [(1.0 - ln(sin2 + self.a2 * m.z * m.z) / self.ln_a2).clamp(0.0, 1.0), azimuth(m.into())]
    }
}

impl<F: Lanes> Coat<F> {
    /// Density of half vectors; times their cosine it integrates to one over the hemisphere (Burley 2012, GTR1) [1/sr].
    #[inline(always)]
    pub fn distribution(&self, m: V3<F>) -> F {
        // 1 + (a^2 - 1) cos^2 = sin^2 + a^2 cos^2: the sine keeps its digits near the normal.
        let sin2 = m.x * m.x + m.y * m.y;
        (self.a2 - 1.0) / (self.ln_a2 * PI * (sin2 + self.a2 * m.z * m.z))
    }

    /// The lobe at strength one, times `|cos wi|` [1/sr]; both directions above the surface, `m` their half vector.
    #[inline(always)]
    pub fn eval(&self, wo: V3<F>, wi: V3<F>, m: V3<F>) -> F {
        let g = smith_g1(wo.z) * smith_g1(wi.z);
        fresnel(m.dot(wi)) * self.distribution(m) * g * wi.z
    }

    /// Samples a half vector with density `distribution * cos`.
    #[inline(always)]
    pub fn sample_half_vector(&self, [u0, u1]: [F; 2]) -> V3<F> {
        // The sine is used. At full gloss its square is 1e-6, and 1 - cos^2 would keep one digit of it.
        let sin2 = ((exp(self.ln_a2 * u0.one_minus()) - self.a2) / self.a2.one_minus()).clamp(0.0, 1.0);
        let (sin, cos) = (sin2.sqrt(), sin2.one_minus().sqrt());
        let (c, s) = cos_sin_of_turn(u1);
        V3::new(sin * c, sin * s, cos)
    }

    /// Density of [`Self::sample_half_vector`] [1/sr].
    #[inline(always)]
    pub fn pdf_half_vector(&self, m: V3<F>) -> F {
        self.distribution(m) * m.z
    }

    /// Density of the direction that mirrors `wo` at a sampled half vector [1/sr]; `cos_d` is the cosine between them.
    #[inline(always)]
    pub fn pdf_reflection(&self, m: V3<F>, cos_d: F) -> F {
        self.pdf_half_vector(m) / (cos_d * 4.0)
    }
}

/// Smith's masking for GGX of roughness [`ALPHA_G`] (Walter et al. 2007).
#[inline(always)]
fn smith_g1<F: Lanes>(cos: F) -> F {
    const A2: f32 = ALPHA_G * ALPHA_G;
    cos * 2.0 / (cos + (cos * cos * (1.0 - A2) + A2).sqrt())
}
