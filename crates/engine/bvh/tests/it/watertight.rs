//! No ray leaves a closed mesh: a million rays from inside at edges and vertices, at every scale and far from the
//! origin.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, bumpy_torus, icosphere};
use dunkelfeld_bvh::Bvh;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Ray, Transform, Vec3};

const RAYS: usize = 1_000_000;

/// Traces rays to the edges and vertices of `shape`. `bvh` is its image in the world.
///
/// `inside` returns a point inside in object space; `place` converts points of object space to the world. It must not
/// rotate (directions are those of object space).
fn count_leaks(shape: &Shape, bvh: &Bvh, inside: Inside, place: impl Fn(Vec3) -> Vec3, rays: usize) -> usize {
    let mut random = Random::new(11);
    let mut leaks = 0;
    for i in 0..rays {
        let origin = inside(&mut random);
        let corners = shape.corners(random.int(shape.triangles.len()) as u32);
        let k = random.int(3);
        let target = if i % 2 == 0 { corners[k] } else { corners[k].lerp(corners[(k + 1) % 3], random.unit()) };
        let ray = Ray::new(place(origin), (target - origin).normalize());
        let leaked = if i % 8 < 6 { bvh.closest_hit(&ray).is_none() } else { !bvh.occluded(&ray) };
        leaks += usize::from(leaked);
    }
    leaks
}

/// Picks a point inside a mesh.
type Inside = fn(&mut Random) -> Vec3;

/// In all placements below, the origin of these rays is inside both meshes. Its x is exactly zero, so a displacement
/// along x by a kilometre is exact for any size of the mesh.
fn meshes() -> [(&'static str, Shape, Inside); 2] {
    [
        ("icosphere", icosphere(5), |r| Vec3::new(0.0, 0.5 * r.signed(), 0.5 * r.signed())),
        ("torus", bumpy_torus(120, 48), |r| Vec3::new(0.0, 1.0 + 0.1 * r.signed(), 0.1 * r.signed())),
    ]
}

fn check(far: f64, baked: bool, scales: &[f32]) {
    for (name, shape, inside) in meshes() {
        for &scale in scales {
            let offset = Vec3::new(far as f32, 0.0, 0.0);
            let place = |p: Vec3| scale * p + offset;
            let bvh = if baked {
                shape.map(place).bvh()
            } else {
                let to_world = DAffine3::from_scale_rotation_translation(
                    DVec3::splat(f64::from(scale)),
                    DQuat::IDENTITY,
                    DVec3::new(far, 0.0, 0.0),
                );
                shape.instanced(Transform::new(to_world).unwrap())
            };
            bvh.validate().unwrap();
            let leaks = count_leaks(&shape, &bvh, inside, place, RAYS);
            assert_eq!(leaks, 0, "{name} at scale {scale}, {far} m away, baked: {baked}");
        }
    }
}

#[test]
fn nothing_leaks_at_the_origin() {
    check(0.0, true, &[1e-4, 1.0, 1e4]);
}

#[test]
fn nothing_leaks_from_an_instance_a_kilometre_away() {
    check(1000.0, false, &[1e-4, 1.0, 1e4]);
}

#[test]
fn nothing_leaks_from_a_mesh_baked_a_kilometre_away() {
    // At a scale of 1e-4 its vertices would fall together: an ulp is 6e-5 there.
    check(1000.0, true, &[1.0, 1e4]);
}

#[test]
fn nothing_leaks_at_the_silhouette_from_a_distance() {
    // From a thousand radii away the rounding of the sheared corners is many times the triangles' height, and rays
    // graze edges. A ray that enters must leave: its line crosses the sphere twice or never.
    let shape = icosphere(4);
    let bvh = shape.bvh();
    let mut random = Random::new(13);
    for _ in 0..200_000 {
        let corners = shape.corners(random.int(shape.triangles.len()) as u32);
        // 30 % inside the silhouette, to be well clear of it.
        let target = 0.7 * corners[random.int(3)];
        let origin = 1000.0 * random.direction();
        let ray = Ray::new(origin, (target - origin).normalize());
        assert!(bvh.closest_hit(&ray).is_some(), "{ray:?} passes through");
    }
}
