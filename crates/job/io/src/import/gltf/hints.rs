//! Hints about light that an export left out or weakened.

use super::document::Document;
use super::nodes::Hierarchy;
use crate::import::options::EmissiveUnit;
use crate::import::warnings::Warnings;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_scene::{PunctualKind, SceneBuilder};

/// Words in the names of lights.
const WORDS: &[&str] = &["light", "lamp"];
/// Names of lights of Blender, with or without a number.
const STARTS: &[&str] = &["area", "spot", "sun"];
/// Most names in a message.
const MOST_NAMES: usize = 6;
/// Nits of an emission, at the unit of glTF, below which it was probably meant in W/(m^2 sr). The factor 683 lm/W lies
/// between this and the emission that is visible.
const DARK_NITS: f32 = 500.0;

/// Warns of nodes without content whose names are those of lights. Blender's export of glTF writes its area lights so.
pub(super) fn lost_lights(document: &Document, hierarchy: &Hierarchy, warnings: &mut Warnings) {
    let lost: Vec<(&str, DVec3)> = hierarchy
        .shown
        .iter()
        .filter_map(|i| {
            let node = document.root.nodes.get(*i)?;
            let has_light = node.extensions.as_ref().is_some_and(|e| e.khr_lights_punctual.is_some());
            let has_children = node.children.as_ref().is_some_and(|c| !c.is_empty());
            let is_empty = node.mesh.is_none() && node.camera.is_none() && !has_light && !has_children;
            let name = node.name.as_deref().filter(|name| is_empty && is_name_of_light(name))?;
            Some((name, hierarchy.to_world.get(*i)?.translation))
        })
        .collect();
    if lost.is_empty() {
        return;
    }
    let shown =
        lost.iter().take(MOST_NAMES).map(|(name, p)| format!("\"{name}\" at [{:.3}, {:.3}, {:.3}]", p.x, p.y, p.z));
    let mut names = shown.collect::<Vec<_>>().join(", ");
    if lost.len() > MOST_NAMES {
        names.push_str(&format!(" and {} more", lost.len() - MOST_NAMES));
    }
    let message = format!(
        "{} nodes without content have names of lights: {names}; Blender's export of glTF leaves out area lights: make \
         them planes with an emissive material, or add `[[light]]` with `kind = \"panel\"` to a job at these places",
        lost.len()
    );
    warnings.push("nodes", message);
}

fn is_name_of_light(name: &str) -> bool {
    let lower = name.to_lowercase();
    let is_numbered = |start: &&str| {
        let rest = lower.strip_prefix(*start);
        rest.is_some_and(|rest| rest.chars().all(|c| !c.is_alphabetic()))
    };
    WORDS.iter().any(|word| lower.contains(word)) || STARTS.iter().any(is_numbered)
}

/// Warns of emissive materials in a file of Blender. Its export writes the strength of lamps with the factor 683 lm/W, and
/// that of emissive materials without.
pub(super) fn dark_emission(scene: &SceneBuilder, document: &Document, unit: EmissiveUnit, warnings: &mut Warnings) {
    let generator = document.root.asset.generator.as_deref().unwrap_or_default();
    if !generator.starts_with("Khronos glTF Blender I/O") || unit != EmissiveUnit::Nit {
        return;
    }
    let shines = |kind: &PunctualKind| match kind {
        PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => !intensity.is_black(),
        PunctualKind::Directional { irradiance } | PunctualKind::Sun { irradiance, .. } => !irradiance.is_black(),
        PunctualKind::Profile { scale, .. } => !scale.is_black(),
    };
    let nits = |radiance: f32| radiance * crate::import::LUMENS_PER_WATT;
    let dark =
        |m: &&dunkelfeld_scene::Material| !m.emission.factor.is_black() && nits(m.emission.factor.mean()) < DARK_NITS;
    let Some(material) = scene.materials.iter().find(dark) else { return };
    let (beside, unlike, result) = match scene.lights.iter().find(|l| shines(&l.kind)) {
        Some(lamp) => {
            (format!(" beside lamps such as \"{}\"", lamp.name), " that its lamps have", "for the ratio of Blender")
        }
        None => (String::new(), "", "for the radiance of Blender"),
    };
    let message = format!(
        "emits {:.1} nit = {:.4} W/(m^2 sr){beside}; Blender writes the strength of emission without the factor of 683 lm/W{unlike}: {result} write `[import]` with `emissive_unit = \"W/(m2 sr)\"` in a job",
        nits(material.emission.factor.mean()),
        material.emission.factor.mean(),
    );
    warnings.push(format!("material \"{}\"", material.name), message);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_lights_are_recognised() {
        for name in ["Area", "area.001", "Spot", "Sun.002", "Key Light", "Lamp", "ringlight_3"] {
            assert!(is_name_of_light(name), "{name}");
        }
        for name in ["Area of interest", "Sunflower", "Empty", "sample", "spotless", ""] {
            assert!(!is_name_of_light(name), "{name}");
        }
    }
}
