//! Checks of the directions in which lights emit: fronts that touch an opaque surface, and fronts that face away from all
//! objects.

use super::places::{bounds, bounds_in_motion, meters, place, push};
use crate::build::report::BuildReport;
use crate::camera::RayGenerator;
use crate::light::Light;
use crate::light::delta::DeltaLight;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{Aabb, Ray, Vec3, geometric_normal};
use std::collections::BTreeSet;
use std::f32::consts::FRAC_PI_2;

/// A surface in front of an emitter is at contact below this share of the size of the emitter.
pub(super) const CONTACT: f32 = 0.02;
/// An object is in front of an emitter if it extends beyond its surface by this share of its size.
const IN_FRONT: f32 = 1e-3;
/// Number of points of an emitter that are tested.
const POINTS: usize = 24;
/// Maximum number of emitters that are tested.
const MAX_EMITTERS: usize = 200;
/// Maximum number of pairs of a point of an emitter and an object that are tested.
const MAX_TESTS: usize = 4_000_000;
/// Rays of a camera along one side of its film that find the emitters in its image.
const RAYS: u32 = 8;
/// An emitter of at most this reflectance is a lamp, and no object that is lit.
const LAMP_REFLECTANCE: f32 = 0.1;

pub(super) fn check(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    covered_emitters(scene, boxes, report);
}

/// Points in the middle of triangles of an emitting part, with the normals of their fronts.
pub(super) fn points(scene: &Scene, part: &Part) -> Vec<(Vec3, Vec3)> {
    let mesh = &scene.meshes[part.mesh as usize];
    let triangles = mesh.triangles.len();
    // Multiples of the golden ratio: the triangles of a body of revolution repeat, and equal steps could find one ring of it.
    let golden = |i: usize| ((0.618_034 * i as f64).fract() * triangles as f64) as usize;
    let chosen = (0..triangles.min(POINTS)).map(|i| if triangles <= POINTS { i } else { golden(i) });
    let point = |t: usize| {
        let own = mesh.corners(t);
        let [a, b, c] = own.map(|p| part.transform.as_ref().map_or(p, |transform| transform.point(p)));
        let normal = geometric_normal(&own);
        ((a + b + c) / 3.0, part.transform.as_ref().map_or(normal, |transform| transform.normal(normal)))
    };
    chosen.map(point).collect()
}

/// Does a part emit from its front only? An unlit surface is no lamp.
fn has_front(scene: &Scene, part: &Part) -> bool {
    let material = &scene.materials[part.material as usize];
    scene.compiled[part.material as usize].emits && !material.double_sided && !material.unlit
}

/// Reports emitters whose front touches an opaque surface.
fn covered_emitters(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let emitters = scene.parts.iter().zip(boxes).filter(|(part, b)| has_front(scene, part) && !b.is_empty());
    let mut findings = Vec::new();
    for (part, bounds) in emitters.take(MAX_EMITTERS) {
        let size = bounds.size().max_element();
        let mut cover: Option<(&Part, f32)> = None;
        let is_covered = points(scene, part).into_iter().all(|(middle, normal)| {
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
                    "emits toward {} {} in front of it, and its light reaches nothing else; turn its normals around, move it, or remove what covers it",
                    place(scene, in_front),
                    meters(distance)
                ),
            ));
        }
    }
    push(report, findings);
}

/// The directions of a light: within an angle around the axis of each of its points.
struct Front {
    points: Vec<(Vec3, Vec3)>,
    /// Angle \[rad\] from the axis.
    reach: f32,
    /// Distance \[m\] beyond the surface at which an object is in front.
    least: f32,
}

impl Front {
    /// Could light arrive somewhere in a box?
    fn reaches(&self, b: &Aabb) -> bool {
        let (center, radius) = (b.center(), 0.5 * b.size().length());
        self.points.iter().any(|&(point, axis)| {
            // The corner that is farthest along the axis.
            let far = Vec3::select(axis.cmpge(Vec3::ZERO), b.max, b.min);
            if (far - point).dot(axis) <= self.least {
                return false;
            }
            let to_center = center - point;
            let distance = to_center.length();
            distance <= radius
                || (to_center.dot(axis) / distance).clamp(-1.0, 1.0).acos() - (radius / distance).asin() < self.reach
        })
    }
}

impl Scene {
    /// Reports lights whose directions contain no object, and which are not in the image of one of the cameras. Each
    /// camera comes with the width and height of its film \[pixels\].
    ///
    /// The test uses the boxes around the objects. So a light that is reported reaches no object, but not each light that
    /// reaches no object is reported.
    pub fn report_averted_lights(&self, cameras: &[(RayGenerator, [u32; 2])], report: &mut BuildReport) {
        let emitters = self.parts.iter().filter(|part| has_front(self, part));
        let candidates: Vec<&Part> = emitters.take(MAX_EMITTERS).collect();
        let spots = self.lights.lights.iter().filter(|light| !matches!(light, Light::Area(_) | Light::Mesh(_)));
        let spots: Vec<(String, Front)> =
            spots.zip(&self.punctual_names).filter_map(|(light, name)| spot(light, name)).take(MAX_EMITTERS).collect();
        if candidates.is_empty() && spots.is_empty() {
            return;
        }
        let lit: Vec<(&Part, Aabb)> = self
            .parts
            .iter()
            .filter(|part| !self.is_lamp(part))
            .map(|part| (part, bounds_in_motion(self, part)))
            .filter(|(_, b)| !b.is_empty())
            .collect();
        let mut tests = MAX_TESTS;
        let mut reaches_one = |front: &Front, object: Option<u32>| {
            let mut others = lit.iter().filter(|(part, _)| Some(part.object) != object).peekable();
            // In a scene of lamps alone, the camera looks at them.
            others.peek().is_none()
                || others.any(|(_, b)| {
                    tests = tests.saturating_sub(front.points.len());
                    tests == 0 || front.reaches(b)
                })
        };
        let mut findings = Vec::new();
        let mut seen: Option<BTreeSet<u32>> = None;
        for part in candidates {
            let front = self.front(part);
            if front.points.is_empty() || reaches_one(&front, Some(part.object)) {
                continue;
            }
            if seen.get_or_insert_with(|| self.fronts_in_images(cameras)).contains(&part.object) {
                continue;
            }
            findings.push((
                place(self, part),
                "faces away from all objects, so that its light reaches none of them; turn its normals around, turn it by `[[object]] rotate`, or write `aim` for a lamp of the job".to_string(),
            ));
        }
        for (name, front) in spots {
            if !reaches_one(&front, None) {
                findings.push((
                    format!("light \"{name}\""),
                    "no object is in its cone, so that its light reaches none; turn it, or write a larger `cone_angle` or another `target` for a lamp of the job".to_string(),
                ));
            }
        }
        push(report, findings);
    }

    /// Does a part emit, and reflect so little that it is no object that is lit?
    pub(super) fn is_lamp(&self, part: &Part) -> bool {
        let material = &self.materials[part.material as usize];
        let reflects = material.base_color.factor.mean() > LAMP_REFLECTANCE || material.textures().next().is_some();
        self.compiled[part.material as usize].emits && !reflects
    }

    fn front(&self, part: &Part) -> Front {
        let points = points(self, part);
        let reach = self.materials[part.material as usize].emission_profile.cutoff_angle();
        let bounds = bounds(self, part);
        let size = if bounds.is_empty() { 0.0 } else { bounds.size().max_element() };
        // Seen from the middle of a triangle, the cone of its other points is wider.
        let reach = if reach < FRAC_PI_2 { (reach + 0.2).min(FRAC_PI_2) } else { reach };
        Front { points, reach, least: IN_FRONT * size }
    }

    /// Objects with emitting fronts along rays of the cameras, also behind other surfaces.
    fn fronts_in_images(&self, cameras: &[(RayGenerator, [u32; 2])]) -> BTreeSet<u32> {
        let mut seen = BTreeSet::new();
        for (camera, [width, height]) in cameras {
            for (i, j) in (0..RAYS).flat_map(|i| (0..RAYS).map(move |j| (i, j))) {
                let at = |k: u32, n: u32| (k as f32 + 0.5) / RAYS as f32 * n as f32;
                let ray = camera.ray(at(i, *width), at(j, *height));
                self.bvh.each_hit(&ray, |hit| {
                    let hit = self.surface_point(&hit, 0.0);
                    if ray.direction.dot(hit.normal) < 0.0 && self.compiled[hit.material as usize].emits {
                        seen.insert(self.parts[hit.part as usize].object);
                    }
                });
            }
        }
        seen
    }
}

/// The cone of a spot light; `None` for other lights.
fn spot(light: &Light, name: &str) -> Option<(String, Front)> {
    let Light::Delta(DeltaLight::Spot { position, axis, cos_outer, intensity, .. }) = light else { return None };
    let reach = cos_outer.clamp(-1.0, 1.0).acos();
    (!intensity.is_black()).then(|| (name.to_string(), Front { points: vec![(*position, *axis)], reach, least: 0.0 }))
}
