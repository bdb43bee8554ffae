//! Descriptions of materials: factors, textures, and the volume inside a surface.

pub mod finish;
pub mod height_image;
pub mod texture;
pub(crate) mod texture_eval;

use crate::light::emission_profile::EmissionProfile;
use crate::material::finish::{Finish, Grain};
use crate::material::height_image::HeightImage;
use crate::material::texture::Texture;
use dunkelfeld_radiometry::Rgb;

/// Below this perceptual roughness a clear surface refracts and reflects in single directions.
pub(crate) const SMOOTH_ROUGHNESS: f32 = 0.01;

/// A colour or a number of a material: a factor, and a texture that multiplies it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Parameter<T> {
    /// The value without a texture.
    pub factor: T,
    /// Multiplies the factor. A number is read from one channel of it.
    pub texture: Option<Texture>,
}

impl<T> From<T> for Parameter<T> {
    fn from(factor: T) -> Self {
        Self { factor, texture: None }
    }
}

/// Interpretation of coverage (alpha).
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize)]
pub enum AlphaMode {
    /// Alpha is ignored: the surface covers fully.
    #[default]
    Opaque,
    /// The surface covers fully where alpha is at least the cutoff, and is absent elsewhere.
    Mask {
        /// Threshold in \[0, 1\].
        cutoff: f32,
    },
    /// Alpha is the probability that light meets the surface: stochastic coverage.
    Blend,
    /// Alpha is ignored: the surface covers rays that meet its front, and is absent for those from behind.
    FrontOnly,
}

/// Content of a solid: a homogeneous medium that absorbs and scatters.
///
/// The coefficients [1/m] are the sum of two descriptions. The first is glTF's: the colour of white light after a
/// distance gives the extinction `-ln(color) / distance`. Of it the share `scattering_albedo` is scattered and the rest
/// absorbed. The second gives `absorption` and `scattering` directly. `Default` is clear: both extinctions are zero.
/// [`Medium`](crate::Medium) is the compiled form.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Volume {
    /// Colour of white light after `attenuation_distance`, per channel in (0, 1].
    pub attenuation_color: Rgb,
    /// Distance \[m\] for `attenuation_color`; infinite means no attenuation.
    pub attenuation_distance: f32,
    /// Single-scattering albedo of this attenuation, per channel in \[0, 1\]: the share that is scattered.
    pub scattering_albedo: Rgb,
    /// Absorption coefficient [1/m], added to the attenuation.
    pub absorption: Rgb,
    /// Scattering coefficient [1/m], added to the attenuation.
    pub scattering: Rgb,
    /// Mean cosine of the deflection by scattering, in (-1, 1): the `g` of Henyey and Greenstein.
    pub scattering_anisotropy: f32,
    /// Priority in places where solids overlap or touch. The solid with the highest priority fills the place (Schmidt
    /// and Budge 2002). Of equal priorities the smaller solid does, so that a solid inside another one needs no
    /// priority.
    pub priority: i32,
}

impl Default for Volume {
    fn default() -> Self {
        Self {
            attenuation_color: Rgb::WHITE,
            attenuation_distance: f32::INFINITY,
            scattering_albedo: Rgb::BLACK,
            absorption: Rgb::BLACK,
            scattering: Rgb::BLACK,
            scattering_anisotropy: 0.0,
            priority: 0,
        }
    }
}

/// Kind of interface of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize)]
pub enum Surface {
    /// A thin sheet or an opaque surface: transmission, if any, passes straight through (KHR_materials_volume absent or
    /// thickness 0).
    #[default]
    Thin,
    /// The closed boundary of a solid that refracts, absorbs and scatters (thickness above 0).
    Solid(Volume),
}

/// Normals of a texture, in tangent space.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct NormalMap {
    /// The normals.
    pub texture: Option<Texture>,
    /// Scales their x and y.
    pub scale: f32,
}

/// The dielectric reflection (KHR_materials_specular).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Specular {
    /// Its strength.
    pub strength: Parameter<f32>,
    /// Tint at normal incidence.
    pub color: Parameter<Rgb>,
    /// Share of the hue of the base colour in this tint.
    pub tint: f32,
}

impl Specular {
    /// No reflection.
    pub const NONE: Self = Self {
        strength: Parameter { factor: 0.0, texture: None },
        color: Parameter { factor: Rgb::WHITE, texture: None },
        tint: 0.0,
    };
}

impl Default for Specular {
    fn default() -> Self {
        Self { strength: 1.0.into(), ..Self::NONE }
    }
}

/// Light that leaves on the other side (KHR_materials_diffuse_transmission).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct DiffuseTransmission {
    /// Share of the diffuse light.
    pub share: Parameter<f32>,
    /// Colour of that light.
    pub color: Parameter<Rgb>,
}

impl Default for DiffuseTransmission {
    fn default() -> Self {
        Self { share: 0.0.into(), color: Rgb::WHITE.into() }
    }
}

/// A clear coat.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Clearcoat {
    /// Its strength.
    pub strength: Parameter<f32>,
    /// Its perceptual roughness.
    pub roughness: Parameter<f32>,
}

/// The sheen of cloth (KHR_materials_sheen).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Sheen {
    /// Its colour.
    pub color: Parameter<Rgb>,
    /// Its roughness (kept for reports; the sheen lobe has a fixed shape).
    pub roughness: f32,
}

/// Highlights that are stretched along a direction (KHR_materials_anisotropy).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Anisotropy {
    /// In \[-1, 1\]; positive stretches along the tangent. Red and green of the texture are a direction.
    pub strength: Parameter<f32>,
    /// Rotation of the axis from the tangent \[rad\].
    pub rotation: f32,
    /// Direction of grooves: the axis lies across them, instead of along the tangents of the mesh.
    pub grain: Option<Grain>,
}

/// Heights of a surface, in the frame of its object: their slopes tilt the normals.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum HeightField {
    /// Of a machined surface.
    Finish(Finish),
    /// Of an image.
    Image(HeightImage),
}

impl HeightField {
    pub(crate) fn is_valid(&self) -> bool {
        match self {
            Self::Finish(finish) => finish.is_valid(),
            Self::Image(image) => image.is_valid(),
        }
    }
}

/// A material: the metallic-roughness model with its glTF extensions, in linear values.
///
/// `Default` is glTF's default material with ior 1.5, except for two values. White, metallic 1 and roughness 1 are the
/// defaults of a glTF *file*. Here metallic is 0 and roughness is 0.5, which suit a program that sets only some fields.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Material {
    /// Name, for overrides and reports.
    pub name: String,
    /// Base colour in \[0, 1\]. The alpha of its texture multiplies `alpha`.
    pub base_color: Parameter<Rgb>,
    /// Coverage in \[0, 1\], interpreted by `alpha_mode`.
    pub alpha: Parameter<f32>,
    /// Interpretation of coverage.
    pub alpha_mode: AlphaMode,
    /// 0 dielectric, 1 metal.
    pub metallic: Parameter<f32>,
    /// Perceptual roughness in \[0, 1\]; GGX alpha is its square.
    pub roughness: Parameter<f32>,
    /// Normal map.
    pub normal_map: NormalMap,
    /// Emitted radiance [W/(m^2 sr)] of the front, and of the back where `double_sided`.
    pub emission: Parameter<Rgb>,
    /// Angular distribution of the emitted radiance; `emission` is its value along the normal where the profile is 1
    /// there.
    pub emission_profile: EmissionProfile,
    /// True if the surface emits on both sides. (It always scatters on both.)
    pub double_sided: bool,
    /// No scattering: the base colour is emitted as radiance (KHR_materials_unlit).
    pub unlit: bool,
    /// Index of refraction; inside another solid the ratio of both indices is used.
    pub ior: f32,
    /// Dielectric reflection.
    pub specular: Specular,
    /// Share of the non-metallic light that is transmitted instead of scattered diffusely.
    pub transmission: Parameter<f32>,
    /// Diffuse light that leaves on the other side.
    pub diffuse_transmission: DiffuseTransmission,
    /// Thin sheet or boundary of a solid.
    pub surface: Surface,
    /// Clear coat.
    pub clearcoat: Clearcoat,
    /// Sheen.
    pub sheen: Sheen,
    /// Anisotropy of the roughness.
    pub anisotropy: Anisotropy,
    /// The height field of the surface. It needs a surface that no light passes.
    pub height: Option<HeightField>,
}

/// Colours, numbers, and other textures of a material.
type Textured<'a> = ([&'a mut Parameter<Rgb>; 5], [&'a mut Parameter<f32>; 9], Vec<&'a mut Option<Texture>>);

impl Material {
    /// True if the surface emits, at some places at least.
    pub fn emits(&self) -> bool {
        self.unlit || !self.emission.factor.is_black()
    }

    /// True if the material is metal at all places, so that it transmits nothing. A texture may reduce the factor, whose
    /// default in glTF is 1.
    pub fn is_metal(&self) -> bool {
        self.metallic.factor >= 1.0 && self.metallic.texture.is_none()
    }

    /// True if no light passes the surface.
    pub fn is_opaque(&self) -> bool {
        self.is_metal() || (self.transmission.factor <= 0.0 && self.diffuse_transmission.share.factor <= 0.0)
    }

    /// True if the surface has a grain or heights in the frame of its object.
    pub fn is_of_object(&self) -> bool {
        self.anisotropy.grain.is_some() || self.height.is_some()
    }

    /// True if the surface is smooth at all places: then it refracts and reflects in single directions.
    pub fn is_smooth(&self) -> bool {
        self.roughness.factor < SMOOTH_ROUGHNESS && self.roughness.texture.is_none()
    }

    /// The texture of the heights.
    pub(crate) fn height_texture(&self) -> Option<Texture> {
        match self.height {
            Some(HeightField::Image(image)) => image.texture,
            _ => None,
        }
    }

    /// All textures of the material.
    pub fn textures(&self) -> impl Iterator<Item = Texture> {
        self.clone().texture_slots().filter_map(|slot| *slot).collect::<Vec<_>>().into_iter()
    }

    /// The places of all textures.
    pub fn texture_slots(&mut self) -> impl Iterator<Item = &mut Option<Texture>> {
        let (colors, numbers, others) = self.parameters();
        let of_colors = colors.map(|color| &mut color.texture);
        of_colors.into_iter().chain(numbers.map(|number| &mut number.texture)).chain(others)
    }

    /// All that can have a texture: colours, numbers, and the textures of normal map and heights.
    pub(crate) fn parameters(&mut self) -> Textured<'_> {
        let colors = [
            &mut self.base_color,
            &mut self.emission,
            &mut self.specular.color,
            &mut self.diffuse_transmission.color,
            &mut self.sheen.color,
        ];
        let numbers = [
            &mut self.alpha,
            &mut self.metallic,
            &mut self.roughness,
            &mut self.specular.strength,
            &mut self.transmission,
            &mut self.diffuse_transmission.share,
            &mut self.clearcoat.strength,
            &mut self.clearcoat.roughness,
            &mut self.anisotropy.strength,
        ];
        let mut others = vec![&mut self.normal_map.texture];
        if let Some(HeightField::Image(image)) = &mut self.height {
            others.push(&mut image.texture);
        }
        (colors, numbers, others)
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Rgb::WHITE.into(),
            alpha: 1.0.into(),
            alpha_mode: AlphaMode::Opaque,
            metallic: 0.0.into(),
            roughness: 0.5.into(),
            normal_map: NormalMap { texture: None, scale: 1.0 },
            emission: Rgb::BLACK.into(),
            emission_profile: EmissionProfile::Lambertian,
            double_sided: false,
            unlit: false,
            ior: 1.5,
            specular: Specular::default(),
            transmission: 0.0.into(),
            diffuse_transmission: DiffuseTransmission::default(),
            surface: Surface::Thin,
            clearcoat: Clearcoat::default(),
            sheen: Sheen::default(),
            anisotropy: Anisotropy::default(),
            height: None,
        }
    }
}
