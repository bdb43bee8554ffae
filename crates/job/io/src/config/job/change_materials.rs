//! Applies `[[material]]` of a job to the materials of a scene.

use super::finish::{GrainSettings, HeightSettings};
use super::materials::InteriorChange;
use super::patterns::{matches, unique};
use super::{AlphaKind, Job, MaterialOverride};
use crate::error::InputError;
use crate::images::load_image;
use crate::input::Role;
use crate::names::suggestion;
use crate::toml_keys::keys_of;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, ColorEncoding, HeightField, HeightImage, ImageId, Material, Medium, SceneBuilder, Surface, Texture,
    Volume,
};
use std::collections::HashMap;

/// A new material of a job: a grey dielectric of medium roughness, [`Material::default`] with a base colour of 0.5.
pub(super) fn new_material(name: &str) -> Material {
    Material { name: name.into(), base_color: Rgb::splat(0.5).into(), ..Material::default() }
}

impl Job {
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
        let is_given = |key: &&&str| **key != "solid" && self.sets(&["material", &i.to_string(), key]);
        let image = change.layers.height.as_ref().map(|height| self.load_height(i, height, scene)).transpose()?;
        let meshes = &scene.meshes;
        let inside = keys_of::<InteriorChange>().iter().find(is_given);
        for (index, material) in scene.materials.iter_mut().enumerate().filter(|(_, m)| matches(&change.name, &m.name))
        {
            if new.get(&index).is_some_and(|entry| *entry > i) {
                is_later = true;
                continue;
            }
            found = true;
            apply(change, material);
            let has_finish = matches!(material.height, Some(HeightField::Finish(_)));
            let heights = [change.layers.finish.is_some(), change.layers.height.is_some()];
            if change.layers.grain.is_some() && heights == [false; 2] && has_finish {
                let problem =
                    format!("the finish of material \"{}\" has its grain from an earlier entry", material.name);
                return Err(self.material_error(i, "grain", problem, "write `finish` in this entry again"));
            }
            if heights != [false; 2] && !material.is_opaque() {
                let problem = format!("light passes material \"{}\"", material.name);
                let key = if heights[0] { "finish" } else { "height" };
                return Err(self.material_error(i, key, problem, "use `roughness`: heights need an opaque surface"));
            }
            if let Some(finish) = &change.layers.finish {
                let finish = finish.finish(material.anisotropy.grain);
                let finish = finish.map_err(|[key, problem, help]| self.material_error(i, key, problem, help))?;
                material.height = Some(HeightField::Finish(finish));
            }
            if let (Some(HeightSettings { depth, size, .. }), Some(image)) = (&change.layers.height, image) {
                let own = Texture::new(image, ColorEncoding::Linear);
                let of_material = material.textures().next().unwrap_or(own);
                let texture = Texture { image, encoding: own.encoding, channel: own.channel, ..of_material };
                let mut plain = meshes
                    .iter()
                    .filter(|part| part.material == index && part.mesh.uvs[usize::from(texture.uv_set & 1)].is_empty());
                if let (None, Some(part)) = (size, plain.next()) {
                    let problem = format!("mesh \"{}\" has no texture coordinates for the image", part.name);
                    let help = "write the width of one image, such as size = \"25mm\", to repeat it over the object";
                    return Err(self.material_error(i, "height", problem, help));
                }
                let (texture, size) = (Some(texture), size.map(|size| size as f32));
                material.height = Some(HeightField::Image(HeightImage { texture, depth: *depth as f32, size }));
            }
            if let Some(key) = inside.filter(|_| material.surface == Surface::Thin) {
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

    /// Adds the image of heights to a scene.
    fn load_height(&self, i: usize, height: &HeightSettings, scene: &mut SceneBuilder) -> Result<ImageId, InputError> {
        let limits = self.import_options().limits;
        let error = |problem: &str, help: &str| {
            let problem = format!("{}: {problem}", height.image.display());
            self.source.error_at_key(&["material", &i.to_string(), "height"], problem, help)
        };
        let (image, _) = load_image(&height.image, Role::Texture, &limits, &scene.images)
            .map_err(|e| error(&e.problem, e.help.as_str()))?;
        let texels = &image.texels;
        let is_grey = |k: usize| texels.get(k).is_none_or(|[r, g, b, _]| r == g && g == b);
        if texels.is_float() || !(0..texels.len()).all(is_grey) {
            let problem = "a height image is grey, of 8 or 16 bits";
            return Err(error(problem, "save it as a grey PNG; 16 bits have finer slopes"));
        }
        scene.images.push(image);
        Ok(ImageId((scene.images.len() - 1) as u32))
    }

    fn material_error(&self, i: usize, key: &str, problem: impl Into<String>, help: impl Into<String>) -> InputError {
        self.source.error_at_key(&["material", &i.to_string(), key], problem, help)
    }
}

fn apply(change: &MaterialOverride, m: &mut Material) {
    if change.textures == Some(false) {
        m.texture_slots().for_each(|slot| *slot = None);
    }
    set(&mut m.base_color.factor, change.base_color);
    set(&mut m.alpha.factor, change.alpha);
    set(&mut m.metallic.factor, change.metallic);
    set(&mut m.roughness.factor, change.roughness);
    set(&mut m.normal_map.scale, change.normal_scale);
    set(&mut m.emission.factor, change.emission);
    set(&mut m.double_sided, change.double_sided);
    set(&mut m.unlit, change.unlit);
    set(&mut m.ior, change.ior);
    let dielectric = &change.dielectric;
    set(&mut m.specular.strength.factor, dielectric.specular);
    set(&mut m.specular.color.factor, dielectric.specular_color);
    set(&mut m.specular.tint, dielectric.specular_tint);
    set(&mut m.transmission.factor, dielectric.transmission);
    set(&mut m.diffuse_transmission.share.factor, dielectric.diffuse_transmission);
    set(&mut m.diffuse_transmission.color.factor, dielectric.diffuse_transmission_color);
    let layers = &change.layers;
    set(&mut m.clearcoat.strength.factor, layers.clearcoat);
    set(&mut m.clearcoat.roughness.factor, layers.clearcoat_roughness);
    set(&mut m.sheen.color.factor, layers.sheen_color);
    set(&mut m.sheen.roughness, layers.sheen_roughness);
    set(&mut m.anisotropy.strength.factor, layers.anisotropy);
    set(&mut m.anisotropy.rotation, layers.anisotropy_rotation);
    m.anisotropy.grain = layers.grain.and_then(GrainSettings::grain).or(m.anisotropy.grain);
    let old_cutoff = if let AlphaMode::Mask { cutoff } = m.alpha_mode { Some(cutoff) } else { None };
    let cutoff = change.alpha_cutoff.or(old_cutoff).unwrap_or(0.5);
    match change.alpha_mode {
        Some(AlphaKind::Opaque) => m.alpha_mode = AlphaMode::Opaque,
        Some(AlphaKind::Mask) => m.alpha_mode = AlphaMode::Mask { cutoff },
        Some(AlphaKind::Blend) => m.alpha_mode = AlphaMode::Blend,
        None if old_cutoff.is_some() => m.alpha_mode = AlphaMode::Mask { cutoff },
        None => {}
    }
    change.interior.apply(&mut m.surface);
}

impl InteriorChange {
    fn apply(&self, surface: &mut Surface) {
        match (self.solid, *surface) {
            (Some(true), Surface::Thin) => *surface = Surface::Solid(Volume::default()),
            (Some(false), _) => *surface = Surface::Thin,
            _ => {}
        }
        let Surface::Solid(volume) = surface else { return };
        set(&mut volume.attenuation_color, self.attenuation_color);
        set(&mut volume.attenuation_distance, self.attenuation_distance);
        set(&mut volume.scattering_albedo, self.scattering_albedo);
        set(&mut volume.scattering_anisotropy, self.scattering_anisotropy);
        set(&mut volume.priority, self.priority);
        if self.absorption.is_some() || self.scattering.is_some() {
            // One coefficient is replaced. The other keeps the value from the attenuation.
            let medium = Medium::new(volume);
            *volume = Volume {
                absorption: self.absorption.unwrap_or(medium.absorption),
                scattering: self.scattering.unwrap_or(medium.scattering),
                scattering_anisotropy: volume.scattering_anisotropy,
                priority: volume.priority,
                ..Volume::default()
            };
        }
    }
}

fn set<T>(slot: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *slot = value;
    }
}
