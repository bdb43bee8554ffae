//! A surface with diffuse transmission, like paper, leaves or milk glass (glTF KHR_materials_diffuse_transmission).

use crate::bsdf_sample::{BsdfSamples, Lobe, View};
use crate::in_lanes::in_lanes;
use crate::layers::{Curves, DIFFUSE, Shares};
use crate::microfacet::mirrored_if;
use crate::principled::{Drawn, Principled, PrincipledView, in_unit};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp::lanes::sample_cosine_hemisphere;
use std::f32::consts::FRAC_1_PI;

/// An opaque principled surface of which a share of the diffuse light leaves on the other side, after Lambert. The
/// layers above the diffuse lobe lie on both sides.
///
/// Both sides are equal: for directions below (z < 0) it is its own mirror image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Translucent<F = f32, C = Shares> {
    /// The reflection; its diffuse lobe is reduced by the transmitted share.
    surface: Principled<F, C>,
    /// Albedo of the transmission.
    transmission: Rgb<F>,
}

in_lanes!(Translucent => Translucent<F, [&'a Shares; MAX_WIDTH]> { surface, transmission });

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
}

impl<F: Lanes, C: Curves> Translucent<F, C> {
    /// The surface seen from `wo`.
    #[inline(always)]
    pub fn view(&self, wo: V3<F>) -> TranslucentView<'_, F, C> {
        let below = wo.z.lt(wo.z.constant(0.0));
        let up = mirrored_if(below, wo);
        let surface = self.surface.view::<true>(up);
        let share = self.surface.shares.at(DIFFUSE, up.z);
        // The probability of the transmission lobe, in proportion to the expected energy of both sides. The floor keeps the
        // probability of reflection above zero where its estimate is black.
        let passed = self.transmission.luminance() * share;
        let reflected = self.surface.albedo(up).luminance();
        let passing = (passed / (passed + reflected.max(wo.z.constant(0.02)))).only(passed.is_positive());
        let transmission = self.transmission * (self.surface.lambert * share);
        TranslucentView { surface, shares: &self.surface.shares, transmission, below, up, passing }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline(always)]
    pub fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        in_unit(self.surface.albedo(wo) + self.transmission)
    }
}

/// A [`Translucent`] surface seen from `wo`.
#[derive(Clone, Copy, Debug)]
pub struct TranslucentView<'a, F: Lanes, C> {
    surface: PrincipledView<'a, F, C, true>,
    shares: &'a C,
    /// The transmitted radiance per irradiance [1/sr], without the share of the light of `wi` that enters.
    transmission: Rgb<F>,
    /// True for `wo` below the surface. Then all directions are mirrored to the other side.
    below: F::Mask,
    up: V3<F>,
    /// Probability of the transmission lobe.
    passing: F,
}

impl<F: Lanes, C: Curves> TranslucentView<'_, F, C> {
    /// [`View::eval_pdf`] for a mirrored direction.
    #[inline(always)]
    fn eval_up(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let (mut value, mut pdf) = self.surface.eval_up(wi);
        pdf *= self.passing.one_minus();
        let through = self.up.z.is_positive() & wi.z.lt(wi.z.constant(0.0));
        if through.any() {
            let cos = -wi.z;
            let passed = self.transmission * (self.shares.at(DIFFUSE, cos) * cos);
            value = Rgb::select(through, passed, value);
            pdf = through.select(self.passing * FRAC_1_PI * cos, pdf);
        }
        (value, pdf)
    }
}

impl<F: Lanes, C: Curves> View<F> for TranslucentView<'_, F, C> {
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
        let passes = u_lobe.lt(self.passing);
        // The remainder of u_lobe chooses among the lobes of reflection.
        let rest = ((u_lobe - self.passing) / self.passing.one_minus()).clamp(0.0, 1.0 - f32::EPSILON / 2.0);
        let Drawn { mut wi, is_valid, mut lobe, .. } = self.surface.draw(rest, u);
        if passes.any() {
            wi = V3::select(passes, mirrored_if(passes, sample_cosine_hemisphere(u)), wi);
            lobe = passes.select((Lobe::DIFFUSE | Lobe::TRANSMISSION).in_lanes(rest.token()), lobe);
        }
        let (value, pdf) = self.eval_up(wi);
        let pdf = pdf.only(is_valid | passes);
        BsdfSamples::new(mirrored_if(self.below, wi), value / pdf, pdf, lobe, rest.constant(1.0))
    }
}
