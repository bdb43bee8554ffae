//! Degenerate inputs: each must build, validate, and have the same hits as brute force.
#![allow(clippy::unwrap_used)]

use crate::common::{Random, Shape, random_soup};
use dunkelfeld_geometry::{Ray, Vec3};

fn triangle_at(p: Vec3, size: f32) -> [Vec3; 3] {
    [p, p + size * Vec3::X, p + size * Vec3::Y]
}

fn ladder() -> Vec<(&'static str, Shape)> {
    let mut random = Random::new(41);
    let base = random_soup(300, 42);
    let mut with_nan = base.clone();
    with_nan.positions[17] = Vec3::NAN;
    with_nan.positions[100].y = f32::INFINITY;
    with_nan.positions[301].z = f32::NEG_INFINITY;
    let mut grid = Vec::new();
    for i in 0..20 {
        for j in 0..20 {
            let at = |i: i32, j: i32| Vec3::new(i as f32, j as f32, 0.0);
            grid.extend([[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]);
        }
    }
    vec![
        ("one triangle", Shape::soup([triangle_at(Vec3::ZERO, 1.0)])),
        ("two that coincide", Shape::soup([triangle_at(Vec3::ZERO, 1.0); 2])),
        ("nine that coincide", Shape::soup([triangle_at(Vec3::ZERO, 1.0); 9])),
        ("65 that coincide", Shape::soup([triangle_at(Vec3::ZERO, 1.0); 65])),
        ("a point", Shape::soup([[Vec3::ONE; 3]])),
        ("a line", Shape::soup([[Vec3::ZERO, Vec3::ONE, 2.0 * Vec3::ONE]])),
        ("points and lines among triangles", {
            let mut s = base.clone();
            for i in (0..900).step_by(9) {
                s.positions[i + 1] = s.positions[i];
            }
            s
        }),
        ("NaN and infinity among triangles", with_nan),
        ("all NaN", Shape::soup([[Vec3::NAN; 3]; 20])),
        ("a flat grid", Shape::soup(grid)),
        (
            "equal boxes, different triangles",
            Shape::soup((0..100).map(|i| {
                let f = i as f32 / 100.0;
                [Vec3::new(0.0, 0.0, f), Vec3::new(1.0, 1.0, 0.0), Vec3::new(f, 0.0, 1.0)]
            })),
        ),
        (
            "boxes in boxes",
            Shape::soup((1..400).map(|i| {
                let s = i as f32;
                [Vec3::new(-s, -s, -s), Vec3::new(s, s, -s), Vec3::new(0.0, s, s)]
            })),
        ),
        (
            "sizes from 1e-6 to 1e6",
            Shape::soup((0..300).map(|i| {
                let s = 10f32.powf(-6.0 + 12.0 * i as f32 / 300.0);
                [s * random.in_cube(), s * random.in_cube(), s * random.in_cube()]
            })),
        ),
        ("huge", base.map(|p| 1e30 * p)),
        ("at the end of the numbers", base.map(|p| 1e38 * p)),
        ("tiny", base.map(|p| 1e-25 * p)),
        ("far", base.map(|p| 1e-2 * p + Vec3::new(1e5, 0.0, 0.0))),
        (
            "needles in one direction",
            Shape::soup((0..300).map(|i| {
                let y = i as f32 * 1e-3;
                [Vec3::new(0.0, y, 0.0), Vec3::new(100.0, y, 0.0), Vec3::new(50.0, y + 1e-4, 1e-5)]
            })),
        ),
    ]
}

/// Rays with difficult directions.
fn rays(shape: &Shape) -> Vec<Ray> {
    let (p, inf) = (shape.positions[0], f32::INFINITY);
    let inside = Vec3::new(0.1, 0.2, 0.3);
    let mut rays = vec![
        Ray::new(Vec3::NAN, Vec3::X),
        Ray::new(inside, Vec3::NAN),
        Ray::new(inside, Vec3::ZERO),
        Ray::new(inside, -Vec3::ZERO),
        Ray::new(inside, Vec3::new(inf, 0.0, 0.0)),
        Ray::new(Vec3::new(0.0, inf, 0.0), Vec3::Y),
        Ray::with_end(inside, Vec3::Z, 0.0),
        Ray::with_end(inside, Vec3::Z, -1.0),
        Ray::with_end(inside, Vec3::Z, f32::NAN),
        Ray::new(Vec3::splat(3e38), -Vec3::ONE.normalize()),
    ];
    for d in
        [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1.0, 0.0, -0.0), Vec3::new(1e-38, 1.0, -1e-42), Vec3::new(0.6, 0.8, 0.0)]
    {
        for s in [1.0, -1.0] {
            rays.extend([p, inside, Vec3::ZERO].map(|o| Ray::new(o - 2.0 * s * d, s * d)));
            rays.push(Ray::new(p, s * d));
        }
    }
    rays
}

#[test]
fn degenerate_meshes_are_traversed() {
    for (name, shape) in ladder() {
        let bvh = shape.bvh();
        bvh.validate().unwrap_or_else(|e| panic!("{name}: {e}"));
        for ray in rays(&shape) {
            let sound = ray.origin.is_finite() && ray.direction.is_finite() && ray.direction != Vec3::ZERO;
            if !(sound && ray.t_max > 0.0) {
                assert_eq!((bvh.closest_hit(&ray), bvh.occluded(&ray)), (None, false), "{name}: {ray:?}");
            } else if name != "at the end of the numbers" {
                shape.assert_agrees(&bvh, &ray);
            } else {
                // Differences of coordinates overflow: no answer is right, but there must be one.
                let _ = (bvh.closest_hit(&ray), bvh.occluded(&ray));
            }
        }
        let mut random = Random::new(43);
        let (scale, middle) = {
            let b = bvh.bounds();
            if b.is_empty() { (1.0, Vec3::ZERO) } else { (0.5 * b.size().max_element(), b.center()) }
        };
        for _ in 0..2_000 {
            let ray = Ray::new(middle + 1.5 * scale * random.in_cube(), random.direction());
            if name == "at the end of the numbers" {
                let _ = (bvh.closest_hit(&ray), bvh.occluded(&ray));
            } else {
                shape.assert_agrees(&bvh, &ray);
            }
        }
    }
}

/// A quadratic build of so many takes minutes for each case, so that the limit on all tests in `.ci/run` ends it.
#[test]
fn a_hundred_thousand_copies_build() {
    let nested = |i: usize| {
        let s = 1.0 + i as f32 * 1e-3;
        [Vec3::new(-s, -s, -s), Vec3::new(s, s, -s), Vec3::new(0.0, s, s)]
    };
    let cases = [
        ("copies", Shape::soup((0..100_000).map(|_| triangle_at(Vec3::ONE, 1.0)))),
        (
            "a hundred places, 1000 copies each",
            Shape::soup((0..100_000).map(|i| triangle_at(Vec3::splat((i % 100) as f32), 1.0))),
        ),
        ("boxes in boxes", Shape::soup((0..100_000).map(nested))),
    ];
    for (name, shape) in cases {
        let bvh = shape.bvh();
        bvh.validate().unwrap();
        assert!(bvh.occluded(&Ray::new(Vec3::new(1.2, 1.2, -9.0), Vec3::Z)), "{name}");
    }
}
