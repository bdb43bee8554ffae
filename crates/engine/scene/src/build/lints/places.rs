//! Corners, bounds and names of objects for findings, and the list of findings of one kind.

use crate::build::report::BuildReport;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Aabb, Vec3};

/// Maximum number of findings of one kind that are reported one by one.
const MAX_PER_KIND: usize = 20;

/// Corners of a part's triangles in render space.
pub(super) fn corners<'a>(scene: &'a Scene, part: &'a Part) -> impl Iterator<Item = [Vec3; 3]> + 'a {
    let mesh = &scene.meshes[part.mesh as usize];
    let to_render = move |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
    (0..mesh.triangles.len()).map(move |t| mesh.corners(t).map(to_render))
}

pub(super) fn bounds(scene: &Scene, part: &Part) -> Aabb {
    let own = Aabb::from_points(corners_in_place(scene, part));
    part.transform.as_ref().map_or(own, |t| own.transformed(t))
}

/// [`bounds`] of all poses at the times of the samples.
pub(super) fn bounds_in_motion(scene: &Scene, part: &Part) -> Aabb {
    let at_rest = bounds(scene, part);
    match (&part.motion, &scene.shutter) {
        (Some(motion), Some(shutter)) => {
            let [from, to] = shutter.times();
            motion.swept(&at_rest, from, to)
        }
        _ => at_rest,
    }
}

/// Corners in the space of the mesh.
pub(super) fn corners_in_place<'a>(scene: &'a Scene, part: &Part) -> impl Iterator<Item = Vec3> + 'a {
    let mesh = &scene.meshes[part.mesh as usize];
    mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize])
}

/// `object "lid"`.
pub(super) fn place(scene: &Scene, part: &Part) -> String {
    let name = scene.object_names.get(part.object as usize).map_or("", String::as_str);
    if name.is_empty() { format!("object {}", part.object) } else { format!("object \"{name}\"") }
}

/// Reports findings of one kind: the first ones one by one, the number of the others.
pub(super) fn push(report: &mut BuildReport, findings: Vec<(String, String)>) {
    let more = findings.len().saturating_sub(MAX_PER_KIND);
    for (place, message) in findings.into_iter().take(MAX_PER_KIND) {
        report.hazard(place, message);
    }
    if more > 0 {
        report.hazard("scene", format!("the same holds for {more} more objects"));
    }
}

/// A length in words.
pub(super) fn meters(v: f32) -> String {
    match v.abs() {
        a if a == 0.0 || (1e-2..1e4).contains(&a) => format!("{v:.3} m"),
        _ => format!("{v:.1e} m"),
    }
}
