//! Alpha-tested triangles: shadow queries report them, all other queries treat them as opaque.
//!
//! Replay: `cargo test -p dunkelfeld-bvh --test it alpha_tested`.

use dunkelfeld_bvh::{Bvh, BvhInstance, MeshTriangles};
use dunkelfeld_geometry::{DAffine3, DVec3, Ray, Transform, Vec3};

/// Forty unit squares (two triangles each) above each other at z = 0, 1, ..., as one mesh.
fn stack() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..40)
        .flat_map(|k| [[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(|[x, y]| Vec3::new(x, y, k as f32)))
        .collect();
    let triangles = (0..40).flat_map(|k| [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]).collect();
    (positions, triangles)
}

#[test]
fn a_shadow_ray_visits_each_alpha_tested_triangle_once_and_stops_at_the_others() {
    let (positions, triangles) = stack();
    let mesh = MeshTriangles { positions: &positions, triangles: &triangles };
    let away = Transform::new(DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, 1.0, 3.0),
        glam::DQuat::from_rotation_x(0.3),
        DVec3::new(50.0, 0.0, 0.0),
    ))
    .expect("invertible");
    for to_world in [None, Some(away)] {
        let instances = [
            BvhInstance { mesh: 0, to_world, motion: None },
            BvhInstance {
                mesh: 0,
                to_world: Some(
                    Transform::new(DAffine3::from_translation(DVec3::new(0.0, -500.0, 0.0))).expect("invertible"),
                ),
                motion: None,
            },
        ];
        for count in [1, 2] {
            for mut bvh in Bvh::build_with_each_instruction_set(&[mesh], &instances[..count]).expect("valid") {
                // Squares 10 to 29 are alpha-tested.
                bvh.mark_alpha_tested(|mesh, _, triangle| mesh == 0 && (20..60).contains(&triangle));
                bvh.validate().expect("marks change nothing");
                let place = to_world.unwrap_or_default();
                let ray = |from: f64, to: f64| {
                    let (a, b) = (DVec3::new(0.3, 0.6, from), DVec3::new(0.3, 0.6, to));
                    let [a, b] = [a, b].map(|p| place.to_world().transform_point3(p));
                    Ray::with_end(a.as_vec3(), (b - a).normalize().as_vec3(), (b - a).length() as f32)
                };
                let seen = |ray: &Ray| {
                    let mut squares = Vec::new();
                    let occluded = bvh.occluded_with_alpha(ray, |hit| squares.push(hit.triangle / 2));
                    squares.sort_unstable();
                    (occluded, squares)
                };
                assert_eq!(seen(&ray(9.5, 29.5)), (false, (10..30).collect()));
                assert_eq!(seen(&ray(29.5, 20.5)), (false, (21..30).collect()));
                assert!(seen(&ray(8.5, 29.5)).0, "square 9 blocks");
                assert!(seen(&ray(20.5, 30.5)).0, "square 30 blocks");
                assert_eq!(seen(&ray(39.5, 60.0)), (false, vec![]));
                assert!(bvh.occluded(&ray(14.5, 16.5)), "to other questions they are like any others");
                let mut every = Vec::new();
                bvh.each_hit(&ray(8.5, 31.5), |hit| every.push(hit.triangle / 2));
                every.sort_unstable();
                assert_eq!(every, (9..32).collect::<Vec<_>>(), "each_hit reports all hits");
                let nearest = bvh.closest_hit(&ray(14.6, 40.0)).expect("square 15");
                assert_eq!(nearest.triangle / 2, 15);
            }
        }
    }
}
