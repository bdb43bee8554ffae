//! The tree against brute force, and the instruction sets against each other.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, bumpy_torus, icosphere, random_soup};
use dunkelfeld_bvh::{Bvh, BvhInstance, Hit, MeshTree};
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Ray, Threads, Transform, Vec3};
use std::sync::Arc;

/// Rays of all kinds: arbitrary, along axes, through vertices or along edges, and short ones.
fn ray_at(shape: &Shape, random: &mut Random) -> Ray {
    let origin = 3.0 * random.in_cube();
    let triangle = shape.corners(random.int(shape.triangles.len()) as u32);
    let direction = match random.int(6) {
        0 => random.direction(),
        1 => (triangle[0] - origin).normalize(),
        2 => (triangle[0].lerp(triangle[1], random.unit()) - origin).normalize(),
        3 => [Vec3::X, -Vec3::Y, Vec3::new(-0.0, 0.0, 1.0)][random.int(3)],
        4 => Vec3::new(random.signed(), 0.0, -0.0),
        _ => ((triangle[0] + triangle[1] + triangle[2]) / 3.0 - origin).normalize(),
    };
    // Some start on a vertex, some in the plane of one.
    let origin = match random.int(8) {
        0 => triangle[2],
        1 => Vec3::new(triangle[1].x, origin.y, triangle[1].z),
        _ => origin,
    };
    let t_max = if random.int(4) == 0 { 3.0 * random.unit() } else { f32::INFINITY };
    Ray::with_end(origin, direction, t_max)
}

#[test]
fn every_hit_equals_that_of_brute_force() {
    let shapes = [random_soup(1, 1), random_soup(7, 2), random_soup(9, 3), random_soup(600, 4), bumpy_torus(30, 12)];
    for (s, shape) in shapes.iter().enumerate() {
        let bvh = shape.bvh();
        bvh.validate().unwrap();
        let mut random = Random::new(100 + s as u64);
        let hits = (0..20_000).filter(|_| shape.assert_agrees(&bvh, &ray_at(shape, &mut random)).is_some()).count();
        assert!(hits > 500, "only {hits} hits: the test does not test");
    }
}

#[test]
fn hits_of_needles_and_slivers_equal_those_of_brute_force() {
    let mut random = Random::new(5);
    // Up to 1 : 1e6, crossing each other in all directions.
    let shape = Shape::soup((0..400).map(|_| {
        let (a, d) = (random.in_cube(), random.direction());
        [a, a + 2.0 * d, a + d + 2e-6 * random.unit() * random.direction()]
    }));
    let bvh = shape.bvh();
    bvh.validate().unwrap();
    let mut hits = 0;
    for _ in 0..20_000 {
        let needle = shape.corners(random.int(400) as u32);
        let origin = 4.0 * random.direction();
        let target = needle[0].lerp(needle[1], random.unit()).lerp(needle[2], random.unit());
        hits += usize::from(shape.assert_agrees(&bvh, &Ray::new(origin, (target - origin).normalize())).is_some());
    }
    assert!(hits > 5_000, "only {hits} hits: the test does not test");
}

/// Trees and traversal of each instruction set, for all questions that a ray can have.
#[test]
fn all_instruction_sets_give_the_same_bits() {
    let meshes = [random_soup(5_000, 6), icosphere(3)];
    let views = meshes.each_ref().map(Shape::view);
    let turned = Transform::new(DAffine3::from_scale_rotation_translation(
        DVec3::new(0.3, -1.7, 0.9),
        DQuat::from_axis_angle(DVec3::new(0.0, 0.6, 0.8), 2.0),
        DVec3::new(0.4, 0.1, -0.7),
    ))
    .unwrap();
    let here = BvhInstance { mesh: 0, to_world: None, motion: None };
    let there = BvhInstance { mesh: 1, to_world: Some(turned), motion: None };
    for instances in [&[here][..], &[here, there]] {
        let mut all = Bvh::build_with_each_instruction_set(&views, instances).unwrap();
        all.iter_mut().for_each(|bvh| bvh.mark_alpha_tested(|_, _, triangle| triangle % 3 == 0));
        let answers = |bvh: &Bvh, ray: &Ray| {
            let (mut alpha_tested, mut every) = (Vec::new(), Vec::new());
            let bits = |h: Hit| (h.t.to_bits(), h.b1.to_bits(), h.b2.to_bits(), h.instance, h.triangle);
            let occluded_with_alpha = bvh.occluded_with_alpha(ray, |hit| alpha_tested.push(bits(hit)));
            bvh.each_hit(ray, |hit| every.push(bits(hit)));
            (bvh.closest_hit(ray).map(bits), bvh.occluded(ray), occluded_with_alpha, alpha_tested, every)
        };
        let mut random = Random::new(7);
        let mut hits = 0;
        for _ in 0..50_000 {
            let ray = ray_at(&meshes[0], &mut random);
            let plain = answers(&all[0], &ray);
            assert_eq!(plain.0.is_some(), plain.1, "for {ray:?}");
            for bvh in &all[1..] {
                assert_eq!(answers(bvh, &ray), plain, "for {ray:?}");
            }
            hits += usize::from(plain.1);
        }
        assert!(hits > 15_000, "only {hits} hits: the test does not test");
    }
}

/// Joined trees have the hits of one tree of all triangles, also beside instances, and their marks.
#[test]
fn joined_trees_have_the_hits_of_one_tree() {
    let shapes: Vec<Shape> = (0..40u64)
        .map(|i| match i % 4 {
            0 => Shape::default(),
            1 => random_soup(1 + i as usize, i),
            2 => icosphere(2).map(|p| 0.3 * p + Vec3::new(0.1 * i as f32 - 2.0, 0.0, 0.2)),
            _ => bumpy_torus(12, 6).map(|p| 0.2 * p - Vec3::splat(0.04 * i as f32)),
        })
        .collect();
    let first: Vec<u32> = shapes
        .iter()
        .scan(0, |next, shape| {
            let first = *next;
            *next += shape.triangles.len() as u32;
            Some(first)
        })
        .collect();
    let all = Shape::soup(shapes.iter().flat_map(|s| (0..s.triangles.len() as u32).map(|t| s.corners(t))));
    let trees = shapes.iter().map(|s| Arc::new(MeshTree::build(&s.view(), Threads::ONE).unwrap())).collect();
    let joined = Arc::new(MeshTree::join(trees).expect("few parts"));
    assert!(MeshTree::join(vec![joined.clone()]).is_none(), "a joined tree cannot be a part");
    let other = Arc::new(MeshTree::build(&icosphere(2).view(), Threads::ONE).unwrap());
    let here = BvhInstance { mesh: 0, to_world: None, motion: None };
    let turned = Transform::new(DAffine3::from_translation(DVec3::new(0.0, 4.0, 0.0))).unwrap();
    let there = BvhInstance { mesh: 1, to_world: Some(turned), motion: None };
    let soup = Arc::new(MeshTree::build(&all.view(), Threads::ONE).unwrap());
    for instances in [&[here][..], &[here, there]] {
        let mut bvh = Bvh::from_trees(vec![joined.clone(), other.clone()], instances, Threads::ONE).unwrap();
        let mut flat = Bvh::from_trees(vec![soup.clone(), other.clone()], instances, Threads::ONE).unwrap();
        let is_tested = |triangle: u32| triangle.is_multiple_of(3);
        bvh.mark_alpha_tested(|mesh, part, triangle| mesh == 0 && is_tested(first[part as usize] + triangle));
        flat.mark_alpha_tested(|mesh, _, triangle| mesh == 0 && is_tested(triangle));
        bvh.validate().unwrap();
        let mut random = Random::new(11);
        let mut hits = 0;
        for _ in 0..20_000 {
            // Through the inside of a triangle: at a corner the order of the leaves decides which of its triangles is hit.
            let triangle = all.corners(random.int(all.triangles.len()) as u32);
            let [u, v] = [0.1 + 0.4 * random.unit(), 0.1 + 0.4 * random.unit()];
            let origin = 3.0 * random.in_cube();
            let target = triangle[0] + u * (triangle[1] - triangle[0]) + v * (triangle[2] - triangle[0]);
            let ray = Ray::new(origin, (target - origin).normalize());
            let number =
                |hit: &Hit| if hit.instance == 0 { first[hit.part as usize] + hit.triangle } else { hit.triangle };
            let (one, two) = (flat.closest_hit(&ray), bvh.closest_hit(&ray));
            // Of two triangles at one distance either may be hit.
            assert_eq!(one.map(|h| (h.t.to_bits(), h.instance)), two.map(|h| (h.t.to_bits(), h.instance)), "{ray:?}");
            hits += usize::from(two.is_some());
            assert_eq!(flat.occluded(&ray), bvh.occluded(&ray), "{ray:?}");
            let (mut a, mut b) = (Vec::new(), Vec::new());
            let blocked =
                flat.occluded_with_alpha(&ray, |hit| a.push((number(&Hit { part: 0, ..hit }), hit.t.to_bits())));
            assert_eq!(blocked, bvh.occluded_with_alpha(&ray, |hit| b.push((number(&hit), hit.t.to_bits()))));
            if !blocked {
                a.sort_unstable();
                b.sort_unstable();
                assert_eq!(a, b, "{ray:?}");
            }
        }
        assert!(hits > 5_000, "only {hits} hits: the test does not test");
    }
}
