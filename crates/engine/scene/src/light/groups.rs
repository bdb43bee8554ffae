//! Groups of lights, whose light a render also sums group by group.

use crate::light::Light;
use crate::light::summary::ENVIRONMENT;
use crate::scene::Scene;

/// The group of each light of a scene.
///
/// A light is what [`Scene::light_inventory`] lists under one name: the emitting surfaces of an object, a punctual light, or
/// the environment. A light that no group names belongs to one more group, the last one. It exists if there are such lights.
#[derive(Clone, Debug)]
pub struct LightGroups {
    /// By the index of the light.
    of_light: Vec<u8>,
    /// By the index of the part, for surfaces that emit.
    of_part: Vec<u8>,
    of_environment: u8,
    len: usize,
}

impl LightGroups {
    /// Most groups, that of the other lights included.
    pub const MAX: usize = 64;

    /// The number of groups.
    #[expect(clippy::len_without_is_empty, reason = "there is always a group")]
    #[inline]
    pub fn len(&self) -> usize {
        self.len
    }

    /// The group of a light by its index.
    #[inline]
    pub fn of_light(&self, light: u32) -> u8 {
        self.of_light.get(light as usize).copied().unwrap_or(0)
    }

    /// The group of the emission of a part.
    #[inline]
    pub fn of_part(&self, part: u32) -> u8 {
        self.of_part.get(part as usize).copied().unwrap_or(0)
    }

    /// The group of the environment.
    #[inline]
    pub fn of_environment(&self) -> u8 {
        self.of_environment
    }
}

impl Scene {
    /// The groups with these names of lights. Of several groups with one name, the first has the light.
    ///
    /// # Errors
    /// The name that no light has; `None` for no group, or for more groups than [`LightGroups::MAX`].
    pub fn light_groups(&self, groups: &[&[String]]) -> Result<LightGroups, Option<String>> {
        if !(1..LightGroups::MAX).contains(&groups.len()) {
            return Err(None);
        }
        let lights = self.light_inventory();
        let is_unknown = |name: &&String| lights.iter().all(|light| light.name != **name);
        if let Some(name) = groups.iter().copied().flatten().find(is_unknown) {
            return Err(Some(name.clone()));
        }
        let mut has_others = false;
        let mut of_name = |name: &str| {
            let found = groups.iter().position(|names| names.iter().any(|n| n == name));
            has_others |= found.is_none();
            found.unwrap_or(groups.len()) as u8
        };
        let name_of_part = |part: u32| self.object_names[self.parts[part as usize].object as usize].as_str();
        let mut of_part = vec![0; self.parts.len()];
        for (number, (group, part)) in (0..).zip(of_part.iter_mut().zip(&self.parts)) {
            if self.emits(part.material) {
                *group = of_name(name_of_part(number));
            }
        }
        let (mut names, mut of_environment) = (self.punctual_names.iter(), 0);
        let of_light = (self.lights.lights.iter())
            .map(|light| match light {
                Light::Area(area) => of_part[area.part as usize],
                Light::Mesh(mesh) => {
                    self.lights.mesh_lights.get(*mesh as usize).map_or(0, |mesh| of_part[mesh.part as usize])
                }
                Light::Delta(_) | Light::Sun(_) => of_name(names.next().map_or("", |name| name)),
                Light::Environment => {
                    of_environment = of_name(ENVIRONMENT);
                    of_environment
                }
            })
            .collect();
        Ok(LightGroups { of_light, of_part, of_environment, len: groups.len() + usize::from(has_others) })
    }
}
