//! Rounded edges: each place of a sharp body reflects as the place of a fillet that the viewer sees.

use dunkelfeld_geometry::{DAffine3, DVec3, LocalDir, Mesh, Ray, Vec3};
use dunkelfeld_scene::shapes::cuboid;
use dunkelfeld_scene::{Material, Scene, SceneBuilder, SurfacePoints};
use std::f32::consts::FRAC_PI_2;

/// Half width of the body and radius of its fillets \[m\].
const HALF: f32 = 0.1;
const RADIUS: f32 = 0.001;

/// A bar along y below z = 0, open at the bottom, from its outline in x and z with the normals of its corners.
fn bar(outline: &[[Vec3; 2]]) -> Mesh {
    let mut mesh = Mesh::default();
    for [corner, normal] in outline {
        mesh.positions.extend([*corner + Vec3::Y, *corner - Vec3::Y]);
        mesh.normals.extend([*normal; 2]);
    }
    for k in (0..2 * outline.len() as u32 - 2).step_by(2) {
        mesh.triangles.extend([[k, k + 1, k + 2], [k + 2, k + 1, k + 3]]);
    }
    mesh
}

/// The bar with cylinders of triangles at its edges.
fn rounded() -> Mesh {
    let foot = |side: f32| [Vec3::new(side * HALF, 0.0, -HALF), Vec3::X * side];
    let fillet = |side: f32, k: u32| {
        let (sin, cos) = (k as f32 / 64.0 * FRAC_PI_2).sin_cos();
        let normal = Vec3::new(side * cos, 0.0, sin);
        [Vec3::new(side * (HALF - RADIUS), 0.0, -RADIUS) + normal * RADIUS, normal]
    };
    let (left, right) = ((0..=64).map(|k| fillet(-1.0, k)), (0..=64).rev().map(|k| fillet(1.0, k)));
    bar(&std::iter::once(foot(-1.0)).chain(left).chain(right).chain([foot(1.0)]).collect::<Vec<_>>())
}

fn sharp() -> Mesh {
    let corners = [[-HALF, -HALF], [-HALF, 0.0], [HALF, 0.0], [HALF, -HALF]];
    Mesh { normals: Vec::new(), ..bar(&corners.map(|[x, z]| [Vec3::new(x, 0.0, z), Vec3::ZERO])) }
}

fn white_metal(roughness: f32) -> Material {
    Material { metallic: 1.0.into(), roughness: roughness.into(), ..Material::default() }
}

fn scene(mesh: Mesh, radius: f32, scale: DVec3) -> Scene {
    let mut b = SceneBuilder::default();
    let m = b.add_material(white_metal(0.3));
    let mut mesh = mesh;
    mesh.positions.iter_mut().for_each(|p| *p = (p.as_dvec3() / scale).as_vec3());
    if scale.x < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    }
    b.add_object("bar", mesh, m);
    b.meshes[0].edge_radius = radius;
    b.instances[0].to_world = DAffine3::from_scale(scale);
    b.build().expect("the scene is valid").0
}

/// Mean radiance of a strip about the edge at the right, seen from an angle \[degrees\] from above, under a lamp of radiance 1 at
/// another angle, 1 m away. Both by the midpoint rule.
fn strip(scene: &Scene, view: f32, lamp: f32) -> f64 {
    const PLACES: u32 = 600;
    const STEPS: u32 = 24;
    let at = |angle: f32| Vec3::new(angle.to_radians().sin(), 0.0, angle.to_radians().cos());
    let (wo, center, origin) = (at(view), at(lamp), scene.world_origin().as_vec3());
    let edge = Vec3::X * HALF - origin;
    let mut sum = 0.0;
    for i in 0..PLACES {
        let aside = (i as f32 + 0.5) / PLACES as f32 * 4.0 - 2.0;
        let Some(hit) = scene.intersect(&Ray::new(edge + at(view + 90.0) * (aside * RADIUS) + wo, -wo)) else {
            continue;
        };
        let mut points = SurfacePoints::<f32>::from(&hit);
        scene.round_edges(hit.material(), &mut points, wo.into());
        let frame = scene.shade_lanes(hit.material(), &points, wo.into()).frames.frame;
        let mut storage = None;
        let bsdf = scene.bsdf(&hit, 0.5, None, &mut storage);
        let local = |direction: Vec3| LocalDir(frame.to_local(direction.into()).into());
        for k in 0..STEPS * STEPS {
            let [u, v] = [k % STEPS, k / STEPS].map(|k| (k as f32 + 0.5) / STEPS as f32 - 0.5);
            let to = center + at(lamp + 90.0) * (0.2 * u) + Vec3::Y * (0.6 * v) - origin - Vec3::from(points.point);
            let (distance, wi) = (to.length(), to.normalize());
            if wi.dot(points.normal.into()) <= 0.0 || wi.dot(-center) >= 0.0 {
                continue;
            }
            let ray = Ray::with_end(points.ray_origins(wi.into()).into(), wi, distance);
            let (value, _) = bsdf.eval_pdf(local(wo), local(wi));
            let solid_angle = 0.12 / (STEPS * STEPS) as f32 * -wi.dot(-center) / (distance * distance);
            sum += f64::from(value.g * solid_angle * scene.transmittance(&ray)) / f64::from(PLACES);
        }
    }
    sum
}

/// In a dark field the line of light on an edge is that of the fillet: of lamps on both sides, also below the plane of the top, for
/// views of one face and of both, and on an object that its scale mirrors.
#[test]
fn an_edge_reflects_as_its_fillet() {
    let mirrored = DVec3::new(-100.0, 100.0, 50.0);
    let fillet = scene(rounded(), 0.0, DVec3::ONE);
    let edges = [scene(sharp(), RADIUS, DVec3::ONE), scene(sharp(), RADIUS, mirrored)];
    let bare = scene(sharp(), 0.0, DVec3::ONE);
    for view in [0.0, 20.0, 45.0] {
        for lamp in [-75.0, -60.0, 30.0, 70.0, 100.0, 130.0] {
            let [stated, bare] = [&fillet, &bare].map(|scene| strip(scene, view, lamp));
            assert!((bare / stated - 1.0).abs() > 0.3, "view {view}, lamp {lamp}: {bare}, stated {stated}");
            for edge in &edges {
                let found = strip(edge, view, lamp);
                assert!((found / stated - 1.0).abs() < 0.002, "view {view}, lamp {lamp}: {found}, stated {stated}");
            }
        }
    }
}

/// All light that arrives at a fillet is that of the surroundings: no direction above its normal meets the body, and the viewer is
/// above it, at edges, corners and silhouettes. So a white body is invisible under uniform light.
#[test]
fn no_direction_from_a_fillet_meets_the_body() {
    let mut b = SceneBuilder::default();
    let m = b.add_material(white_metal(0.3));
    b.add_object("box", cuboid(-Vec3::ONE, Vec3::ONE), m);
    b.meshes[0].edge_radius = 0.3;
    let scene = b.build().expect("the scene is valid").0;
    let wo = Vec3::new(0.4, 0.3, 0.9).normalize();
    let (right, up) = wo.any_orthonormal_pair();
    let (mut tilted, mut all, mut blocked) = (0, 0, 0);
    for k in 0..120 * 120 {
        let [x, y] = [k % 120, k / 120].map(|k| k as f32 / 30.0 - 2.0);
        let Some(hit) = scene.intersect(&Ray::new(right * x + up * y + wo * 5.0, -wo)) else { continue };
        if hit.normal.dot(wo) <= 0.0 {
            // At a silhouette a ray can meet the face behind it.
            continue;
        }
        let mut points = SurfacePoints::<f32>::from(&hit);
        scene.round_edges(hit.material(), &mut points, wo.into());
        let normal = Vec3::from(points.normal);
        assert!(normal.dot(wo) > 0.015, "{normal} is turned away");
        tilted += u32::from(normal.distance(hit.normal) > 1e-3);
        for i in 0..64 {
            let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
            let z = (i as f32 + 0.5) / 64.0;
            let (u, v) = normal.any_orthonormal_pair();
            let wi = (u * cos + v * sin) * (1.0 - z * z).sqrt() + normal * z;
            all += 1;
            blocked += u32::from(scene.transmittance(&Ray::new(points.ray_origins(wi.into()).into(), wi)) == 0.0);
        }
    }
    assert!(tilted > 1000 && f64::from(blocked) < 1e-3 * f64::from(all), "{tilted}: {blocked} of {all}");
}
