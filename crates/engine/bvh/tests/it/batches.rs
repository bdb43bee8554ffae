//! Batches of rays have the bits of single rays, for all instruction sets and in any grouping.
//!
//! Replay: `cargo test -p dunkelfeld-bvh --test it batches`.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, bumpy_torus, icosphere, random_soup};
use dunkelfeld_bvh::{Bvh, BvhInstance, Hit, HitBatch, InstanceMotion, MeshTree, NO_HIT, RayBatch};
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Ray, RigidMotion, Threads, Transform, Vec3};
use dunkelfeld_lanes::InstructionSet;
use std::sync::Arc;

type Bits = [u32; 6];

fn bits(hit: Option<Hit>) -> Bits {
    hit.map_or([NO_HIT; 6], |h| [h.t.to_bits(), h.b1.to_bits(), h.b2.to_bits(), h.instance, h.part, h.triangle])
}

/// The hits of a batch in parts of a size, and which rays are occluded.
fn traced(bvh: &Bvh, set: InstructionSet, rays: &[Ray], size: usize) -> Vec<(Bits, bool)> {
    let mut results = Vec::new();
    for rays in rays.chunks(size) {
        let row = |f: fn(&Ray) -> f32| -> Vec<f32> { rays.iter().map(f).collect() };
        let origin = [row(|r| r.origin.x), row(|r| r.origin.y), row(|r| r.origin.z)];
        let direction = [row(|r| r.direction.x), row(|r| r.direction.y), row(|r| r.direction.z)];
        let batch = RayBatch {
            origin: origin.each_ref().map(Vec::as_slice),
            direction: direction.each_ref().map(Vec::as_slice),
            t_max: &row(|r| r.t_max),
            time: &row(|r| r.time),
        };
        let (mut numbers, mut indices) =
            ([(); 3].map(|()| vec![0.0; rays.len()]), [(); 3].map(|()| vec![0; rays.len()]));
        let ([t, b1, b2], [instance, part, triangle]) = (&mut numbers, &mut indices);
        bvh.closest_hits(set, &batch, &mut HitBatch { t, b1, b2, instance, part, triangle });
        let mut occluded = vec![false; rays.len()];
        bvh.occluded_batch(set, &batch, &mut occluded);
        for (i, occluded) in occluded.into_iter().enumerate() {
            let [t, b1, b2] = numbers.each_ref().map(|row| row[i]);
            let [instance, part, triangle] = indices.each_ref().map(|row| row[i]);
            let hit = (instance != NO_HIT).then_some(Hit { t, b1, b2, instance, part, triangle });
            results.push((bits(hit), occluded));
        }
    }
    results
}

/// Rays of all kinds around a shape, in coherent and in random order.
fn rays(shape: &Shape, random: &mut Random) -> Vec<Ray> {
    let corners = |random: &mut Random| shape.corners(random.int(shape.triangles.len()) as u32);
    let mut rays = Vec::new();
    for _ in 0..60 {
        let (eye, target) = (3.0 * random.in_cube(), corners(random)[0]);
        let spread = 10f32.powf(-4.0 * random.unit());
        let end = if random.int(2) == 0 { f32::INFINITY } else { 4.0 * random.unit() };
        for i in 0..20 + random.int(40) {
            // From a point, toward a small area, or parallel; every fifth one through a corner or an edge.
            let [a, b, _] = corners(random);
            let (from, to) = match i % 5 {
                0 => (eye, a.lerp(b, [0.0, random.unit()][random.int(2)])),
                1 | 2 => (eye, target + spread * random.in_cube()),
                _ => (eye + spread * random.in_cube(), target),
            };
            rays.push(Ray::with_end(from, (to - from).normalize(), end).at_time(random.unit()));
        }
        // From a vertex, along axes, and rays that hit nothing.
        rays.push(Ray::new(target, random.direction()));
        rays.push(Ray::with_end(eye, [Vec3::X, -Vec3::Y, Vec3::new(-0.0, 0.0, 1.0)][random.int(3)], end));
        rays.push(Ray::with_end(
            eye,
            [Vec3::ZERO, Vec3::NAN, Vec3::X][random.int(3)],
            [1.0, 0.0, f32::NAN][random.int(3)],
        ));
    }
    for _ in 0..2_000 {
        let (a, b) = (3.0 * random.in_cube(), 1.5 * random.in_cube());
        rays.push(Ray::with_end(a, (b - a).normalize(), 6.0 * random.unit()).at_time(random.unit()));
    }
    rays
}

fn assert_bits_of_single_rays(name: &str, bvh: &Bvh, rays: &[Ray]) {
    let single: Vec<_> = rays.iter().map(|ray| (bits(bvh.closest_hit(ray)), bvh.occluded(ray))).collect();
    for (ray, (hit, occluded)) in rays.iter().zip(&single) {
        assert_eq!(hit[3] != NO_HIT, *occluded, "{name}: closest_hit and occluded disagree on {ray:?}");
    }
    for set in InstructionSet::all() {
        for size in [rays.len(), 37, 5] {
            let batch = traced(bvh, set, rays, size);
            for ((ray, one), many) in rays.iter().zip(&single).zip(&batch) {
                assert_eq!(one, many, "{name}, {set:?}, batches of {size}: {ray:?}");
            }
            assert_eq!(batch.len(), rays.len());
        }
    }
}

fn coincident(count: usize) -> Shape {
    Shape::soup((0..count).map(|_| [Vec3::ZERO, Vec3::X, Vec3::Y]))
}

fn grid() -> Shape {
    let at = |i: usize, j: usize| Vec3::new(0.1 * i as f32 - 1.0, 0.1 * j as f32 - 1.0, 0.0);
    Shape::soup((0..400).flat_map(|k| {
        let (i, j) = (k % 20, k / 20);
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    }))
}

#[test]
fn batches_have_the_bits_of_single_rays() {
    let mut random = Random::new(61);
    let needles = Shape::soup((0..400).map(|_| {
        let (a, d) = (random.in_cube(), random.direction());
        [a, a + 2.0 * d, a + d + 2e-6 * random.unit() * random.direction()]
    }));
    let shapes = [
        ("one triangle", coincident(1)),
        ("65 that coincide", coincident(65)),
        ("grid", grid()),
        ("two grids in one place", Shape::soup((0..1600).map(|i| grid().corners(i % 800)).collect::<Vec<_>>())),
        ("needles", needles),
        ("soup", random_soup(900, 62)),
        ("torus", bumpy_torus(60, 24)),
        ("sphere", icosphere(4)),
        ("far", icosphere(3).map(|p| p + Vec3::new(1000.0, 0.0, 0.0))),
    ];
    for (name, shape) in shapes {
        let rays: Vec<Ray> = match name {
            "far" => {
                let shift = Vec3::new(1000.0, 0.0, 0.0);
                let near = rays(&shape.map(|p| p - shift), &mut random);
                near.into_iter().map(|r| Ray { origin: r.origin + shift, ..r }).collect()
            }
            _ => rays(&shape, &mut random),
        };
        assert_bits_of_single_rays(name, &shape.bvh(), &rays);
    }
}

#[test]
fn batches_through_instances_have_the_bits_of_single_rays() {
    let shapes = [bumpy_torus(24, 12), random_soup(200, 63), icosphere(2)];
    let trees: Vec<_> = shapes.iter().map(|s| Arc::new(MeshTree::build(&s.view(), Threads::ONE).unwrap())).collect();
    let joined = Arc::new(MeshTree::join(trees.clone()).unwrap());
    let meshes: Vec<_> = trees.into_iter().chain([joined]).collect();
    let here = |mesh| BvhInstance { mesh, to_world: None, motion: None };
    let turned = Transform::new(DAffine3::from_scale_rotation_translation(
        DVec3::new(0.3, -1.7, 0.9),
        DQuat::from_axis_angle(DVec3::new(0.0, 0.6, 0.8), 2.0),
        DVec3::new(0.4, 0.1, -0.7),
    ))
    .unwrap();
    let there = |mesh| BvhInstance { mesh, to_world: Some(turned), motion: None };
    let motion = RigidMotion::linear(DVec3::new(0.5, -0.2, 0.1));
    let moving = |mesh| BvhInstance { motion: Some(InstanceMotion { motion, times: [0.0, 1.0] }), ..there(mesh) };
    let mut random = Random::new(64);
    for (name, instances) in [
        ("joined", vec![here(3)]),
        ("the same twice", vec![here(0), here(0)]),
        ("joined and its parts", vec![here(3), here(2), here(1), here(0)]),
        ("fixed", vec![there(0), here(1), there(2), there(2), here(2)]),
        ("moving", vec![moving(0), here(2), there(1), moving(2)]),
    ] {
        let bvh = Bvh::from_trees(meshes.clone(), &instances, Threads::ONE).unwrap();
        assert_bits_of_single_rays(name, &bvh, &rays(&shapes[0], &mut random));
    }
}

#[test]
fn of_equal_hits_the_first_triangle_counts() {
    let mut random = Random::new(65);
    for (name, shape) in [("coincident", coincident(65)), ("grid", grid())] {
        let bvh = shape.bvh();
        let two = Bvh::build(&[shape.view()], &[BvhInstance { mesh: 0, to_world: None, motion: None }; 2]).unwrap();
        let mut hits = 0;
        for ray in rays(&shape, &mut random) {
            let is_valid = ray.direction.is_finite() && ray.direction != Vec3::ZERO && ray.t_max > 0.0;
            let first = if is_valid { shape.brute_force(&ray).map(|(triangle, _)| (0, triangle)) } else { None };
            for bvh in [&bvh, &two] {
                assert_eq!(bvh.closest_hit(&ray).map(|h| (h.instance, h.triangle)), first, "{name}: {ray:?}");
            }
            hits += usize::from(first.is_some());
        }
        assert!(hits > 300, "{name}: only {hits} hits: the test does not test");
    }
}
