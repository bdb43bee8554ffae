//! A thin-walled sheet: a pane of glass or film whose two faces are treated as one surface.

use crate::bsdf_sample::{BsdfSamples, Lobe, View};
use crate::dielectric::clamp_eta;
use crate::in_lanes::in_lanes;
use crate::microfacet::{Ggx, mirrored_if, reflect};
use crate::{compensation, fresnel};
use dunkelfeld_lanes::{Lanes, Mask, V3};
use dunkelfeld_radiometry::Rgb;

/// A clear sheet too thin to displace a ray. Light is reflected or passes straight. Both sides are equal.
///
/// The sum of all internal reflections of a sheet whose faces reflect `R` is `R' = R + (1-R)^2 R / (1-R^2) = 2R /
/// (1+R)` (Stokes 1862). A rough sheet spreads both parts by the same GGX lobe. Its transmission is the mirror image of
/// its reflection, the common model for thin walls (Pharr, Jakob and Humphreys 2023, section 9.5).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ThinSheet<F = f32> {
    eta: F,
    ggx: Ggx<F>,
    /// One if rough, zero if smooth.
    rough: F,
    reflection_tint: Rgb<F>,
    transmission_tint: Rgb<F>,
    /// One with [`crate::compensation`].
    compensated: F,
}

in_lanes!(ThinSheet => ThinSheet<F> { eta, ggx, rough, reflection_tint, transmission_tint, compensated });

impl ThinSheet {
    /// A sheet of index of refraction `eta` relative to its surroundings (clamped to `[1e-3, 1e3]`) and GGX roughness
    /// `alpha` (0 is smooth; a rough lobe has at least 1e-4). The tints multiply reflection and transmission.
    #[inline]
    pub fn new(eta: f32, alpha: f32, reflection_tint: Rgb, transmission_tint: Rgb) -> Self {
        let (eta, rough) = (clamp_eta(eta), f32::from(u8::from(alpha > 0.0)));
        Self { eta, ggx: Ggx::new(alpha, alpha), rough, reflection_tint, transmission_tint, compensated: 0.0 }
    }

    /// The same sheet with [`crate::compensation`]. Reflection and transmission are one lobe and its mirror image, so
    /// together they lose as much energy as a mirror.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: 1.0, ..self }
    }

    /// True if the sheet is smooth.
    #[inline]
    pub fn is_delta(&self) -> bool {
        self.rough == 0.0
    }
}

impl<F: Lanes> ThinSheet<F> {
    /// Reflectance at an angle of cosine `cos`, all internal reflections included.
    #[inline(always)]
    pub fn reflectance(&self, cos: F) -> F {
        let r = fresnel::dielectric(cos, self.eta).reflectance;
        r * 2.0 / (r + 1.0)
    }

    /// The sheet seen from `wo`.
    #[inline(always)]
    pub fn view(&self, wo: V3<F>) -> ThinSheetView<'_, F> {
        let below = wo.z.lt(wo.z.constant(0.0));
        let (up, rough) = (mirrored_if(below, wo), self.rough.is_positive());
        let is_compensated = rough & self.compensated.is_positive();
        let gain = if is_compensated.any() {
            compensation::reflected_once(is_compensated, &self.ggx, up).recip()
        } else {
            wo.z.constant(1.0)
        };
        ThinSheetView { surface: self, rough, below, up, gain }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline(always)]
    pub fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        self.transmission_tint.lerp(self.reflection_tint, self.reflectance(wo.z.abs()))
    }
}

/// A [`ThinSheet`] seen from `wo`.
#[derive(Clone, Copy, Debug)]
pub struct ThinSheetView<'a, F: Lanes> {
    surface: &'a ThinSheet<F>,
    rough: F::Mask,
    /// True for `wo` below the surface. Then all directions are mirrored to the other side.
    below: F::Mask,
    up: V3<F>,
    /// Factor of the compensation.
    gain: F,
}

impl<F: Lanes> ThinSheetView<'_, F> {
    /// Value and density for a direction on the side of `wo`: `wi` if it is reflected, else the mirror image of `wi`.
    #[inline(always)]
    fn eval_image(&self, image: V3<F>, reflected: F::Mask) -> (Rgb<F>, F) {
        let (s, up, zero) = (self.surface, self.up, image.z.constant(0.0));
        let mask = self.rough & up.z.is_positive() & image.z.is_positive();
        if !mask.any() {
            return (Rgb::splat(zero), zero);
        }
        let (m, is_some) = (up + image).try_normalize();
        let r = s.reflectance(up.dot(m));
        let share = reflected.select(r, r.one_minus());
        let value = share * s.ggx.pdf_visible_reflection(up, m) * s.ggx.g1(image) * self.gain;
        let tint = Rgb::select(reflected, s.reflection_tint, s.transmission_tint);
        let mask = mask & is_some;
        (tint * value.only(mask), (share * s.ggx.pdf_bounded_reflection(up, m)).only(mask))
    }
}

impl<F: Lanes> View<F> for ThinSheetView<'_, F> {
    #[inline(always)]
    fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        self.surface.albedo(wo)
    }

    #[inline(always)]
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let wi = mirrored_if(self.below, wi);
        let passed = wi.z.lt(wi.z.constant(0.0));
        self.eval_image(mirrored_if(passed, wi), !passed)
    }

    #[inline(always)]
    fn sample(&self, u_lobe: F, u: [F; 2]) -> BsdfSamples<F> {
        let Self { surface: s, rough, below, up, .. } = *self;
        let (token, zero, one) = (up.z.token(), up.z.constant(0.0), up.z.constant(1.0));
        let mut m = V3::new(zero, zero, one);
        if rough.any() {
            m = V3::select(rough, s.ggx.sample_bounded(up, u), m);
        }
        let r = s.reflectance(up.dot(m));
        let reflected = u_lobe.lt(r);
        let image = reflect(up, m);
        // The delta lobes.
        let mut weight = Rgb::select(reflected, s.reflection_tint, s.transmission_tint);
        let mut pdf = reflected.select(r, r.one_minus());
        if rough.any() {
            let (value, density) = self.eval_image(image, reflected);
            weight = Rgb::select(rough, value / density, weight);
            pdf = rough.select(density, pdf);
        }
        let side = reflected.select(Lobe::REFLECTION.in_lanes(token), Lobe::TRANSMISSION.in_lanes(token));
        let kind = rough.select(Lobe::GLOSSY.in_lanes(token), Lobe::DELTA.in_lanes(token));
        let lobe = F::from_bits(side.to_bits() | kind.to_bits());
        let wi = mirrored_if(below, mirrored_if(!reflected, image));
        BsdfSamples::new(wi, weight, pdf.only(up.z.is_positive()), lobe, one)
    }
}
