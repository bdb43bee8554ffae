//! Checks for faces of different objects in one plane, or so close together that rounding decides their order.

use super::places::{corners, meters, place, push};
use crate::build::report::BuildReport;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Vec2, Vec3, geometric_normal};
use std::collections::{BTreeMap, HashMap};

/// Faces within this many steps of the coordinates of the scene are coincident.
const SAME: f32 = 4.0;
/// Rounding changes a gap below this many steps by percents.
const NARROW: f32 = 64.0;
/// Number of grid steps per unit of a normal. Normals in the same cell count as one direction.
const DIRECTIONS: f32 = 1e4;
/// Maximum number of triangles that are checked, and of planes that are stored. Scenes made by hand have fewer.
const MAX_TRIANGLES: usize = 4_000_000;
const MAX_PLANES: usize = 400_000;
/// Maximum number of parts that are stored for one plane. For a ceiling of ten thousand lamps a sample of them is
/// enough.
const MAX_FACES: usize = 256;
/// Maximum number of triangles of a part in one plane that are compared one by one.
const MAX_TRIANGLES_OF_FACE: usize = 512;
/// Maximum number of compared pairs of triangles, which takes a fraction of a second. The remaining pairs are not
/// checked.
const MAX_COMPARISONS: usize = 1 << 22;

/// A plane up to its orientation, in steps of direction and of distance.
type PlaneKey = [i32; 4];

/// The triangles of one part in one plane.
struct Face {
    part: usize,
    /// True if the face has the normal of the plane, false if the opposite one.
    along: bool,
    offset: f32,
    /// Lowest and highest values of the two coordinates that are used in the plane.
    low: [f32; 2],
    high: [f32; 2],
    /// The triangles in the same coordinates, at most [`MAX_TRIANGLES_OF_FACE`].
    triangles: Vec<[Vec2; 3]>,
}

pub(super) fn check(scene: &Scene, report: &mut BuildReport) {
    let step = scene.radius.next_up() - scene.radius;
    if !(step > 0.0 && step.is_finite()) {
        return;
    }
    // An ordered map, so that the order of the findings is the same in every run.
    let mut planes: BTreeMap<PlaneKey, Vec<Face>> = BTreeMap::new();
    let mut checked = 0;
    for (index, part) in scene.parts.iter().enumerate() {
        checked += scene.meshes[part.mesh as usize].triangles.len();
        if checked > MAX_TRIANGLES {
            break;
        }
        for triangle in corners(scene, part) {
            if planes.len() < MAX_PLANES {
                add(&mut planes, index, triangle, NARROW * step);
            }
        }
    }
    let mut found: HashMap<(usize, usize), String> = HashMap::new();
    let mut order = Vec::new();
    let mut comparisons = MAX_COMPARISONS;
    for faces in planes.values().filter(|f| f.len() > 1) {
        for (i, a) in faces.iter().enumerate() {
            for b in &faces[i + 1..] {
                let gap = (a.offset - b.offset).abs();
                if gap > NARROW * step || !boxes_overlap(a, b, SAME * step) {
                    continue;
                }
                let pair = (a.part.min(b.part), a.part.max(b.part));
                if found.contains_key(&pair) {
                    continue;
                }
                if let Some(message) = overlap_message(scene, a, b, gap, step)
                    && overlap(a, b, SAME * step, &mut comparisons)
                {
                    found.insert(pair, message);
                    order.push(pair);
                }
            }
        }
    }
    order.sort_unstable();
    let finding = |pair| found.remove(&pair).map(|m| (place(scene, &scene.parts[pair.0]), m));
    push(report, order.into_iter().filter_map(finding).collect());
}

/// Adds a triangle to its plane and to the next one. So two planes that are close share a key.
fn add(planes: &mut BTreeMap<PlaneKey, Vec<Face>>, part: usize, triangle: [Vec3; 3], width: f32) {
    let n = geometric_normal(&triangle);
    if n == Vec3::ZERO {
        return;
    }
    // A plane has two normals. The one whose first component that is not small is positive is the key for both.
    let leading = [n.x, n.y, n.z].into_iter().find(|c| c.abs() > 0.01).unwrap_or(1.0);
    let along = leading > 0.0;
    let m = if along { n } else { -n };
    let offset = (m.as_dvec3().dot(triangle[0].as_dvec3())) as f32;
    let direction = (m * DIRECTIONS).round();
    // Projected along the coordinate axis that is nearest to the normal of the plane. This axis is the same for all
    // triangles with the same key. A frame computed from the normal could flip with the sign of a zero.
    let steps = direction.abs().to_array();
    let k = if steps[0] >= steps[1].max(steps[2]) { 0 } else { 1 + usize::from(steps[1] < steps[2]) };
    let flat = triangle.map(|p| Vec2::new(p[(k + 1) % 3], p[(k + 2) % 3]));
    let bound = |f: fn(f32, f32) -> f32, k: usize| f(f(flat[0][k], flat[1][k]), flat[2][k]);
    let (low, high) = ([bound(f32::min, 0), bound(f32::min, 1)], [bound(f32::max, 0), bound(f32::max, 1)]);
    // Cells are two gaps wide and start at every gap. So two planes within a gap share a cell.
    let cell = (offset / width).floor();
    for shift in [0.0, 1.0] {
        let key = [direction.x as i32, direction.y as i32, direction.z as i32, (cell + shift) as i32];
        let faces = planes.entry(key).or_default();
        let same = |f: &&mut Face| f.part == part && f.along == along && (f.offset - offset).abs() < 1e-3 * width;
        let has_room = faces.len() < MAX_FACES;
        match faces.iter_mut().find(same) {
            Some(face) => {
                for k in 0..2 {
                    (face.low[k], face.high[k]) = (face.low[k].min(low[k]), face.high[k].max(high[k]));
                }
                if face.triangles.len() < MAX_TRIANGLES_OF_FACE {
                    face.triangles.push(flat);
                }
            }
            None if has_room => faces.push(Face { part, along, offset, low, high, triangles: vec![flat] }),
            None => {}
        }
    }
}

/// True if the boxes around two faces overlap. This test rejects most pairs.
fn boxes_overlap(a: &Face, b: &Face, least: f32) -> bool {
    (0..2).all(|k| a.high[k].min(b.high[k]) - a.low[k].max(b.low[k]) > least)
}

/// True if two faces overlap. For a frame and the object in it the triangles must be compared. Each compared pair is
/// subtracted from `comparisons`; if none is left the result is false.
fn overlap(a: &Face, b: &Face, least: f32, comparisons: &mut usize) -> bool {
    a.triangles.iter().any(|s| {
        let Some(left) = comparisons.checked_sub(b.triangles.len()) else { return false };
        *comparisons = left;
        b.triangles.iter().any(|t| share_area(s, t, least))
    })
}

/// True if two triangles overlap by more than `least` along every direction perpendicular to one of their edges. (Two
/// convex shapes are separate if and only if they are separate along one of these: the separating axis theorem.)
fn share_area(s: &[Vec2; 3], t: &[Vec2; 3], least: f32) -> bool {
    let extent = |corners: &[Vec2; 3], axis: Vec2| {
        let [a, b, c] = corners.map(|p| p.dot(axis));
        [a.min(b).min(c), a.max(b).max(c)]
    };
    [s, t].into_iter().all(|shape| {
        (0..3).all(|k| {
            let axis = (shape[(k + 1) % 3] - shape[k]).perp().normalize_or_zero();
            let ([s0, s1], [t0, t1]) = (extent(s, axis), extent(t, axis));
            s1.min(t1) - s0.max(t0) > least
        })
    })
}

/// The finding for two coincident faces; `None` if they are harmless.
fn overlap_message(scene: &Scene, a: &Face, b: &Face, gap: f32, step: f32) -> Option<String> {
    let parts = [&scene.parts[a.part], &scene.parts[b.part]];
    let [pa, pb] = parts;
    if pa.object == pb.object && pa.material == pb.material {
        return None;
    }
    let is = |f: &dyn Fn(&Part) -> bool| parts.map(f);
    let solid = is(&|p| scene.compiled[p.material as usize].is_solid);
    let emits = is(&|p| scene.compiled[p.material as usize].emits);
    // The finding is reported for the first of the two.
    let other = place(scene, &scene.parts[a.part.max(b.part)]);
    if gap > SAME * step {
        // A narrow gap matters only if light passes through it.
        return (solid[0] || solid[1]).then(|| {
            format!(
                "has a face {} from one of {other}, where coordinates go in steps of {}: the gap has an error of {:.0} %; make it wider, or let the faces coincide",
                meters(gap), meters(step), 100.0 * step / gap
            )
        });
    }
    match (solid, emits) {
        // Solids in contact form one interface.
        ([true, true], _) => None,
        ([true, false] | [false, true], _) => Some(format!(
            "touches {other}, and one of them is a clear solid: light passes from one to the other without an air gap; leave a gap of some {} if there is air between them",
            meters(200.0 * step)
        )),
        (_, [true, true]) => Some(format!(
            "and {other} both emit from the same place: light sampling adds both, a camera ray hits one; delete one of them"
        )),
        (_, [true, false] | [false, true]) => Some(format!(
            "lies in a face of {other}, and one of them emits: rounding decides which of the two is rendered; move the emitter off the surface"
        )),
        // Opposite faces in contact hide each other. For faces with the same orientation, rounding decides which one is
        // visible.
        _ if a.along == b.along => Some(format!(
            "lies in a face of {other}: rounding decides which of the two is rendered; delete one of them or move them apart by more than {}",
            meters(SAME * step)
        )),
        _ => None,
    }
}
