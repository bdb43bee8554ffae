//! Applies `[[material]]` of a job to the materials of a scene.

use super::finish::GrainSettings;
use super::patterns::{matches, unique};
use super::{AlphaKind, Job, MaterialOverride};
use crate::error::InputError;
use crate::names::suggestion;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, Material, Medium, SceneBuilder, Surface, Volume};
use std::collections::HashMap;

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
                return Err(self.material_error(i, "name", problem, help));
            }
            if m.grain.is_some_and(|grain| grain.grain().is_none()) {
                let problem = "a direction of no length";
                return Err(self.material_error(i, "grain", problem, "write a direction such as [1, 0, 0]"));
            }
            let keys = medium_keys(m);
            let (by_color, outright) = (&keys[..3], &keys[3..5]);
            let given = |keys: &[(&'static str, bool)]| keys.iter().find(|(_, given)| *given).map(|(key, _)| *key);
            if let (Some(first), Some(second)) = (given(by_color), given(outright)) {
                let problem = format!("`{first}` and `{second}` both define the light inside the solid");
                let help = "describe the medium by `attenuation_color`, `attenuation_distance` and `scattering_albedo`, or by `absorption` and `scattering`";
                return Err(self.material_error(i, second, problem, help));
            }
        }
        Ok(())
    }

    /// Adds the materials with `new = true`, so that objects can have them. Returns the entries that define them, by their
    /// place in the scene: an earlier entry does not change them.
    pub(super) fn add_new_materials(&self, scene: &mut SceneBuilder) -> Result<HashMap<usize, usize>, InputError> {
        let mut entries = HashMap::new();
        for (i, change) in self.materials.iter().enumerate().filter(|(_, m)| m.new) {
            if scene.materials.iter().any(|m| m.name == change.name) {
                let problem = format!("there is already a material named \"{}\"", change.name);
                let help = "write another name, or remove `new` to change the existing one";
                return Err(self.material_error(i, "name", problem, help));
            }
            entries.insert(scene.add_material(new_material(&change.name)), i);
        }
        Ok(entries)
    }

    /// Changes the materials that entry `i` selects. `new` contains the entries that define new ones.
    pub(super) fn change_materials(
        &self,
        i: usize,
        change: &MaterialOverride,
        new: &HashMap<usize, usize>,
        scene: &mut SceneBuilder,
    ) -> Result<(), InputError> {
        let (mut found, mut is_later) = (false, false);
        for (index, material) in scene.materials.iter_mut().enumerate().filter(|(_, m)| matches(&change.name, &m.name))
        {
            if new.get(&index).is_some_and(|entry| *entry > i) {
                is_later = true;
                continue;
            }
            found = true;
            apply(change, material);
            if change.finish.is_some() && (material.transmission > 0.0 || material.diffuse_transmission > 0.0) {
                let problem =
                    format!("light passes material \"{}\", and a finish needs an opaque surface", material.name);
                return Err(self.material_error(
                    i,
                    "finish",
                    problem,
                    "use `roughness`, or a height field in the mesh",
                ));
            }
            if let Some(finish) = &change.finish {
                let finish = finish.finish(material.grain);
                material.finish =
                    Some(finish.map_err(|[key, problem, help]| self.material_error(i, key, problem, help))?);
            }
            let inside = medium_keys(change).into_iter().find(|(_, given)| *given);
            if let Some((key, _)) = inside.filter(|_| material.surface == Surface::Thin) {
                let problem = format!("material \"{}\" is a thin sheet, which has no inside", material.name);
                let help = "add `solid = true` if its meshes are closed, or tint `base_color`";
                return Err(self.material_error(i, key, problem, help));
            }
        }
        if found {
            return Ok(());
        }
        let known = unique(scene.materials.iter().map(|m| m.name.as_str()));
        if is_later {
            let problem = format!("\"{}\" is defined by a later entry with `new = true`", change.name);
            let help = "write this entry behind that one";
            return Err(self.material_error(i, "name", problem, help));
        }
        let problem = format!("the scene has no material named \"{}\"", change.name);
        let help = suggestion(&change.name, "materials", &known);
        Err(self.material_error(i, "name", problem, help))
    }

    fn material_error(&self, i: usize, key: &str, problem: impl Into<String>, help: impl Into<String>) -> InputError {
        self.source.error_at_key(&["material", &i.to_string(), key], problem, help)
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
    m.grain = change.grain.and_then(GrainSettings::grain).or(m.grain);
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

/// The keys about the interior of a solid, and whether they are given: three by its colour, two coefficients, two others.
fn medium_keys(change: &MaterialOverride) -> [(&'static str, bool); 7] {
    [
        ("attenuation_color", change.attenuation_color.is_some()),
        ("attenuation_distance", change.attenuation_distance.is_some()),
        ("scattering_albedo", change.scattering_albedo.is_some()),
        ("absorption", change.absorption.is_some()),
        ("scattering", change.scattering.is_some()),
        ("scattering_anisotropy", change.scattering_anisotropy.is_some()),
        ("priority", change.priority.is_some()),
    ]
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
