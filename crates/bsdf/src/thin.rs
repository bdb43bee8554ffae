//! A thin-walled sheet: a pane of glass or film whose two faces are treated as one surface.

use crate::bsdf_sample::{BsdfSample, Lobe};
use crate::compensation;
use crate::dielectric::{clamp_eta, delta, finite_sample, from_above, mirrored_if};
use crate::fresnel;
use crate::microfacet::{Ggx, reflect};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_radiometry::Rgb;

/// A clear sheet too thin to displace a ray. Light is reflected or passes straight. Both sides are equal.
///
/// The sum of all internal reflections of a sheet whose faces reflect `R` is `R' = R + (1-R)^2 R / (1-R^2) = 2R /
/// (1+R)` (Stokes 1862). A rough sheet spreads both parts by the same GGX lobe. Its transmission is the mirror image of
/// its reflection, the common model for thin walls (Pharr, Jakob and Humphreys 2023, section 9.5).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ThinSheet {
    eta: f32,
    rough: Option<Ggx>,
    reflection_tint: Rgb,
    transmission_tint: Rgb,
    compensated: bool,
}

impl ThinSheet {
    /// A sheet of index of refraction `eta` relative to its surroundings (clamped to `[1e-3, 1e3]`) and GGX roughness
    /// `alpha` (0 is smooth; a rough lobe has at least 1e-4). The tints multiply reflection and transmission.
    #[inline]
    pub fn new(eta: f32, alpha: f32, reflection_tint: Rgb, transmission_tint: Rgb) -> Self {
        let rough = (alpha > 0.0).then(|| Ggx::new(alpha, alpha));
        Self { eta: clamp_eta(eta), rough, reflection_tint, transmission_tint, compensated: false }
    }

    /// The same sheet with [`crate::compensation`]. Reflection and transmission are one lobe and its mirror image, so
    /// together they lose as much energy as a mirror.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: true, ..self }
    }

    /// True if the sheet is smooth.
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.rough.is_none()
    }

    /// Reflectance at an angle of cosine `cos`, all internal reflections included.
    #[inline]
    pub fn reflectance(&self, cos: f32) -> f32 {
        let r = fresnel::dielectric(cos, self.eta).reflectance;
        2.0 * r / (1.0 + r)
    }

    /// See [`crate::Bsdf::eval_pdf`].
    #[inline]
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        let none = (Rgb::BLACK, 0.0);
        let Some(ggx) = self.rough else { return none };
        if wo.0.z == 0.0 || wi.0.z == 0.0 {
            return none;
        }
        let (_, wo, wi) = from_above(self.eta, wo, wi);
        let reflected = wi.0.z > 0.0;
        let wi = mirrored_if(!reflected, wi);
        let Some(m) = (wo.0 + wi.0).try_normalize() else { return none };
        let r = self.reflectance(wo.0.dot(m));
        let (share, tint) = if reflected { (r, self.reflection_tint) } else { (1.0 - r, self.transmission_tint) };
        let pdf = share * ggx.pdf_bounded_reflection(wo, m);
        let value = share * ggx.distribution(m) * ggx.g1(wi) / (2.0 * (wo.0.z + ggx.stretch(wo)));
        let gain = if self.compensated { 1.0 / compensation::reflected_once(&ggx, wo) } else { 1.0 };
        (tint * (value * gain), pdf)
    }

    /// See [`crate::Bsdf::sample`].
    #[inline]
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if wo.0.z == 0.0 {
            return None;
        }
        let (_, up, _) = from_above(self.eta, wo, wo);
        let m = self.rough.map_or(Vec3::Z, |ggx| ggx.sample_bounded(up, u));
        let r = self.reflectance(up.0.dot(m));
        let reflected = u_lobe < r;
        let side = if reflected { Lobe::REFLECTION } else { Lobe::TRANSMISSION };
        match self.rough {
            None if reflected => delta(LocalDir::new(-wo.0.x, -wo.0.y, wo.0.z), self.reflection_tint, r, side, 1.0),
            None => delta(-wo, self.transmission_tint, 1.0 - r, side, 1.0),
            Some(_) => {
                let wi = reflect(up, m);
                if wi.0.z <= 0.0 {
                    return None;
                }
                let wi = mirrored_if((wo.0.z < 0.0) == reflected, wi);
                let (value, pdf) = self.eval_pdf(wo, wi);
                finite_sample(wi, value, pdf, Lobe::GLOSSY | side, 1.0)
            }
        }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline]
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        self.transmission_tint.lerp(self.reflection_tint, self.reflectance(wo.abs_cos_theta()))
    }
}
