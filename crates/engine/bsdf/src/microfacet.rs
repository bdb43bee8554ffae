//! GGX microfacets: distribution, masking, and the sampling of visible normals.
//!
//! All directions are above the surface (z > 0). The caller mirrors directions below it first.

use crate::in_lanes::in_lanes;
use dunkelfeld_lanes::{Lanes, V3, cos_sin_of_turn};
use dunkelfeld_sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// The anisotropic GGX distribution with Smith masking (Trowbridge and Reitz 1975; Walter et al. 2007; Heitz 2014).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Ggx<F = f32> {
    alpha_x: F,
    alpha_y: F,
    inverse_x: F,
    inverse_y: F,
}

in_lanes!(Ggx => Ggx<F> { alpha_x, alpha_y, inverse_x, inverse_y });

impl Ggx {
    /// From the root-mean-square slopes along x and y. The minimum of a slope is `1e-4`: there f32 directions still
    /// resolve the lobe, and its peak is 3e7 / sr.
    #[inline]
    pub fn new(alpha_x: f32, alpha_y: f32) -> Self {
        // `max` also turns NaN into the bound.
        let (alpha_x, alpha_y) = (alpha_x.max(1e-4), alpha_y.max(1e-4));
        Self { alpha_x, alpha_y, inverse_x: 1.0 / alpha_x, inverse_y: 1.0 / alpha_y }
    }

    /// The random numbers that give a normal in [`Self::sample_visible`].
    #[inline]
    pub fn invert_visible(&self, wo: V3<f32>, m: V3<f32>) -> [f32; 2] {
        self.invert_cap(wo, 1.0, m)
    }

    /// The random numbers that give a normal in [`Self::sample_bounded`].
    #[inline]
    pub fn invert_bounded(&self, wo: V3<f32>, m: V3<f32>) -> [f32; 2] {
        self.invert_cap(wo, self.cap_bound(wo), m)
    }

    /// Density of [`Self::sample_bounded`] per solid angle of the normal [1/sr].
    #[inline]
    pub fn pdf_bounded(&self, wo: V3<f32>, m: V3<f32>) -> f32 {
        let in_cap = self.cap_point(wo, m).z >= -self.cap_bound(wo) * self.stretched(wo).z;
        if in_cap { 4.0 * wo.dot(m).max(0.0) * self.pdf_bounded_reflection(wo, m) } else { 0.0 }
    }

    /// The inverse of [`Self::sample_cap`].
    #[inline]
    fn invert_cap(&self, wo: V3<f32>, bound: f32, m: V3<f32>) -> [f32; 2] {
        let cap = self.cap_point(wo, m);
        let lower = bound * self.stretched(wo).z;
        [warp::azimuth(cap.into()), ((1.0 - cap.z) / (1.0 + lower)).clamp(0.0, 1.0)]
    }

    /// The point of the cap that gives a normal: `wo` mirrored at the normal, both stretched.
    #[inline]
    fn cap_point(&self, wo: V3<f32>, m: V3<f32>) -> V3<f32> {
        let h = V3::new(m.x * self.inverse_x, m.y * self.inverse_y, m.z).normalize();
        reflect(self.stretched(wo), h)
    }
}

impl<F: Lanes> Ggx<F> {
    /// The slopes along x and y.
    #[inline(always)]
    pub fn slopes(&self) -> [F; 2] {
        [self.alpha_x, self.alpha_y]
    }

    /// Density of microfacet normals per unit solid angle and unit of macroscopic area [1/sr].
    #[inline(always)]
    pub fn distribution(&self, m: V3<F>) -> F {
        let (x, y) = (m.x * self.inverse_x, m.y * self.inverse_y);
        let e = x * x + y * y + m.z * m.z;
        self.inverse_x * self.inverse_y * FRAC_1_PI / (e * e)
    }

    /// `sqrt((ax x)^2 + (ay y)^2 + z^2)`: the length of a direction in the space where the microsurface is a
    /// hemisphere.
    ///
    /// Smith's masking function is `g1 = 2 z / (z + stretch)`. The two are separate because `g1 / z` has no
    /// singularity.
    #[inline(always)]
    pub fn stretch(&self, w: V3<F>) -> F {
        let (x, y) = (self.alpha_x * w.x, self.alpha_y * w.y);
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// Smith's masking function: visible share of the microfacets that face `w` (z > 0).
    #[inline(always)]
    pub fn g1(&self, w: V3<F>) -> F {
        w.z * 2.0 / (w.z + self.stretch(w))
    }

    /// Samples a visible normal: density `g1(wo) max(0, wo.m) D(m) / wo.z`, by spherical caps (Dupuy and Benyoub 2023).
    #[inline(always)]
    pub fn sample_visible(&self, wo: V3<F>, u: [F; 2]) -> V3<F> {
        self.sample_cap(wo, wo.z.constant(1.0), u)
    }

    /// Density of [`Self::sample_visible`] per solid angle of the normal [1/sr].
    #[inline(always)]
    pub fn pdf_visible(&self, wo: V3<F>, m: V3<F>) -> F {
        self.pdf_visible_reflection(wo, m) * 4.0 * wo.dot(m).max(wo.z.constant(0.0))
    }

    /// Density per solid angle of the *reflected direction* for a normal of [`Self::sample_visible`] [1/sr]: `D g1(wo) / (4
    /// wo.z)`, without its singularity at grazing angles.
    #[inline(always)]
    pub fn pdf_visible_reflection(&self, wo: V3<F>, m: V3<F>) -> F {
        self.distribution(m) * self.visible_scale(wo)
    }

    /// Samples a visible normal for reflection. The cap is limited to normals that can reflect above the surface (Eto
    /// and Tokuyoshi 2023). A few reflections below the surface remain.
    #[inline(always)]
    pub fn sample_bounded(&self, wo: V3<F>, u: [F; 2]) -> V3<F> {
        self.sample_cap(wo, self.cap_bound(wo), u)
    }

    /// Density per solid angle of the *reflected direction* for a normal of [`Self::sample_bounded`] [1/sr].
    #[inline(always)]
    pub fn pdf_bounded_reflection(&self, wo: V3<F>, m: V3<F>) -> F {
        self.distribution(m) * self.bounded_scale(wo)
    }

    /// [`Self::pdf_visible_reflection`] over [`Self::distribution`].
    #[inline(always)]
    pub(crate) fn visible_scale(&self, wo: V3<F>) -> F {
        wo.z.constant(0.5) / (wo.z + self.stretch(wo))
    }

    /// [`Self::pdf_bounded_reflection`] over [`Self::distribution`].
    #[inline(always)]
    pub(crate) fn bounded_scale(&self, wo: V3<F>) -> F {
        wo.z.constant(0.5) / (self.cap_bound(wo) * wo.z + self.stretch(wo))
    }

    /// `k` of Eto and Tokuyoshi (2023, equation 5): the lower bound of the cap is `-k` times the stretched cosine.
    #[inline(always)]
    fn cap_bound(&self, wo: V3<F>) -> F {
        let a = self.alpha_x.min(self.alpha_y).min(wo.z.constant(1.0));
        let s = (wo.x * wo.x + wo.y * wo.y).sqrt() + 1.0;
        let (a2, s2) = (a * a, s * s);
        a2.one_minus() * s2 / (s2 + a2 * wo.z * wo.z)
    }

    /// A point of the spherical cap `z >= -bound * wo_z` of the stretched sphere, halfway to `wo`, unstretched.
    #[inline(always)]
    fn sample_cap(&self, wo: V3<F>, bound: F, [u0, u1]: [F; 2]) -> V3<F> {
        let w = self.stretched(wo);
        let (zero, lower) = (bound.constant(0.0), bound * w.z);
        let z = u1.one_minus() * (lower + 1.0) - lower;
        let sin = (z.one_minus() * (z + 1.0)).max(zero).sqrt();
        let (c, s) = cos_sin_of_turn(u0);
        // The cap extends below the horizon, but its sum with w does not.
        let h = V3::new(sin * c + w.x, sin * s + w.y, (z + w.z).max(zero));
        let up = V3::new(zero, zero, bound.constant(1.0));
        V3::new(h.x * self.alpha_x, h.y * self.alpha_y, h.z).normalize_or(up)
    }

    /// A direction in the space where the microsurface is a hemisphere, as a unit vector.
    #[inline(always)]
    fn stretched(&self, wo: V3<F>) -> V3<F> {
        V3::new(wo.x * self.alpha_x, wo.y * self.alpha_y, wo.z) * self.stretch(wo).recip()
    }
}

/// Mirrors `w` at a unit normal `m`.
#[inline(always)]
pub fn reflect<F: Lanes>(w: V3<F>, m: V3<F>) -> V3<F> {
    m * (w.dot(m) * 2.0) - w
}

/// `w`, mirrored at the surface in the lanes that are true.
#[inline(always)]
pub(crate) fn mirrored_if<F: Lanes>(mask: F::Mask, w: V3<F>) -> V3<F> {
    V3::new(w.x, w.y, dunkelfeld_lanes::Mask::select(mask, -w.z, w.z))
}
