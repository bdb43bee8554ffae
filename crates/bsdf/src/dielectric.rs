//! The boundary of a clear solid: smooth (two delta lobes) or rough (Walter, Marschner, Li and Torrance 2007).

use crate::bsdf_sample::{BsdfSample, Lobe};
use crate::compensation;
use crate::fresnel;
use crate::microfacet::{Ggx, reflect};
use crate::transmission::{eval_refraction, refract};
use dunkelfeld_geometry::LocalDir;
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
pub struct Dielectric {
    eta: f32,
    rough: Option<Ggx>,
    reflection_tint: Rgb,
    transmission_tint: Rgb,
    compensated: bool,
}

impl Dielectric {
    /// A boundary with index of refraction `eta` inside over outside and GGX roughness `alpha` (0 is smooth).
    ///
    /// `eta` is clamped to `[1e-3, 1e3]`. A rough lobe has at least `alpha = 1e-4`. A boundary whose index is matched
    /// to within [`MATCHED_INDEX`] is treated as smooth. The tints multiply reflection and transmission; white is
    /// physical.
    #[inline]
    pub fn new(eta: f32, alpha: f32, reflection_tint: Rgb, transmission_tint: Rgb) -> Self {
        let eta = clamp_eta(eta);
        let rough = (alpha > 0.0 && (eta - 1.0).abs() >= MATCHED_INDEX).then(|| Ggx::new(alpha, alpha));
        Self { eta, rough, reflection_tint, transmission_tint, compensated: false }
    }

    /// The same boundary with [`crate::compensation`].
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: true, ..self }
    }

    /// A clear, smooth boundary.
    #[inline]
    pub fn smooth(eta: f32) -> Self {
        Self::new(eta, 0.0, Rgb::WHITE, Rgb::WHITE)
    }

    /// True if the boundary is smooth.
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.rough.is_none()
    }

    /// Index of refraction inside over outside.
    #[inline]
    pub fn eta(&self) -> f32 {
        self.eta
    }

    /// See [`crate::Bsdf::eval_pdf`].
    #[inline]
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        let none = (Rgb::BLACK, 0.0);
        let Some(ggx) = self.rough else { return none };
        if wo.0.z == 0.0 || wi.0.z == 0.0 {
            return none;
        }
        let (eta, wo, wi) = from_above(self.eta, wo, wi);
        let gain = if self.compensated { 1.0 / compensation::scattered_once(&ggx, wo, eta) } else { 1.0 };
        if wi.0.z > 0.0 {
            let Some(m) = (wo.0 + wi.0).try_normalize() else { return none };
            let f = fresnel::dielectric(wo.0.dot(m), eta).reflectance;
            let pdf = f * ggx.distribution(m) / (2.0 * (wo.0.z + ggx.stretch(wo)));
            (self.reflection_tint * (pdf * ggx.g1(wi) * gain), pdf)
        } else {
            let Some(r) = eval_refraction(&ggx, wo, wi, eta) else { return none };
            (self.transmission_tint * (r.value * gain), (1.0 - r.fresnel) * r.density)
        }
    }

    /// See [`crate::Bsdf::sample`].
    #[inline]
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if wo.0.z == 0.0 {
            return None;
        }
        let (eta, up, _) = from_above(self.eta, wo, wo);
        let below = wo.0.z < 0.0;
        match self.rough {
            None => {
                let f = fresnel::dielectric(up.0.z, eta);
                if u_lobe < f.reflectance {
                    let wi = LocalDir::new(-wo.0.x, -wo.0.y, wo.0.z);
                    delta(wi, self.reflection_tint, f.reflectance, Lobe::REFLECTION, 1.0)
                } else {
                    let inv = 1.0 / eta;
                    let wi = LocalDir::new(-inv * up.0.x, -inv * up.0.y, -f.cos_t);
                    let weight = self.transmission_tint * (inv * inv);
                    delta(mirrored_if(below, wi), weight, 1.0 - f.reflectance, Lobe::TRANSMISSION, eta)
                }
            }
            Some(ggx) => {
                let m = ggx.sample_visible(up, u);
                let f = fresnel::dielectric(up.0.dot(m), eta);
                let (wi, lobe, eta) = if u_lobe < f.reflectance {
                    (reflect(up, m), Lobe::REFLECTION, 1.0)
                } else {
                    (refract(up, m, eta, f.cos_t), Lobe::TRANSMISSION, eta)
                };
                if (wi.0.z > 0.0) != (lobe == Lobe::REFLECTION) {
                    return None;
                }
                let wi = mirrored_if(below, wi);
                let (value, pdf) = self.eval_pdf(wo, wi);
                finite_sample(wi, value, pdf, Lobe::GLOSSY | lobe, eta)
            }
        }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline]
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        let (eta, up, _) = from_above(self.eta, wo, wo);
        let f = fresnel::dielectric(up.0.z, eta).reflectance;
        self.transmission_tint.lerp(self.reflection_tint, f)
    }
}

/// A relative index of refraction in a valid range: within `[1e-3, 1e3]`, 1 if it is NaN.
#[inline]
pub(crate) fn clamp_eta(eta: f32) -> f32 {
    if eta.is_nan() { 1.0 } else { eta.clamp(1e-3, 1e3) }
}

/// Mirrors directions with `wo` below the surface (`wo.z < 0`) to above: index of refraction, `wo`, `wi`.
#[inline]
pub(crate) fn from_above(eta: f32, wo: LocalDir, wi: LocalDir) -> (f32, LocalDir, LocalDir) {
    if wo.0.z < 0.0 { (1.0 / eta, mirrored_if(true, wo), mirrored_if(true, wi)) } else { (eta, wo, wi) }
}

/// `w`, mirrored at the surface if the condition is true.
#[inline]
pub(crate) fn mirrored_if(condition: bool, w: LocalDir) -> LocalDir {
    if condition { LocalDir::new(w.0.x, w.0.y, -w.0.z) } else { w }
}

/// A sample of a delta lobe; `None` if its weight is zero.
#[inline]
pub(crate) fn delta(wi: LocalDir, weight: Rgb, probability: f32, side: Lobe, eta: f32) -> Option<BsdfSample> {
    (probability > 0.0 && weight.is_finite() && !weight.is_black() && wi.0.z != 0.0).then_some(BsdfSample {
        wi,
        weight,
        pdf: probability,
        lobe: Lobe::DELTA | side,
        eta,
    })
}

/// A sample of a lobe with a density; `None` if its weight is zero or its density underflowed.
#[inline]
pub(crate) fn finite_sample(wi: LocalDir, value: Rgb, pdf: f32, lobe: Lobe, eta: f32) -> Option<BsdfSample> {
    let weight = value / pdf;
    (pdf > 0.0 && weight.is_finite() && !weight.is_black()).then_some(BsdfSample { wi, weight, pdf, lobe, eta })
}
