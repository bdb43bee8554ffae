//! The principled BSDF: the mix of all lobes, with the parameters of Mitsuba 3.9's `principled`.
//!
//! The model is that of Burley (2012, 2015), with layers that conserve energy ([`crate::layers`]). A furnace is never
//! above one, and all lobes without [`crate::compensation`] are reciprocal:
//! - the diffuse lobe is Lambert's, below the dielectric reflection, the clear coat and the sheen;
//! - coat and sheen lie on all other lobes side by side, the sheen with a strength of at most 10;
//! - a dielectric refracts what it does not reflect in the brightest channel; tint and specular colour change its
//!   reflection at normal incidence.
//!
//! Where the papers leave a choice, it follows Mitsuba:
//! - roughness squared is the GGX slope, anisotropy divides and multiplies it by `sqrt(1 - 0.9 anisotropic)`, slopes
//!   are at least 0.001;
//! - masking and shadowing are separable, `G = g1(wo) g1(wi)`;
//! - the specular reflectance blends exact dielectric Fresnel with Schlick terms for metal and tint;
//! - transmission takes the square root of the base colour at each boundary;
//! - sheen vanishes for `spec_trans = 1`;
//! - only the refractive part (`spec_trans`) exists for light on the inside (z < 0); the rest absorbs there.
//!
//! Deviations: `specular_factor`, `specular_color` and `sheen_color` are added (neutral by default). `anisotropic` may
//! be negative, which swaps the axes. A transmitting boundary with matched index (within [`MATCHED_INDEX`] of 1) is a
//! delta lobe. Parameters are clamped to their ranges. The sampling densities differ from Mitsuba's: the reflective
//! lobe uses bounded visible normals.
//!
//! [`PrincipledModel::Mitsuba`] has Burley's diffuse lobe, and adds the lobes without regard to energy. Then no
//! deviation changes a value where Mitsuba's parameters are in range and `eta` is not 1. It exists for comparisons.

use crate::bsdf_sample::{BsdfSamples, Lobe, View};
use crate::clearcoat::{self, Coat};
use crate::dielectric::{MATCHED_INDEX, clamp_eta};
use crate::fresnel::{self, normal_reflectance, schlick_weight};
use crate::in_lanes::in_lanes;
use crate::layers::{Curve, Curves, DIFFUSE, LEAST_SLOPE, SPECULAR, Shares, below_coat_and_sheen, below_specular};
use crate::microfacet::{Ggx, mirrored_if, reflect};
use crate::specular::SpecularColor;
use crate::transmission::{eval_refraction, refract};
use crate::{compensation, diffuse, sheen};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp::lanes::sample_cosine_hemisphere;
use std::f32::consts::FRAC_1_PI;

/// How the lobes of a principled surface share the light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrincipledModel {
    /// Layers that conserve energy.
    #[default]
    Layered,
    /// The sum of the lobes of Mitsuba's `principled`, which may scatter more light than arrives. For comparisons.
    Mitsuba,
}

/// The parameters of a surface. Ranges are `[0, 1]` unless noted; values outside are clamped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledParams {
    /// Diffuse colour, and the colour of metal and of transmitted light.
    pub base_color: Rgb,
    /// From dielectric to metal.
    pub metallic: f32,
    /// Perceptual roughness; its square is the GGX slope, which is at least 0.001 (roughness 0.032).
    pub roughness: f32,
    /// Stretch of highlights along the tangent, `[-1, 1]`; negative stretches along the bitangent.
    pub anisotropic: f32,
    /// Index of refraction inside over outside, `[1e-3, 1e3]`. At normal incidence it reflects `((eta - 1) / (eta + 1))^2`.
    pub eta: f32,
    /// Factor on the dielectric reflection at all angles (glTF KHR_materials_specular).
    pub specular_factor: f32,
    /// Factor on the dielectric reflection at normal incidence (glTF KHR_materials_specular); not negative, the product
    /// is clamped to 1.
    pub specular_color: Rgb,
    /// Share of the hue of the base colour in the dielectric reflection at normal incidence.
    pub spec_tint: f32,
    /// From opaque to refracting.
    pub spec_trans: f32,
    /// Strength of the sheen of cloth; not negative.
    pub sheen: f32,
    /// Factor on the sheen, beside its strength and tint (glTF KHR_materials_sheen); not negative.
    pub sheen_color: Rgb,
    /// Share of the hue of the base colour in the sheen.
    pub sheen_tint: f32,
    /// Strength of the clear coat, `[0, 4]`: 1 is Burley's coat, a quarter of a real lacquer; 4 is a real one.
    pub clearcoat: f32,
    /// From satin to gloss, for the clear coat.
    pub clearcoat_gloss: f32,
    /// How the lobes share the light.
    pub model: PrincipledModel,
}

impl Default for PrincipledParams {
    /// Grey plastic of index 1.5, half rough: Mitsuba's defaults.
    fn default() -> Self {
        Self {
            base_color: Rgb::splat(0.5),
            metallic: 0.0,
            roughness: 0.5,
            anisotropic: 0.0,
            eta: 1.5,
            specular_factor: 1.0,
            specular_color: Rgb::WHITE,
            spec_tint: 0.0,
            spec_trans: 0.0,
            sheen: 0.0,
            sheen_color: Rgb::WHITE,
            sheen_tint: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 0.0,
            model: PrincipledModel::Layered,
        }
    }
}

/// Up to this roughness the specular lobe has its least width.
const POLISHED: f32 = 0.032;

/// A principled surface in compiled form. Products of the parameters are computed once per shading point.
///
/// `C` holds the curves: [`Shares`], or in lanes references to those of each lane.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Principled<F = f32, C = Shares> {
    ggx: Ggx<F>,
    roughness: F,
    eta: F,
    /// Base colour times the opaque dielectric share.
    diffuse_color: Rgb<F>,
    pub(crate) shares: C,
    /// Factor of the diffuse lobe, `1 / (pi mean(shares[DIFFUSE]))`.
    pub(crate) lambert: F,
    /// The refracting share of the dielectric.
    spec_trans: F,
    /// The refracting dielectric share, `(1 - metallic) spec_trans`.
    refracting: F,
    /// Square root of the base colour times the refracting share.
    transmission_color: Rgb<F>,
    specular: SpecularColor<F>,
    /// Sheen colour times its strength.
    sheen_color: Rgb<F>,
    /// Strength of the coat times Burley's 1/4.
    coat: F,
    coat_shape: Coat<F>,
    /// Luminance of the diffuse lobe without layers above it, and of the sheen, for the choice of a lobe.
    diffuse_luminance: F,
    sheen_luminance: F,
    /// The same of the specular and the transmission lobe together, at normal and at grazing incidence.
    specular_luminance: F,
    grazing_luminance: F,
    /// One with [`crate::compensation`].
    compensated: F,
    /// One if the diffuse lobe is that of Burley.
    burley: F,
    /// See [`Self::is_rich`].
    rich: bool,
}

in_lanes!(Principled => Principled<F, [&'a Shares; MAX_WIDTH]> {
    ggx, roughness, eta, diffuse_color, shares, lambert, spec_trans, refracting, transmission_color, specular, sheen_color,
    coat, coat_shape, diffuse_luminance, sheen_luminance, specular_luminance,
    grazing_luminance, compensated, burley, rich
});

impl Principled {
    /// Computes the products of the parameters. Parameters are clamped to their ranges, and NaN counts as zero.
    pub fn new(p: &PrincipledParams) -> Self {
        let base = p.base_color.map(unit);
        let (metallic, spec_trans, spec_tint) = (unit(p.metallic), unit(p.spec_trans), unit(p.spec_tint));
        let (roughness, eta) = (unit(p.roughness), clamp_eta(p.eta));
        let hue = sheen::hue(base);

        let alpha = roughness * roughness;
        let aspect = (1.0 - 0.9 * unit(p.anisotropic.abs())).sqrt();
        let (long, short) = ((alpha / aspect).max(LEAST_SLOPE), (alpha * aspect).max(LEAST_SLOPE));
        let ggx = if p.anisotropic < 0.0 { Ggx::new(short, long) } else { Ggx::new(long, short) };

        let opaque = (1.0 - metallic) * (1.0 - spec_trans);
        let refracting = (1.0 - metallic) * spec_trans;
        let layered = p.model == PrincipledModel::Layered;
        let mut specular_color = p.specular_color.map(at_least_zero);
        if layered {
            specular_color *= Rgb::WHITE.lerp(hue, spec_tint);
        }
        let schlick_tint = if layered { 0.0 } else { spec_tint };
        let scale = (unit(p.specular_factor), specular_color);
        let specular = SpecularColor::new(eta, base, hue, metallic, schlick_tint, scale);
        // A surface that refracts everything has no sheen, as in Mitsuba, where sheen belongs to the diffuse layer.
        let sheen = if opaque > 0.0 { at_least_zero(p.sheen) * (1.0 - metallic) } else { 0.0 };
        let mut sheen_color = Rgb::WHITE.lerp(hue, unit(p.sheen_tint)) * p.sheen_color.map(at_least_zero) * sheen;
        let diffuse_color = base * opaque;
        let coat = clearcoat::STRENGTH * at_least_zero(p.clearcoat).min(4.0);
        let coat_alpha = clearcoat::alpha_from_gloss(unit(p.clearcoat_gloss));
        let mut shares = [Curve::ONE; 2];
        if layered {
            sheen_color = sheen_color * (10.0 / sheen_color.max_channel().max(10.0));
            shares[SPECULAR] = below_coat_and_sheen(coat, coat_alpha, sheen_color.max_channel());
            if opaque > 0.0 {
                shares[DIFFUSE] =
                    below_specular(&ggx, eta).zip(shares[SPECULAR], |t, above| (1.0 - specular.bound(1.0 - t)) * above);
            }
        }
        let transmission_color = base.map(f32::sqrt) * refracting;
        let lobes = |exact: f32, weight: f32| {
            specular.reflectance(exact, weight).luminance() + (1.0 - exact) * transmission_color.luminance()
        };
        let burley = !layered && opaque > 0.0;
        Self {
            ggx,
            roughness,
            eta,
            diffuse_color,
            shares,
            lambert: if opaque > 0.0 { FRAC_1_PI / shares[DIFFUSE].mean().max(f32::MIN_POSITIVE) } else { 0.0 },
            spec_trans,
            refracting,
            transmission_color,
            specular,
            sheen_color,
            coat,
            coat_shape: Coat::new(coat_alpha),
            diffuse_luminance: diffuse_color.luminance(),
            // More than a sheen of strength one scatters at any view, 0.09, because its colour varies.
            sheen_luminance: 0.25 * sheen_color.luminance(),
            specular_luminance: lobes(normal_reflectance(eta), 0.0),
            grazing_luminance: lobes(if eta == 1.0 { 0.0 } else { 1.0 }, 1.0),
            compensated: 0.0,
            burley: f32::from(u8::from(burley)),
            rich: burley || refracting > 0.0 || coat > 0.0 || !sheen_color.is_black(),
        }
    }

    /// The same surface with [`crate::compensation`] of its specular and transmission lobes.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: 1.0, rich: true, ..self }
    }

    /// The same surface with its diffuse lobe scaled by a factor in `[0, 1]`.
    #[inline]
    pub(crate) fn with_less_diffuse(self, factor: f32) -> Self {
        let diffuse_color = self.diffuse_color * factor;
        Self { diffuse_color, diffuse_luminance: diffuse_color.luminance(), ..self }
    }

    /// True if it has only a specular lobe, and that lobe has its least width.
    #[inline]
    pub(crate) fn is_polished(&self) -> bool {
        self.roughness <= POLISHED && !self.rich && self.diffuse_luminance == 0.0
    }
}

impl<F: Lanes, C: Curves> Principled<F, C> {
    /// True if it has more than the diffuse and the specular lobe of an opaque surface, in some lane. Most surfaces have
    /// not. Code for these two lobes is sufficient for them: [`Self::view`] with `RICH` false.
    #[inline(always)]
    pub fn is_rich(&self) -> bool {
        self.rich
    }

    /// The surface seen from `wo`. `RICH` must be true if [`Self::is_rich`]; else it changes no result.
    #[inline(always)]
    pub fn view<const RICH: bool>(&self, wo: V3<F>) -> PrincipledView<'_, F, C, RICH> {
        let (zero, one) = (wo.z.constant(0.0), wo.z.constant(1.0));
        let below = wo.z.lt(zero);
        let (mut up, mut eta) = (wo, self.eta);
        if RICH {
            (up, eta) = (mirrored_if(below, wo), below.select(eta.recip(), eta));
        }
        // Schlick's approximation is sufficient for the choice of a lobe, in proportion to their expected energy. The floor
        // keeps the probability of a lobe that is black at normal incidence above zero, because its tilted facets are not
        // black.
        let w = schlick_weight(up.z).max(wo.z.constant(0.01));
        let mut specular = self.specular_luminance * w.one_minus() + self.grazing_luminance * w;
        let mut diffuse_share = zero;
        if self.diffuse_luminance.is_positive().any() {
            diffuse_share = self.shares.at(DIFFUSE, up.z).only(self.diffuse_luminance.is_positive());
        }
        let mut diffuse = self.diffuse_luminance * diffuse_share;
        let (mut coat, mut specular_share) = (zero, one);
        let is_refracting = self.refracting.is_positive();
        let has_coat = self.coat.is_positive();
        let is_covered = has_coat | self.sheen_color.is_lit();
        if RICH {
            coat = self.coat * (w * 0.96 + 0.04);
            diffuse += self.sheen_luminance;
            if is_covered.any() {
                specular_share = self.shares.at(SPECULAR, up.z);
            }
        }
        let sum = diffuse + specular + coat;
        let scale = sum.recip();
        let mut is_lit = wo.z.is_positive() & sum.is_positive() & scale.is_finite();
        [diffuse, coat, specular] = [diffuse * scale, coat * scale, specular * scale];
        let mut gains = None;
        if RICH {
            // Below the surface only the boundary of the refracting share scatters light.
            [diffuse, coat, specular] = [diffuse.only(!below), coat.only(!below), below.select(one, specular)];
            is_lit = is_lit | below & is_refracting;
            let is_compensated = self.compensated.is_positive();
            if is_compensated.any() {
                gains = Some(self.gains(is_compensated, up, eta));
            }
        }
        PrincipledView {
            surface: self,
            up,
            eta,
            below,
            is_lit,
            is_refracting,
            is_covered,
            is_matched: self.is_matched(),
            visible: self.ggx.visible_scale(up),
            bounded: self.ggx.bounded_scale(up),
            diffuse,
            coat,
            specular,
            diffuse_share,
            specular_share,
            gains,
        }
    }

    /// Compensation of the metal by its reflectance at normal incidence (Turquin 2019), of the refracting share as a clear
    /// boundary, unless the reflection is brighter than that of the index. The light that the rest loses reaches the
    /// diffuse lobe.
    #[inline(always)]
    fn gains(&self, mask: F::Mask, up: V3<F>, eta: F) -> Gains<F> {
        let one = eta.constant(1.0);
        let is_clear = mask & !self.is_matched() & !self.specular.is_brighter();
        let clear = compensation::scattered_once(is_clear, &self.ggx, up, eta).recip();
        let once = compensation::reflected_once(mask, &self.ggx, up);
        Gains {
            clear,
            dielectric: self.spec_trans * (clear - 1.0) + 1.0,
            metal: Rgb::splat(one) + self.specular.metal() * (once.one_minus() / once),
        }
    }

    /// See [`crate::Bsdf::albedo`].
    #[inline(always)]
    pub fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        let cos = wo.z.abs();
        let f = fresnel::dielectric(cos, self.eta);
        let specular = self.specular.reflectance(f.reflectance, self.schlick_weight(cos, f.cos_t));
        let below = self.diffuse_color + self.transmission_color;
        in_unit(specular + below * f.reflectance.one_minus())
    }

    /// Schlick's weight at a facet above the surface. Toward a thinner medium it uses the angle of refraction, so that
    /// it reaches one at the critical angle (Burley 2015).
    #[inline(always)]
    fn schlick_weight(&self, cos_d: F, cos_t: F) -> F {
        schlick_weight(self.eta.gt(self.eta.constant(1.0)).select(cos_d, cos_t))
    }

    /// True if there is no boundary with refraction.
    #[inline(always)]
    fn is_matched(&self) -> F::Mask {
        (self.eta - 1.0).abs().lt(self.eta.constant(MATCHED_INDEX))
    }

    /// Probability of reflection at a facet of the refracting boundary, in proportion to the energy of each side.
    #[inline(always)]
    fn reflection_probability(&self, reflected: Rgb<F>, fresnel: F) -> F {
        let (r, t) = (reflected.luminance(), fresnel.one_minus() * self.transmission_color.luminance());
        (r / (r + t)).only(r.is_positive())
    }
}

/// Factors of the compensation: on both lobes of the refracting share, on the dielectric, on the metal.
#[derive(Clone, Copy, Debug)]
struct Gains<F> {
    clear: F,
    dielectric: F,
    metal: Rgb<F>,
}

/// A [`Principled`] surface seen from `wo`.
#[derive(Clone, Copy, Debug)]
pub struct PrincipledView<'a, F: Lanes, C, const RICH: bool> {
    surface: &'a Principled<F, C>,
    /// `wo`, mirrored to above the surface.
    up: V3<F>,
    /// Index of refraction on the far side of `wo` over that on its side.
    eta: F,
    /// True for `wo` below the surface. Then all directions are mirrored to the other side.
    below: F::Mask,
    /// True if it scatters light toward `wo`.
    is_lit: F::Mask,
    is_refracting: F::Mask,
    /// True below a coat or a sheen.
    is_covered: F::Mask,
    /// True if there is no boundary with refraction.
    is_matched: F::Mask,
    /// Factors from the distribution of normals to densities of visible and of bounded normals.
    visible: F,
    bounded: F,
    /// Probabilities of the lobes, which sum to one.
    diffuse: F,
    coat: F,
    specular: F,
    /// Values of the curves for `wo`.
    diffuse_share: F,
    specular_share: F,
    gains: Option<Gains<F>>,
}

/// A direction drawn from the lobes, mirrored like `wo`.
pub(crate) struct Drawn<F: Lanes> {
    pub(crate) wi: V3<F>,
    /// False if the direction lies on the wrong side for its lobe.
    pub(crate) is_valid: F::Mask,
    /// See [`Lobe::in_lanes`].
    pub(crate) lobe: F,
    eta: F,
    /// The lanes of delta lobes, with weight and probability.
    delta: Option<(F::Mask, Rgb<F>, F)>,
}

impl<F: Lanes, C: Curves, const RICH: bool> PrincipledView<'_, F, C, RICH> {
    /// [`View::eval_pdf`] for a mirrored direction.
    #[inline(always)]
    pub(crate) fn eval_up(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let zero = wi.z.constant(0.0);
        let facing = self.is_lit & wi.z.is_positive();
        let above = if RICH { facing & !self.below } else { facing };
        let (mut value, mut pdf) = (Rgb::splat(zero), zero);
        if above.any() {
            (value, pdf) = self.reflect_above(wi);
            (value, pdf) = (Rgb::select(above, value, Rgb::splat(zero)), pdf.only(above));
        }
        if RICH {
            let inside = facing & self.below;
            if inside.any() {
                let inner = self.reflect_inside(wi);
                (value, pdf) = (Rgb::select(inside, inner.0, value), inside.select(inner.1, pdf));
            }
            let through = self.is_lit & self.is_refracting & !self.is_matched & wi.z.lt(zero);
            if through.any() {
                let outer = self.refract_through(wi);
                (value, pdf) = (Rgb::select(through, outer.0, value), through.select(outer.1, pdf));
            }
        }
        (value, pdf)
    }

    /// Both directions above the surface: all reflective lobes that the surface has.
    #[inline(always)]
    fn reflect_above(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let (s, wo, zero) = (self.surface, self.up, wi.z.constant(0.0));
        let (m, is_some) = (wo + wi).try_normalize();
        let cos_d = wo.dot(m).clamp(1e-6, 1.0);

        let f = fresnel::dielectric(cos_d, s.eta);
        let weight = s.schlick_weight(cos_d, f.cos_t);
        let reflectance = s.specular.reflectance(f.reflectance, weight);
        let d = s.ggx.distribution(m);
        let shape = d * self.visible * s.ggx.g1(wi);
        let mut value = reflectance * shape;
        let mut density = d * self.bounded;
        if RICH {
            if let Some(gains) = self.gains {
                value = s.specular.compensated(f.reflectance, weight, gains.dielectric, gains.metal) * shape;
            }
            if self.is_covered.any() {
                value *= self.specular_share.min(s.shares.at(SPECULAR, wi.z));
            }
            if self.is_refracting.any() {
                let q = s.reflection_probability(reflectance, f.reflectance);
                density = self.is_refracting.select(d * self.visible * q, density);
            }
        }
        let mut pdf = self.specular * density;
        let has_diffuse = self.diffuse.is_positive();
        if has_diffuse.any() {
            let mut lobe = s.lambert * self.diffuse_share * s.shares.at(DIFFUSE, wi.z) * wi.z;
            if RICH {
                let burley = s.burley.is_positive();
                if burley.any() {
                    lobe = burley.select(diffuse::eval_diffuse(wo.z, wi.z, cos_d, s.roughness), lobe);
                }
                if self.is_covered.any() {
                    value += s.sheen_color * sheen::eval_sheen(wi.z, cos_d).only(has_diffuse);
                }
            }
            value += s.diffuse_color * lobe.only(has_diffuse);
            pdf += self.diffuse * (wi.z * FRAC_1_PI);
        }
        if RICH {
            let has_coat = self.coat.is_positive();
            if has_coat.any() {
                value += Rgb::splat((s.coat * s.coat_shape.eval(wo, wi, m)).only(has_coat));
                pdf += self.coat * s.coat_shape.pdf_reflection(m, cos_d);
            }
        }
        (Rgb::select(is_some, value, Rgb::splat(zero)), pdf.only(is_some))
    }

    /// Both directions below the surface, mirrored: reflection at the boundary of the refracting share.
    #[inline(always)]
    fn reflect_inside(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let s = self.surface;
        let (m, is_some) = (self.up + wi).try_normalize();
        let f = fresnel::dielectric(self.up.dot(m), self.eta).reflectance;
        let visible = s.ggx.distribution(m) * self.visible;
        let reflected = s.refracting * f;
        let q = s.reflection_probability(Rgb::splat(reflected), f);
        let value = reflected * visible * s.ggx.g1(wi) * self.clear_gain();
        (Rgb::splat(value.only(is_some)), (visible * q).only(is_some))
    }

    /// Directions on different sides, mirrored: refraction at the boundary of the refracting share.
    #[inline(always)]
    fn refract_through(&self, wi: V3<F>) -> (Rgb<F>, F) {
        let s = self.surface;
        let r = eval_refraction(&s.ggx, self.up, wi, self.eta);
        let reflected = self.reflected(r.fresnel, s.schlick_weight(r.cos_o, r.cos_i));
        let q = s.reflection_probability(reflected, r.fresnel);
        let value = r.value * self.kept(r.fresnel, wi) * self.clear_gain();
        let pdf = self.specular * q.one_minus() * r.density;
        (s.transmission_color * value.only(r.is_possible), pdf.only(r.is_possible))
    }

    /// Reflectance of a facet of the refracting boundary, from either side.
    #[inline(always)]
    fn reflected(&self, fresnel: F, weight: F) -> Rgb<F> {
        let s = self.surface;
        Rgb::select(self.below, Rgb::splat(s.refracting * fresnel), s.specular.reflectance(fresnel, weight))
    }

    /// The share of refracted light that reflection and layers leave, for a mirrored direction.
    #[inline(always)]
    fn kept(&self, fresnel: F, wi: V3<F>) -> F {
        let mut kept = self.surface.specular.refracted(fresnel);
        if self.is_covered.any() {
            kept *= self.surface.shares.at(SPECULAR, self.below.select(-wi.z, self.up.z));
        }
        kept
    }

    #[inline(always)]
    fn clear_gain(&self) -> F {
        match self.gains {
            Some(gains) => gains.clear,
            None => self.eta.constant(1.0),
        }
    }

    /// Draws a direction.
    #[inline(always)]
    pub(crate) fn draw(&self, u_lobe: F, u: [F; 2]) -> Drawn<F> {
        let (s, up) = (self.surface, self.up);
        let (token, zero, one) = (u_lobe.token(), u_lobe.constant(0.0), u_lobe.constant(1.0));
        let mut wi = V3::new(zero, zero, one);
        let mut lobe = (Lobe::GLOSSY | Lobe::REFLECTION).in_lanes(token);
        let (mut eta, mut delta, mut refracted) = (one, None, None);

        let is_diffuse = u_lobe.lt(self.diffuse);
        let mut is_specular = !is_diffuse;
        if RICH {
            let is_coat = !is_diffuse & u_lobe.lt(self.diffuse + self.coat);
            if is_coat.any() {
                wi = V3::select(is_coat, reflect(up, s.coat_shape.sample_half_vector(u)), wi);
                lobe = is_coat.select((Lobe::CLEARCOAT | Lobe::GLOSSY | Lobe::REFLECTION).in_lanes(token), lobe);
            }
            let is_boundary = !is_diffuse & !is_coat & self.is_refracting;
            is_specular = !is_diffuse & !is_coat & !self.is_refracting;
            if is_boundary.any() {
                // A visible facet, then reflection or refraction there, by the remainder of u_lobe.
                let rest = ((u_lobe - self.diffuse - self.coat) / self.specular).clamp(0.0, 1.0 - f32::EPSILON / 2.0);
                let m = s.ggx.sample_visible(up, u);
                let up_m = up.dot(m);
                let f = fresnel::dielectric(up_m, self.eta);
                let reflected = self.reflected(f.reflectance, s.schlick_weight(up_m, f.cos_t));
                let q = s.reflection_probability(reflected, f.reflectance);
                let passes = is_boundary & q.le(rest);
                wi = V3::select(is_boundary, reflect(up, m), wi);
                if passes.any() {
                    lobe = passes.select((Lobe::GLOSSY | Lobe::TRANSMISSION).in_lanes(token), lobe);
                    wi = V3::select(passes, refract(up, m, self.eta, f.cos_t), wi);
                    eta = passes.select(self.eta, one);
                    refracted = Some(passes);
                    let is_delta = passes & self.is_matched;
                    if is_delta.any() {
                        // The facet decided only between reflection and transmission. Averaged over facets, the
                        // transmitted direction is straight.
                        lobe = is_delta.select((Lobe::DELTA | Lobe::TRANSMISSION).in_lanes(token), lobe);
                        wi = V3::select(is_delta, -up, wi);
                        eta = is_delta.select(one, eta);
                        let pdf = self.specular * q.one_minus();
                        let passed = self.kept(f.reflectance, wi) * f.reflectance.one_minus();
                        delta = Some((is_delta, s.transmission_color * (passed / pdf), pdf));
                    }
                }
            }
        }
        if is_specular.any() {
            wi = V3::select(is_specular, reflect(up, s.ggx.sample_bounded(up, u)), wi);
        }
        if is_diffuse.any() {
            wi = V3::select(is_diffuse, sample_cosine_hemisphere(u), wi);
            lobe = is_diffuse.select((Lobe::DIFFUSE | Lobe::REFLECTION).in_lanes(token), lobe);
        }
        let mut is_valid = wi.z.is_positive();
        if let Some(refracted) = refracted {
            is_valid = is_valid & !refracted | wi.z.lt(zero) & refracted;
        }
        Drawn { wi, is_valid: is_valid & self.is_lit, lobe, eta, delta }
    }
}

impl<F: Lanes, C: Curves, const RICH: bool> View<F> for PrincipledView<'_, F, C, RICH> {
    #[inline(always)]
    fn albedo(&self, wo: V3<F>) -> Rgb<F> {
        self.surface.albedo(wo)
    }

    #[inline(always)]
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F) {
        self.eval_up(if RICH { mirrored_if(self.below, wi) } else { wi })
    }

    #[inline(always)]
    fn sample(&self, u_lobe: F, u: [F; 2]) -> BsdfSamples<F> {
        let Drawn { wi, is_valid, lobe, eta, delta } = self.draw(u_lobe, u);
        let (value, pdf) = self.eval_up(wi);
        let (mut weight, mut pdf) = (value / pdf, pdf);
        if let Some((mask, straight, probability)) = delta {
            (weight, pdf) = (Rgb::select(mask, straight, weight), mask.select(probability, pdf));
        }
        let wi = if RICH { mirrored_if(self.below, wi) } else { wi };
        BsdfSamples::new(wi, weight, pdf.only(is_valid), lobe, eta)
    }
}

/// A colour clamped to `[0, 1]`.
#[inline(always)]
pub(crate) fn in_unit<F: Lanes>(c: Rgb<F>) -> Rgb<F> {
    Rgb::new(c.r.clamp(0.0, 1.0), c.g.clamp(0.0, 1.0), c.b.clamp(0.0, 1.0))
}

/// A parameter clamped to `[0, 1]`, NaN to 0.
#[inline]
fn unit(x: f32) -> f32 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

/// A parameter clamped from below, NaN to 0; infinity becomes large but finite.
#[inline]
fn at_least_zero(x: f32) -> f32 {
    if x > 0.0 { x.min(1e6) } else { 0.0 }
}
