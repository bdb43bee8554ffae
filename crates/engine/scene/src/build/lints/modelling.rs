//! Checks for slips of modelling and export: a wrong unit of length, and materials that no one chose.

use super::places::{meters, place, push};
use crate::build::bake::PlacedObject;
use crate::build::builder::MeshPart;
use crate::build::report::BuildReport;
use crate::material::Material;
use crate::scene::Scene;
use dunkelfeld_geometry::{Aabb, DVec3};
use dunkelfeld_radiometry::{Number, Rgb};

/// An object that is larger \[m\] was probably modelled in millimetres: a station is smaller, and a part of 10 mm is then
/// 10 m large.
pub const LARGEST_OBJECT: f32 = 10.0;

/// An object of a file without a unit that is smaller \[m\] was probably modelled in metres, and read in millimetres.
const SMALLEST_OBJECT: f64 = 2e-3;

/// Reports objects of files without a unit that are too small for the unit that was assumed.
pub(crate) fn small_objects(placed: &[PlacedObject], meshes: &[MeshPart], report: &mut BuildReport) {
    let mut findings = Vec::new();
    for (_, instance, transform) in placed {
        let to_world = transform.to_world().matrix3;
        let axes = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|axis| axis.length());
        let of_file = instance.meshes.iter().map(|&m| &meshes[m]).filter(|part| part.is_unit_assumed);
        let sizes = of_file.map(|part| Aabb::from_points(part.mesh.positions.iter().copied()).size().as_dvec3());
        let largest = sizes.map(|size| (size * DVec3::from(axes)).max_element()).fold(0.0, f64::max);
        if largest > 0.0 && largest < SMALLEST_OBJECT {
            findings.push((
                format!("object \"{}\"", instance.name),
                format!(
                    "is {} mm large, as its file was read in millimetres; if it was modelled in metres, write `[import]` with `unit = \"m\"` in a job, otherwise `unit = \"mm\"`",
                    Number((1e6 * largest).round() / 1e3)
                ),
            ));
        }
    }
    push(report, findings);
}

pub(super) fn check(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    unit(scene, boxes, report);
    unchosen_materials(scene, report);
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
    m.metallic.factor >= 1.0
        && m.roughness.factor >= 1.0
        && m.base_color.factor == Rgb::WHITE
        && m.transmission.factor == 0.0
        && m.clearcoat.strength.factor == 0.0
        && !m.emits()
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
