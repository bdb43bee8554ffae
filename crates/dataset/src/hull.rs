//! Convex hulls with flat facets, by the crate parry3d.

use dunkelfeld_geometry::{DQuat, DVec3};
use parry3d_f64::math::Vec3;
use parry3d_f64::transformation::try_convex_hull;
use std::collections::{BTreeMap, BTreeSet};

/// Points of one call of the crate, whose time grows with their square.
const CHUNK: usize = 2000;
/// Most points on the hull of an object. Denser ones are thinned.
const MOST: usize = 20_000;
/// Points this near to the plane of a facet belong to it, as a share of the size.
const FLAT: f64 = 1e-5;
/// Cosine of the largest angle between the parts of one facet.
const SAME: f64 = 0.9998;
/// Rotations that are tried if rounding spoils a hull.
const TRIES: u32 = 8;

/// A convex hull.
#[derive(Clone, Debug)]
pub(crate) struct Hull {
    pub(crate) points: Vec<DVec3>,
    pub(crate) faces: Vec<Face>,
    /// Centre of its volume; of its area if it is flat.
    pub(crate) center: DVec3,
    /// Volume; 0 if it is flat.
    pub(crate) volume: f64,
    /// All points lie in a plane, and the hull has two faces.
    pub(crate) is_flat: bool,
}

/// A flat facet of a hull.
#[derive(Clone, Debug)]
pub(crate) struct Face {
    /// Corners, counter-clockwise seen from outside.
    pub(crate) triangles: Vec<[usize; 3]>,
    /// Unit outward normal.
    pub(crate) normal: DVec3,
    /// Edges of its boundary.
    pub(crate) edges: Vec<Edge>,
}

/// An edge of a facet, which is on its left seen from outside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    pub(crate) from: usize,
    pub(crate) to: usize,
    /// The facet on the other side.
    pub(crate) beyond: usize,
}

/// The hull of points. It depends on the points alone, not on their order in space or on the machine.
///
/// # Errors
/// Points on one line, and none: the problem, as the end of a sentence about the object.
pub(crate) fn convex_hull(points: impl Iterator<Item = DVec3>) -> Result<Hull, &'static str> {
    const LINE: &str = "it has no extent in two directions, so that no face of it can rest on the plane";
    // + 0.0 makes one zero of both.
    let unique: BTreeSet<[u64; 3]> = points.map(|p| (p + 0.0).to_array().map(f64::to_bits)).collect();
    let points: Vec<DVec3> = unique.into_iter().map(|p| DVec3::from(p.map(f64::from_bits))).collect();
    let bounds = points.iter().map(|p| (*p, *p)).reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
    let (low, high) = bounds.ok_or("it has no triangles")?;
    let size = low.distance(high);
    if !(size > 0.0 && size.is_finite()) {
        return Err(LINE);
    }
    // The hull of an affine map is the map of the hull. In a cube, thin objects lose no facet by the tolerances of the crate.
    let extent = high - low;
    let thin = FLAT * size + 1e-6 * low.abs().max(high.abs()).max_element();
    let scale = [0, 1, 2].map(|k| if extent[k] > thin { 1.0 / extent[k] } else { 1.0 / size });
    let middle = 0.5 * (low + high);
    let cube: Vec<DVec3> = points.iter().map(|p| (*p - middle) * DVec3::from(scale)).collect();
    let (used, triangles) = triangles_of(&cube).ok_or(LINE)?;
    let points: Vec<DVec3> = used.into_iter().map(|i| points[i]).collect();
    faces_of(points, triangles, thin).ok_or(LINE)
}

/// The numbers of the points of a hull, and its triangles of these. The boundary of the triangles is closed.
fn triangles_of(points: &[DVec3]) -> Option<(Vec<usize>, Vec<[usize; 3]>)> {
    // The hull of all points is that of the corners of the hulls of parts of them.
    let mut left: Vec<usize> = (0..points.len()).collect();
    while left.len() > CHUNK {
        let before = left.len();
        left = left.chunks(CHUNK).flat_map(|chunk| corners(points, chunk)).collect();
        if left.len() > before / 2 {
            break;
        }
    }
    let mut cells = 1024.0;
    while left.len() > MOST {
        let cell = |i: usize| (points[i] * cells).floor().to_array().map(|v| v as i64);
        let kept: BTreeMap<[i64; 3], usize> = left.iter().rev().map(|i| (cell(*i), *i)).collect();
        left = kept.into_values().collect();
        cells *= 0.5;
    }
    (0..TRIES).find_map(|attempt| hull_of(points, &left, attempt))
}

/// The corners of the hull of some points; all points if it has no volume.
fn corners(points: &[DVec3], chunk: &[usize]) -> Vec<usize> {
    hull_of(points, chunk, 0).map_or_else(|| chunk.to_vec(), |(used, _)| used)
}

/// One call of the crate, with points that are rotated for another rounding. `None` if the triangles are not closed.
fn hull_of(points: &[DVec3], chunk: &[usize], attempt: u32) -> Option<(Vec<usize>, Vec<[usize; 3]>)> {
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.48, 0.64).normalize(), 0.7 * f64::from(attempt));
    let turned: Vec<Vec3> = chunk.iter().map(|i| Vec3::from_array((turn * points[*i]).to_array())).collect();
    let key = |p: &Vec3| p.to_array().map(f64::to_bits);
    let numbers: BTreeMap<[u64; 3], usize> = turned.iter().map(key).zip(chunk.iter().copied()).collect();
    let (corners, triangles) = try_convex_hull(&turned).ok()?;
    let used: Vec<usize> = corners.iter().map(|p| numbers.get(&key(p)).copied()).collect::<Option<_>>()?;
    let triangles: Vec<[usize; 3]> = triangles.iter().map(|t| t.map(|i| i as usize)).collect();
    is_closed(&triangles).then_some((used, triangles))
}

/// Has each edge one triangle on each side?
fn is_closed(triangles: &[[usize; 3]]) -> bool {
    let mut edges = BTreeSet::new();
    let is_single = triangles.iter().flat_map(edges_of).all(|edge| edge.0 != edge.1 && edges.insert(edge));
    is_single && edges.iter().all(|(from, to)| edges.contains(&(*to, *from)))
}

fn edges_of(t: &[usize; 3]) -> [(usize, usize); 3] {
    [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]
}

/// Joins triangles to flat facets. `None` without an area.
fn faces_of(points: Vec<DVec3>, triangles: Vec<[usize; 3]>, thin: f64) -> Option<Hull> {
    let corners = |t: &[usize; 3]| t.map(|i| points[i]);
    let areas: Vec<DVec3> = (triangles.iter().map(corners)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a)).collect();
    let across: BTreeMap<(usize, usize), usize> =
        triangles.iter().enumerate().flat_map(|(i, t)| edges_of(t).map(|edge| (edge, i))).collect();
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|a, b| areas[*b].length().total_cmp(&areas[*a].length()).then(a.cmp(b)));
    let largest = *order.first()?;
    let normal = areas[largest].try_normalize()?;
    let plane = points[triangles[largest][0]];
    let is_flat = points.iter().all(|p| normal.dot(*p - plane).abs() <= thin);
    let mut face_of = vec![usize::MAX; triangles.len()];
    let mut faces: Vec<Face> = Vec::new();
    for seed in order {
        if face_of[seed] != usize::MAX {
            continue;
        }
        let number = faces.len();
        let normal = areas[seed].normalize_or_zero();
        let at = points[triangles[seed][0]];
        let (mut open, mut members) = (vec![seed], Vec::new());
        face_of[seed] = number;
        while let Some(i) = open.pop() {
            members.push(i);
            for (from, to) in edges_of(&triangles[i]) {
                let Some(&other) = across.get(&(to, from)).filter(|other| face_of[**other] == usize::MAX) else {
                    continue;
                };
                let is_near = corners(&triangles[other]).iter().all(|p| normal.dot(*p - at).abs() <= thin);
                // Slivers have no normal of their own.
                let turned = areas[other].normalize_or_zero().dot(normal);
                let is_sliver = areas[other].length() <= thin * thin;
                if is_near && (turned >= SAME || (is_sliver && !is_flat)) || (is_flat && turned > 0.0) {
                    face_of[other] = number;
                    open.push(other);
                }
            }
        }
        members.sort_unstable();
        let normal = members.iter().map(|i| areas[*i]).sum::<DVec3>().normalize_or_zero();
        faces.push(Face { triangles: members.into_iter().map(|i| triangles[i]).collect(), normal, edges: Vec::new() });
    }
    for (i, t) in triangles.iter().enumerate() {
        for (from, to) in edges_of(t) {
            let beyond = *across.get(&(to, from)).map(|other| &face_of[*other])?;
            if beyond != face_of[i] {
                faces[face_of[i]].edges.push(Edge { from, to, beyond });
            }
        }
    }
    let (mut volume, mut moment, mut area, mut area_moment) = (0.0, DVec3::ZERO, 0.0, DVec3::ZERO);
    for (t, part) in triangles.iter().zip(&areas) {
        let [a, b, c] = corners(t).map(|p| p - plane);
        let six = a.dot(b.cross(c));
        volume += six / 6.0;
        moment += six / 24.0 * (a + b + c);
        area += part.length();
        area_moment += part.length() / 3.0 * (a + b + c);
    }
    let center = plane + if is_flat { area_moment / area } else { moment / volume };
    let is_whole = center.is_finite() && area > thin * thin && faces.len() > 1;
    is_whole.then_some(Hull { points, faces, center, volume: if is_flat { 0.0 } else { volume }, is_flat })
}
