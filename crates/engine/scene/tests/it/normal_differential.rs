//! The derivative of the shading normal against finite differences of the shading frame's normal.

use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, Ray, Vec3};
use dunkelfeld_scene::shapes::{rectangle, sphere};
use dunkelfeld_scene::{Material, NormalDifferentials, Scene, SceneBuilder, Surface, SurfacePoint, Volume};

/// A ball under a transform; as an instance if `instanced` is true, with a copy far away.
fn ball(material: Material, to_world: DAffine3, instanced: bool, smooth: bool) -> Scene {
    let mut b = SceneBuilder::default();
    let m = b.add_material(material);
    // Copies of this many triangles stay instances.
    let mesh: Mesh = sphere(Vec3::ZERO, 1.0, if instanced { 70 } else { 12 }, smooth);
    b.add_object("ball", mesh, m);
    b.instances[0].to_world = to_world;
    if instanced {
        let mut twin = b.instances[0].clone();
        twin.to_world = DAffine3::from_translation(DVec3::new(9.0, 0.0, 0.0));
        b.instances.push(twin);
    }
    let scene = b.build().expect("valid").0;
    assert_eq!(scene.summary().instanced_parts, if instanced { 2 } else { 0 });
    scene
}

fn glass() -> Material {
    Material {
        transmission: 1.0.into(),
        roughness: 0.0.into(),
        surface: Surface::Solid(Volume::default()),
        ..Material::default()
    }
}

/// The hit of a ray from one place toward another.
fn hit(scene: &Scene, from: Vec3, to: Vec3) -> Option<SurfacePoint> {
    scene.intersect(&Ray::new(from, (to - from).normalize()))
}

fn shading_normal(scene: &Scene, p: &SurfacePoint, wo: Vec3) -> Vec3 {
    scene.shade_lanes::<f32>(p.material(), &p.into(), wo.into()).frames.frame.normal.into()
}

/// The normal of the frame, whether it depends on the viewer in direction `wo`, and its derivative.
fn differential(scene: &Scene, p: &SurfacePoint, wo: Vec3) -> (Vec3, bool, Option<NormalDifferentials<f32>>) {
    let normal = shading_normal(scene, p, wo);
    let (is_turned, found) = scene.normal_differentials::<f32>((), &p.into(), wo.into(), normal.into());
    (normal, is_turned, found)
}

/// The change of the normal for a displacement.
fn along(differential: &NormalDifferentials<f32>, d: Vec3) -> DVec3 {
    Vec3::from(differential.along(d.into())).as_dvec3()
}

#[test]
fn the_differential_is_the_derivative_of_the_shading_normal() {
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    for (mirror, instanced, solid) in
        [(1.0, false, true), (-1.0, false, true), (1.0, true, true), (-1.0, true, true), (-1.0, true, false)]
    {
        let place = DAffine3::from_scale_rotation_translation(
            DVec3::new(mirror * 0.7, 1.3, 0.4),
            turn,
            DVec3::new(0.2, 0.1, 0.0),
        );
        let scene = ball(if solid { glass() } else { Material::default() }, place, instanced, true);
        let middle = (DVec3::new(0.2, 0.1, 0.0) - scene.world_origin()).as_vec3();
        let mut compared = 0;
        for k in 0..200 {
            let a = k as f32 * 2.399_963;
            let z = (k as f32 + 0.5) / 100.0 - 1.0;
            let outward = Vec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            // From outside, and from inside.
            for from in [middle + outward * 4.0, middle] {
                let to = if from == middle { middle + outward } else { middle };
                let Some(p) = hit(&scene, from, to) else { continue };
                let wo = (from - p.point).normalize();
                let (normal, is_turned, differential) = differential(&scene, &p, wo);
                if is_turned {
                    continue;
                }
                // Neighbours in the plane of the triangle, as far as it reaches.
                let e = p.normal.any_orthonormal_vector();
                for direction in [e, p.normal.cross(e), (e + p.normal.cross(e)).normalize()] {
                    let h = if instanced { 1e-3 } else { 5e-3 };
                    let near = |s: f32| {
                        let target = p.point + direction * s;
                        // Straight onto the plane, from the viewer's side.
                        let side = p.normal * if wo.dot(p.normal) > 0.0 { 0.01 } else { -0.01 };
                        let q = hit(&scene, target + side, target)?;
                        // Beyond the edge the next triangle has another plane.
                        (q.normal == p.normal).then(|| shading_normal(&scene, &q, wo).as_dvec3())
                    };
                    let (Some(before), Some(after)) = (near(-h), near(h)) else { continue };
                    let measured = (after - before) / f64::from(2.0 * h);
                    let Some(d) = &differential else { panic!("no derivative at {}", p.point) };
                    let computed = along(d, direction);
                    // Rounding of f32 normals over the step, and the curvature within it.
                    let tolerance = 4e-7 / f64::from(h) + 2e-3 * computed.length();
                    assert!(measured.distance(computed) < tolerance, "{measured} against {computed} at {}", p.point);
                    assert!(
                        computed.dot(normal.as_dvec3()).abs() < 1e-4 * computed.length(),
                        "a unit normal only turns"
                    );
                    compared += 1;
                }
            }
        }
        assert!(compared > 300, "{compared} comparisons");
    }
}

#[test]
fn lanes_whose_normal_depends_on_the_viewer_are_told() {
    // Above the surface but below the interpolated normal: shading turns the normal toward the viewer.
    let mut b = SceneBuilder::default();
    let m = b.add_material(glass());
    let normals = [-0.9f32, -0.8, -0.7, -0.6].map(|x| Vec3::new(x, 0.0, 0.3).normalize()).to_vec();
    b.add_object("sheet", Mesh { normals, ..rectangle(Vec3::ZERO, Vec3::X, Vec3::Y) }, m);
    let scene = b.build().expect("valid").0;
    let p = hit(&scene, Vec3::new(0.1, 0.2, 4.0), Vec3::new(0.1, 0.2, 0.0)).expect("the sheet");
    let grazing = Vec3::new(0.99, 0.0, 0.1).normalize();
    let (_, is_turned, _) = differential(&scene, &p, grazing);
    assert!(is_turned);
    let (_, is_turned, found) = differential(&scene, &p, Vec3::Z);
    assert!(!is_turned && found.is_some_and(|found| along(&found, Vec3::ONE) != DVec3::ZERO));
}
