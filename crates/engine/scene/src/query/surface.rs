//! From a material and a place on a mesh to the parameters of a BSDF.
//!
//! | material | BSDF |
//! |---|---|
//! | `unlit` | absorber that emits its base colour |
//! | `transmission` 1, metallic 0, solid | dielectric, smooth where roughness is 0; half of the base colour's density at each face |
//! | `transmission` 1, metallic 0, thin | thin sheet, tinted by the base colour |
//! | `transmission` t, solid | principled with `spec_trans` = t |
//! | `transmission` t, thin | thin sheet with probability t (1 - metallic), else principled |
//! | `diffuse_transmission` d, `transmission` 0 or the rest of a thin sheet | translucent: principled, with the share d of its diffuse light transmitted |
//! | all others | principled |
//!
//! `docs/materials.md` has the same table for users, and the source of each parameter.

use crate::light::emission_profile::EmissionProfile;
use crate::material::finish::Relief;
use crate::material::texture::{Image, Texture};
use crate::material::{AlphaMode, Material, SMOOTH_ROUGHNESS, Surface};
use crate::media::medium::Medium;
use dunkelfeld_bsdf::{Bsdf, Dielectric, Principled, PrincipledModel, PrincipledParams, ThinSheet, Translucent};
use dunkelfeld_geometry::{Vec2, Vec4};
use dunkelfeld_lanes::cos_sin_of_angle;
use dunkelfeld_radiometry::Rgb;

/// Texture coordinates and vertex colour of a place on a mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TexturePoint {
    pub(crate) uvs: [Vec2; 2],
    pub(crate) color: Vec4,
}

impl TexturePoint {
    /// The place that is used for a surface with constant parameters.
    pub(crate) const ANYWHERE: Self = Self { uvs: [Vec2::ZERO; 2], color: Vec4::ONE };

    /// The value of a texture.
    #[inline]
    pub(crate) fn eval(&self, texture: &Texture, images: &[Image]) -> [f32; 4] {
        texture.eval(images, self.uvs[usize::from(texture.uv_set & 1)])
    }
}

/// A material with all values precomputed that do not depend on the place.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct CompiledMaterial {
    /// The BSDF of a material with constant parameters.
    constant: Option<Constant>,
    /// Absorption coefficient of the solid [1/m], zero if it is none.
    pub(crate) absorption: Rgb,
    /// True if light can cross the surface into or out of a solid.
    pub(crate) is_solid: bool,
    /// True if light passes it in one direction only, at least at some places.
    pub(crate) is_smooth_clear: bool,
    /// True if the surface is one of two kinds at random.
    pub(crate) is_mixture: bool,
    /// True if light from behind is scattered to the front (all transmitting materials).
    pub(crate) both_sides: bool,
    /// True if the coverage must be evaluated.
    pub(crate) has_coverage: bool,
    /// True if rays pass the surface from behind.
    pub(crate) is_back_invisible: bool,
    /// Coverage, if it is constant.
    constant_coverage: Option<f32>,
    /// True if the parameters depend on the place.
    pub(crate) varies: bool,
    /// True if the frame needs a tangent: a normal map, or anisotropic roughness.
    pub(crate) needs_tangent: bool,
    pub(crate) emits: bool,
    /// True if the emission or the coverage of an emitter must be evaluated at each place.
    pub(crate) has_varying_radiance: bool,
    /// For the face of a clear solid with constant parameters: the factor on light that passes it where the index of
    /// refraction is the same on both sides.
    pub(crate) clear_tint: Option<Rgb>,
    /// The height field.
    pub(crate) relief: Option<Relief>,
    /// True if some part of it has rounded edges.
    #[serde(skip)]
    pub(crate) has_rounded_edges: bool,
    options: SurfaceOptions,
}

/// Options of all surfaces of a scene.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(crate) struct SurfaceOptions {
    pub(crate) energy_compensation: bool,
    pub(crate) principled: PrincipledModel,
}

#[derive(Clone, Copy, Debug, serde::Serialize)]
#[expect(clippy::large_enum_variant, reason = "a box would be allocated at each textured point")]
enum Constant {
    One(Bsdf),
    /// The first with the given probability, else the second.
    Either(f32, Bsdf, Bsdf),
}

impl Constant {
    #[inline]
    fn compensated_if(self, on: bool) -> Self {
        match self {
            Self::One(b) if on => Self::One(b.with_energy_compensation()),
            Self::Either(p, a, b) if on => Self::Either(p, a.with_energy_compensation(), b.with_energy_compensation()),
            same => same,
        }
    }

    #[inline]
    fn pick(&self, u: f32) -> &Bsdf {
        match self {
            Self::One(b) => b,
            Self::Either(p, a, _) if u < *p => a,
            Self::Either(_, _, b) => b,
        }
    }
}

impl CompiledMaterial {
    /// `is_painted`: true if some mesh of this material has vertex colours.
    pub(crate) fn new(m: &Material, is_painted: bool, options: SurfaceOptions, images: &[Image]) -> Self {
        let transmits = m.transmission.factor > 0.0 && !m.is_metal();
        let diffuses = m.diffuse_transmission.share.factor > 0.0 && !m.is_metal();
        let is_solid = matches!(m.surface, Surface::Solid(_)) && (transmits || diffuses);
        let absorption = match &m.surface {
            Surface::Solid(v) if is_solid => Medium::new(v).absorption,
            _ => Rgb::BLACK,
        };
        let has_coverage = m.alpha_mode != AlphaMode::Opaque;
        let has_profile = m.emission_profile != EmissionProfile::Lambertian;
        let others = [m.alpha.texture, m.emission.texture, m.normal_map.texture, m.height_texture()];
        let varies = is_painted || m.textures().count() > others.iter().flatten().count();
        let constant = (!varies).then(|| scatter(m, m.ior, &[], &TexturePoint::ANYWHERE, options));
        let fades = is_painted || m.alpha.texture.is_some() || m.base_color.texture.is_some();
        let constant_coverage = (!fades).then(|| coverage(m, &[], &TexturePoint::ANYWHERE));
        let needs_tangent = m.normal_map.texture.is_some() || m.anisotropy.strength.factor != 0.0;
        let is_mixture = transmits && matches!(m.surface, Surface::Thin);
        let sharp = m.roughness.factor < SMOOTH_ROUGHNESS || m.roughness.texture.is_some();
        let is_full = m.transmission.factor >= 1.0;
        let is_clear = is_solid && is_full && m.metallic.factor <= 0.0 && !has_coverage && !m.emits();
        let is_even =
            m.base_color.texture.is_none() && m.transmission.texture.is_none() && m.metallic.texture.is_none();
        let tint = m.base_color.factor.map(|c| c.clamp(0.0, 1.0).sqrt());
        Self {
            clear_tint: (is_clear && !is_painted && is_even).then_some(tint),
            constant,
            absorption,
            is_solid,
            is_smooth_clear: transmits && sharp && (!is_solid || is_full),
            is_mixture,
            both_sides: transmits || diffuses,
            has_coverage,
            is_back_invisible: m.alpha_mode == AlphaMode::FrontOnly,
            constant_coverage,
            varies,
            needs_tangent,
            emits: m.emits(),
            has_varying_radiance: m.unlit || m.emission.texture.is_some() || has_coverage || has_profile,
            relief: m.height.as_ref().and_then(|height| Relief::new(height, images)),
            has_rounded_edges: false,
            options,
        }
    }

    /// True if it is random: present or absent, or one of two kinds.
    #[inline]
    pub(crate) fn is_stochastic(&self) -> bool {
        self.has_coverage || self.is_mixture
    }

    /// The probability that light meets the surface. `at` is called only if the coverage is not constant.
    #[inline]
    pub(crate) fn coverage(&self, m: &Material, images: &[Image], at: impl FnOnce() -> TexturePoint) -> f32 {
        self.constant_coverage.unwrap_or_else(|| coverage(m, images, &at()))
    }

    /// The BSDF at a place where the index of refraction inside over outside is `eta`. `u` in `[0, 1)` chooses between
    /// the two kinds of a partly transmitting thin sheet.
    pub(crate) fn bsdf_between(&self, m: &Material, eta: f32, images: &[Image], at: &TexturePoint, u: f32) -> Bsdf {
        *scatter(m, eta, images, at, self.options).pick(u)
    }

    /// The BSDF of a material with constant parameters, with `u` as in [`Self::bsdf_between`].
    #[inline]
    pub(crate) fn constant_bsdf(&self, u: f32) -> Option<&Bsdf> {
        Some(self.constant.as_ref()?.pick(u))
    }

    /// The BSDF of a material that has one for all points.
    #[inline]
    pub(crate) fn only_bsdf(&self) -> Option<&Bsdf> {
        match self.constant.as_ref()? {
            Constant::One(bsdf) => Some(bsdf),
            Constant::Either(..) => None,
        }
    }
}

/// Base colour at a place.
#[inline]
fn base_color(m: &Material, images: &[Image], at: &TexturePoint) -> Rgb {
    m.base_color.at(images, at) * Rgb::new(at.color.x, at.color.y, at.color.z)
}

/// The probability that light meets the surface at a place.
pub(crate) fn coverage(m: &Material, images: &[Image], at: &TexturePoint) -> f32 {
    let mut alpha = m.alpha.at(images, at) * at.color.w;
    if let Some(t) = &m.base_color.texture {
        alpha *= at.eval(t, images)[3];
    }
    match m.alpha_mode {
        AlphaMode::Opaque | AlphaMode::FrontOnly => 1.0,
        AlphaMode::Mask { cutoff } => f32::from(u8::from(alpha >= cutoff)),
        AlphaMode::Blend => alpha.clamp(0.0, 1.0),
    }
}

/// Emitted radiance [W/(m^2 sr)] of the emitting side at a place.
pub(crate) fn emission(m: &Material, images: &[Image], at: &TexturePoint) -> Rgb {
    let emitted = m.emission.at(images, at);
    if m.unlit { emitted + base_color(m, images, at) } else { emitted }
}

/// Mean emitted radiance over all places, for choosing lights: that of a Lambertian surface of the same power.
pub(crate) fn mean_emission(m: &Material, images: &[Image]) -> Rgb {
    let emitted = m.emission.mean(images) * (m.emission_profile.exitance() as f32);
    if m.unlit { emitted + m.base_color.mean(images) } else { emitted }
}

/// The BSDF parameters at a place; `eta` is the index of refraction inside over outside.
fn scatter(m: &Material, eta: f32, images: &[Image], at: &TexturePoint, options: SurfaceOptions) -> Constant {
    lobes(m, eta, images, at, options.principled).compensated_if(options.energy_compensation)
}

/// [`scatter`] without compensation.
fn lobes(m: &Material, eta: f32, images: &[Image], at: &TexturePoint, model: PrincipledModel) -> Constant {
    if m.unlit {
        return Constant::One(Bsdf::Absorber);
    }
    let base = base_color(m, images, at);
    let metallic = m.metallic.at(images, at).clamp(0.0, 1.0);
    let roughness = m.roughness.at(images, at).clamp(0.0, 1.0);
    let transmission = m.transmission.at(images, at).clamp(0.0, 1.0);
    let specular = m.specular.strength.at(images, at);
    let specular_color = m.specular.color.at(images, at);
    let clear = transmission * (1.0 - metallic);
    let alpha = if roughness < SMOOTH_ROUGHNESS { 0.0 } else { roughness * roughness };
    let solid = matches!(m.surface, Surface::Solid(_));
    if solid && clear >= 1.0 {
        return Constant::One(Bsdf::Dielectric(Dielectric::new(
            eta,
            alpha,
            Rgb::WHITE,
            base.map(|c| c.max(0.0).sqrt()),
        )));
    }
    let sheen_color = m.sheen.color.at(images, at);
    let clearcoat = m.clearcoat.strength.at(images, at);
    let coat_roughness = m.clearcoat.roughness.at(images, at);
    let passed = m.diffuse_transmission.share.at(images, at).clamp(0.0, 1.0);
    let principled = |metallic: f32, spec_trans: f32| {
        let surface = Principled::new(&PrincipledParams {
            base_color: base,
            metallic,
            roughness,
            anisotropic: m.anisotropy.strength.at(images, at),
            eta,
            specular_factor: specular,
            specular_color,
            spec_tint: m.specular.tint,
            spec_trans,
            sheen: 1.0,
            sheen_color,
            sheen_tint: 0.0,
            // Burley's coat of strength 1 reflects a quarter of a lacquer of index 1.5, and glTF's coat of strength 1
            // is the lacquer.
            clearcoat: 4.0 * clearcoat,
            // Burley's coat has GGX-like alpha from 0.1 (satin) to 0.001 (gloss).
            clearcoat_gloss: ((0.1 - coat_roughness * coat_roughness) / 0.099).clamp(0.0, 1.0),
            model,
        });
        if passed > 0.0 && spec_trans <= 0.0 {
            let tint = m.diffuse_transmission.color.at(images, at);
            Bsdf::Translucent(Translucent::new(surface, passed, tint * (passed * (1.0 - metallic))))
        } else {
            Bsdf::Principled(surface)
        }
    };
    if solid {
        return Constant::One(principled(metallic, transmission));
    }
    if clear <= 0.0 {
        return Constant::One(principled(metallic, 0.0));
    }
    let sheet = Bsdf::ThinSheet(ThinSheet::new(eta, alpha, specular_color * specular.min(1.0), base));
    if clear >= 1.0 {
        return Constant::One(sheet);
    }
    // The remainder without the sheet: all of the metal, and the opaque share of the dielectric.
    Constant::Either(clear, sheet, principled(metallic / (1.0 - clear), 0.0))
}

/// Cosine and sine of the angle from the tangent to the axis of the anisotropy (KHR_materials_anisotropy: red and green
/// of the texture are a direction).
pub(crate) fn anisotropy_axis(m: &Material, images: &[Image], at: &TexturePoint) -> [f32; 2] {
    let (cos, sin) = cos_sin_of_angle(m.anisotropy.rotation);
    match &m.anisotropy.strength.texture {
        None => [cos, sin],
        Some(t) => {
            let [r, g, ..] = at.eval(t, images);
            let Vec2 { x, y } = Vec2::new(2.0 * r - 1.0, 2.0 * g - 1.0).try_normalize().unwrap_or(Vec2::X);
            [cos * x - sin * y, sin * x + cos * y]
        }
    }
}
