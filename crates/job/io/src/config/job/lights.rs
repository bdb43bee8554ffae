//! Applies the `[[light]]` entries of a job to a scene: strengths by name, and measured distributions.

use super::light::LightChange;
use super::patterns::{matches, unique};
use super::{Job, Strength};
use crate::error::{ImportWarning, InputError};
use crate::ies::load_ies;
use crate::names::suggestion;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::lamps::placed_area;
use dunkelfeld_scene::{LightProfile, Material, PunctualKind, SceneBuilder};
use std::f64::consts::PI;
use std::path::Path;

impl Job {
    /// Changes the lights that entry `i` selects.
    pub(super) fn change_lights(
        &self,
        i: usize,
        change: &LightChange,
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
                if change.wavelength.is_some() || change.scale.is_some() {
                    let (PunctualKind::Point { intensity: strength }
                    | PunctualKind::Spot { intensity: strength, .. }
                    | PunctualKind::Directional { irradiance: strength }
                    | PunctualKind::Sun { irradiance: strength, .. }
                    | PunctualKind::Profile { scale: strength, .. }) = &mut light.kind;
                    *strength = scaled_line(change, *strength);
                }
            }
            return Ok(());
        }
        if change.ies.is_some() || matches!(change.strength, Some(Strength::Intensity(_) | Strength::Irradiance(_))) {
            let (key, what, help) = match &change.strength {
                Some(strength) if change.ies.is_none() => {
                    (strength.key(), strength.key(), "give `radiance` or `power`")
                }
                _ => ("ies", "profile", "name a point or spot light"),
            };
            let problem = format!("\"{}\" is not a light without extent, so it has no {what}", change.name);
            return Err(self.light_error(i, key, problem, help));
        }
        let surfaces = emitting_surfaces(&change.name, scene).ok_or_else(|| {
            let names = scene.lights.iter().map(|l| l.name.as_str());
            let emissive = scene.materials.iter().filter(|m| !m.emission.factor.is_black()).map(|m| m.name.as_str());
            let known = unique(names.chain(scene.instances.iter().map(|n| n.name.as_str())).chain(emissive));
            let problem = format!("the scene has no light, object or material named \"{}\"", change.name);
            self.light_error(i, "name", problem, suggestion(&change.name, "names", &known))
        })?;
        if !change.enabled && surfaces.remove(scene) {
            return Ok(());
        }
        let lights = surfaces.separate(scene);
        for light in lights {
            let emission = self.changed_emission(i, change, &light, scene, warnings)?;
            for material in light.materials {
                if let Some(material) = scene.materials.get_mut(material) {
                    // Strengths that a file gives as ratios are preserved only if the light has a single material.
                    let radiance = &mut material.emission.factor;
                    *radiance = emission.map_or(*radiance, |e| e.of(*radiance));
                    let keys = [("wavelength", change.wavelength.is_some()), ("scale", change.scale.is_some())];
                    if let Some((key, _)) = keys.iter().find(|(_, given)| *given) {
                        let is_unset = change.enabled && change.strength.is_none();
                        if is_unset && radiance.is_black() {
                            let problem = format!("\"{}\" does not emit, so that it has no {key}", light.name);
                            let help = "give `radiance` or `power` as well, or remove this";
                            return Err(self.light_error(i, key, problem, help));
                        }
                        *radiance = scaled_line(change, *radiance);
                    }
                }
            }
        }
        Ok(())
    }

    /// Reads an IES file and assigns it to the lights of the change. Their hue remains.
    fn attach_profile(
        &self,
        i: usize,
        path: &Path,
        change: &LightChange,
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<(), InputError> {
        let (profile, found) = load_ies(path).map_err(|e| {
            let problem = format!("{}, {}: {}", path.display(), e.place, e.problem);
            self.light_error(i, "ies", problem, e.help)
        })?;
        warnings.extend(found);
        for light in scene.lights.iter_mut().filter(|l| matches(&change.name, &l.name)) {
            let color = match light.kind {
                PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => intensity,
                PunctualKind::Profile { scale, .. } => scale,
                PunctualKind::Directional { .. } | PunctualKind::Sun { .. } => {
                    let problem = format!("\"{}\" is distant light, which has no profile", light.name);
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
        change: &LightChange,
        name: &str,
        kind: PunctualKind,
        profiles: &[LightProfile],
    ) -> Result<PunctualKind, InputError> {
        let Some(strength) = change.strength else { return Ok(kind) };
        Ok(match (kind, strength) {
            (PunctualKind::Point { .. }, Strength::Intensity(intensity)) => PunctualKind::Point { intensity },
            (PunctualKind::Point { intensity }, Strength::Power(power)) => {
                PunctualKind::Point { intensity: with_mean(intensity, power / (4.0 * PI)) }
            }
            (PunctualKind::Spot { inner, outer, .. }, Strength::Intensity(intensity)) => {
                PunctualKind::Spot { intensity, inner, outer }
            }
            (PunctualKind::Spot { intensity, inner, outer }, Strength::Power(power)) => {
                let intensity = with_mean(intensity, power / spot_solid_angle(inner, outer));
                PunctualKind::Spot { intensity, inner, outer }
            }
            (PunctualKind::Profile { profile, scale }, Strength::Intensity(_) | Strength::Power(_)) => {
                // Strengths apply to the whole profile. A black profile cannot be scaled to a strength.
                let (peak, all) = profiles.get(profile).map_or((0.0, 0.0), |p| (p.peak(), f64::from(p.power())));
                if peak <= 0.0 {
                    let problem = format!("the profile of \"{name}\" is dark in all directions");
                    let help = "remove the key, or use another profile";
                    return Err(self.light_error(i, strength.key(), problem, help));
                }
                let scale = match strength {
                    Strength::Power(power) => with_mean(scale, power / all),
                    Strength::Intensity(wanted) => wanted * (1.0 / peak),
                    _ => scale,
                };
                PunctualKind::Profile { profile, scale }
            }
            (PunctualKind::Directional { .. }, Strength::Irradiance(irradiance)) => {
                PunctualKind::Directional { irradiance }
            }
            (PunctualKind::Sun { half_angle, .. }, Strength::Irradiance(irradiance)) => {
                PunctualKind::Sun { irradiance, half_angle }
            }
            _ => {
                let (what, fit) = match kind {
                    PunctualKind::Point { .. } => ("a point light", "`intensity` or `power`"),
                    PunctualKind::Spot { .. } => ("a spot light", "`intensity` or `power`"),
                    PunctualKind::Profile { .. } => ("a light with an IES profile", "`intensity` or `power`"),
                    PunctualKind::Directional { .. } | PunctualKind::Sun { .. } => ("distant light", "`irradiance`"),
                };
                let key = strength.key();
                let problem = format!("\"{name}\" is {what}, which has no {key}");
                return Err(self.light_error(i, key, problem, format!("give {fit}")));
            }
        })
    }

    fn changed_emission(
        &self,
        i: usize,
        change: &LightChange,
        light: &SurfaceLight,
        scene: &SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<Option<Emission>, InputError> {
        if !change.enabled {
            return Ok(Some(Emission::Set(Rgb::BLACK)));
        }
        let power = match change.strength {
            Some(Strength::Radiance(radiance)) => return Ok(Some(Emission::Set(radiance))),
            Some(Strength::Power(power)) => power,
            _ => return Ok(None),
        };
        let used: Vec<&Material> = light.materials.iter().filter_map(|m| scene.materials.get(*m)).collect();
        if used.iter().any(|m| m.emission.texture.is_some()) {
            warnings.push(ImportWarning {
                place: format!("[[light]] {}, power", i + 1),
                message: format!("\"{}\" has an emission texture; the power holds as if it were white", light.name),
            });
        }
        // Radiant power of a Lambertian emitter: pi * area * radiance, per emitting side. The present emission weights
        // the parts of a light with several materials.
        let mut weight = 0.0;
        let black = used.iter().all(|m| m.emission.factor.is_black());
        for (area, material) in &light.areas {
            let Some(material) = scene.materials.get(*material) else { continue };
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            let radiance = if black { 1.0 } else { f64::from(material.emission.factor.mean()) };
            weight += PI * area * sides * radiance;
        }
        if weight <= 0.0 {
            let problem = format!("\"{}\" has no area that could emit", light.name);
            return Err(self.light_error(i, "power", problem, "check the object's meshes and scale"));
        }
        let factor = power / weight;
        Ok(Some(if black { Emission::Set(Rgb::splat(factor as f32)) } else { Emission::Scale(factor) }))
    }

    pub(super) fn light_error(
        &self,
        i: usize,
        key: &str,
        problem: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        self.source.error_at_key(&["light", &i.to_string(), key], problem, help)
    }
}

/// A strength with the wavelength and the factor of a change.
fn scaled_line(change: &LightChange, strength: Rgb) -> Rgb {
    let strength = change.wavelength.map_or(strength, |line| line.triple(f64::from(strength.mean())));
    change.scale.map_or(strength, |scale| strength.map(|v| (f64::from(v) * scale) as f32))
}

/// A change of the emission of a material.
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

/// The surfaces that the name of a light selects.
enum Surfaces {
    /// Instances. Only their emissive parts are used, unless no part is emissive.
    Objects { instances: Vec<usize>, only_emissive: bool },
    /// Materials, on all objects.
    Materials(Vec<usize>),
}

/// Objects that emit, then materials that emit, then any object, then any material.
fn emitting_surfaces(name: &str, scene: &SceneBuilder) -> Option<Surfaces> {
    let emits = |material: usize| scene.materials.get(material).is_some_and(|m| !m.emission.factor.is_black());
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
    /// Removes emitting objects as a whole, or the parts of emitting materials. Returns false, without a change, if the
    /// selection does not emit.
    fn remove(&self, scene: &mut SceneBuilder) -> bool {
        match self {
            Self::Objects { only_emissive: false, .. } => false,
            Self::Objects { instances, .. } => {
                let mut index = 0..;
                scene.instances.retain(|_| index.next().is_none_or(|i| !instances.contains(&i)));
                true
            }
            Self::Materials(materials) => {
                let emits = |m: &usize| scene.materials.get(*m).is_some_and(|m| !m.emission.factor.is_black());
                if !materials.iter().any(emits) {
                    return false;
                }
                let meshes = &scene.meshes;
                let is_lamp = |mesh: &usize| meshes.get(*mesh).is_some_and(|part| materials.contains(&part.material));
                for instance in &mut scene.instances {
                    instance.meshes.retain(|mesh| !is_lamp(mesh));
                }
                scene.instances.retain(|instance| !instance.meshes.is_empty());
                true
            }
        }
    }

    /// Gives each light its own materials, so that a change of one light does not affect the rest of the scene.
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
    let areas =
        parts.filter(|(_, p)| p.material == material).map(|(t, p)| (placed_area(&p.mesh, &t), material)).collect();
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
        let emits = scene.materials.get(old).is_some_and(|m| !m.emission.factor.is_black());
        if only_emissive && !emits {
            continue;
        }
        light.areas.push((placed_area(&part.mesh, &to_world), old));
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

/// The colour scaled to a mean of its channels; white if it was black.
fn with_mean(color: Rgb, mean: f64) -> Rgb {
    let base = if color.is_black() { Rgb::WHITE } else { color };
    let scale = mean / f64::from(base.mean());
    base.map(|v| (f64::from(v) * scale) as f32)
}

/// Integral of a spot light's falloff over the sphere [sr]. KHR_lights_punctual squares a ramp that is linear in the
/// cosine between the edge and the inner cone: 2 pi ((1 - ci) + (ci - co) / 3).
pub(super) fn spot_solid_angle(inner: f32, outer: f32) -> f64 {
    let (ci, co) = (f64::from(inner).cos(), f64::from(outer).cos());
    2.0 * PI * ((1.0 - ci) + (ci - co).max(0.0) / 3.0).max(1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cone without soft edge of half-angle t has the solid angle 2 pi (1 - cos t).
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
