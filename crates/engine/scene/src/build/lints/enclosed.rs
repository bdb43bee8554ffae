//! Checks for lights inside solids: opaque bodies, which no light leaves, and clear ones. Check for cameras inside
//! opaque bodies, which no light enters.

use super::lights::{CONTACT, points};
use super::places::{bounds, place, push};
use crate::build::report::BuildReport;
use crate::camera::RayGenerator;
use crate::light::Light;
use crate::light::delta::DeltaLight;
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::health::MeshHealth;
use dunkelfeld_geometry::{Aabb, Mesh, Ray, Vec3};
use std::collections::BTreeMap;

/// Maximum number of lights that are tested.
const MAX_LIGHTS: usize = 200;
/// Maximum number of points of a light that are tested.
const MAX_POINTS: usize = 8;
/// Maximum number of pairs of a light and an object whose boxes are compared.
const MAX_TESTS: usize = 4_000_000;
/// Directions of the rays that count the faces around a point. None is near an axis or a diagonal.
const DIRECTIONS: [Vec3; 3] = [
    Vec3::new(0.267_261_24, 0.801_783_7, 0.534_522_5),
    Vec3::new(0.324_442_84, -0.811_107_1, 0.486_664_27),
    Vec3::new(-0.861_640_4, 0.123_091_49, -0.492_365_96),
];

/// A light without extent, or an emitting object.
struct Source {
    place: String,
    /// The object that emits.
    object: Option<u32>,
    points: Vec<Vec3>,
}

/// Reports lights inside solids.
pub(super) fn check(scene: &Scene, boxes: &[Aabb], report: &mut BuildReport) {
    let sources = sources(scene, boxes);
    if sources.is_empty() {
        return;
    }
    let bodies = opaque_objects(scene, boxes);
    let mut closed: BTreeMap<u32, bool> = BTreeMap::new();
    let mut tests = MAX_TESTS;
    let mut findings = Vec::new();
    for source in sources {
        tests = tests.saturating_sub(bodies.len());
        let contains = |body: &Aabb| source.points.iter().all(|p| body.contains(*p));
        let is_near = tests > 0 && bodies.values().any(contains);
        let mut around: Vec<u32> = Vec::new();
        if let (true, [first, others @ ..]) = (is_near, source.points.as_slice()) {
            around = objects_around(scene, *first);
            around.retain(|object| source.object != Some(*object) && bodies.contains_key(object));
            for p in others {
                if !around.is_empty() {
                    let objects = objects_around(scene, *p);
                    around.retain(|object| objects.contains(object));
                }
            }
        }
        let is_cover = |object: &&u32| {
            *closed.entry(**object).or_insert_with(|| is_closed(scene, **object))
                && !scene.cameras.iter().any(|camera| {
                    // A camera inside as well: the body is a room or a housing of the station.
                    let eye = (camera.to_world.translation - scene.world_origin).as_vec3();
                    objects_around(scene, eye).contains(object)
                })
        };
        let around = around.iter().find(is_cover);
        if let Some(object) = around {
            let name = scene.object_names.get(*object as usize).map_or("", String::as_str);
            findings.push((
                source.place,
                format!(
                    "is inside the opaque object \"{name}\", so that its light reaches nothing outside; move it out, or remove the object by `[[object]]` with `visible = false`"
                ),
            ));
            continue;
        }
        let solid = |p: &Vec3| scene.material_inside(&scene.interior_at(*p));
        let Some(material) = source.points.first().and_then(solid) else { continue };
        if source.points.iter().all(|p| solid(p) == Some(material)) {
            findings.push((
                source.place,
                format!(
                    "is inside a clear solid of material \"{}\"; move it out if that is not meant",
                    scene.materials[material as usize].name
                ),
            ));
        }
    }
    push(report, findings);
}

impl Scene {
    /// The name of the opaque object around a camera, if no lamp is inside with it: its image is black. With `closed`,
    /// an object with open edges does not count, because light can enter it.
    pub fn body_around(&self, camera: &RayGenerator, closed: bool) -> Option<&str> {
        let mut around = objects_around(self, camera.origin());
        if around.is_empty() {
            return None;
        }
        let boxes: Vec<Aabb> = self.parts.iter().map(|part| bounds(self, part)).collect();
        let bodies = opaque_objects(self, &boxes);
        around.retain(|object| bodies.contains_key(object) && (!closed || is_closed(self, *object)));
        for source in sources(self, &boxes) {
            let inside: Vec<u32> = source.points.iter().flat_map(|point| objects_around(self, *point)).collect();
            around.retain(|object| !inside.contains(object));
        }
        around.first().and_then(|object| self.object_names.get(*object as usize)).map(String::as_str)
    }

    /// Reports a closed opaque object around a camera, without a lamp inside.
    pub fn report_enclosed_camera(&self, camera: &RayGenerator, report: &mut BuildReport) {
        if let Some(name) = self.body_around(camera, true) {
            let message = "is opaque and closed, and the camera is inside it, so that its image is black; move the camera out (`position` or `working_distance` in [camera]), or remove the object by `[[object]]` with `visible = false`";
            report.hazard(format!("object \"{name}\""), message);
        }
    }
}

fn sources(scene: &Scene, boxes: &[Aabb]) -> Vec<Source> {
    let emitters = scene.parts.iter().zip(boxes).filter(|(part, b)| {
        let is_unlit = scene.materials[part.material as usize].unlit;
        scene.compiled[part.material as usize].emits && !is_unlit && !b.is_empty()
    });
    let of_emitter = |(part, b): (&Part, &Aabb)| {
        // Off the surface, far above rounding and far below the distance of contact.
        let lift = 1e-3 * CONTACT * b.size().max_element();
        let sides: &[f32] = if scene.materials[part.material as usize].double_sided { &[1.0, -1.0] } else { &[1.0] };
        let all = points(scene, part);
        let every = all.len().div_ceil(MAX_POINTS).max(1);
        let some = all.into_iter().step_by(every);
        let points = some.flat_map(|(p, normal)| sides.iter().map(move |side| p + normal * (side * lift))).collect();
        Source { place: place(scene, part), object: Some(part.object), points }
    };
    let punctual = scene.lights.lights.iter().filter(|light| !matches!(light, Light::Area(_) | Light::Mesh(_)));
    let of_light = |(light, name): (&Light, &String)| match light {
        Light::Delta(
            DeltaLight::Point { position, .. }
            | DeltaLight::Spot { position, .. }
            | DeltaLight::Profile { position, .. },
        ) => Some(Source { place: format!("light \"{name}\""), object: None, points: vec![*position] }),
        _ => None,
    };
    let lights = punctual.zip(&scene.punctual_names).filter_map(of_light);
    let all = lights.take(MAX_LIGHTS).chain(emitters.take(MAX_LIGHTS).map(of_emitter));
    all.filter(|source| !source.points.is_empty()).collect()
}

/// The boxes of the objects that no light passes.
fn opaque_objects(scene: &Scene, boxes: &[Aabb]) -> BTreeMap<u32, Aabb> {
    let mut bodies: BTreeMap<u32, Option<Aabb>> = BTreeMap::new();
    for (part, b) in scene.parts.iter().zip(boxes).filter(|(_, b)| !b.is_empty()) {
        let compiled = &scene.compiled[part.material as usize];
        let body = bodies.entry(part.object).or_insert(Some(Aabb::EMPTY));
        let is_opaque = !compiled.both_sides && !compiled.has_coverage;
        *body = body.filter(|_| is_opaque).map(|body| body.union(*b));
    }
    bodies.into_iter().filter_map(|(object, body)| Some((object, body?))).collect()
}

/// The objects that surround a point, in ascending order. In each direction, more of their faces are then left than
/// entered, or, where they are wound inward, the other way round.
fn objects_around(scene: &Scene, point: Vec3) -> Vec<u32> {
    let mut counts: BTreeMap<u32, [i32; 3]> = BTreeMap::new();
    for (way, direction) in DIRECTIONS.into_iter().enumerate() {
        scene.bvh.each_hit(&Ray::new(point, direction), |hit| {
            let hit = scene.surface_point(&hit, 0.0);
            let count = counts.entry(scene.parts[hit.part as usize].object).or_default();
            count[way] += if direction.dot(hit.normal) > 0.0 { 1 } else { -1 };
        });
    }
    let is_around = |count: &[i32; 3]| count[0] != 0 && count.iter().all(|c| *c == count[0]);
    counts.into_iter().filter(|(_, count)| is_around(count)).map(|(object, _)| object).collect()
}

/// Do the triangles of an object have no open edge?
fn is_closed(scene: &Scene, object: u32) -> bool {
    let mut whole = Mesh::default();
    for part in scene.parts.iter().filter(|part| part.object == object) {
        let mesh = &scene.meshes[part.mesh as usize];
        let first = whole.positions.len() as u32;
        let placed = mesh.positions.iter().map(|p| part.transform.as_ref().map_or(*p, |t| t.point(*p)));
        whole.positions.extend(placed);
        whole.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| first + i)));
    }
    let health = MeshHealth::from_mesh(&whole);
    health.triangles > 0 && health.open_edges == 0
}
