//! The boundary of a clear solid: smooth (two delta lobes) or rough (Walter, Marschner, Li and Torrance 2007).

use crate::bsdf_sample::{BsdfSamples, Lobe, View};
use crate::in_lanes::in_lanes;
use crate::microfacet::{Ggx, mirrored_if, reflect};
use crate::transmission::{eval_refraction, refract};
use crate::{compensation, fresnel};
use dunkelfeld_lanes::{Lanes, Mask, V3};
use dunkelfeld_radiometry::Rgb;

/// Relative indices within this distance of 1 are matched: light passes straight, at any roughness.
///
/// The neglected deflection is below a milliradian for facets tilted by less than 45 degrees, the neglected reflection
/// below 3e-7 at normal incidence. Nearer to 1 the half vector of a refraction would be rounding noise.
pub const MATCHED_INDEX: f32 = 1e-3;

/// The boundary between two dielectrics. Below the surface (z < 0) is the inside.
///
/// The transported quantity is radiance: a refraction scales it by `1 / eta^2`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Dielectric<F = f32> {
    eta: F,
    ggx: Ggx<F>,
    /// One if rough, zero if smooth.
    rough: F,
    reflection_tint: Rgb<F>,
    transmission_tint: Rgb<F>,
    /// One with [`crate::compensation`].
    compensated: F,
}

in_lanes!(Dielectric => Dielectric<F> { eta, ggx, rough, reflection_tint, transmission_tint, compensated });

impl Dielectric {
    /// A boundary with index of refraction `eta` inside over outside and GGX roughness `alpha` (0 is smooth).
    ///
    /// `eta` is clamped to `[1e-3, 1e3]`. A rough lobe has at least `alpha = 1e-4`. A boundary whose index is matched
    /// to within [`MATCHED_INDEX`] is treated as smooth. The tints multiply reflection and transmission; white is
    /// physical.
    #[inline]
    pub fn new(eta: f32, alpha: f32, reflection_tint: Rgb, transmission_tint: Rgb) -> Self {
        let eta = clamp_eta(eta);
        let rough = f32::from(u8::from(alpha > 0.0 && (eta - 1.0).abs() >= MATCHED_INDEX));
        Self { eta, ggx: Ggx::new(alpha, alpha), rough, reflection_tint, transmission_tint, compensated: 0.0 }
    }

    /// The same boundary with [`crate::compensation`].
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: 1.0, ..self }
    }

    /// A clear, smooth boundary.
    #[inline]
    pub fn smooth(eta: f32) -> Self {
        Self::new(eta, 0.0, Rgb::WHITE, Rgb::WHITE)
    }

    /// True if the boundary is smooth.
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.rough == 0.0
    }

    /// Index of refraction inside over outside.
    #[inline]
    pub fn eta(&self) -> f32 {
        self.eta
    }
}

impl<F: Lanes> Dielectric<F> {
    /// The boundary seen from `wo`.
    #[inline(always)]
    pub fn view(&self, wo: V3<F>) -> DielectricView<'_, F> {
        let (zero, one) = (wo.z.constant(0.0), wo.z.constant(1.0));
        let below = wo.z.lt(zero);
        let (up, eta) = (mirrored_if(below, wo), below.select(self.eta.recip(), self.eta));
        let rough = self.rough.is_positive();
        let is_compensated = rough & self.compensated.is_positive();
        let gain = if is_compensated.any() {
            compensation::scattered_once(is_compensated, &self.ggx, up, eta).recip()
        } else {
            one
        };
        DielectricView { surface: self, rough, below, up, eta, gain }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline(always)]
    pub fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        let eta = wo.z.lt(wo.z.constant(0.0)).select(self.eta.recip(), self.eta);
        let f = fresnel::dielectric(wo.z.abs(), eta).reflectance;
        self.transmission_tint.lerp(self.reflection_tint, f)
    }
}

/// A [`Dielectric`] seen from `wo`.
#[derive(Clone, Copy, Debug)]
pub struct DielectricView<'a, F: Lanes> {
    surface: &'a Dielectric<F>,
    rough: F::Mask,
    /// True for `wo` below the surface. Then all directions are mirrored to the other side.
    below: F::Mask,
    up: V3<F>,
    /// Index of refraction on the far side of `wo` over that on its side.
    eta: F,
    /// Factor of the compensation.
    gain: F,
}

impl<F: Lanes> DielectricView<'_, F> {
    /// [`View::eval_pdf`] for a mirrored direction.
    #[inline(always)]
    fn eval_up(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let (s, up) = (self.surface, self.up);
        let zero = wi.z.constant(0.0);
        let (mut value, mut pdf) = (Rgb::splat(zero), zero);
        let facing = self.rough & up.z.is_positive();
        let reflected = facing & wi.z.is_positive();
        if reflected.any() {
            let (m, is_some) = (up + wi).try_normalize();
            let f = fresnel::dielectric(up.dot(m), self.eta).reflectance;
            pdf = (f * s.ggx.pdf_visible_reflection(up, m)).only(reflected & is_some);
            value = s.reflection_tint * (pdf * s.ggx.g1(wi) * self.gain).only(reflected & is_some);
        }
        let refracted = facing & wi.z.lt(zero);
        if refracted.any() {
            let r = eval_refraction(&s.ggx, up, wi, self.eta);
            let refracted = refracted & r.is_possible;
            value += s.transmission_tint * (r.value * self.gain).only(refracted);
            pdf += (r.fresnel.one_minus() * r.density).only(refracted);
        }
        (value, pdf)
    }
}

impl<F: Lanes> View<F> for DielectricView<'_, F> {
    #[inline(always)]
    fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        self.surface.albedo(wo)
    }

    #[inline(always)]
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F) {
        self.eval_up(mirrored_if(self.below, wi))
    }

    #[inline(always)]
    fn sample(&self, u_lobe: F, u: [F; 2]) -> BsdfSamples<F> {
        let Self { surface: s, rough, below, up, eta, .. } = *self;
        let (token, zero, one) = (eta.token(), eta.constant(0.0), eta.constant(1.0));
        let mut m = V3::new(zero, zero, one);
        if rough.any() {
            m = V3::select(rough, s.ggx.sample_visible(up, u), m);
        }
        let f = fresnel::dielectric(up.dot(m), eta);
        let reflected = u_lobe.lt(f.reflectance);
        let inv = reflected.select(one, eta.recip());
        // The delta lobes.
        let mut wi = V3::new(-inv * up.x, -inv * up.y, reflected.select(up.z, -f.cos_t));
        let mut weight = Rgb::select(reflected, s.reflection_tint, s.transmission_tint * (inv * inv));
        let mut pdf = reflected.select(f.reflectance, f.reflectance.one_minus());
        if rough.any() {
            wi = V3::select(rough, V3::select(reflected, reflect(up, m), refract(up, m, eta, f.cos_t)), wi);
            let (value, density) = self.eval_up(wi);
            // A facet may reflect or refract to the wrong side.
            let density = density.only(wi.z.is_positive() & reflected | wi.z.lt(zero) & !reflected);
            weight = Rgb::select(rough, value / density, weight);
            pdf = rough.select(density, pdf);
        }
        let side = reflected.select(Lobe::REFLECTION.in_lanes(token), Lobe::TRANSMISSION.in_lanes(token));
        let kind = rough.select(Lobe::GLOSSY.in_lanes(token), Lobe::DELTA.in_lanes(token));
        let lobe = F::from_bits(side.to_bits() | kind.to_bits());
        BsdfSamples::new(mirrored_if(below, wi), weight, pdf.only(up.z.is_positive()), lobe, reflected.select(one, eta))
    }
}

/// A relative index of refraction in a valid range: within `[1e-3, 1e3]`, 1 if it is NaN.
#[inline]
pub(crate) fn clamp_eta(eta: f32) -> f32 {
    if eta.is_nan() { 1.0 } else { eta.clamp(1e-3, 1e3) }
}
