//! Checks for slips of modelling and export: a wrong unit of length, materials that no one chose, objects that are twice
//! in one place, lights that are covered.

use super::places::{meters, place, push};
use crate::build::builder::Instance;
use crate::build::report::BuildReport;
use crate::material::Material;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Aabb, Ray, Transform};
use dunkelfeld_radiometry::Rgb;
use std::collections::HashMap;

/// An object that is larger \[m\] was probably modelled in millimetres: no part and no station is so large.
const LARGEST_OBJECT: f32 = 100.0;
/// A surface in front of an emitter is at contact below this share of the size of the emitter.
const CONTACT: f32 = 0.02;
/// Number of points of an emitter that are tested.
const POINTS: usize = 24;
/// Maximum number of emitters that are tested.
const MAX_EMITTERS: usize = 200;

pub(super) fn check(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    unit(scene, boxes, report);
    unchosen_materials(scene, report);
    covered_emitters(scene, boxes, report);
}

/// Reports the largest object if it is too large for the unit.
fn unit(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let sized = scene.parts.iter().zip(boxes).filter(|(_, b)| !b.is_empty());
    let largest = sized.map(|(part, b)| (part, b.size().max_element())).max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((part, size)) = largest.filter(|(_, size)| *size > LARGEST_OBJECT) {
        report.hazard(
            place(scene, part),
            format!(
                "is {} large; if the scene was modelled in millimetres, write `[import]` with `unit = \"mm\"` in a job, or export it in metres",
                meters(size)
            ),
        );
    }
}

/// White rough metal: the values of a glTF material without any key, and of a primitive without a material.
fn is_unchosen(m: &Material) -> bool {
    m.metallic >= 1.0
        && m.roughness >= 1.0
        && m.base_color == Rgb::WHITE
        && m.emission.is_black()
        && m.transmission == 0.0
        && m.clearcoat == 0.0
        && !m.unlit
        && m.textures().next().is_none()
}

/// Reports objects with a material that has all default values of glTF.
fn unchosen_materials(scene: &Scene, report: &mut BuildReport) {
    let mut seen = vec![false; scene.materials.len()];
    let mut findings = Vec::new();
    for part in &scene.parts {
        let material = &scene.materials[part.material as usize];
        let is_painted = !scene.meshes[part.mesh as usize].colors.is_empty();
        if is_painted || !is_unchosen(material) || std::mem::replace(&mut seen[part.material as usize], true) {
            continue;
        }
        findings.push((
            place(scene, part),
            format!(
                "has an empty material (\"{}\"), which glTF defines as white rough metal; give it a material in the modelling program (in Blender with a Principled BSDF node), or `metallic = 0` and a `base_color` in `[[material]]` of a job",
                material.name
            ),
        ));
    }
    push(report, findings);
}

/// Reports emitters whose front touches an opaque surface.
fn covered_emitters(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let emitters = scene.parts.iter().zip(boxes).filter(|(p, _)| scene.compiled[p.material as usize].emits);
    let mut findings = Vec::new();
    for (part, bounds) in emitters.filter(|(_, b)| !b.is_empty()).take(MAX_EMITTERS) {
        let size = bounds.size().max_element();
        let triangles = &scene.meshes[part.mesh as usize].triangles;
        let every = triangles.len().div_ceil(POINTS).max(1);
        let mut cover: Option<(&Part, f32)> = None;
        let is_covered = !scene.materials[part.material as usize].double_sided
            && super::corners(scene, part).step_by(every).all(|corners| {
                let normal = dunkelfeld_geometry::geometric_normal(&corners);
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                // A start off the surface, far above rounding and far below the distance of contact.
                let start = middle + normal * (1e-3 * CONTACT * size);
                let hit = scene.intersect(&Ray::with_end(start, normal, CONTACT * size));
                let Some(hit) = hit else { return false };
                let in_front = &scene.parts[hit.part as usize];
                let compiled = &scene.compiled[hit.material as usize];
                let is_opaque = !compiled.both_sides && !compiled.has_coverage && !compiled.emits;
                if cover.is_none_or(|(_, distance)| hit.distance < distance) {
                    cover = Some((in_front, hit.distance));
                }
                is_opaque && in_front.object != part.object
            });
        if let (true, Some((in_front, distance))) = (is_covered, cover) {
            findings.push((
                place(scene, part),
                format!(
                    "shines at {} {} in front of it, and its light reaches nothing else; turn its normals around, move it, or remove what covers it",
                    place(scene, in_front),
                    meters(distance)
                ),
            ));
        }
    }
    push(report, findings);
}

/// Reports objects that show the same meshes in the same place as an earlier one.
pub(crate) fn twins(placed: &[(u32, Instance, Transform)], report: &mut BuildReport) {
    let mut known: HashMap<(&[usize], [u32; 12]), &str> = HashMap::new();
    let mut findings = Vec::new();
    for (_, instance, transform) in placed.iter().filter(|(_, instance, _)| !instance.meshes.is_empty()) {
        let key = transform.to_world().to_cols_array().map(|v| (v as f32 + 0.0).to_bits());
        match known.get(&(instance.meshes.as_slice(), key)) {
            Some(first) => findings.push((
                format!("object \"{}\"", instance.name),
                format!(
                    "is a copy of object \"{first}\" in the same place: light meets both, and labels show either; remove one of them, for example by `[[object]]` with `visible = false`"
                ),
            )),
            None => {
                known.insert((&instance.meshes, key), &instance.name);
            }
        }
    }
    push(report, findings);
}
