//! Summary of a scene for reports: lights and their power, parts and their numbers of triangles.

use crate::light::delta::DeltaLight;
use crate::light::mesh_light::MeshLight;
use crate::light::{Light, NO_LIGHT};
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Aabb, DVec3};
use dunkelfeld_radiometry::Rgb;

/// The name of the environment among the lights.
pub(crate) const ENVIRONMENT: &str = "environment";

/// A light in reports: all emitting triangles of an object together.
#[derive(Clone, Debug, PartialEq)]
pub struct LightInfo {
    /// Name of the object or the light.
    pub name: String,
    /// `area (2 rectangles, 3 triangles)`, `point`, `spot`, `directional`, `profile lamp.ies`, `environment`.
    pub kind: String,
    /// Emitted power \[W\] per channel; for light from infinity, over the scene's cross-section.
    pub power: Rgb,
    /// Mean radiance [W/(m^2 sr)] of area lights and the environment.
    pub radiance: Option<Rgb>,
    /// Lowest and highest corner in world space \[m\]; `None` for light from infinitely far away.
    pub bounds: Option<[DVec3; 2]>,
}

/// An object in reports.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectInfo {
    /// Its name.
    pub name: String,
    /// Lowest and highest corner in world space \[m\]; `None` without triangles. The box contains the object, and is
    /// larger than necessary for an instanced mesh that is rotated.
    pub bounds: Option<[DVec3; 2]>,
    /// Number of triangles.
    pub triangles: u64,
    /// Indices of its materials, each once, in the order of its parts.
    pub materials: Vec<u32>,
}

/// A mesh of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct PartInfo {
    /// The object.
    pub object: String,
    /// Index of the material.
    pub material: u32,
    /// Number of triangles.
    pub triangles: usize,
    /// True if the mesh is shared and placed by a transform.
    pub instanced: bool,
}

impl Scene {
    /// The lights. Punctual lights have the names of the builder.
    pub fn light_inventory(&self) -> Vec<LightInfo> {
        let mut list: Vec<LightInfo> = self.parts.iter().filter_map(|part| self.area_light_info(part)).collect();
        let mut names = self.punctual_names.iter();
        for light in &self.lights.lights {
            let power = || self.lights.power(light, self.radius);
            match light {
                Light::Area(_) | Light::Mesh(_) => {}
                Light::Sun(sun) => list.push(LightInfo {
                    name: names.next().cloned().unwrap_or_default(),
                    kind: "sun".into(),
                    power: power(),
                    radiance: Some(sun.disc_radiance()),
                    bounds: None,
                }),
                Light::Delta(d) => {
                    let (kind, position) = match d {
                        DeltaLight::Point { position, .. } => ("point".into(), Some(position)),
                        DeltaLight::Spot { position, .. } => ("spot".into(), Some(position)),
                        DeltaLight::Directional { .. } => ("directional".into(), None),
                        DeltaLight::Profile { profile, position, .. } => {
                            let name = self.lights.profiles.get(*profile as usize).map_or("", |p| p.name());
                            (format!("profile {name}"), Some(position))
                        }
                    };
                    list.push(LightInfo {
                        name: names.next().cloned().unwrap_or_default(),
                        kind,
                        power: power(),
                        radiance: None,
                        bounds: position.map(|p| [p.as_dvec3() + self.world_origin; 2]),
                    });
                }
                Light::Environment => list.push(LightInfo {
                    name: ENVIRONMENT.into(),
                    kind: ENVIRONMENT.into(),
                    power: power(),
                    radiance: self.lights.environment.as_ref().map(|e| e.mean),
                    bounds: None,
                }),
            }
        }
        list
    }

    /// The names of the lights, each once, in the order of [`Self::light_inventory`].
    pub fn light_names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for light in self.light_inventory() {
            if !names.contains(&light.name) {
                names.push(light.name);
            }
        }
        names
    }

    /// The light of a part; `None` if it emits nothing.
    fn area_light_info(&self, part: &Part) -> Option<LightInfo> {
        let (mut power, mut rectangles, mut triangles, mut single) = (Rgb::BLACK, 0, 0, None);
        let mut seen = NO_LIGHT;
        for &index in part.lights.iter().filter(|&&l| l != NO_LIGHT) {
            if index == seen {
                continue;
            }
            seen = index;
            match self.lights.lights.get(index as usize) {
                Some(Light::Area(a)) => {
                    power += a.power();
                    if a.triangles[1] == u32::MAX { triangles += 1 } else { rectangles += 1 }
                }
                Some(light @ Light::Mesh(m)) => {
                    power += self.lights.power(light, self.radius);
                    single = self.lights.mesh_lights.get(*m as usize).map(MeshLight::len);
                }
                _ => {}
            }
        }
        let counted = |n: i32, what: &str| match n {
            0 => None,
            1 => Some(format!("1 {what}")),
            n => Some(format!("{n} {what}s")),
        };
        let shapes: Vec<String> =
            [counted(rectangles, "rectangle"), counted(triangles, "triangle")].into_iter().flatten().collect();
        let kind = match single {
            Some(n) => format!("area (1 light of {n} triangles)"),
            None if shapes.is_empty() => return None,
            None => format!("area ({})", shapes.join(", ")),
        };
        let radiance = crate::query::surface::mean_emission(&self.materials[part.material as usize], &self.images);
        Some(LightInfo {
            name: self.object_names.get(part.object as usize).cloned().unwrap_or_default(),
            kind,
            power,
            radiance: Some(radiance),
            bounds: self.part_bounds(part),
        })
    }

    /// The light sampling technique in words: the number of lights, each emitting triangle or rectangle counted, and
    /// the method of the choice.
    pub fn light_choice(&self) -> String {
        let count = self.lights.lights.len();
        match (&self.lights.tree, count) {
            (_, 0) => "no light".into(),
            (None, 1) => "1 light, sampled at every surface".into(),
            (None, n) if self.lights.samples_each() => {
                format!("{n} lights, all sampled at each surface that scatters")
            }
            (None, n) => format!("{n} lights, one sampled at each surface, in proportion to its contribution"),
            (Some(tree), n) => {
                let beside = match tree.infinite() {
                    0 => String::new(),
                    n => format!(", {n} infinitely far away beside it"),
                };
                format!(
                    "{n} lights, one sampled at each surface, chosen by a tree of {} of depth {}{beside}",
                    tree.leaves(),
                    tree.depth()
                )
            }
        }
    }

    /// The objects, in the order of their ids.
    pub fn object_inventory(&self) -> Vec<ObjectInfo> {
        let empty =
            |name: &String| ObjectInfo { name: name.clone(), bounds: None, triangles: 0, materials: Vec::new() };
        let mut list: Vec<ObjectInfo> = self.object_names.iter().map(empty).collect();
        for part in &self.parts {
            let Some(object) = list.get_mut(part.object as usize) else { continue };
            object.triangles += self.meshes[part.mesh as usize].triangles.len() as u64;
            object.bounds = match (object.bounds, self.part_bounds(part)) {
                (Some([low, high]), Some([l, h])) => Some([low.min(l), high.max(h)]),
                (one, other) => one.or(other),
            };
            if !object.materials.contains(&part.material) {
                object.materials.push(part.material);
            }
        }
        list
    }

    /// Lowest and highest corner of a part in world space \[m\].
    fn part_bounds(&self, part: &Part) -> Option<[DVec3; 2]> {
        let mesh = &self.meshes[part.mesh as usize];
        let own = Aabb::from_points(mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]));
        let placed = part.transform.as_ref().map_or(own, |t| own.transformed(t));
        (!placed.is_empty()).then(|| [placed.min, placed.max].map(|p| p.as_dvec3() + self.world_origin))
    }

    /// The parts, in the order of their objects.
    pub fn part_inventory(&self) -> Vec<PartInfo> {
        let mut list: Vec<(u32, PartInfo)> = self
            .parts
            .iter()
            .map(|p| {
                let object = self.object_names.get(p.object as usize).cloned().unwrap_or_default();
                let triangles = self.meshes[p.mesh as usize].triangles.len();
                (p.object, PartInfo { object, material: p.material, triangles, instanced: p.transform.is_some() })
            })
            .collect();
        list.sort_by_key(|(object, _)| *object);
        list.into_iter().map(|(_, info)| info).collect()
    }
}
