//! A surface that passes light on diffusely, like paper, leaves or milk glass (glTF KHR_materials_diffuse_transmission).

use crate::Principled;
use crate::bsdf::{BsdfSample, Lobe};
use crate::dielectric::{finite_sample, mirrored_if};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// An opaque principled surface of which a share of the diffuse light comes out on the other side, after Lambert.
///
/// Both sides are alike: seen from below (z < 0) it is its own mirror image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Translucent {
    /// What is reflected; its diffuse lobe is that share smaller.
    surface: Principled,
    /// Albedo of what is passed on.
    transmission: Rgb,
}

impl Translucent {
    /// Takes the share `share` in `[0, 1]` off the diffuse lobe of a surface and lets light of albedo `transmission` (channels
    /// in `[0, 1]`) through instead. The albedo is the whole of what passes: share and colour multiplied out.
    #[inline]
    pub fn new(surface: Principled, share: f32, transmission: Rgb) -> Self {
        let kept = if share > 0.0 { 1.0 - share.min(1.0) } else { 1.0 };
        let in_range = |c: f32| if c > 0.0 { c.min(1.0) } else { 0.0 };
        Self { surface: surface.with_less_diffuse(kept), transmission: transmission.map(in_range) }
    }

    /// The same surface with [`crate::compensation`] of its specular lobe.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { surface: self.surface.with_energy_compensation(), ..self }
    }

    /// See [`crate::Bsdf::eval_pdf`].
    #[inline]
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        if wo.0.z == 0.0 || wi.0.z == 0.0 {
            return (Rgb::BLACK, 0.0);
        }
        let below = wo.0.z < 0.0;
        let (wo, wi) = (mirrored_if(below, wo), mirrored_if(below, wi));
        let passing = self.probability_to_pass(wo);
        if wi.0.z > 0.0 {
            let (value, pdf) = self.surface.eval_pdf(wo, wi);
            (value, (1.0 - passing) * pdf)
        } else {
            let lambert = FRAC_1_PI * wi.abs_cos_theta();
            (self.transmission * lambert, passing * lambert)
        }
    }

    /// See [`crate::Bsdf::sample`].
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if wo.0.z == 0.0 {
            return None;
        }
        let below = wo.0.z < 0.0;
        let up = mirrored_if(below, wo);
        let passing = self.probability_to_pass(up);
        let (wi, lobe) = if u_lobe < passing {
            let w = warp::sample_cosine_hemisphere(u);
            (LocalDir::new(w.x, w.y, -w.z), Lobe::DIFFUSE | Lobe::TRANSMISSION)
        } else {
            // What is left of u_lobe chooses among the lobes of reflection.
            let rest = ((u_lobe - passing) / (1.0 - passing)).clamp(0.0, 1.0 - f32::EPSILON / 2.0);
            let sample = self.surface.sample(up, rest, u)?;
            (sample.wi, sample.lobe)
        };
        let wi = mirrored_if(below, wi);
        let (value, pdf) = self.eval_pdf(wo, wi);
        finite_sample(wi, value, pdf, lobe, 1.0)
    }

    /// See [`crate::Bsdf::albedo`].
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        let up = mirrored_if(wo.0.z < 0.0, wo);
        (self.surface.albedo(up) + self.transmission).map(|c| c.clamp(0.0, 1.0))
    }

    /// The probability of the transmission lobe, after the light that both sides are expected to carry.
    #[inline]
    fn probability_to_pass(&self, up: LocalDir) -> f32 {
        let (passed, reflected) = (self.transmission.luminance(), self.surface.albedo(up).luminance());
        // The floor keeps reflection alive where the estimate of it is black.
        if passed > 0.0 { passed / (passed + reflected.max(0.02)) } else { 0.0 }
    }
}
