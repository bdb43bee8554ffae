//! The phase function of a scattering medium (Henyey and Greenstein 1941).

use crate::bsdf_sample::{BsdfSamples, Lobe, View};
use crate::in_lanes::in_lanes;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Frame, Lanes, V3, cos_sin_of_turn};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp::azimuth;
use std::f32::consts::FRAC_1_PI;

/// The largest `|g|`. There f32 directions still resolve the peak, which is 1.6e7 / sr, similar to the sharpest GGX
/// lobe.
const MAX_ANISOTROPY: f32 = 1.0 - 1e-4;

/// The phase function of a medium, by the mean cosine `g` of the deflection: above 0 mostly forward, below 0 mostly
/// backward, 0 equally in all directions.
///
/// Directions point away from the place of scattering, as at surfaces: light without deflection has `wi = -wo`. The
/// value of the phase function is its density, so a sample has weight one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct HenyeyGreenstein<F = f32> {
    g: F,
}

in_lanes!(HenyeyGreenstein => HenyeyGreenstein<F> { g });

impl HenyeyGreenstein {
    /// A phase function of mean cosine `g` in (-1, 1); it is clamped to 1e-4 within the ends, and NaN is 0.
    #[inline]
    pub fn new(g: f32) -> Self {
        Self { g: if g.is_nan() { 0.0 } else { g.clamp(-MAX_ANISOTROPY, MAX_ANISOTROPY) } }
    }

    /// The mean cosine.
    #[inline]
    pub fn mean_cosine(&self) -> f32 {
        self.g
    }

    /// The phase function, which is its own density [1/sr].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.view(wo.into()).eval_pdf(wi.into()).1
    }

    /// Samples a direction with density [`Self::pdf`]; `u` in `[0, 1)`.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        self.view(wo.into()).direction(u).into()
    }

    /// The uniform numbers that give a direction in [`Self::sample`].
    #[inline]
    pub fn invert(&self, wo: Vec3, wi: Vec3) -> [f32; 2] {
        let PhaseView { g, near, peak } = self.view(wo.into());
        let versine = 0.5 * (V3::from(wi) - peak).length_squared();
        let s = (near * near + 2.0 * g * versine).sqrt();
        let u0 = near * (2.0 - versine) / (s * (1.0 + g + s));
        [u0.clamp(0.0, 1.0), azimuth(Frame::from_normal(peak).to_local(wi.into()).into())]
    }
}

impl<F: Lanes> HenyeyGreenstein<F> {
    /// The phase function for light that leaves toward `wo`.
    #[inline(always)]
    pub fn view(&self, wo: V3<F>) -> PhaseView<F> {
        let (g, is_backward) = (self.g.abs(), self.g.lt(self.g.constant(0.0)));
        PhaseView { g, near: g.one_minus(), peak: V3::select(is_backward, wo, -wo) }
    }
}

/// [`HenyeyGreenstein`] seen from `wo`, in world space.
#[derive(Clone, Copy, Debug)]
pub struct PhaseView<F> {
    /// `|g|` and `1 - |g|`.
    g: F,
    near: F,
    /// The direction of the peak.
    peak: V3<F>,
}

impl<F: Lanes> PhaseView<F> {
    /// A direction: the inverse of the distribution of the cosine, written for `1 - cos`, so that it has no singularity at
    /// `g = 0` and no cancellation at `|g| = 1`.
    #[inline(always)]
    fn direction(&self, [u0, u1]: [F; 2]) -> V3<F> {
        let Self { g, near, peak } = *self;
        let spread = near + g * 2.0 * u0;
        let s = near * (g + 1.0) / spread;
        // 1 - cos = (s^2 - (1 - g)^2) / 2g, where s - (1 - g) = 2g (1 - g)(1 - u) / spread.
        let versine = near * u0.one_minus() * (s + near) / spread;
        let sin = (versine * (versine.constant(2.0) - versine)).max(g.constant(0.0)).sqrt();
        let (cos_phi, sin_phi) = cos_sin_of_turn(u1);
        Frame::from_normal(peak).to_world(V3::new(sin * cos_phi, sin * sin_phi, versine.one_minus()))
    }
}

impl<F: Lanes> View<F> for PhaseView<F> {
    /// White: the phase function absorbs nothing.
    #[inline(always)]
    fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        Rgb::splat(wo.z.constant(1.0))
    }

    /// The phase function, twice: `(1 - g^2) / (4 pi (1 + g^2 + 2 g wo.wi)^(3/2))`.
    ///
    /// With `v` the squared chord between `wi` and the direction of the peak, the bracket is `(1 - |g|)^2 + |g| v`: a sum
    /// without cancellation, however sharp the peak.
    #[inline(always)]
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let Self { g, near, peak } = *self;
        let s2 = near * near + g * (wi - peak).length_squared();
        let pdf = near * (0.25 * FRAC_1_PI) * (g + 1.0) / (s2 * s2.sqrt());
        (Rgb::splat(pdf), pdf)
    }

    #[inline(always)]
    fn sample(&self, _: F, u: [F; 2]) -> BsdfSamples<F> {
        let (wi, one) = (self.direction(u), self.g.constant(1.0));
        let pdf = self.eval_pdf(wi).1;
        BsdfSamples::new(wi, Rgb::splat(one), pdf, Lobe::default().in_lanes(one.token()), one)
    }
}
