//! Stable poses of objects on a plane and their probabilities after a drop.
//!
//! Source: Goldberg et al. 1999, the quasi-static estimate. An object falls without a preferred orientation on the facet of
//! its convex hull that lies below its centre of mass: with the solid angle of the facet, seen from there, over that of the
//! sphere. A facet over which the centre of mass does not project inside is unstable. The object then tips over the edge
//! that is nearest to that projection, to the next facet, until it rests.

use crate::hull::{Hull, convex_hull};
use dunkelfeld_geometry::health::MeshHealth;
use dunkelfeld_geometry::{DAffine3, DMat3, DQuat, DVec3, Mesh};
use dunkelfeld_scene::{Instance, SceneBuilder};
use std::collections::VecDeque;
use std::f64::consts::PI;
use std::sync::Arc;

/// Hulls that are kept for later objects and images.
const KEPT: usize = 64;
/// A centre of mass this far inside an edge counts as on it, as a share of the size of the object.
const ON_EDGE: f64 = 1e-7;

/// A stable pose of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StablePose {
    /// Number of the facet of the hull that lies below.
    pub(crate) face: usize,
    /// Probability of the pose.
    pub(crate) probability: f64,
    /// Unit outward normal of the facet, world axes.
    pub(crate) normal: DVec3,
}

impl StablePose {
    /// The rotation that turns the facet downward.
    pub(crate) fn rotation(&self) -> DQuat {
        DQuat::from_rotation_arc(self.normal, DVec3::NEG_Y)
    }
}

/// The hull and the centre of mass of some meshes.
#[derive(Debug)]
struct Body {
    hull: Hull,
    /// Centre of mass in the frame of the meshes \[m\].
    center: DVec3,
}

/// The hulls of objects. Computing one takes longer than all other steps of a placement.
#[derive(Debug, Default)]
pub(crate) struct Hulls {
    known: VecDeque<(Vec<Arc<Mesh>>, Arc<Body>)>,
}

impl Hulls {
    /// The stable poses of an object with their probabilities, whose sum is 1, in the order of the facets of its hull.
    ///
    /// # Errors
    /// An object without an extent in two directions, as a problem.
    pub(crate) fn stable_poses(
        &mut self,
        scene: &SceneBuilder,
        object: &Instance,
    ) -> Result<Vec<StablePose>, &'static str> {
        let parts = object.meshes.iter().filter_map(|mesh| scene.meshes.get(*mesh));
        let meshes: Vec<Arc<Mesh>> = parts.map(|part| part.mesh.clone()).collect();
        let is_same = |known: &[Arc<Mesh>]| {
            known.len() == meshes.len() && known.iter().zip(&meshes).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        let body = match self.known.iter().find(|(known, _)| is_same(known)) {
            Some((_, body)) => body.clone(),
            None => {
                let body = Arc::new(body_of(&meshes)?);
                if self.known.len() >= KEPT {
                    self.known.pop_front();
                }
                self.known.push_back((meshes, body.clone()));
                body
            }
        };
        poses(&body, object.to_world)
    }
}

/// The pose of a number in \[0, 1).
pub(crate) fn choose(poses: &[StablePose], u: f64) -> Option<StablePose> {
    let mut sum = 0.0;
    let chosen = poses.iter().find(|pose| {
        sum += pose.probability;
        u < sum
    });
    // Rounding can leave the sum below 1.
    chosen.or(poses.last()).copied()
}

fn body_of(meshes: &[Arc<Mesh>]) -> Result<Body, &'static str> {
    let used = meshes
        .iter()
        .flat_map(|mesh| mesh.triangles.iter().flatten().filter_map(|i| mesh.positions.get(*i as usize)))
        .filter(|p| p.is_finite())
        .map(|p| p.as_dvec3());
    let hull = convex_hull(used)?;
    let center = center_of_volume(meshes, &hull).unwrap_or(hull.center);
    Ok(Body { hull, center })
}

/// Centre of the volume of closed meshes (Mirtich 1996, for a density of 1). `None` if one is open, or if they enclose
/// nothing.
fn center_of_volume(meshes: &[Arc<Mesh>], hull: &Hull) -> Option<DVec3> {
    /// Less volume than this share of the hull is rounding.
    const LEAST: f64 = 1e-6;
    let (mut volume, mut moment) = (0.0, DVec3::ZERO);
    for mesh in meshes {
        if !MeshHealth::from_mesh(mesh).is_closed() {
            return None;
        }
        let (mut six, mut first) = (0.0, DVec3::ZERO);
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|i| mesh.positions.get(i as usize).map(|p| p.as_dvec3() - hull.center));
            let (a, b, c) = (a?, b?, c?);
            let part = a.dot(b.cross(c));
            six += part;
            first += part * (a + b + c) * 0.25;
        }
        // A mesh that is wound inward encloses as much.
        volume += six.abs() / 6.0;
        moment += first * six.signum() / 6.0;
    }
    let center = hull.center + moment / volume;
    let is_inside = |normal: &DVec3, at: &DVec3| normal.dot(center - *at) <= 0.0;
    let lies_inside = hull.faces.iter().all(|f| is_inside(&f.normal, &hull.points[f.triangles[0][0]]));
    (volume > LEAST * hull.volume && hull.volume > 0.0 && center.is_finite() && lies_inside).then_some(center)
}

/// A facet in the world, with the centre of mass at the origin.
struct Facet {
    normal: DVec3,
    solid_angle: f64,
    /// Height of the centre of mass above the facet.
    height: f64,
    /// The facet that the object tips to; `None` if it rests.
    next: Option<usize>,
}

fn poses(body: &Body, to_world: DAffine3) -> Result<Vec<StablePose>, &'static str> {
    let Body { hull, center } = body;
    let linear: DMat3 = to_world.matrix3;
    // A reflection turns the winding of the triangles.
    let side = linear.determinant().signum();
    let points: Vec<DVec3> = hull.points.iter().map(|p| linear * (*p - *center)).collect();
    let size = points.iter().map(|p| p.length()).fold(0.0, f64::max);
    let facets: Vec<Facet> = hull.faces.iter().map(|face| facet(face, &points, side, size, hull.is_flat)).collect();
    if facets.iter().any(|facet| !(facet.normal.is_normalized() && facet.solid_angle.is_finite())) {
        return Err("its scale makes it flat");
    }
    let total: f64 = facets.iter().map(|facet| facet.solid_angle).sum();
    let mut probabilities = vec![0.0; facets.len()];
    for (start, facet) in facets.iter().enumerate() {
        let mut at = start;
        // The centre of mass gets lower from facet to facet, so that no facet comes twice.
        while let Some(next) = facets[at].next.filter(|next| facets[*next].height < facets[at].height) {
            at = next;
        }
        probabilities[at] += facet.solid_angle / total;
    }
    let poses = probabilities.into_iter().enumerate().filter(|(_, probability)| *probability > 0.0);
    Ok(poses.map(|(face, probability)| StablePose { face, probability, normal: facets[face].normal }).collect())
}

fn facet(face: &crate::hull::Face, points: &[DVec3], side: f64, size: f64, is_flat: bool) -> Facet {
    let (mut area, mut solid_angle) = (DVec3::ZERO, 0.0);
    for triangle in &face.triangles {
        let [a, b, c] = triangle.map(|i| points[i]);
        area += side * (b - a).cross(c - a);
        solid_angle += solid_angle_of([a, b, c]).abs();
    }
    let normal = area.normalize_or_zero();
    // Both sides of a flat object are seen from a point in its plane under half of the sphere.
    let solid_angle = if is_flat { 2.0 * PI } else { solid_angle };
    let height = face.triangles.iter().flatten().map(|i| normal.dot(points[*i])).fold(f64::NEG_INFINITY, f64::max);
    let foot = normal * height;
    // The centre of mass projects outside of an edge if its distance to the line of the edge is above zero.
    let mut nearest: Option<(f64, f64, usize)> = None;
    for edge in &face.edges {
        let (from, to) = (points[edge.from], points[edge.to]);
        let Some(along) = (to - from).try_normalize() else { continue };
        let outside = side * along.cross(normal).dot(foot - from);
        if outside <= ON_EDGE * size {
            continue;
        }
        let t = along.dot(foot - from).clamp(0.0, from.distance(to));
        let distance = foot.distance(from + along * t);
        // At a corner, of two edges at one distance, the one that the centre of mass is farther beyond.
        let is_nearer = nearest.is_none_or(|(d, o, _)| {
            let (closer, same) = (distance < d - ON_EDGE * size, (distance - d).abs() <= ON_EDGE * size);
            closer || (same && outside > o)
        });
        if is_nearer {
            nearest = Some((distance, outside, edge.beyond));
        }
    }
    Facet { normal, solid_angle, height, next: nearest.map(|(_, _, beyond)| beyond) }
}

/// The signed solid angle of a triangle, seen from the origin (Van Oosterom and Strackee 1983).
fn solid_angle_of([a, b, c]: [DVec3; 3]) -> f64 {
    let [la, lb, lc] = [a, b, c].map(DVec3::length);
    let above = a.dot(b.cross(c));
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * above.atan2(below)
}

#[cfg(test)]
#[path = "stable_tests.rs"]
mod tests;
