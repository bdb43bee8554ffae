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

use crate::bsdf_sample::{BsdfSample, Lobe};
use crate::dielectric::{MATCHED_INDEX, clamp_eta, delta, finite_sample, from_above, mirrored_if};
use crate::fresnel::{self, schlick_weight};
use crate::layers::{Curve, LEAST_SLOPE, below_coat_and_sheen, below_specular};
use crate::microfacet::{Ggx, reflect};
use crate::specular::SpecularColor;
use crate::transmission::{eval_refraction, refract};
use crate::{EFFECTS, clearcoat, compensation, diffuse, sheen};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::warp;
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
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Principled {
    ggx: Ggx,
    roughness: f32,
    eta: f32,
    /// Base colour times the opaque dielectric share.
    diffuse_color: Rgb,
    /// The share of the light of a direction that reaches the diffuse lobe.
    diffuse_share: Curve,
    /// Factor of the diffuse lobe, `1 / (pi mean(diffuse_share))`.
    lambert: f32,
    /// The share of the light of a direction that passes coat and sheen.
    to_specular: Curve,
    /// The refracting share of the dielectric.
    spec_trans: f32,
    /// The refracting dielectric share, `(1 - metallic) spec_trans`.
    refracting: f32,
    /// Square root of the base colour times the refracting share.
    transmission_color: Rgb,
    specular: SpecularColor,
    /// Sheen colour times its strength.
    sheen_color: Rgb,
    /// Strength of the coat times Burley's 1/4.
    coat: f32,
    coat_alpha: f32,
    /// Luminance of the diffuse lobe without layers above it, and of the sheen, for the choice of a lobe.
    diffuse_luminance: f32,
    sheen_luminance: f32,
    compensated: bool,
    /// True if the diffuse lobe is that of Burley.
    burley: bool,
    /// True if it has more than the diffuse and the specular lobe of an opaque surface. Most surfaces have not. They
    /// use code for these two lobes only: the functions below with `RICH` false.
    rich: bool,
}

/// Probabilities of the lobes for one `wo`, which sum to one, and the values of both curves for it.
#[derive(Clone, Copy, Debug)]
struct Choice {
    diffuse: f32,
    coat: f32,
    specular: f32,
    diffuse_share: f32,
    to_specular: f32,
}

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
        let [mut to_specular, mut diffuse_share] = [Curve::ONE; 2];
        if layered {
            sheen_color = sheen_color * (10.0 / sheen_color.max_channel().max(10.0));
            to_specular = below_coat_and_sheen(coat, coat_alpha, sheen_color.max_channel());
            if opaque > 0.0 {
                diffuse_share =
                    below_specular(&ggx, eta).zip(to_specular, |t, above| (1.0 - specular.bound(1.0 - t)) * above);
            }
        }
        let burley = !layered && opaque > 0.0;
        Self {
            ggx,
            roughness,
            eta,
            diffuse_color,
            spec_trans,
            refracting,
            transmission_color: base.map(f32::sqrt) * refracting,
            diffuse_share,
            lambert: if opaque > 0.0 { FRAC_1_PI / diffuse_share.mean().max(f32::MIN_POSITIVE) } else { 0.0 },
            to_specular,
            specular,
            sheen_color,
            coat,
            coat_alpha,
            diffuse_luminance: diffuse_color.luminance(),
            // More than a sheen of strength one scatters at any view, 0.09, because its colour varies.
            sheen_luminance: 0.25 * sheen_color.luminance(),
            compensated: false,
            burley,
            rich: burley || refracting > 0.0 || coat > 0.0 || !sheen_color.is_black(),
        }
    }

    /// The same surface with [`crate::compensation`] of its specular and transmission lobes.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        Self { compensated: true, rich: true, ..self }
    }

    /// The same surface with its diffuse lobe scaled by a factor in `[0, 1]`.
    #[inline]
    pub(crate) fn with_less_diffuse(self, factor: f32) -> Self {
        let diffuse_color = self.diffuse_color * factor;
        Self { diffuse_color, diffuse_luminance: diffuse_color.luminance(), ..self }
    }

    /// The share of the light of a direction above the surface that reaches the diffuse lobe.
    #[inline]
    pub(crate) fn diffuse_share(&self, w: LocalDir) -> f32 {
        self.diffuse_share.at(w.0.z)
    }

    /// The diffuse lobe of albedo one below the layers, without `|cos wi|` [1/sr]. Both directions lie above the
    /// surface.
    #[inline]
    pub(crate) fn diffuse_below(&self, wo: LocalDir, wi: LocalDir) -> f32 {
        self.lambert * self.diffuse_share(wo) * self.diffuse_share(wi)
    }

    /// See [`crate::Bsdf::eval_pdf`].
    #[inline]
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        if self.is_rich() { self.eval_rich(wo, wi) } else { self.eval_above::<false>(wo, wi) }
    }

    /// See [`crate::Bsdf::sample`].
    #[inline(always)]
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        if self.is_rich() {
            // Bound to a variable first: see `Bsdf::sample`.
            let sample = self.sample_rich(wo, u_lobe, u)?;
            Some(sample)
        } else {
            self.sample_as::<false>(wo, u_lobe, u)
        }
    }

    #[inline]
    fn is_rich(&self) -> bool {
        EFFECTS && self.rich
    }

    /// [`Self::eval_pdf`] with all lobes, on both sides.
    #[inline(never)]
    fn eval_rich(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        if wo.0.z > 0.0 && wi.0.z > 0.0 {
            self.eval_above::<true>(wo, wi)
        } else if self.refracting > 0.0 && wo.0.z != 0.0 && wi.0.z != 0.0 {
            if wo.same_side(wi) { self.reflect_inside(wo, wi) } else { self.refract_through(wo, wi) }
        } else {
            (Rgb::BLACK, 0.0)
        }
    }

    /// [`Self::eval_pdf`] where both directions lie above the surface. For other directions the result is zero.
    #[inline]
    fn eval_above<const RICH: bool>(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        if !(wo.0.z > 0.0 && wi.0.z > 0.0) {
            return (Rgb::BLACK, 0.0);
        }
        match self.choose::<RICH>(wo) {
            Some(choice) => self.reflect_above::<RICH>(wo, wi, choice),
            None => (Rgb::BLACK, 0.0),
        }
    }

    /// [`Self::sample`] with all lobes.
    #[inline(never)]
    fn sample_rich(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        self.sample_as::<true>(wo, u_lobe, u)
    }

    #[inline(always)]
    fn sample_as<const RICH: bool>(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let choice = if wo.0.z > 0.0 {
            self.choose::<RICH>(wo)?
        } else if RICH && wo.0.z < 0.0 && self.refracting > 0.0 {
            Choice { diffuse: 0.0, coat: 0.0, specular: 1.0, diffuse_share: 0.0, to_specular: 0.0 }
        } else {
            return None;
        };
        let (wi, lobe) = if u_lobe < choice.diffuse {
            (LocalDir(warp::sample_cosine_hemisphere(u)), Lobe::DIFFUSE | Lobe::REFLECTION)
        } else if RICH && u_lobe < choice.diffuse + choice.coat {
            let m = clearcoat::sample_half_vector(u, self.coat_alpha);
            (reflect(wo, m), Lobe::CLEARCOAT | Lobe::GLOSSY | Lobe::REFLECTION)
        } else if RICH && self.refracting > 0.0 {
            // The remainder of u_lobe decides between reflection and refraction.
            let rest = (u_lobe - choice.diffuse - choice.coat) / choice.specular;
            let rest = rest.clamp(0.0, 1.0 - f32::EPSILON / 2.0);
            return self.sample_boundary(wo, choice.specular, rest, u);
        } else {
            (reflect(wo, self.ggx.sample_bounded(wo, u)), Lobe::GLOSSY | Lobe::REFLECTION)
        };
        if wi.0.z <= 0.0 {
            return None;
        }
        let (value, pdf) = self.reflect_above::<RICH>(wo, wi, choice);
        finite_sample(wi, value, pdf, lobe, 1.0)
    }

    /// True if it has only a specular lobe, and that lobe has its least width.
    #[inline]
    pub(crate) fn is_polished(&self) -> bool {
        self.roughness <= POLISHED && !self.rich && self.diffuse_luminance == 0.0
    }

    /// See [`crate::Bsdf::albedo`].
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        let cos = wo.abs_cos_theta();
        let f = fresnel::dielectric(cos, self.eta);
        let specular = self.specular.reflectance(f.reflectance, self.schlick_weight(cos, f.cos_t));
        let below = self.diffuse_color + self.transmission_color;
        (specular + below * (1.0 - f.reflectance)).map(|c| c.clamp(0.0, 1.0))
    }

    /// Both directions above the surface: all reflective lobes that the surface has.
    #[inline]
    fn reflect_above<const RICH: bool>(&self, wo: LocalDir, wi: LocalDir, choice: Choice) -> (Rgb, f32) {
        let Some(m) = (wo.0 + wi.0).try_normalize() else { return (Rgb::BLACK, 0.0) };
        let cos_d = wo.0.dot(m).clamp(1e-6, 1.0);

        let f = fresnel::dielectric(cos_d, self.eta);
        let weight = self.schlick_weight(cos_d, f.cos_t);
        let reflectance = self.specular.reflectance(f.reflectance, weight);
        let stretch = self.ggx.stretch(wo);
        let d = self.ggx.distribution(m);
        // D g1(wo) / (4 wo.z), without its singularity at grazing angles.
        let visible = d / (2.0 * (wo.0.z + stretch));
        let shape = visible * self.ggx.g1(wi);
        let mut value = reflectance * shape;
        if RICH {
            if self.compensated {
                value = self.compensated_above(wo, f.reflectance, weight) * shape;
            }
            value *= choice.to_specular.min(self.to_specular.at(wi.0.z));
        }
        let mut pdf = choice.specular
            * if RICH && self.refracting > 0.0 {
                visible * self.reflection_probability(reflectance, f.reflectance)
            } else {
                d / (2.0 * (self.ggx.cap_bound(wo) * wo.0.z + stretch))
            };
        if choice.diffuse > 0.0 {
            value += self.diffuse_color
                * if RICH && self.burley {
                    diffuse::eval_diffuse(wo, wi, cos_d, self.roughness)
                } else {
                    self.lambert * choice.diffuse_share * self.diffuse_share(wi) * wi.0.z
                };
            if RICH && !self.sheen_color.is_black() {
                value += self.sheen_color * sheen::eval_sheen(wi, cos_d);
            }
            pdf += choice.diffuse * warp::pdf_cosine_hemisphere(wi.0);
        }
        if RICH && choice.coat > 0.0 {
            value += Rgb::splat(self.coat * clearcoat::eval_clearcoat(wo, wi, m, self.coat_alpha));
            pdf += choice.coat * clearcoat::pdf_reflection(m, cos_d, self.coat_alpha);
        }
        (value, pdf)
    }

    /// Both directions below the surface: reflection at the boundary of the refracting share.
    fn reflect_inside(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        let (eta, wo, wi) = from_above(self.eta, wo, wi);
        let Some(m) = (wo.0 + wi.0).try_normalize() else { return (Rgb::BLACK, 0.0) };
        let f = fresnel::dielectric(wo.0.dot(m), eta).reflectance;
        let visible = self.ggx.distribution(m) / (2.0 * (wo.0.z + self.ggx.stretch(wo)));
        let q = self.reflection_probability(Rgb::splat(self.refracting * f), f);
        (Rgb::splat(self.refracting * f * visible * self.ggx.g1(wi) * self.clear_gain(wo, eta)), visible * q)
    }

    /// Directions on different sides: refraction at the boundary of the refracting share.
    fn refract_through(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        let none = (Rgb::BLACK, 0.0);
        if self.is_matched() {
            return none;
        }
        let above = wo.0.z > 0.0;
        let (eta, wo, wi) = from_above(self.eta, wo, wi);
        let Some(r) = eval_refraction(&self.ggx, wo, wi, eta) else { return none };
        let (reflected, specular) = if above {
            let Some(choice) = self.choose::<true>(wo) else { return none };
            (self.specular.reflectance(r.fresnel, self.schlick_weight(r.cos_o, r.cos_i)), choice.specular)
        } else {
            (Rgb::splat(self.refracting * r.fresnel), 1.0)
        };
        let q = self.reflection_probability(reflected, r.fresnel);
        let kept = self.specular.refracted(r.fresnel) * self.to_specular.at(if above { wo.0.z } else { -wi.0.z });
        (self.transmission_color * (r.value * kept * self.clear_gain(wo, eta)), specular * (1.0 - q) * r.density)
    }

    /// Samples the refracting boundary from either side: a visible facet, then reflection or refraction there.
    fn sample_boundary(&self, wo: LocalDir, probability: f32, u_side: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let below = wo.0.z < 0.0;
        let (eta, up, _) = from_above(self.eta, wo, wo);
        let m = self.ggx.sample_visible(up, u);
        let up_m = up.0.dot(m);
        let f = fresnel::dielectric(up_m, eta);
        let reflected = if below {
            Rgb::splat(self.refracting * f.reflectance)
        } else {
            self.specular.reflectance(f.reflectance, self.schlick_weight(up_m, f.cos_t))
        };
        let q = self.reflection_probability(reflected, f.reflectance);
        if u_side < q {
            let wi = reflect(up, m);
            let wi = (wi.0.z > 0.0).then(|| mirrored_if(below, wi))?;
            let (value, pdf) = self.eval_pdf(wo, wi);
            finite_sample(wi, value, pdf, Lobe::GLOSSY | Lobe::REFLECTION, 1.0)
        } else if self.is_matched() {
            // The facet decided only between reflection and transmission. Averaged over facets, the transmitted
            // direction is straight.
            let kept = self.specular.refracted(f.reflectance) * self.to_specular.at(up.0.z);
            let weight = self.transmission_color * (kept * (1.0 - f.reflectance) / (probability * (1.0 - q)));
            delta(-wo, weight, probability * (1.0 - q), Lobe::TRANSMISSION, 1.0)
        } else {
            let wi = refract(up, m, eta, f.cos_t);
            let wi = (wi.0.z < 0.0).then(|| mirrored_if(below, wi))?;
            let (value, pdf) = self.eval_pdf(wo, wi);
            finite_sample(wi, value, pdf, Lobe::GLOSSY | Lobe::TRANSMISSION, eta)
        }
    }

    /// The reflectance above the surface with compensation: metal by its reflectance at normal incidence (Turquin
    /// 2019), the refracting share as a clear boundary. The light that the rest loses reaches the diffuse lobe.
    #[cold]
    fn compensated_above(&self, wo: LocalDir, exact: f32, weight: f32) -> Rgb {
        let once = compensation::reflected_once(&self.ggx, wo);
        let metal = Rgb::WHITE + self.specular.metal() * ((1.0 - once) / once);
        let clear = 1.0 + self.spec_trans * (self.clear_gain(wo, self.eta) - 1.0);
        self.specular.compensated(exact, weight, clear, metal)
    }

    /// The compensation factor of both lobes of the refracting share; one if the reflection is brighter than that of
    /// the index.
    #[inline]
    fn clear_gain(&self, wo: LocalDir, eta: f32) -> f32 {
        if self.compensated && !self.is_matched() && !self.specular.is_brighter() {
            1.0 / compensation::scattered_once(&self.ggx, wo, eta)
        } else {
            1.0
        }
    }

    /// Probability of reflection at a facet of the refracting boundary, in proportion to the energy of each side.
    #[inline]
    fn reflection_probability(&self, reflected: Rgb, fresnel: f32) -> f32 {
        let (r, t) = (reflected.luminance(), (1.0 - fresnel) * self.transmission_color.luminance());
        if r > 0.0 { r / (r + t) } else { 0.0 }
    }

    /// Probabilities of the lobes above the surface, in proportion to their expected energy; `None` if all are zero.
    #[inline]
    fn choose<const RICH: bool>(&self, wo: LocalDir) -> Option<Choice> {
        // Schlick's approximation is sufficient for the choice. The floor keeps the probability of a lobe that is black
        // at normal incidence above zero, because its tilted facets are not black.
        let w = schlick_weight(wo.0.z).max(0.01);
        let f0 = self.specular.dielectric_f0();
        let f = if self.eta == 1.0 { 0.0 } else { f0 + (1.0 - f0) * w };
        let reflected = self.specular.reflectance(f, w).luminance();
        let refracted = if RICH { (1.0 - f) * self.transmission_color.luminance() } else { 0.0 };
        let specular = reflected + refracted;
        let coat = if RICH && self.coat > 0.0 { self.coat * (0.04 + 0.96 * w) } else { 0.0 };
        let diffuse_share = if self.diffuse_luminance > 0.0 { self.diffuse_share(wo) } else { 0.0 };
        let diffuse = self.diffuse_luminance * diffuse_share + if RICH { self.sheen_luminance } else { 0.0 };
        let to_specular = if RICH { self.to_specular.at(wo.0.z) } else { 1.0 };
        let sum = diffuse + specular + coat;
        let scale = 1.0 / sum;
        (sum > 0.0 && scale.is_finite()).then_some(Choice {
            diffuse: diffuse * scale,
            coat: coat * scale,
            specular: specular * scale,
            diffuse_share,
            to_specular,
        })
    }

    /// Schlick's weight at a facet above the surface. Toward a thinner medium it uses the angle of refraction, so that
    /// it reaches one at the critical angle (Burley 2015).
    #[inline]
    fn schlick_weight(&self, cos_d: f32, cos_t: f32) -> f32 {
        schlick_weight(if self.eta > 1.0 { cos_d } else { cos_t })
    }

    /// True if there is no boundary with refraction.
    #[inline]
    fn is_matched(&self) -> bool {
        (self.eta - 1.0).abs() < MATCHED_INDEX
    }
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
