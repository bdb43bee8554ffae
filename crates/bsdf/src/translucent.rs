//! A surface with diffuse transmission, like paper, leaves or milk glass (glTF KHR_materials_diffuse_transmission).

use crate::Principled;
use crate::bsdf_sample::{BsdfSample, Lobe};
use crate::dielectric::{finite_sample, mirrored_if};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// An opaque principled surface of which a share of the diffuse light leaves on the other side, after Lambert. The
/// layers above the diffuse lobe lie on both sides.
///
/// Both sides are equal: for directions below (z < 0) it is its own mirror image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Translucent {
    /// The reflection; its diffuse lobe is reduced by the transmitted share.
    surface: Principled,
    /// Albedo of the transmission.
    transmission: Rgb,
}

impl Translucent {
    /// Reduces the diffuse lobe of a surface by the share `share` in `[0, 1]`, and adds a transmission of albedo
    /// `transmission` (channels in `[0, 1]`). The albedo already contains share and colour.
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
            let up = mirrored_if(true, wi);
            (self.transmission * (self.surface.diffuse_below(wo, up) * up.0.z), passing * FRAC_1_PI * up.0.z)
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
            // The remainder of u_lobe chooses among the lobes of reflection.
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

    /// The probability of the transmission lobe, in proportion to the expected energy of both sides.
    #[inline]
    fn probability_to_pass(&self, up: LocalDir) -> f32 {
        let passed = self.transmission.luminance() * self.surface.diffuse_share(up);
        let reflected = self.surface.albedo(up).luminance();
        // The floor keeps the probability of reflection above zero where its estimate is black.
        if passed > 0.0 { passed / (passed + reflected.max(0.02)) } else { 0.0 }
    }
}
