//! Descriptions of materials: factors, textures, and the volume inside a surface.

pub mod finish;
pub mod texture;
pub(crate) mod texture_eval;

use crate::light::emission_profile::EmissionProfile;
use crate::material::finish::{Finish, Grain};
use crate::material::texture::Texture;
use dunkelfeld_radiometry::Rgb;

/// A texture of which one channel is read.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ChannelTexture {
    /// The texture.
    pub texture: Texture,
    /// 0 red, 1 green, 2 blue, 3 alpha.
    pub channel: u8,
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

/// A material: the metallic-roughness model with its glTF extensions, in linear values. Every factor multiplies its
/// texture.
///
/// `Default` is glTF's default material with ior 1.5, except for two values. White, metallic 1 and roughness 1 are the
/// defaults of a glTF *file*. Here metallic is 0 and roughness is 0.5, which suit a program that sets only some fields.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Material {
    /// Name, for overrides and reports.
    pub name: String,
    /// Base colour in \[0, 1\].
    pub base_color: Rgb,
    /// RGB multiplies `base_color`, its alpha multiplies `alpha`.
    pub base_color_texture: Option<Texture>,
    /// Coverage in \[0, 1\], interpreted by `alpha_mode`.
    pub alpha: f32,
    /// A separate coverage map (OBJ `map_d`).
    pub alpha_texture: Option<ChannelTexture>,
    /// Interpretation of coverage.
    pub alpha_mode: AlphaMode,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Multiplies `metallic`.
    pub metallic_texture: Option<ChannelTexture>,
    /// Perceptual roughness in \[0, 1\]; GGX alpha is its square.
    pub roughness: f32,
    /// Multiplies `roughness`.
    pub roughness_texture: Option<ChannelTexture>,
    /// Tangent-space normal map.
    pub normal_texture: Option<Texture>,
    /// Scales x and y of the normal map.
    pub normal_scale: f32,
    /// Emitted radiance [W/(m^2 sr)] of the front, and of the back where `double_sided`.
    pub emission: Rgb,
    /// Multiplies `emission`.
    pub emission_texture: Option<Texture>,
    /// True if the surface emits on both sides. (It always scatters on both.)
    pub double_sided: bool,
    /// Angular distribution of the emitted radiance; `emission` is its value along the normal where the profile is 1
    /// there.
    pub emission_profile: EmissionProfile,
    /// True if rays that come from behind pass the surface as if it were absent. A lamp in front of a camera is then
    /// invisible to it, like the image of a lamp in a beam splitter.
    pub is_back_invisible: bool,
    /// No scattering: the base colour is emitted as radiance (KHR_materials_unlit).
    pub unlit: bool,
    /// Index of refraction; inside another solid the ratio of both indices is used.
    pub ior: f32,
    /// Strength of the dielectric reflection (KHR_materials_specular).
    pub specular: f32,
    /// Multiplies `specular`.
    pub specular_texture: Option<ChannelTexture>,
    /// Tint of the dielectric reflection at normal incidence.
    pub specular_color: Rgb,
    /// Multiplies `specular_color`.
    pub specular_color_texture: Option<Texture>,
    /// Share of the non-metallic light that is transmitted instead of scattered diffusely.
    pub transmission: f32,
    /// Multiplies `transmission`.
    pub transmission_texture: Option<ChannelTexture>,
    /// Share of the diffuse light that leaves on the other side (KHR_materials_diffuse_transmission).
    pub diffuse_transmission: f32,
    /// Multiplies `diffuse_transmission`.
    pub diffuse_transmission_texture: Option<ChannelTexture>,
    /// Colour of that light.
    pub diffuse_transmission_color: Rgb,
    /// Multiplies `diffuse_transmission_color`.
    pub diffuse_transmission_color_texture: Option<Texture>,
    /// Thin sheet or boundary of a solid.
    pub surface: Surface,
    /// Strength of a clear coat.
    pub clearcoat: f32,
    /// Multiplies `clearcoat`.
    pub clearcoat_texture: Option<ChannelTexture>,
    /// Perceptual roughness of the coat.
    pub clearcoat_roughness: f32,
    /// Multiplies `clearcoat_roughness`.
    pub clearcoat_roughness_texture: Option<ChannelTexture>,
    /// Sheen colour (KHR_materials_sheen).
    pub sheen_color: Rgb,
    /// Multiplies `sheen_color`.
    pub sheen_color_texture: Option<Texture>,
    /// Sheen roughness (kept for reports; the sheen lobe has a fixed shape).
    pub sheen_roughness: f32,
    /// Anisotropy in \[-1, 1\]; positive stretches highlights along the tangent.
    pub anisotropy: f32,
    /// Rotation of the anisotropy's axis from the tangent \[rad\].
    pub anisotropy_rotation: f32,
    /// RG: direction, B: strength (KHR_materials_anisotropy).
    pub anisotropy_texture: Option<Texture>,
    /// Direction of the grooves. The axis of the anisotropy lies across them, instead of along the tangents of the mesh.
    pub grain: Option<Grain>,
    /// The height field of the surface. It needs a surface that no light passes.
    pub finish: Option<Finish>,
    /// Share of the hue of the base colour in the tint of the dielectric reflection.
    pub specular_tint: f32,
}

impl Material {
    /// All textures of the material.
    pub fn textures(&self) -> impl Iterator<Item = &Texture> {
        let colors = [
            &self.base_color_texture,
            &self.normal_texture,
            &self.emission_texture,
            &self.specular_color_texture,
            &self.sheen_color_texture,
            &self.anisotropy_texture,
            &self.diffuse_transmission_color_texture,
        ];
        let channels = [
            &self.alpha_texture,
            &self.metallic_texture,
            &self.roughness_texture,
            &self.specular_texture,
            &self.transmission_texture,
            &self.diffuse_transmission_texture,
            &self.clearcoat_texture,
            &self.clearcoat_roughness_texture,
        ];
        colors
            .into_iter()
            .filter_map(Option::as_ref)
            .chain(channels.into_iter().filter_map(|t| t.as_ref().map(|t| &t.texture)))
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Rgb::WHITE,
            base_color_texture: None,
            alpha: 1.0,
            alpha_texture: None,
            alpha_mode: AlphaMode::Opaque,
            metallic: 0.0,
            metallic_texture: None,
            roughness: 0.5,
            roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission: Rgb::BLACK,
            emission_texture: None,
            double_sided: false,
            emission_profile: EmissionProfile::Lambertian,
            is_back_invisible: false,
            unlit: false,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Rgb::WHITE,
            specular_color_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            diffuse_transmission: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color: Rgb::WHITE,
            diffuse_transmission_color_texture: None,
            surface: Surface::Thin,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            sheen_color: Rgb::BLACK,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            anisotropy_texture: None,
            grain: None,
            finish: None,
            specular_tint: 0.0,
        }
    }
}
