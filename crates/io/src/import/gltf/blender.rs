//! Hints for files of Blender's own glTF exporter, which leaves out area lights and writes emission in W/(m² sr).

use super::document::Document;
use crate::import::options::EmissiveUnit;
use crate::import::warnings::Warnings;

/// Parts of names that lights have, in lower case.
const PARTS: [&str; 3] = ["lamp", "light", "softbox"];

/// Warns about nodes without content that are named like lights, and about emission in another unit.
pub(super) fn warn(document: &Document, shown: &[usize], unit: EmissiveUnit, warnings: &mut Warnings) {
    let nodes = &document.root.nodes;
    let is_empty = |index: usize| {
        nodes.get(index).is_some_and(|n| {
            let has_light = n.extensions.as_ref().is_some_and(|e| e.khr_lights_punctual.is_some());
            let has_profile = document.nodes.get(index).is_some_and(|n| n.profile.is_some());
            let has_children = n.children.as_ref().is_some_and(|c| !c.is_empty());
            n.mesh.is_none() && n.camera.is_none() && n.skin.is_none() && !has_light && !has_profile && !has_children
        })
    };
    let empty = shown.iter().filter(|index| is_empty(**index)).filter_map(|index| nodes.get(*index)?.name.as_deref());
    let lamps: Vec<&str> = empty.filter(|name| is_named_like_a_light(name)).collect();
    if let Some(first) = lamps.first() {
        let message = format!(
            "{} without content named like lights, \"{first}\" first: exporters leave out area lights; give them to the \
             job as [[light]] with a `kind`, or export with the add-on for Blender",
            match lamps.len() {
                1 => "a node is".to_string(),
                n => format!("{n} nodes are"),
            }
        );
        warnings.push("nodes", message);
    }
    let emits = document.root.materials.iter().find(|m| m.emissive_factor.0.iter().any(|c| *c > 0.0));
    if let Some(material) = emits.filter(|_| document.is_from_blender && unit == EmissiveUnit::Nit) {
        let name = material.name.as_deref().unwrap_or_default();
        let message = format!(
            "emission, \"{name}\" first, is read in nit and divided by 683; Blender writes W/(m2 sr): write \
             emissive_unit = \"W/(m2 sr)\" in [import], or export with the add-on for Blender"
        );
        warnings.push("materials", message);
    }
}

/// Has a name a part that lights have, or the word "area", the name of an area light in Blender?
fn is_named_like_a_light(name: &str) -> bool {
    let lower = name.to_lowercase();
    PARTS.iter().any(|part| lower.contains(part))
        || lower.split(|c: char| !c.is_alphabetic()).any(|word| word == "area")
}
