//! Lays a job's environment, materials and lights over a scene that was read.

use super::{AlphaKind, EnvironmentSettings, Job, LightOverride, MaterialOverride};
use crate::error::{ImportWarning, InputError};
use crate::ies::load_ies;
use crate::images::load_environment;
use crate::loader::Limits;
use crate::names::suggestion;
use dunkelfeld_geometry::{DAffine3, Mesh};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, Environment, EnvironmentSource, ImageId, LightProfile, Material, Medium, PunctualKind, SceneBuilder, Surface,
    Volume,
};
use std::f64::consts::PI;
use std::path::Path;

impl Job {
    /// What can be told without a scene: overrides that contradict themselves.
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
                let problem = format!("`{first}` and `{second}` both say what happens to light inside the solid");
                let mend = "describe the medium by `attenuation_color`, `attenuation_distance` and `scattering_albedo`, or by `absorption` and `scattering`";
                return Err(self.source.error_at_key(&["material", &i.to_string(), second], problem, mend));
            }
        }
        Ok(())
    }

    /// Changes the scene as `[environment]`, `[[material]]` and `[[light]]` say, in this order.
    ///
    /// # Errors
    /// If a name stands for nothing in the scene, a light's quantity does not fit its kind, or the environment's image
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
        for (i, change) in self.lights.iter().enumerate() {
            self.change_lights(i, change, scene, &mut warnings)?;
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
                let (image, repaired) = load_environment(path, &Limits::default()).map_err(|e| {
                    let problem = format!("{}: {}", path.display(), e.problem);
                    self.source.error_at_key(&["environment", "image"], problem, e.mend)
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
                    format!("material \"{}\" is a thin sheet, in which there is no way to go", material.name),
                    "add `solid = true` if its meshes are closed, or tint `base_color`",
                ));
            }
        }
        if found {
            return Ok(());
        }
        let known = unique(scene.materials.iter().map(|m| m.name.as_str()));
        let problem = format!("the scene has no material named \"{}\"", change.name);
        let mend = suggestion(&change.name, "materials", &known);
        Err(self.source.error_at_key(&["material", &i.to_string(), "name"], problem, mend))
    }

    fn change_lights(
        &self,
        i: usize,
        change: &LightOverride,
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<(), InputError> {
        if scene.lights.iter().any(|l| matches(&change.name, &l.name)) {
            if !change.enabled {
                scene.lights.retain(|l| !matches(&change.name, &l.name));
                return Ok(());
            }
            if let Some(path) = &change.ies {
                self.attach_profile(i, path, change, scene, warnings)?;
            }
            for light in scene.lights.iter_mut().filter(|l| matches(&change.name, &l.name)) {
                light.kind = self.changed_kind(i, change, &light.name, light.kind, &scene.profiles)?;
            }
            return Ok(());
        }
        for (key, given, mend) in [
            ("ies", change.ies.is_some(), "name a point or spot light"),
            ("intensity", change.intensity.is_some(), "give `radiance` or `power`"),
            ("irradiance", change.irradiance.is_some(), "give `radiance` or `power`"),
        ] {
            if given {
                let what = if key == "ies" { "profile" } else { key };
                let problem = format!("\"{}\" is no light without extent, so it has no {what}", change.name);
                return Err(self.light_error(i, key, problem, mend));
            }
        }
        let surfaces = emitting_surfaces(&change.name, scene).ok_or_else(|| {
            let names = scene.lights.iter().map(|l| l.name.as_str());
            let emissive = scene.materials.iter().filter(|m| !m.emission.is_black()).map(|m| m.name.as_str());
            let known = unique(names.chain(scene.instances.iter().map(|n| n.name.as_str())).chain(emissive));
            let problem = format!("the scene has no light, object or material named \"{}\"", change.name);
            self.light_error(i, "name", problem, suggestion(&change.name, "names", &known))
        })?;
        let lights = surfaces.separate(scene);
        for light in lights {
            let Some(emission) = self.changed_emission(i, change, &light, scene, warnings)? else { continue };
            for material in light.materials {
                if let Some(material) = scene.materials.get_mut(material) {
                    // Strengths that a file gives in proportion stay so only where the light has a single material.
                    material.emission = emission.of(material.emission);
                }
            }
        }
        Ok(())
    }

    /// Reads an IES file and gives it to the lights that the change names; their hue stays.
    fn attach_profile(
        &self,
        i: usize,
        path: &Path,
        change: &LightOverride,
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<(), InputError> {
        let (profile, found) = load_ies(path).map_err(|e| {
            let problem = format!("{}, {}: {}", path.display(), e.place, e.problem);
            self.light_error(i, "ies", problem, e.mend)
        })?;
        warnings.extend(found);
        for light in scene.lights.iter_mut().filter(|l| matches(&change.name, &l.name)) {
            let color = match light.kind {
                PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => intensity,
                PunctualKind::Profile { scale, .. } => scale,
                PunctualKind::Directional { .. } => {
                    let problem = format!("\"{}\" is a parallel light, which has no profile", light.name);
                    return Err(self.light_error(i, "ies", problem, "name a point or spot light"));
                }
            };
            light.kind = PunctualKind::Profile { profile: scene.profiles.len(), scale: with_mean(color, 1.0) };
        }
        scene.profiles.push(profile);
        Ok(())
    }

    fn changed_kind(
        &self,
        i: usize,
        change: &LightOverride,
        name: &str,
        kind: PunctualKind,
        profiles: &[LightProfile],
    ) -> Result<PunctualKind, InputError> {
        let unfit = |key: &str, fit: &str| {
            let what = match kind {
                PunctualKind::Point { .. } => "a point light",
                PunctualKind::Spot { .. } => "a spot light",
                PunctualKind::Directional { .. } => "a parallel light",
                PunctualKind::Profile { .. } => "a measured light",
            };
            Err(self.light_error(i, key, format!("\"{name}\" is {what}, which has no {key}"), format!("give {fit}")))
        };
        if change.irradiance.is_some() && !matches!(kind, PunctualKind::Directional { .. }) {
            return unfit("irradiance", "`intensity` or `power`");
        }
        if change.radiance.is_some() {
            let fit = if matches!(kind, PunctualKind::Directional { .. }) {
                "`irradiance`"
            } else {
                "`intensity` or `power`"
            };
            return unfit("radiance", fit);
        }
        Ok(match kind {
            PunctualKind::Point { intensity } => {
                let scaled = change.power.map(|power| with_mean(intensity, power / (4.0 * PI)));
                PunctualKind::Point { intensity: change.intensity.or(scaled).unwrap_or(intensity) }
            }
            PunctualKind::Spot { intensity, inner, outer } => {
                let scaled = change.power.map(|power| with_mean(intensity, power / spot_solid_angle(inner, outer)));
                PunctualKind::Spot { intensity: change.intensity.or(scaled).unwrap_or(intensity), inner, outer }
            }
            PunctualKind::Profile { profile, scale } => {
                // Strengths are those of the whole profile; of a dark one no factor makes light.
                let (peak, all) = profiles.get(profile).map_or((0.0, 0.0), |p| (p.peak(), f64::from(p.power())));
                let dark = peak <= 0.0;
                if let Some((key, _)) = [("power", change.power.is_some()), ("intensity", change.intensity.is_some())]
                    .into_iter()
                    .find(|(_, given)| *given && dark)
                {
                    let problem = format!("the profile of \"{name}\" is dark in all directions");
                    return Err(self.light_error(i, key, problem, "remove the key, or use another profile"));
                }
                let by_peak = change.intensity.map(|wanted| wanted * (1.0 / peak));
                let by_power = change.power.map(|power| with_mean(scale, power / all));
                PunctualKind::Profile { profile, scale: by_peak.or(by_power).unwrap_or(scale) }
            }
            PunctualKind::Directional { irradiance } => {
                if let Some((key, _)) = [("power", change.power.is_some()), ("intensity", change.intensity.is_some())]
                    .into_iter()
                    .find(|(_, given)| *given)
                {
                    return unfit(key, "`irradiance`");
                }
                PunctualKind::Directional { irradiance: change.irradiance.unwrap_or(irradiance) }
            }
        })
    }

    fn changed_emission(
        &self,
        i: usize,
        change: &LightOverride,
        light: &SurfaceLight,
        scene: &SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<Option<Emission>, InputError> {
        if !change.enabled {
            return Ok(Some(Emission::Set(Rgb::BLACK)));
        }
        if let Some(radiance) = change.radiance {
            return Ok(Some(Emission::Set(radiance)));
        }
        let Some(power) = change.power else { return Ok(None) };
        let used: Vec<&Material> = light.materials.iter().filter_map(|m| scene.materials.get(*m)).collect();
        if used.iter().any(|m| m.emission_texture.is_some()) {
            warnings.push(ImportWarning {
                place: format!("[[light]] {}, power", i + 1),
                message: format!("\"{}\" has an emission texture; the power holds as if it were white", light.name),
            });
        }
        // Radiant power of a Lambertian emitter: pi * area * radiance, per emitting side. The emission in force weighs
        // the parts of a light that has several materials.
        let mut weight = 0.0;
        let black = used.iter().all(|m| m.emission.is_black());
        for (area, material) in &light.areas {
            let Some(material) = scene.materials.get(*material) else { continue };
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            let radiance = if black { 1.0 } else { f64::from(material.emission.mean()) };
            weight += PI * area * sides * radiance;
        }
        if weight <= 0.0 {
            let problem = format!("\"{}\" has no area that could emit", light.name);
            return Err(self.light_error(i, "power", problem, "check the object's meshes and scale"));
        }
        let factor = power / weight;
        Ok(Some(if black { Emission::Set(Rgb::splat(factor as f32)) } else { Emission::Scale(factor) }))
    }

    fn light_error(&self, i: usize, key: &str, problem: impl Into<String>, mend: impl Into<String>) -> InputError {
        self.source.error_at_key(&["light", &i.to_string(), key], problem, mend)
    }
}

/// What happens to the emission of a material.
#[derive(Clone, Copy)]
enum Emission {
    Set(Rgb),
    Scale(f64),
}

impl Emission {
    fn of(self, old: Rgb) -> Rgb {
        match self {
            Self::Set(new) => new,
            Self::Scale(factor) => old.map(|v| (f64::from(v) * factor) as f32),
        }
    }
}

/// A light with extent: its emitting materials, and the area [m^2] of each of its parts with its material.
struct SurfaceLight {
    name: String,
    materials: Vec<usize>,
    areas: Vec<(f64, usize)>,
}

/// What a light's name stands for among surfaces.
enum Surfaces {
    /// Instances; of their parts only the emissive ones, unless none is.
    Objects { instances: Vec<usize>, only_emissive: bool },
    /// Materials, wherever they are.
    Materials(Vec<usize>),
}

/// Objects that emit, then materials that emit, then any object, then any material.
fn emitting_surfaces(name: &str, scene: &SceneBuilder) -> Option<Surfaces> {
    let emits = |material: usize| scene.materials.get(material).is_some_and(|m| !m.emission.is_black());
    let part_emits = |mesh: &usize| scene.meshes.get(*mesh).is_some_and(|m| emits(m.material));
    let objects = |emissive: bool| -> Vec<usize> {
        let named = scene.instances.iter().enumerate().filter(|(_, n)| matches(name, &n.name));
        named.filter(|(_, n)| !emissive || n.meshes.iter().any(part_emits)).map(|(i, _)| i).collect()
    };
    let materials = |emissive: bool| -> Vec<usize> {
        let named = scene.materials.iter().enumerate().filter(|(_, m)| matches(name, &m.name));
        named.map(|(i, _)| i).filter(|i| !emissive || emits(*i)).collect()
    };
    for only_emissive in [true, false] {
        let instances = objects(only_emissive);
        if !instances.is_empty() {
            return Some(Surfaces::Objects { instances, only_emissive });
        }
        let found = materials(only_emissive);
        if !found.is_empty() {
            return Some(Surfaces::Materials(found));
        }
    }
    None
}

impl Surfaces {
    /// Gives each light materials of its own, so that changing one light leaves the rest of the scene alone.
    fn separate(self, scene: &mut SceneBuilder) -> Vec<SurfaceLight> {
        match self {
            Self::Materials(materials) => materials.into_iter().map(|m| material_light(m, scene)).collect(),
            Self::Objects { instances, only_emissive } => {
                instances.into_iter().map(|i| object_light(i, only_emissive, scene)).collect()
            }
        }
    }
}

fn material_light(material: usize, scene: &SceneBuilder) -> SurfaceLight {
    let parts = scene.instances.iter().flat_map(|n| n.meshes.iter().map(|m| (n.to_world, *m)));
    let parts = parts.filter_map(|(to_world, m)| Some((to_world, scene.meshes.get(m)?)));
    let areas = parts.filter(|(_, p)| p.material == material).map(|(t, p)| (area(&p.mesh, &t), material)).collect();
    let name = scene.materials.get(material).map(|m| m.name.clone()).unwrap_or_default();
    SurfaceLight { name, materials: vec![material], areas }
}

fn object_light(instance: usize, only_emissive: bool, scene: &mut SceneBuilder) -> SurfaceLight {
    let Some(object) = scene.instances.get(instance) else {
        return SurfaceLight { name: String::new(), materials: Vec::new(), areas: Vec::new() };
    };
    let (name, to_world, meshes) = (object.name.clone(), object.to_world, object.meshes.clone());
    let mut light = SurfaceLight { name, materials: Vec::new(), areas: Vec::new() };
    for (slot, mesh) in meshes.into_iter().enumerate() {
        let Some(part) = scene.meshes.get(mesh) else { continue };
        let old = part.material;
        let emits = scene.materials.get(old).is_some_and(|m| !m.emission.is_black());
        if only_emissive && !emits {
            continue;
        }
        light.areas.push((area(&part.mesh, &to_world), old));
        let uses = |m: usize| scene.instances.iter().flat_map(|n| &n.meshes).filter(|used| **used == m).count();
        let mesh_shared = uses(mesh) > 1;
        let material_elsewhere =
            mesh_shared || scene.meshes.iter().enumerate().any(|(i, p)| i != mesh && p.material == old && uses(i) > 0);
        let mut own = old;
        if material_elsewhere && let Some(material) = scene.materials.get(old).cloned() {
            scene.materials.push(material);
            own = scene.materials.len() - 1;
        }
        if mesh_shared {
            let mut copy = scene.meshes[mesh].clone();
            copy.material = own;
            scene.meshes.push(copy);
            let copy = scene.meshes.len() - 1;
            if let Some(slot) = scene.instances.get_mut(instance).and_then(|n| n.meshes.get_mut(slot)) {
                *slot = copy;
            }
        } else if let Some(part) = scene.meshes.get_mut(mesh) {
            part.material = own;
        }
        if let Some(last) = light.areas.last_mut() {
            last.1 = own;
        }
        if !light.materials.contains(&own) {
            light.materials.push(own);
        }
    }
    light
}

/// Area [m^2] of a placed mesh.
fn area(mesh: &Mesh, to_world: &DAffine3) -> f64 {
    let at = |i: u32| mesh.positions.get(i as usize).map(|p| to_world.transform_point3(p.as_dvec3()));
    let triangle = |[a, b, c]: &[u32; 3]| {
        let (a, b, c) = (at(*a)?, at(*b)?, at(*c)?);
        Some(0.5 * (b - a).cross(c - a).length())
    };
    mesh.triangles.iter().filter_map(triangle).filter(|a| a.is_finite()).sum()
}

/// The colour scaled to a mean of its channels; white if it was black.
fn with_mean(color: Rgb, mean: f64) -> Rgb {
    let base = if color.is_black() { Rgb::WHITE } else { color };
    let scale = mean / f64::from(base.mean());
    base.map(|v| (f64::from(v) * scale) as f32)
}

/// Integral of a spot light's falloff over the sphere [sr]. KHR_lights_punctual squares a ramp that is linear in the
/// cosine between the edge and the inner cone: 2 pi ((1 - ci) + (ci - co) / 3).
fn spot_solid_angle(inner: f32, outer: f32) -> f64 {
    let (ci, co) = (f64::from(inner).cos(), f64::from(outer).cos());
    2.0 * PI * ((1.0 - ci) + (ci - co).max(0.0) / 3.0).max(1e-12)
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
            // One coefficient is replaced, the other stays what the attenuation made it.
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

/// The first key that speaks of the inside of a solid.
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
    m.clearcoat_texture = None;
    m.clearcoat_roughness_texture = None;
    m.sheen_color_texture = None;
    m.anisotropy_texture = None;
}

/// Does a name match a pattern with `*` and `?`? A name that holds these characters itself matches literally too.
fn matches(pattern: &str, name: &str) -> bool {
    pattern == name || (pattern.contains(['*', '?']) && glob(pattern, name))
}

/// Greedy matching that steps back to the last `*`: quadratic at worst.
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

fn unique<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
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

    /// A cone without soft edge of half-angle t covers 2 pi (1 - cos t).
    #[test]
    fn the_spot_integral_agrees_with_a_sum_over_angles() {
        assert!((spot_solid_angle(0.5, 0.5) - 2.0 * PI * (1.0 - 0.5_f64.cos())).abs() < 1e-7);
        let (inner, outer) = (0.3_f64, 0.8_f64);
        let steps = 200_000;
        let sum: f64 = (0..steps)
            .map(|i| {
                let t = outer * (f64::from(i) + 0.5) / f64::from(steps);
                let ramp = ((t.cos() - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                2.0 * PI * t.sin() * ramp * ramp * outer / f64::from(steps)
            })
            .sum();
        let exact = spot_solid_angle(inner as f32, outer as f32);
        assert!((sum - exact).abs() < 1e-6, "{sum} {exact}");
    }
}
