//! The phase function of a scattering medium (Henyey and Greenstein 1941).

use dunkelfeld_geometry::{Frame, LocalDir, Vec3};
use dunkelfeld_sampling::warp::sin_cos_turn;
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
pub struct HenyeyGreenstein {
    g: f32,
}

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

    /// The phase function, which is its own density [1/sr]: `(1 - g^2) / (4 pi (1 + g^2 + 2 g wo.wi)^(3/2))`.
    ///
    /// With `v` the squared chord between `wi` and the direction of the peak, the bracket is `(1 - |g|)^2 + |g| v`: a sum
    /// without cancellation, however sharp the peak.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (g, near) = (self.g.abs(), 1.0 - self.g.abs());
        let s2 = near * near + g * (wi - self.peak(wo)).length_squared();
        0.25 * FRAC_1_PI * near * (1.0 + g) / (s2 * s2.sqrt())
    }

    /// Samples a direction with density [`Self::pdf`]; `u` in `[0, 1)`.
    ///
    /// The inverse of the distribution of the cosine, written for `1 - cos`, so that it has no singularity at `g = 0` and no
    /// cancellation at `|g| = 1`.
    #[inline]
    pub fn sample(&self, wo: Vec3, [u0, u1]: [f32; 2]) -> Vec3 {
        let (g, near) = (self.g.abs(), 1.0 - self.g.abs());
        let spread = near + 2.0 * g * u0;
        let s = near * (1.0 + g) / spread;
        // 1 - cos = (s^2 - (1 - g)^2) / 2g, where s - (1 - g) = 2g (1 - g)(1 - u) / spread.
        let versine = near * (1.0 - u0) * (s + near) / spread;
        let sin = (versine * (2.0 - versine)).max(0.0).sqrt();
        let (sin_phi, cos_phi) = sin_cos_turn(u1);
        let local = LocalDir::new(sin * cos_phi, sin * sin_phi, 1.0 - versine);
        Frame::from_normal(self.peak(wo)).to_world(local)
    }

    /// The uniform numbers that give a direction in [`Self::sample`].
    #[inline]
    pub fn invert(&self, wo: Vec3, wi: Vec3) -> [f32; 2] {
        let (g, near) = (self.g.abs(), 1.0 - self.g.abs());
        let peak = self.peak(wo);
        let versine = 0.5 * (wi - peak).length_squared();
        let s = (near * near + 2.0 * g * versine).sqrt();
        let u0 = near * (2.0 - versine) / (s * (1.0 + g + s));
        let local = Frame::from_normal(peak).to_local(wi).0;
        let turn = local.y.atan2(local.x) / std::f32::consts::TAU;
        [u0.clamp(0.0, 1.0), if turn < 0.0 { turn + 1.0 } else { turn }]
    }

    /// The direction of the peak.
    #[inline]
    fn peak(&self, wo: Vec3) -> Vec3 {
        if self.g < 0.0 { wo } else { -wo }
    }
}
