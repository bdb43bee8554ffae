//! A ray that leaves a surface does not hit that surface again, and hits the next one at any distance.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, bumpy_torus};
use dunkelfeld_bvh::Bvh;
use dunkelfeld_geometry::{
    DAffine3, DQuat, DVec3, Frame, LocalDir, Ray, Transform, Vec3, geometric_normal, hit_point, offset_ray_origin,
};

const RAYS: usize = 1_000_000;

/// The start of a ray that leaves a point of a triangle, on the side of `normal`, in the world.
struct SpawnedRay {
    ray: Ray,
    triangle: u32,
}

/// Picks a point on the shape and a direction on one side of it, half of them at a grazing angle.
fn spawn(shape: &Shape, to_world: Option<&Transform>, grazing: f32, random: &mut Random) -> SpawnedRay {
    let triangle = random.int(shape.triangles.len()) as u32;
    let corners = shape.corners(triangle);
    let (b1, b2) = {
        let (u, v) = (random.unit(), random.unit());
        if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) }
    };
    let (mut p, mut error) = hit_point(&corners, b1, b2);
    let mut n = geometric_normal(&corners);
    if let Some(t) = to_world {
        (p, error) = t.point_with_error(p, error);
        n = t.normal(n);
    }
    if random.int(2) == 0 {
        n = -n;
    }
    let cos = if random.int(2) == 0 { random.unit().max(grazing) } else { grazing.powf(random.unit()) };
    let (sin, phi) = ((1.0 - cos * cos).sqrt(), std::f32::consts::TAU * random.unit());
    let direction = Frame::from_normal(n).to_world(LocalDir::new(sin * phi.cos(), sin * phi.sin(), cos));
    SpawnedRay { ray: Ray::new(offset_ray_origin(p, error, n, direction), direction), triangle }
}

fn placed(scale: f64, far: f64) -> Transform {
    let turn = DQuat::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 1.0);
    let at = DVec3::new(far, -0.3 * far, 0.7 * far);
    Transform::new(DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, at)).unwrap()
}

/// All placements of a shape in the world: at several scales, near and far, baked or as an instance.
fn placements(shape: &Shape) -> Vec<(String, Shape, Bvh, Option<Transform>)> {
    let mut all = Vec::new();
    for scale in [1e-4, 1.0, 1e4] {
        for far in [0.0, 1000.0] {
            let t = placed(scale, far);
            all.push((format!("instance, scale {scale}, {far} m away"), shape.clone(), shape.instanced(t), Some(t)));
            if far == 0.0 || scale >= 1.0 {
                let baked = shape.map(|p| t.point(p));
                let bvh = baked.bvh();
                all.push((format!("baked, scale {scale}, {far} m away"), baked, bvh, None));
            }
        }
    }
    all
}

#[test]
fn no_ray_hits_the_triangle_of_its_origin() {
    let all = placements(&bumpy_torus(60, 24));
    let rays = RAYS / all.len() + 1;
    for (name, shape, bvh, to_world) in all {
        let mut random = Random::new(21);
        for _ in 0..rays {
            let SpawnedRay { ray, triangle } = spawn(&shape, to_world.as_ref(), 1e-6, &mut random);
            let hit = bvh.closest_hit(&ray);
            assert!(
                hit.is_none_or(|h| h.triangle != triangle),
                "{name}: {ray:?} starts at triangle {triangle}, hits {hit:?}"
            );
        }
    }
}

#[test]
fn no_ray_hits_the_planar_patch_of_its_origin() {
    // Two triangles. After rounding, their planes differ by an ulp of the coordinates over the size of the patch, which
    // at 1 km is 6e-5 rad. A ray at a smaller angle than that may cross the plane in fact.
    let patch = Shape {
        positions: vec![
            Vec3::new(-0.3, -0.3, 0.1),
            Vec3::new(0.3, -0.3, 0.1),
            Vec3::new(0.3, 0.3, 0.1),
            Vec3::new(-0.3, 0.3, 0.1),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let all = placements(&patch);
    let rays = RAYS / all.len() + 1;
    for (name, shape, bvh, to_world) in all {
        let mut random = Random::new(22);
        for _ in 0..rays {
            let SpawnedRay { ray, .. } = spawn(&shape, to_world.as_ref(), 1e-3, &mut random);
            assert!(!bvh.occluded(&ray), "{name}: {ray:?} hits {:?}", bvh.closest_hit(&ray));
        }
    }
}

#[test]
fn a_surface_at_ten_micrometres_or_one_is_hit() {
    // Two plates of 0.6 m, turned. The upper one is a little larger, so that slanted rays hit it too.
    for (gap, grazing) in [(1e-5, 0.02), (1e-6, 0.05)] {
        let turn = placed(1.0, 0.0);
        let plate = |half: f32, z: f32| {
            [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| turn.point(Vec3::new(half * x, half * y, z)))
        };
        let lower = Shape { positions: plate(0.3, 0.0).to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let mut both = lower.clone();
        both.positions.extend(plate(0.31, gap));
        both.triangles.extend([[4, 5, 6], [4, 6, 7]]);
        let bvh = both.bvh();
        let up = turn.normal(Vec3::Z);
        let mut random = Random::new(23);
        for _ in 0..RAYS / 2 {
            let SpawnedRay { mut ray, .. } = spawn(&lower, None, grazing, &mut random);
            let is_up = ray.direction.dot(up) > 0.0;
            ray.t_max = 1.0;
            let hit = bvh.closest_hit(&ray);
            if is_up {
                let t = gap / ray.direction.dot(up);
                assert!(
                    hit.is_some_and(|h| h.triangle >= 2 && (h.t - t).abs() < 0.3 * t),
                    "gap {gap}: {ray:?} must hit the upper plate at {t}, hits {hit:?}"
                );
            } else {
                assert_eq!(hit, None, "gap {gap}: {ray:?} goes down and out");
            }
        }
    }
}
