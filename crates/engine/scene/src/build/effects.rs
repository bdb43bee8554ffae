//! The effects of light that a scene needs, with the objects that need them, and the techniques that its lights need.
//!
//! Only these effects are simulated. A user must be able to read the list, because an unintended effect (a normal map,
//! a metal that is slightly clear) costs time and changes the image.

use crate::build::builder::{EnvironmentSource, MeshPart, PunctualKind, SceneBuilder};
use crate::camera::shutter::Shutter;
use crate::light::emission_profile::EmissionProfile;
use crate::material::{AlphaMode, Material, Surface};
use crate::media::medium::Medium;

/// A part of light transport that only some scenes need, or a technique that only some scenes use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
pub enum Effect {
    /// Images on surfaces, except normal maps.
    Textures,
    /// Colours of vertices.
    VertexColors,
    /// Normal maps.
    NormalMaps,
    /// Normals interpolated between vertices.
    SmoothNormals,
    /// Surfaces with a coverage below one, or cut out by a mask.
    Coverage,
    /// Clear sheets without thickness.
    ThinSheets,
    /// Light scattered through to the other side of a surface.
    DiffuseTransmission,
    /// Solids with a smooth clear surface.
    SmoothRefraction,
    /// Solids with a rough clear surface.
    RoughRefraction,
    /// Solids that touch, overlap or contain each other.
    Nesting,
    /// Solids that absorb.
    Absorption,
    /// Solids that scatter.
    Scattering,
    /// Highlights stretched along a direction.
    Anisotropy,
    /// Height fields: of machined surfaces, and of images.
    Finish,
    /// Sharp edges that are seen as fillets.
    RoundedEdges,
    /// The sheen of cloth.
    Sheen,
    /// Clear coats.
    Clearcoat,
    /// Multiple scattering between the facets of rough surfaces.
    EnergyCompensation,
    /// Lenses with a finite aperture.
    FiniteAperture,
    /// Lenses that distort.
    Distortion,
    /// Lenses that blur: diffraction, aberrations, veiling glare.
    LensBlur,
    /// Objects that move during the exposure.
    Motion,
    /// Rows that are exposed one after the other by one sensor line.
    LineScan,
    /// Light from infinitely far away, from all around.
    Environment,
    /// Lights without extent, and suns.
    PunctualLights,
    /// Lights with a measured profile.
    LightProfiles,
    /// Emitting surfaces whose radiance depends on the direction.
    EmissionProfiles,
    /// More lights than are weighed one by one; a tree chooses among them.
    ManyLights,
    /// Surfaces or lights that are not grey.
    Color,
    /// A technique: every vertex on a surface takes a sample of each light, in scenes of few lights.
    EveryLight,
    /// A technique: next-event estimation through clear covers. Without it, only scattering samples light behind a
    /// cover.
    CoverConnection,
    /// A technique: Russian roulette and splitting of paths, as training paths have learned them. Without it no path is split,
    /// and survival follows from the throughput of a path.
    LearnedRoulette,
}

impl Effect {
    /// All effects, in the order in which they are listed.
    pub const ALL: [Self; 32] = [
        Self::Textures,
        Self::VertexColors,
        Self::NormalMaps,
        Self::SmoothNormals,
        Self::Coverage,
        Self::ThinSheets,
        Self::DiffuseTransmission,
        Self::SmoothRefraction,
        Self::RoughRefraction,
        Self::Nesting,
        Self::Absorption,
        Self::Scattering,
        Self::Anisotropy,
        Self::Finish,
        Self::RoundedEdges,
        Self::Sheen,
        Self::Clearcoat,
        Self::EnergyCompensation,
        Self::FiniteAperture,
        Self::Distortion,
        Self::LensBlur,
        Self::Motion,
        Self::LineScan,
        Self::Environment,
        Self::PunctualLights,
        Self::LightProfiles,
        Self::EmissionProfiles,
        Self::ManyLights,
        Self::Color,
        Self::EveryLight,
        Self::CoverConnection,
        Self::LearnedRoulette,
    ];

    /// Its name, as in `smooth-refraction`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Textures => "textures",
            Self::VertexColors => "vertex-colors",
            Self::NormalMaps => "normal-maps",
            Self::SmoothNormals => "smooth-normals",
            Self::Coverage => "coverage",
            Self::ThinSheets => "thin-sheets",
            Self::DiffuseTransmission => "diffuse-transmission",
            Self::SmoothRefraction => "smooth-refraction",
            Self::RoughRefraction => "rough-refraction",
            Self::Nesting => "nesting",
            Self::Absorption => "absorption",
            Self::Scattering => "scattering",
            Self::Anisotropy => "anisotropy",
            Self::Finish => "finish",
            Self::RoundedEdges => "rounded-edges",
            Self::Sheen => "sheen",
            Self::Clearcoat => "clearcoat",
            Self::EnergyCompensation => "energy-compensation",
            Self::FiniteAperture => "finite-aperture",
            Self::Distortion => "distortion",
            Self::LensBlur => "psf",
            Self::Motion => "motion",
            Self::LineScan => "line-scan",
            Self::Environment => "environment",
            Self::PunctualLights => "punctual-lights",
            Self::LightProfiles => "light-profiles",
            Self::EmissionProfiles => "emission-profiles",
            Self::ManyLights => "many-lights",
            Self::Color => "color",
            Self::EveryLight => "every-light",
            Self::CoverConnection => "cover-connection",
            Self::LearnedRoulette => "learned-roulette",
        }
    }

    /// True for a sampling technique. If a technique is left out, the noise of the image changes and its expected
    /// value stays.
    pub fn is_technique(self) -> bool {
        matches!(self, Self::EveryLight | Self::CoverConnection | Self::LearnedRoulette)
    }
}

/// The effects that a scene needs, each with the objects that need it.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Effects {
    users: Vec<(Effect, Vec<String>)>,
}

impl Effects {
    /// Reads the description of a scene. Effects that only a compiled scene determines (nesting, number of lights,
    /// covers) are added by the compiler.
    pub(crate) fn from_scene(scene: &SceneBuilder) -> Self {
        let mut effects = Self::default();
        let mut used = vec![false; scene.materials.len()];
        for part in scene.instances.iter().flat_map(|i| &i.meshes).filter_map(|&m| scene.meshes.get(m)) {
            if let Some(used) = used.get_mut(part.material) {
                *used = true;
            }
            effects.add_from_mesh(part);
        }
        for (material, _) in scene.materials.iter().zip(used).filter(|(_, used)| *used) {
            effects.add_from_material(material);
            let rough = material.roughness.factor > 0.0 || material.roughness.texture.is_some();
            if scene.energy_compensation && rough && !material.unlit {
                effects.add(Effect::EnergyCompensation, material_place(material));
            }
        }
        for light in &scene.lights {
            let place = format!("light \"{}\"", light.name);
            let (effect, color) = match light.kind {
                PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => {
                    (Effect::PunctualLights, intensity)
                }
                PunctualKind::Directional { irradiance } | PunctualKind::Sun { irradiance, .. } => {
                    (Effect::PunctualLights, irradiance)
                }
                PunctualKind::Profile { scale, .. } => (Effect::LightProfiles, scale),
            };
            if !is_grey(color) {
                effects.add(Effect::Color, place.clone());
            }
            effects.add(effect, place);
        }
        if let Some(environment) = &scene.environment {
            let (what, is_colored) = match &environment.source {
                EnvironmentSource::Constant(radiance) => ("constant", !is_grey(*radiance)),
                EnvironmentSource::Image { .. } => ("an image", true),
            };
            effects.add(Effect::Environment, format!("environment ({what})"));
            if is_colored {
                effects.add(Effect::Color, "environment".into());
            }
        }
        for instance in scene.instances.iter().filter(|i| scene.moves(i)) {
            effects.add(Effect::Motion, format!("object \"{}\"", instance.name));
        }
        if matches!(scene.shutter, Some(Shutter::Lines(_))) {
            effects.add(Effect::LineScan, "line scan".into());
        }
        for camera in &scene.cameras {
            let place = || format!("camera \"{}\"", camera.name);
            if camera.lens.aperture.is_some() {
                effects.add(Effect::FiniteAperture, place());
            }
            if !camera.lens.distortion.is_none() {
                effects.add(Effect::Distortion, place());
            }
            if camera.lens.spread.is_some() {
                effects.add(Effect::LensBlur, place());
            }
        }
        effects
    }

    fn add_from_mesh(&mut self, part: &MeshPart) {
        let place = || format!("mesh \"{}\"", part.name);
        if !part.mesh.colors.is_empty() {
            self.add(Effect::VertexColors, place());
            self.add(Effect::Color, place());
        }
        if !part.mesh.normals.is_empty() {
            self.add(Effect::SmoothNormals, place());
        }
        if part.edge_radius > 0.0 {
            self.add(Effect::RoundedEdges, place());
        }
    }

    fn add_from_material(&mut self, m: &Material) {
        let transmits = m.transmission.factor > 0.0 && !m.is_metal();
        let medium = match &m.surface {
            Surface::Solid(volume) if transmits => Some(Medium::new(volume)),
            _ => None,
        };
        let has_normal_map = m.normal_map.texture.is_some();
        let others = [m.normal_map.texture, m.height_texture()];
        let is_textured = m.textures().count() > others.iter().flatten().count();
        // An interface between equal indices of refraction neither bends light nor reflects it.
        let bends = transmits && m.ior != 1.0;
        let colors = [m.base_color, m.emission, m.specular.color, m.sheen.color];
        let is_colored = is_textured
            || colors.iter().any(|c| !is_grey(c.factor))
            || medium.as_ref().is_some_and(|v| !is_grey(v.absorption) || !is_grey(v.scattering));
        let required = [
            (Effect::Textures, is_textured),
            (Effect::NormalMaps, has_normal_map),
            (Effect::Coverage, m.alpha_mode != AlphaMode::Opaque),
            (Effect::ThinSheets, bends && medium.is_none()),
            (Effect::DiffuseTransmission, m.diffuse_transmission.share.factor > 0.0),
            (Effect::SmoothRefraction, bends && medium.is_some() && m.is_smooth()),
            (Effect::RoughRefraction, bends && medium.is_some() && !m.is_smooth()),
            (Effect::Absorption, medium.as_ref().is_some_and(|v| !v.absorption.is_black())),
            (Effect::Scattering, medium.as_ref().is_some_and(Medium::scatters)),
            (Effect::Anisotropy, m.anisotropy.strength.factor != 0.0),
            (Effect::Finish, m.height.is_some()),
            (Effect::Sheen, !m.sheen.color.factor.is_black()),
            (Effect::Clearcoat, m.clearcoat.strength.factor > 0.0),
            (
                Effect::EmissionProfiles,
                m.emission_profile != EmissionProfile::Lambertian && !m.emission.factor.is_black(),
            ),
            (Effect::Color, is_colored),
        ];
        for (effect, _) in required.into_iter().filter(|(_, is_required)| *is_required) {
            self.add(effect, material_place(m));
        }
    }

    /// Records that an object needs an effect.
    pub(crate) fn add(&mut self, effect: Effect, place: String) {
        match self.users.iter_mut().find(|(e, _)| *e == effect) {
            Some((_, places)) if places.contains(&place) => {}
            Some((_, places)) => places.push(place),
            None => self.users.push((effect, vec![place])),
        }
    }

    /// The objects that need an effect; empty if there are none.
    pub fn users(&self, effect: Effect) -> &[String] {
        self.users.iter().find(|(e, _)| *e == effect).map_or(&[], |(_, places)| places)
    }

    /// True if the scene needs the effect.
    pub fn has(&self, effect: Effect) -> bool {
        !self.users(effect).is_empty()
    }
}

pub(crate) fn material_place(m: &Material) -> String {
    format!("material \"{}\"", m.name)
}

fn is_grey(c: dunkelfeld_radiometry::Rgb) -> bool {
    c.r == c.g && c.g == c.b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Volume;
    use dunkelfeld_geometry::Mesh;
    use dunkelfeld_radiometry::Rgb;

    fn scene(material: Material) -> SceneBuilder {
        let mut scene = SceneBuilder::default();
        let index = scene.add_material(material);
        scene.add_object("body", Mesh::default(), index);
        scene
    }

    #[test]
    fn effects_of_a_material_are_listed_with_its_name() {
        let volume = Volume { scattering: Rgb::splat(100.0), absorption: Rgb::new(1.0, 2.0, 3.0), ..Volume::default() };
        let frosted = Material {
            name: "frosted".into(),
            transmission: 1.0.into(),
            roughness: 0.3.into(),
            surface: Surface::Solid(volume),
            alpha_mode: AlphaMode::Blend,
            ..Material::default()
        };
        let effects = Effects::from_scene(&scene(frosted));
        let called: Vec<Effect> = Effect::ALL.into_iter().filter(|&e| effects.has(e)).collect();
        let wanted = [Effect::Coverage, Effect::RoughRefraction, Effect::Absorption, Effect::Scattering, Effect::Color];
        assert_eq!(called, wanted);
        assert_eq!(effects.users(Effect::Scattering), ["material \"frosted\""]);
    }
}
