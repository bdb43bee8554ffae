//! An instance of a mesh has the same hits as the transformed mesh.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, icosphere, random_soup};
use dunkelfeld_bvh::{Bvh, BvhError, BvhInstance};
use dunkelfeld_geometry::{Aabb, DAffine3, DMat3, DQuat, DVec3, Ray, Transform, Vec3};

fn transform(scale: DVec3, turn: f64, at: DVec3) -> Transform {
    let q = DQuat::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), turn);
    Transform::new(DAffine3::from_scale_rotation_translation(scale, q, at)).unwrap()
}

#[test]
fn exact_transforms_give_exactly_the_baked_hits() {
    // Axes exchanged, mirrored, doubled: nothing rounds. So instance and baked mesh must agree on t, except for the
    // rounding caused by the different choice of the sheared axes.
    let shape = random_soup(500, 31);
    let m = DMat3::from_cols(DVec3::new(0.0, 2.0, 0.0), DVec3::new(0.0, 0.0, -2.0), DVec3::new(2.0, 0.0, 0.0));
    let t = Transform::new(DAffine3::from_mat3_translation(m, DVec3::new(4.0, -8.0, 0.5))).unwrap();
    assert!(t.swaps_handedness());
    let (instanced, baked) = (shape.instanced(t), shape.map(|p| t.point(p)).bvh());
    let mut random = Random::new(32);
    let mut hits = 0;
    for _ in 0..50_000 {
        let origin = t.point(3.0 * random.in_cube());
        let ray = Ray::new(origin, random.direction());
        let (a, b) = (instanced.closest_hit(&ray), baked.closest_hit(&ray));
        if let (Some(a), Some(b)) = (a, b) {
            assert!((a.t - b.t).abs() <= 1e-5 * b.t + 1e-6, "{a:?} against {b:?} for {ray:?}");
            hits += 1;
        }
        // Only for a ray at the rim of a triangle one of them may have a hit and the other none.
        assert_eq!(a.is_some(), b.is_some(), "for {ray:?}");
    }
    assert!(hits > 1_000, "only {hits} hits: the test does not test");
}

#[test]
fn many_instances_equal_one_baked_mesh() {
    let ball = icosphere(2);
    let mut random = Random::new(33);
    let mut baked = Shape::default();
    let mut instances = Vec::new();
    for _ in 0..60 {
        let scale = DVec3::new(
            0.05 + 0.3 * f64::from(random.unit()),
            -0.05 - 0.3 * f64::from(random.unit()),
            0.05 + 0.3 * f64::from(random.unit()),
        );
        let t = transform(scale, 6.0 * f64::from(random.unit()), 2.0 * random.in_cube().as_dvec3());
        let base = baked.positions.len() as u32;
        baked.positions.extend(ball.positions.iter().map(|&p| t.point(p)));
        baked.triangles.extend(ball.triangles.iter().map(|t| t.map(|i| i + base)));
        instances.push(BvhInstance { mesh: 0, to_world: Some(t), motion: None });
    }
    let two_level = Bvh::build(&[ball.view()], &instances).unwrap();
    two_level.validate().unwrap();
    let flat = baked.bvh();
    assert!(two_level.memory_bytes() < flat.memory_bytes() / 5, "the mesh is stored once");
    let (a, b) = (two_level.bounds(), flat.bounds());
    assert!(a.encloses(&b) && (a.size() - b.size()).max_element() < 0.5);

    let per_mesh = ball.triangles.len() as u32;
    let (mut hits, mut differ) = (0, 0);
    for _ in 0..100_000 {
        let ray = Ray::new(2.5 * random.in_cube(), random.direction());
        let (a, b) = (two_level.closest_hit(&ray), flat.closest_hit(&ray));
        assert_eq!(two_level.occluded(&ray), a.is_some(), "for {ray:?}");
        match (a, b) {
            (Some(a), Some(b)) => {
                hits += 1;
                let same = (a.instance, a.triangle) == (b.triangle / per_mesh, b.triangle % per_mesh);
                differ += usize::from(!same || (a.t - b.t).abs() > 1e-4 * b.t + 1e-5);
            }
            (None, None) => {}
            _ => differ += 1,
        }
    }
    assert!(hits > 10_000 && differ < 30, "{differ} of {hits} hits differ: more than rims and shared edges explain");
}

#[test]
fn invalid_indices_are_errors_and_an_empty_scene_is_valid() {
    let p = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let good = dunkelfeld_bvh::MeshTriangles { positions: &p, triangles: &[[0, 1, 2]] };
    let bad = dunkelfeld_bvh::MeshTriangles { positions: &p, triangles: &[[0, 1, 2], [0, 1, 3]] };
    let at = |mesh| BvhInstance { mesh, to_world: None, motion: None };
    assert_eq!(
        Bvh::build(&[good, bad], &[at(0)]).err(),
        Some(BvhError::VertexOutOfRange { mesh: 1, triangle: 1, vertices: 3 })
    );
    assert_eq!(
        Bvh::build(&[good], &[at(0), at(1)]).err(),
        Some(BvhError::MeshOutOfRange { instance: 1, mesh: 1, meshes: 1 })
    );
    let empty = Shape::default();
    for bvh in [
        Bvh::build(&[], &[]),
        Bvh::build(&[good], &[]),
        Bvh::build(&[empty.view()], &[at(0)]),
        Bvh::build(&[empty.view()], &[at(0), at(0)]),
    ] {
        let bvh = bvh.unwrap();
        bvh.validate().unwrap();
        assert_eq!(bvh.bounds(), Aabb::EMPTY);
        let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
        assert_eq!((bvh.closest_hit(&ray), bvh.occluded(&ray)), (None, false));
    }
}
