//! GGX microfacets: distribution, masking, and the sampling of visible normals.
//!
//! All directions are above the surface (z > 0). The caller mirrors directions below it first.

use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_sampling::warp::{self, sin_cos_turn};
use std::f32::consts::FRAC_1_PI;

/// The anisotropic GGX distribution with Smith masking (Trowbridge and Reitz 1975; Walter et al. 2007; Heitz 2014).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Ggx {
    alpha_x: f32,
    alpha_y: f32,
    inverse_x: f32,
    inverse_y: f32,
}

impl Ggx {
    /// From the root-mean-square slopes along x and y. The minimum of a slope is `1e-4`: there f32 directions still
    /// resolve the lobe, and its peak is 3e7 / sr.
    #[inline]
    pub fn new(alpha_x: f32, alpha_y: f32) -> Self {
        // `max` also turns NaN into the bound.
        let (alpha_x, alpha_y) = (alpha_x.max(1e-4), alpha_y.max(1e-4));
        Self { alpha_x, alpha_y, inverse_x: 1.0 / alpha_x, inverse_y: 1.0 / alpha_y }
    }

    /// The slopes along x and y.
    #[inline]
    pub fn slopes(&self) -> [f32; 2] {
        [self.alpha_x, self.alpha_y]
    }

    /// Density of microfacet normals per unit solid angle and unit of macroscopic area [1/sr].
    #[inline]
    pub fn distribution(&self, m: Vec3) -> f32 {
        let (x, y) = (m.x * self.inverse_x, m.y * self.inverse_y);
        let e = x * x + y * y + m.z * m.z;
        FRAC_1_PI * self.inverse_x * self.inverse_y / (e * e)
    }

    /// `sqrt((ax x)^2 + (ay y)^2 + z^2)`: the length of a direction in the space where the microsurface is a
    /// hemisphere.
    ///
    /// Smith's masking function is `g1 = 2 z / (z + stretch)`. The two are separate because `g1 / z` has no
    /// singularity.
    #[inline]
    pub fn stretch(&self, w: LocalDir) -> f32 {
        let (x, y) = (self.alpha_x * w.0.x, self.alpha_y * w.0.y);
        (x * x + y * y + w.0.z * w.0.z).sqrt()
    }

    /// Smith's masking function: visible share of the microfacets that face `w` (z > 0).
    #[inline]
    pub fn g1(&self, w: LocalDir) -> f32 {
        2.0 * w.0.z / (w.0.z + self.stretch(w))
    }

    /// Samples a visible normal: density `g1(wo) max(0, wo.m) D(m) / wo.z`, by spherical caps (Dupuy and Benyoub 2023).
    #[inline]
    pub fn sample_visible(&self, wo: LocalDir, u: [f32; 2]) -> Vec3 {
        self.sample_cap(wo, 1.0, u)
    }

    /// Density of [`Self::sample_visible`] per solid angle of the normal [1/sr].
    #[inline]
    pub fn pdf_visible(&self, wo: LocalDir, m: Vec3) -> f32 {
        2.0 * self.distribution(m) * wo.0.dot(m).max(0.0) / (wo.0.z + self.stretch(wo))
    }

    /// The random numbers that give a normal in [`Self::sample_visible`].
    #[inline]
    pub fn invert_visible(&self, wo: LocalDir, m: Vec3) -> [f32; 2] {
        self.invert_cap(wo, 1.0, m)
    }

    /// Samples a visible normal for reflection. The cap is limited to normals that can reflect above the surface (Eto
    /// and Tokuyoshi 2023). A few reflections below the surface remain.
    #[inline(always)]
    pub fn sample_bounded(&self, wo: LocalDir, u: [f32; 2]) -> Vec3 {
        self.sample_cap(wo, self.cap_bound(wo), u)
    }

    /// Density per solid angle of the *reflected direction* for a normal of [`Self::sample_bounded`] [1/sr].
    #[inline]
    pub fn pdf_bounded_reflection(&self, wo: LocalDir, m: Vec3) -> f32 {
        self.distribution(m) / (2.0 * (self.cap_bound(wo) * wo.0.z + self.stretch(wo)))
    }

    /// Density of [`Self::sample_bounded`] per solid angle of the normal [1/sr].
    #[inline]
    pub fn pdf_bounded(&self, wo: LocalDir, m: Vec3) -> f32 {
        let in_cap = self.cap_point(wo, m).z >= -self.cap_bound(wo) * self.stretched(wo).z;
        if in_cap { 4.0 * wo.0.dot(m).max(0.0) * self.pdf_bounded_reflection(wo, m) } else { 0.0 }
    }

    /// The random numbers that give a normal in [`Self::sample_bounded`].
    #[inline]
    pub fn invert_bounded(&self, wo: LocalDir, m: Vec3) -> [f32; 2] {
        self.invert_cap(wo, self.cap_bound(wo), m)
    }

    /// `k` of Eto and Tokuyoshi (2023, equation 5): the lower bound of the cap is `-k` times the stretched cosine.
    #[inline]
    pub(crate) fn cap_bound(&self, wo: LocalDir) -> f32 {
        let a = self.alpha_x.min(self.alpha_y).min(1.0);
        let s = 1.0 + wo.sin2_theta().sqrt();
        let (a2, s2) = (a * a, s * s);
        (1.0 - a2) * s2 / (s2 + a2 * wo.0.z * wo.0.z)
    }

    /// A point of the spherical cap `z >= -bound * wo_z` of the stretched sphere, halfway to `wo`, unstretched.
    #[inline]
    fn sample_cap(&self, wo: LocalDir, bound: f32, [u0, u1]: [f32; 2]) -> Vec3 {
        let w = self.stretched(wo);
        let lower = bound * w.z;
        let z = (1.0 - u1) * (1.0 + lower) - lower;
        let sin = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
        let (s, c) = sin_cos_turn(u0);
        // The cap extends below the horizon, but its sum with w does not.
        let h = Vec3::new(sin * c + w.x, sin * s + w.y, (z + w.z).max(0.0));
        Vec3::new(h.x * self.alpha_x, h.y * self.alpha_y, h.z).try_normalize().unwrap_or(Vec3::Z)
    }

    /// The inverse of [`Self::sample_cap`].
    #[inline]
    fn invert_cap(&self, wo: LocalDir, bound: f32, m: Vec3) -> [f32; 2] {
        let cap = self.cap_point(wo, m);
        let lower = bound * self.stretched(wo).z;
        [warp::azimuth(cap), ((1.0 - cap.z) / (1.0 + lower)).clamp(0.0, 1.0)]
    }

    /// The point of the cap that gives a normal: `wo` mirrored at the normal, both stretched.
    #[inline]
    fn cap_point(&self, wo: LocalDir, m: Vec3) -> Vec3 {
        let w = self.stretched(wo);
        let h = Vec3::new(m.x * self.inverse_x, m.y * self.inverse_y, m.z).normalize();
        h * (2.0 * w.dot(h)) - w
    }

    /// A direction in the space where the microsurface is a hemisphere, as a unit vector.
    #[inline]
    fn stretched(&self, wo: LocalDir) -> Vec3 {
        Vec3::new(wo.0.x * self.alpha_x, wo.0.y * self.alpha_y, wo.0.z) / self.stretch(wo)
    }
}

/// Mirrors `w` at a unit normal `m`.
#[inline]
pub fn reflect(w: LocalDir, m: Vec3) -> LocalDir {
    LocalDir(m * (2.0 * w.0.dot(m)) - w.0)
}
