//! `[[material]]` of a job: changes of the materials of a scene, and new ones.

use super::overrides::{matches, unique};
use super::{Job, check};
use crate::error::InputError;
use crate::names::suggestion;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, Material, Medium, SceneBuilder, Surface, Volume};
use serde::Deserialize;

/// `[[material]]`: a given value replaces the factor of that name. Textures still multiply it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialOverride {
    /// Name of the material, or a pattern with `*` (any characters) and `?` (any one).
    pub name: String,
    /// `true` makes a new material of this name: a grey dielectric before the other keys. Default false.
    #[serde(default)]
    pub new: bool,
    /// `false` removes all textures of the material first.
    pub textures: Option<bool>,
    /// Base colour, 0 to 1.
    #[serde(default, deserialize_with = "check::color")]
    pub base_color: Option<Rgb>,
    /// Coverage, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub alpha: Option<f32>,
    /// `"opaque"`, `"mask"` or `"blend"`.
    pub alpha_mode: Option<AlphaKind>,
    /// Threshold of `alpha_mode = "mask"`, 0 to 1. Default 0.5.
    #[serde(default, deserialize_with = "check::unit")]
    pub alpha_cutoff: Option<f32>,
    /// 0 dielectric to 1 metal.
    #[serde(default, deserialize_with = "check::unit")]
    pub metallic: Option<f32>,
    /// Perceptual roughness, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub roughness: Option<f32>,
    /// Scales the normal map.
    #[serde(default, deserialize_with = "check::factor")]
    pub normal_scale: Option<f32>,
    /// Emitted radiance [W/(m^2 sr)].
    #[serde(default, deserialize_with = "check::light")]
    pub emission: Option<Rgb>,
    /// Is the emission two-sided?
    pub double_sided: Option<bool>,
    /// Does it emit its base colour and scatter nothing?
    pub unlit: Option<bool>,
    /// Index of refraction, 1 to 10.
    #[serde(default, deserialize_with = "check::ior")]
    pub ior: Option<f32>,
    /// Strength of the dielectric reflection, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub specular: Option<f32>,
    /// Tint of the dielectric reflection.
    #[serde(default, deserialize_with = "check::color")]
    pub specular_color: Option<Rgb>,
    /// Share of the base colour's hue in the dielectric reflection, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub specular_tint: Option<f32>,
    /// Share of the non-metallic light that is transmitted, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub transmission: Option<f32>,
    /// Share of the diffuse light that leaves on the other side, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub diffuse_transmission: Option<f32>,
    /// Colour of that light.
    #[serde(default, deserialize_with = "check::color")]
    pub diffuse_transmission_color: Option<Rgb>,
    /// `true`: the closed boundary of a solid that refracts, absorbs and scatters; `false`: a thin sheet.
    pub solid: Option<bool>,
    /// Where solids touch or overlap, the one with the highest priority is used, and of equal ones the smaller solid.
    /// Default 0.
    #[serde(default, deserialize_with = "check::priority")]
    pub priority: Option<i32>,
    /// Colour of white light after `attenuation_distance` in the solid, each channel above 0.
    #[serde(default, deserialize_with = "check::positive_color")]
    pub attenuation_color: Option<Rgb>,
    /// Distance \[m\] for `attenuation_color`; written as `"2mm"`.
    #[serde(default, deserialize_with = "check::distance")]
    pub attenuation_distance: Option<f32>,
    /// The single-scattering albedo, 0 to 1: the part of this attenuation that is scattered. The rest is absorbed.
    #[serde(default, deserialize_with = "check::color")]
    pub scattering_albedo: Option<Rgb>,
    /// Absorption coefficient of the solid [1/m]. It replaces the one from the attenuation. Written as `"0.5/mm"`.
    #[serde(default, deserialize_with = "check::coefficient")]
    pub absorption: Option<Rgb>,
    /// Scattering coefficient of the solid [1/m]. It replaces the one from the attenuation. Written as `"0.5/mm"`.
    #[serde(default, deserialize_with = "check::coefficient")]
    pub scattering: Option<Rgb>,
    /// Mean cosine g of the deflection by scattering (Henyey and Greenstein), -0.9999 to 0.9999.
    #[serde(default, deserialize_with = "check::mean_cosine")]
    pub scattering_anisotropy: Option<f32>,
    /// Strength of a clear coat, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub clearcoat: Option<f32>,
    /// Roughness of the clear coat, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub clearcoat_roughness: Option<f32>,
    /// Sheen colour, 0 to 1.
    #[serde(default, deserialize_with = "check::color")]
    pub sheen_color: Option<Rgb>,
    /// Sheen roughness, 0 to 1.
    #[serde(default, deserialize_with = "check::unit")]
    pub sheen_roughness: Option<f32>,
    /// Anisotropy, -1 to 1; positive stretches highlights along the tangent.
    #[serde(default, deserialize_with = "check::signed_unit")]
    pub anisotropy: Option<f32>,
    /// Rotation of the anisotropy's axis \[rad\]; written as `"30deg"`.
    #[serde(default, deserialize_with = "check::angle")]
    pub anisotropy_rotation: Option<f32>,
}

/// `alpha_mode` of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AlphaKind {
    /// Covers fully.
    Opaque,
    /// Covers where alpha reaches the cutoff.
    Mask,
    /// Covers stochastically.
    Blend,
}

/// A new material of a job: a grey dielectric of medium roughness, [`Material::default`] with a base colour of 0.5.
pub(super) fn new_material(name: &str) -> Material {
    Material { name: name.into(), base_color: Rgb::splat(0.5), ..Material::default() }
}

impl Job {
    /// Checks without a scene: keys of `[[material]]` that contradict each other.
    pub(super) fn check_materials(&self) -> Result<(), InputError> {
        for (i, m) in self.materials.iter().enumerate() {
            if m.new && (m.name.is_empty() || m.name.contains(['*', '?'])) {
                let problem = "a new material cannot have a pattern as its name, or none";
                let help = "write a name without `*` and `?`";
                return Err(self.source.error_at_key(&["material", &i.to_string(), "name"], problem, help));
            }
            let by_color = [
                ("attenuation_color", m.attenuation_color.is_some()),
                ("attenuation_distance", m.attenuation_distance.is_some()),
                ("scattering_albedo", m.scattering_albedo.is_some()),
            ];
            let outright = [("absorption", m.absorption.is_some()), ("scattering", m.scattering.is_some())];
            let given = |keys: &[(&'static str, bool)]| keys.iter().find(|(_, given)| *given).map(|(key, _)| *key);
            if let (Some(first), Some(second)) = (given(&by_color), given(&outright)) {
                let problem = format!("`{first}` and `{second}` both define the light inside the solid");
                let help = "describe the medium by `attenuation_color`, `attenuation_distance` and `scattering_albedo`, or by `absorption` and `scattering`";
                return Err(self.source.error_at_key(&["material", &i.to_string(), second], problem, help));
            }
        }
        Ok(())
    }

    /// Adds the materials with `new = true`, so that objects can have them.
    pub(super) fn add_new_materials(&self, scene: &mut SceneBuilder) -> Result<(), InputError> {
        for (i, change) in self.materials.iter().enumerate().filter(|(_, m)| m.new) {
            if scene.materials.iter().any(|m| m.name == change.name) {
                let problem = format!("there is already a material named \"{}\"", change.name);
                let help = "write another name, or remove `new` to change the existing one";
                return Err(self.source.error_at_key(&["material", &i.to_string(), "name"], problem, help));
            }
            scene.add_material(new_material(&change.name));
        }
        Ok(())
    }

    /// Changes the materials that entry `i` selects.
    pub(super) fn change_materials(
        &self,
        i: usize,
        change: &MaterialOverride,
        scene: &mut SceneBuilder,
    ) -> Result<(), InputError> {
        let mut found = false;
        for material in scene.materials.iter_mut().filter(|m| matches(&change.name, &m.name)) {
            found = true;
            apply(change, material);
            if let Some(key) = medium_key(change).filter(|_| material.surface == Surface::Thin) {
                return Err(self.source.error_at_key(
                    &["material", &i.to_string(), key],
                    format!("material \"{}\" is a thin sheet, which has no inside", material.name),
                    "add `solid = true` if its meshes are closed, or tint `base_color`",
                ));
            }
        }
        if found {
            return Ok(());
        }
        let known = unique(scene.materials.iter().map(|m| m.name.as_str()));
        let problem = format!("the scene has no material named \"{}\"", change.name);
        let help = suggestion(&change.name, "materials", &known);
        Err(self.source.error_at_key(&["material", &i.to_string(), "name"], problem, help))
    }
}

fn apply(change: &MaterialOverride, m: &mut Material) {
    if change.textures == Some(false) {
        drop_textures(m);
    }
    fn set<T: Copy>(slot: &mut T, value: Option<T>) {
        if let Some(value) = value {
            *slot = value;
        }
    }
    set(&mut m.base_color, change.base_color);
    set(&mut m.alpha, change.alpha);
    set(&mut m.metallic, change.metallic);
    set(&mut m.roughness, change.roughness);
    set(&mut m.normal_scale, change.normal_scale);
    set(&mut m.emission, change.emission);
    set(&mut m.double_sided, change.double_sided);
    set(&mut m.unlit, change.unlit);
    set(&mut m.ior, change.ior);
    set(&mut m.specular, change.specular);
    set(&mut m.specular_color, change.specular_color);
    set(&mut m.specular_tint, change.specular_tint);
    set(&mut m.transmission, change.transmission);
    set(&mut m.diffuse_transmission, change.diffuse_transmission);
    set(&mut m.diffuse_transmission_color, change.diffuse_transmission_color);
    set(&mut m.clearcoat, change.clearcoat);
    set(&mut m.clearcoat_roughness, change.clearcoat_roughness);
    set(&mut m.sheen_color, change.sheen_color);
    set(&mut m.sheen_roughness, change.sheen_roughness);
    set(&mut m.anisotropy, change.anisotropy);
    set(&mut m.anisotropy_rotation, change.anisotropy_rotation);
    let old_cutoff = if let AlphaMode::Mask { cutoff } = m.alpha_mode { Some(cutoff) } else { None };
    let cutoff = change.alpha_cutoff.or(old_cutoff).unwrap_or(0.5);
    match change.alpha_mode {
        Some(AlphaKind::Opaque) => m.alpha_mode = AlphaMode::Opaque,
        Some(AlphaKind::Mask) => m.alpha_mode = AlphaMode::Mask { cutoff },
        Some(AlphaKind::Blend) => m.alpha_mode = AlphaMode::Blend,
        None if old_cutoff.is_some() => m.alpha_mode = AlphaMode::Mask { cutoff },
        None => {}
    }
    match (change.solid, m.surface) {
        (Some(true), Surface::Thin) => {
            m.surface = Surface::Solid(Volume::default());
        }
        (Some(false), _) => m.surface = Surface::Thin,
        _ => {}
    }
    if let Surface::Solid(volume) = &mut m.surface {
        set(&mut volume.attenuation_color, change.attenuation_color);
        set(&mut volume.attenuation_distance, change.attenuation_distance);
        set(&mut volume.scattering_albedo, change.scattering_albedo);
        set(&mut volume.scattering_anisotropy, change.scattering_anisotropy);
        set(&mut volume.priority, change.priority);
        if change.absorption.is_some() || change.scattering.is_some() {
            // One coefficient is replaced. The other keeps the value from the attenuation.
            let medium = Medium::new(volume);
            *volume = Volume {
                absorption: change.absorption.unwrap_or(medium.absorption),
                scattering: change.scattering.unwrap_or(medium.scattering),
                scattering_anisotropy: volume.scattering_anisotropy,
                priority: volume.priority,
                ..Volume::default()
            };
        }
    }
}

/// The first key about the interior of a solid.
fn medium_key(change: &MaterialOverride) -> Option<&'static str> {
    let keys = [
        ("attenuation_color", change.attenuation_color.is_some()),
        ("attenuation_distance", change.attenuation_distance.is_some()),
        ("scattering_albedo", change.scattering_albedo.is_some()),
        ("absorption", change.absorption.is_some()),
        ("scattering", change.scattering.is_some()),
        ("scattering_anisotropy", change.scattering_anisotropy.is_some()),
        ("priority", change.priority.is_some()),
    ];
    keys.into_iter().find(|(_, given)| *given).map(|(key, _)| key)
}

fn drop_textures(m: &mut Material) {
    m.base_color_texture = None;
    m.alpha_texture = None;
    m.metallic_texture = None;
    m.roughness_texture = None;
    m.normal_texture = None;
    m.emission_texture = None;
    m.specular_texture = None;
    m.specular_color_texture = None;
    m.transmission_texture = None;
    m.diffuse_transmission_texture = None;
    m.diffuse_transmission_color_texture = None;
    m.clearcoat_texture = None;
    m.clearcoat_roughness_texture = None;
    m.sheen_color_texture = None;
    m.anisotropy_texture = None;
}
