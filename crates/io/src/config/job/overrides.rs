//! Applies the environment and the materials of a job to an imported scene. The module `lights` applies its lights.

use super::lamps::lamp_key;
use super::{AlphaKind, EnvironmentSettings, Job, MaterialOverride};
use crate::error::{ImportWarning, InputError};
use crate::images::load_environment;
use crate::names::suggestion;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, Environment, EnvironmentSource, ImageId, Material, Medium, SceneBuilder, Surface, Volume,
};

impl Job {
    /// Checks without a scene: overrides that contradict each other.
    pub(super) fn check_overrides(&self) -> Result<(), InputError> {
        for (i, light) in self.lights.iter().enumerate() {
            let given = [
                ("radiance", light.radiance.is_some()),
                ("power", light.power.is_some()),
                ("intensity", light.intensity.is_some()),
                ("irradiance", light.irradiance.is_some()),
            ];
            let mut keys = given.iter().filter(|(_, given)| *given).map(|(key, _)| *key);
            if let (Some(first), Some(second)) = (keys.next(), keys.next()) {
                let problem = format!("`{first}` and `{second}` both set the light's strength");
                return Err(self.light_error(i, second, problem, "keep one of them"));
            }
            if let Some(kind) = light.kind {
                self.check_lamp(i, light, kind)?;
                continue;
            }
            let item = i.to_string();
            if light.name.is_empty() {
                let problem = "a change of a light needs its name";
                let help = "write the name of a light of the scene, or a `kind` such as \"ring\" for a new lamp";
                return Err(self.source.error_at_key(&["light", &item], problem, help));
            }
            if let Some(key) = lamp_key(|key| self.source.has_key(&["light", &item, key])) {
                let problem = format!("`{key}` belongs to a new lamp");
                let help = "write its `kind` as well, such as \"ring\", or remove this";
                return Err(self.light_error(i, key, problem, help));
            }
        }
        for (i, m) in self.materials.iter().enumerate() {
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

    /// Changes the scene by `[environment]`, `[[material]]`, `[camera]` and `[[light]]`, in this order.
    ///
    /// # Errors
    /// If a name matches nothing in the scene, a light's quantity does not fit its kind, or the environment's image
    /// cannot be read. The scene is then partly changed and should be dropped.
    pub fn apply_overrides(&self, scene: &mut SceneBuilder) -> Result<Vec<ImportWarning>, InputError> {
        let mut warnings = Vec::new();
        scene.energy_compensation = self.render.energy_compensation;
        if let Some(environment) = &self.environment {
            scene.environment = self.environment(environment, scene, &mut warnings)?;
        }
        for (i, change) in self.materials.iter().enumerate() {
            self.change_materials(i, change, scene)?;
        }
        // Lights may be placed on the axis of a camera.
        self.add_cameras(scene)?;
        for (i, change) in self.lights.iter().enumerate() {
            match change.kind {
                Some(kind) => self.add_lamp(i, change, kind, scene, &mut warnings)?,
                None => self.change_lights(i, change, scene, &mut warnings)?,
            }
        }
        Ok(warnings)
    }

    fn environment(
        &self,
        settings: &EnvironmentSettings,
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<Option<Environment>, InputError> {
        let source = match (&settings.radiance, &settings.image) {
            (Some(radiance), _) => EnvironmentSource::Constant(*radiance),
            (None, Some(path)) => {
                let limits = self.import_options().limits;
                let (image, repaired) = load_environment(path, &limits, &scene.images).map_err(|e| {
                    let problem = format!("{}: {}", path.display(), e.problem);
                    self.source.error_at_key(&["environment", "image"], problem, e.help)
                })?;
                warnings.extend(repaired);
                scene.images.push(image);
                let image = ImageId((scene.images.len() - 1) as u32);
                EnvironmentSource::Image { image, scale: settings.scale.unwrap_or(Rgb::WHITE) }
            }
            (None, None) => return Ok(None),
        };
        Ok(Some(Environment { source, rotation: settings.rotation.unwrap_or(0.0) }))
    }

    fn change_materials(
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

/// Does a name match a pattern with `*` and `?`? A name that contains these characters also matches literally.
pub(super) fn matches(pattern: &str, name: &str) -> bool {
    pattern == name || (pattern.contains(['*', '?']) && glob(pattern, name))
}

/// Greedy matching that returns to the last `*`: quadratic in the worst case.
fn glob(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(c) if *c == '?' || *c == name[n] => {
                p += 1;
                n += 1;
            }
            _ => match &mut star {
                Some((at, taken)) => {
                    *taken += 1;
                    (p, n) = (*at + 1, *taken);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

pub(super) fn unique<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut list: Vec<&str> = names.filter(|n| !n.is_empty()).collect();
    list.sort_unstable();
    list.dedup();
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, name, expected) in [
            ("pmma", "pmma", true),
            ("pmma", "pmma2", false),
            ("symbol *", "symbol 3", true),
            ("*light*", "rear light 2", true),
            ("a?c", "abc", true),
            ("a?c", "ac", false),
            ("*", "", true),
            ("a*b*c", "a-b-b-c", true),
            ("a*b*c", "a-b-b-d", false),
            ("[*]", "[*]", true),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} against {name}");
        }
    }
}
