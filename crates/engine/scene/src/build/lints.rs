//! Checks of a compiled scene for hazards before the render: sizes below the precision of f32, coincident faces,
//! attributes that disagree with the surface, implausible indices of refraction.
//!
//! Every finding names its object and contains help. Geometry that the renderer handles correctly, such as thin
//! triangles or solids in contact, is not reported.

mod attributes;
mod blocked;
mod contact;
mod enclosed;
mod lights;
mod modelling;
mod motion;
mod places;
mod twins;

pub use modelling::LARGEST_OBJECT;
pub(crate) use modelling::small_objects;
pub(crate) use twins::{Shape, twins};

use crate::build::lints::places::{bounds, corners, meters, place, push};
use crate::build::report::BuildReport;
use crate::material::Surface;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Aabb, Mesh, Vec3};

/// An object whose size is less than this many steps of its coordinates is reported.
const MIN_STEPS: f32 = 1e3;
/// A solid thinner than this many steps is reported: the relative error of its absorption is a few percent.
const MIN_STEPS_THROUGH: f32 = 32.0;
/// An emitter smaller than this share of the scene is a hazard if the scene has sharp reflections.
const TINY_EMITTER: f32 = 1e-4;
/// Below this roughness a reflection is too sharp for light sampling.
const SHARP: f32 = 0.05;
/// Maximum number of corners of a solid that are tested for overlap with other solids.
const MAX_CORNERS: usize = 48;
/// Maximum number of solids in the test for overlap, which compares all pairs.
const MAX_SOLIDS: usize = 1000;

impl Scene {
    /// Adds hazards of the compiled scene to a report: sizes, coincident faces, lights inside solids, implausible values.
    pub fn report_hazards(&self, report: &mut BuildReport) {
        check(self, report);
    }
}

/// Runs all checks on a compiled scene.
fn check(scene: &Scene, report: &mut BuildReport) {
    let boxes: Vec<Aabb> = scene.parts.iter().map(|p| bounds(scene, p)).collect();
    modelling::check(scene, &boxes, report);
    lights::check(scene, &boxes, report);
    enclosed::check(scene, &boxes, report);
    sizes(scene, &boxes, report);
    attributes::check(scene, report);
    materials(scene, report);
    tiny_emitters(scene, &boxes, report);
    contact::check(scene, report);
    overlaps(scene, &boxes, report);
    cameras(scene, report);
}

/// The reason why a mesh lost precision before it was imported, if it did: its vertices lie far from their own origin.
pub(crate) fn lost_digits(mesh: &Mesh) -> Option<String> {
    let bounds = Aabb::from_points(mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]));
    if bounds.is_empty() {
        return None;
    }
    let (step, size) = (step(&bounds), bounds.size().max_element());
    (step * MIN_STEPS > size).then(|| {
        format!(
            "is {} large, but its vertices lie {} from their own origin, where coordinates go in steps of {}: its shape was rounded by {:.1} % of its size when it was written; export it around its own origin and place it by its transform",
            meters(size), meters(bounds.center().length()), meters(step), 100.0 * step / size
        )
    })
}

/// The distance between neighbouring f32 numbers at the largest coordinate of a box: the step of its coordinates \[m\].
fn step(bounds: &Aabb) -> f32 {
    let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
    largest.next_up() - largest
}

/// Reports objects that are small compared with the step of their coordinates, solids that are thin compared with it,
/// and triangles whose height is rounding error.
fn sizes(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let (mut small, mut thin, mut needles) = (Vec::new(), Vec::new(), Vec::new());
    for (part, bounds) in scene.parts.iter().zip(boxes).filter(|(_, b)| !b.is_empty()) {
        let (step, size) = (step(bounds), bounds.size().max_element());
        if step * MIN_STEPS > size {
            let far = bounds.center().length();
            small.push((
                place(scene, part),
                format!(
                    "is {} large and lies {} from the middle of the scene, where coordinates go in steps of {}: its shape is rounded by {:.1} % of its size; remove the objects that make the scene so large, or place the object near the middle of the scene",
                    meters(size), meters(far), meters(step), 100.0 * step / size
                ),
            ));
            continue;
        }
        let (mut area, mut volume, mut noisy) = (0.0f64, 0.0f64, 0usize);
        let middle = bounds.center();
        for [a, b, c] in corners(scene, part).map(|c| c.map(|p| (p - middle).as_dvec3())) {
            let twice = (b - a).cross(c - a).length();
            let longest2 = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
            (area, volume) = (area + 0.5 * twice, volume + a.dot(b.cross(c)) / 6.0);
            // Height times longest edge is twice the area.
            noisy += usize::from(twice < 4.0 * f64::from(step) * longest2.sqrt());
        }
        // A plate of area A on both sides together has the volume A d / 2.
        let thickness = (2.0 * volume.abs() / area) as f32;
        let is_solid = scene.compiled[part.material as usize].is_solid;
        if is_solid && thickness > 0.0 && thickness < MIN_STEPS_THROUGH * step {
            thin.push((
                place(scene, part),
                format!(
                    "is a solid {} thick where coordinates go in steps of {}: its absorption has an error of {:.0} %; give its material thickness 0 to make it a sheet, or model it nearer to the middle of the scene",
                    meters(thickness), meters(step), 100.0 * step / thickness
                ),
            ));
        }
        if noisy > 0 {
            needles.push((
                place(scene, part),
                format!(
                    "has {noisy} triangles less than 4 steps of their coordinates ({}) high: the direction in which they face is rounding noise; remesh the object, or export it in double precision around its own origin",
                    meters(step)
                ),
            ));
        }
    }
    [small, thin, needles].into_iter().for_each(|findings| push(report, findings));
}

/// Reports indices of refraction outside the range of clear materials.
fn materials(scene: &Scene, report: &mut BuildReport) {
    let mut used = vec![false; scene.materials.len()];
    scene.parts.iter().for_each(|p| used[p.material as usize] = true);
    for (m, compiled) in scene.materials.iter().zip(&scene.compiled).zip(used).filter(|(_, u)| *u).map(|(m, _)| m) {
        let place = || format!("material \"{}\"", m.name);
        let (ior, clear) = (m.ior, compiled.both_sides);
        if ior < 1.0 && clear {
            report.hazard(place(), format!("has an index of refraction of {ior}, as if the surroundings were the denser medium; if that is not meant, give the inverse, {:.4}", 1.0 / ior));
        } else if ior > 4.1 && m.metallic.factor < 1.0 {
            report.hazard(place(), format!("has an index of refraction of {ior}; clear materials have 1 to 4.1 (germanium), and from 1000 on the number is cut off; for a metal set metallic to 1"));
        } else if compiled.is_solid && ior != 1.0 && (ior - 1.0).abs() < dunkelfeld_bsdf::dielectric::MATCHED_INDEX {
            report.hazard(place(), format!("has an index of refraction of {ior}, too near to 1: it neither reflects nor refracts; use 1, or differ by 0.001 at least"));
        }
    }
}

/// Reports emitters that are too small for scattered rays, in scenes with reflections so sharp that only scattered rays
/// sample them.
fn tiny_emitters(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let sharp = scene.parts.iter().map(|p| p.material as usize).find(|&m| {
        let material = &scene.materials[m];
        scene.compiled[m].is_smooth_clear || (material.metallic.factor > 0.5 && material.roughness.factor < SHARP)
    });
    let Some(sharp) = sharp else { return };
    let emitters = scene.parts.iter().zip(boxes).filter(|(p, _)| scene.compiled[p.material as usize].emits);
    let tiny = emitters.filter(|(_, b)| !b.is_empty() && b.size().max_element() < TINY_EMITTER * scene.radius);
    let findings = tiny.map(|(part, b)| {
        (
            place(scene, part),
            format!(
                "shines and is only {} large in a scene of {}: where material \"{}\" reflects or refracts it sharply, few samples find it and those that do are bright specks; make it larger and dimmer",
                meters(b.size().max_element()), meters(2.0 * scene.radius), scene.materials[sharp].name
            ),
        )
    });
    push(report, findings.collect());
}

/// Reports solids that overlap partly. Different priorities say which one is meant.
fn overlaps(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    if !scene.has_nesting() {
        return;
    }
    let mut seen = std::collections::HashSet::new();
    let mut findings = Vec::new();
    let priority = |part: &Part| match scene.materials[part.material as usize].surface {
        Surface::Solid(volume) => volume.priority,
        Surface::Thin => 0,
    };
    let solids = || scene.parts.iter().zip(boxes).filter(|(p, _)| scene.compiled[p.material as usize].is_solid);
    for (part, b) in solids().take(MAX_SOLIDS) {
        let others: Vec<&Part> = solids()
            .filter(|(o, _)| o.solid != part.solid && priority(o) == priority(part))
            .filter(|(_, ob)| b.min.cmplt(ob.max).all() && ob.min.cmplt(b.max).all())
            .map(|(o, _)| o)
            .collect();
        if others.is_empty() {
            continue;
        }
        let triangles: Vec<[Vec3; 3]> = corners(scene, part).collect();
        let every = triangles.len().div_ceil(MAX_CORNERS / 2).max(1);
        // A corner, and the middle of an edge. If two bars cross, only their edges enter each other.
        let asked: Vec<Vec3> =
            triangles.iter().step_by(every).flat_map(|[p, q, _]| [*p, 0.5 * (*p + *q)]).take(MAX_CORNERS).collect();
        let interiors: Vec<_> = asked.iter().map(|&p| scene.interior_at(p)).collect();
        for other in others {
            let inside = interiors.iter().filter(|i| i.ranks().contains(&other.solid)).count();
            let pair = (part.solid.min(other.solid), part.solid.max(other.solid));
            if inside == 0 || inside == asked.len() || !seen.insert(pair) {
                continue;
            }
            let top = if part.solid > other.solid { part } else { other };
            findings.push((
                place(scene, part),
                format!(
                    "overlaps {}: both are solids, and where both are, {} is; if that is not meant, move them apart or set the `priority` of their materials",
                    place(scene, other), place(scene, top)
                ),
            ));
        }
    }
    push(report, findings);
}

/// Reports cameras inside a solid.
fn cameras(scene: &Scene, report: &mut BuildReport) {
    for camera in &scene.cameras {
        let eye = (camera.to_world.translation - scene.world_origin).as_vec3();
        if let Some(material) = scene.material_inside(&scene.interior_at(eye)) {
            report.hazard(
                format!("camera \"{}\"", camera.name),
                format!(
                    "is inside a solid of material \"{}\", and all its rays start there; move it out if that is not meant",
                    scene.materials[material as usize].name
                ),
            );
        }
    }
}
