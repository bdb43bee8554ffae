//! Family 5, furnaces: whole renders in which light must neither appear nor disappear.
//!
//! Hard, because every error of energy adds up: a bounce that keeps 0.999 of its light is not visible in a picture, and
//! after a hundred bounces a tenth of the light is missing. Clamps, depth limits and rays that are given up all show here,
//! and only here.
//!
//! Must give: one, wherever nothing absorbs and the surroundings are one; the integral of `f cos` for a surface under a
//! white sky; and for closed cavities the sum of the series over all bounces, `e / (1 - F)` where each keeps F, the solution
//! of an integral equation where it depends on the angle.

use super::facets::Plate;
use super::support::{Terms, clear, f_cos, gives, integrate, sky, spot, terms, two_halves, view};
use crate::support::{Add, build, emitter, square};
use dunkelfeld::geometry::{DVec3, LocalDir, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{Material, Scene, SceneBuilder, Surface, Volume};
use dunkelfeld_bsdf::{Bsdf, Principled, PrincipledParams};
use std::f64::consts::PI;

/// A principled surface, as a material and as its parameters.
fn lobe(name: &str, roughness: f32) -> (Material, PrincipledParams) {
    let m = Material { name: name.into(), roughness: roughness.into(), ..Material::default() };
    let p = PrincipledParams { base_color: Rgb::WHITE, roughness, eta: 1.5, ..Default::default() };
    match name {
        "metal" => (Material { metallic: 1.0.into(), ..m }, PrincipledParams { metallic: 1.0, ..p }),
        "plastic" => (m, p),
        "half metal" => (Material { metallic: 0.5.into(), ..m }, PrincipledParams { metallic: 0.5, ..p }),
        _ => (
            // The base below the dielectric reflection is black: the reflection alone.
            Material { base_color: Rgb::BLACK.into(), ..m },
            PrincipledParams { base_color: Rgb::BLACK, ..p },
        ),
    }
}

#[test]
fn a_surface_under_a_white_sky_is_the_integral_of_its_bsdf() {
    for name in ["plastic", "metal", "half metal", "reflection"] {
        for roughness in [0.3f32, 0.6, 1.0] {
            let (material, params) = lobe(name, roughness);
            let bsdf = Bsdf::Principled(Principled::new(&params));
            let expected = 2.0
                * PI
                * integrate(700, |u, v| {
                    let r = (1.0 - u * u).sqrt();
                    let wi = DVec3::new(r * (2.0 * PI * v).cos(), r * (2.0 * PI * v).sin(), u);
                    f_cos(&bsdf, DVec3::Z, view(), wi)
                });
            let mut b = SceneBuilder::default();
            b.add("floor", square(0.0, 1.0, false), material);
            b.environment = sky(1.0);
            spot(&mut b, view(), DVec3::ZERO, 1e-4);
            let what = format!("{name} of roughness {roughness}");
            // To a thousandth of the sky.
            gives(&build(b), expected, Terms { spp: 512.0, sure: 1e-3 / expected, rounding: 1e-4 }, &what);
        }
    }
}

#[test]
fn a_rough_plate_reflects_and_transmits_what_its_facets_leave() {
    // Under a sky that is white above, white below, and white all around. What comes back is less than one by what would be
    // scattered between facets, at each of the many faces that a path meets: for full roughness more than half. The value is
    // that of an integral equation over the facets, solved in f64 from the published formulas (`facets.rs`).
    let toward = DVec3::new(0.5, 0.8, 0.2).normalize();
    for roughness in [0.2f32, 0.5, 1.0] {
        let alpha = f64::from(roughness * roughness);
        let [fine, coarse] = [4, 2].map(|fineness| Plate { alpha, ior: 1.5, fineness }.seen_at(toward.y));
        for (above, below) in [(1.0f32, 0.0f32), (0.0, 1.0), (1.0, 1.0)] {
            let of = |[r, t]: [f64; 2]| f64::from(above) * r + f64::from(below) * t;
            let expected = of(fine);
            // The result of half the grid bounds the error of the full one.
            let off = (expected - of(coarse)).abs();
            assert!(off < 1e-3, "roughness {roughness}: half the grid gives {off} more or less");
            let mut b = SceneBuilder::default();
            b.add(
                "plate",
                cuboid(Vec3::new(-5.0, -1e-3, -5.0), Vec3::new(5.0, 0.0, 5.0)),
                Material { roughness: roughness.into(), ..clear(1.5) },
            );
            two_halves(&mut b, above, below);
            spot(&mut b, 0.3 * toward, DVec3::ZERO, 1e-4);
            let what = format!("roughness {roughness}, sky {above}, ground {below}");
            let terms = Terms { spp: 1024.0, sure: 1e-3 / expected, rounding: off / expected };
            gives(&build(b), expected, terms, &what);
        }
    }
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn a_mirror_room_of_albedo_099_sums_its_series() {
    // A cube whose walls shine with 1 and reflect like a metal of F0 = 0.99. Seen along the diagonal every wall is met at
    // the same angle, so every bounce keeps F = F0 + (1 - F0)(1 - 1/sqrt 3)^5 (Schlick 1994): 1 / (1 - F), of a hundred
    // bounces on average. Facets of alpha = 1e-3 scatter the path by 0.02 rad in a hundred bounces, evenly to all sides.
    let f0 = 0.99f64;
    let f = f0 + (1.0 - f0) * (1.0 - 1.0 / 3f64.sqrt()).powi(5);
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material {
        base_color: Rgb::splat(f0 as f32).into(),
        metallic: 1.0.into(),
        roughness: 0.0.into(),
        emission: Rgb::WHITE.into(),
        ..Material::default()
    });
    let mut room = cuboid(Vec3::splat(-1.0), Vec3::splat(1.0));
    // Fronts inward.
    room.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    b.add_object("room", room, m);
    spot(&mut b, DVec3::new(0.1, 0.2, -0.15), DVec3::new(0.1, 0.2, -0.15) - DVec3::ONE, 1e-3);
    // Roulette by what is lost makes the number of bounces geometric: its spread is its mean, and n paths give 1 / sqrt(n) of
    // it, for any sampling. From the 64th vertex on roulette takes 2 % of what has lost 0.9 %, and survivors count for
    // 1.1 % more each time: two to three times that. A thousandth would take 4e6 paths of a hundred bounces.
    let spp = 512.0;
    let sure = 3.0 / (256.0f64 * spp).sqrt();
    gives(&build(b), 1.0 / (1.0 - f), Terms { spp, sure, rounding: 2e-3 }, "a mirror room");
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn two_endless_plates_solve_their_integral_equation() {
    // Two plates 20 m wide, 1 cm apart, both shining with 1 and scattering like plastic. By symmetry the radiance depends on
    // the angle alone: L(o) = 1 + integral of f(o, i) cos i L(i). Solved by its own series, on 200 cosines.
    let params = PrincipledParams { base_color: Rgb::splat(0.85), roughness: 0.6, eta: 1.5, ..Default::default() };
    let bsdf = Bsdf::Principled(Principled::new(&params));
    const N: usize = 200;
    const AZIMUTHS: usize = 64;
    let local = |z: f64, phi: f64| {
        let r = (1.0 - z * z).sqrt();
        LocalDir(DVec3::new(r * phi.cos(), r * phi.sin(), z).as_vec3())
    };
    let cosine = |k: usize| (k as f64 + 0.5) / N as f64;
    // f cos over all azimuths, times the width of a cosine's cell.
    let kernel = |o: f64, i: f64| {
        let around = |k: usize| {
            let phi = PI * (k as f64 + 0.5) / AZIMUTHS as f64;
            f64::from(bsdf.eval_pdf(local(o, 0.0), local(i, phi)).0.g)
        };
        (0..AZIMUTHS).map(around).sum::<f64>() * 2.0 * PI / (AZIMUTHS * N) as f64
    };
    let rows: Vec<f64> = (0..N * N).map(|k| kernel(cosine(k / N), cosine(k % N))).collect();
    let mut radiance = vec![1.0; N];
    for _ in 0..400 {
        let scattered = |row: &[f64]| 1.0 + row.iter().zip(&radiance).map(|(k, l)| k * l).sum::<f64>();
        radiance = rows.chunks(N).map(scattered).collect();
    }
    let seen = view();
    let expected = 1.0 + (0..N).map(|i| kernel(seen.z, cosine(i)) * radiance[i]).sum::<f64>();
    assert!(expected > 3.0, "light goes back and forth: {expected}");

    let mut b = SceneBuilder::default();
    let m = b.add_material(Material {
        base_color: Rgb::splat(0.85).into(),
        roughness: 0.6.into(),
        emission: Rgb::WHITE.into(),
        ..Material::default()
    });
    b.add_object("lower", square(0.0, 20.0, false), m);
    b.add_object("upper", square(0.01, 20.0, true), m);
    spot(&mut b, seen * 5e-3, DVec3::ZERO, 1e-4);
    // The plates end at a thousand gaps: a share of 1e-6 of all directions misses them.
    gives(&build(b), expected, Terms { spp: 4096.0, sure: 1e-3, rounding: 1e-3 }, "two plates");
}

/// A cube whose walls are black and shine with one, around whatever stands in it.
fn in_a_white_box(add: impl Fn(&mut SceneBuilder)) -> Scene {
    let mut b = SceneBuilder::default();
    let m = b.add_material(emitter(1.0));
    let mut room = cuboid(Vec3::splat(-1.0), Vec3::splat(1.0));
    room.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    b.add_object("room", room, m);
    add(&mut b);
    spot(&mut b, view() * 0.9, DVec3::ZERO, 0.2);
    build(b)
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn bodies_without_absorption_are_invisible_in_a_white_box() {
    let glass = |b: &mut SceneBuilder, ior: f32| b.add_material(clear(ior));
    let cube = |half: f32| cuboid(Vec3::splat(-half), Vec3::splat(half));
    let fog = |scattering: f32, ior: f32| {
        let volume = Volume { scattering: Rgb::splat(scattering), scattering_anisotropy: 0.5, ..Volume::default() };
        Material { surface: Surface::Solid(volume), ..clear(ior) }
    };
    let scenes: [(&str, Scene); 5] = [
        (
            "a glass cube",
            in_a_white_box(|b| {
                let m = glass(b, 1.5);
                b.add_object("cube", cube(0.3), m);
            }),
        ),
        (
            "a glass ball of facets",
            in_a_white_box(|b| {
                let m = glass(b, 1.49);
                b.add_object("ball", sphere(Vec3::ZERO, 0.3, 16, false), m);
            }),
        ),
        (
            "a cube of fog",
            in_a_white_box(|b| {
                b.add("fog", cube(0.3), fog(20.0, 1.0));
            }),
        ),
        (
            "a cube of milk glass",
            in_a_white_box(|b| {
                b.add("milk", cube(0.3), fog(5.0, 1.4));
            }),
        ),
        (
            "a thin pane",
            in_a_white_box(|b| {
                b.add(
                    "pane",
                    square(0.0, 1.0, false),
                    Material { roughness: 0.0.into(), transmission: 1.0.into(), ..Material::default() },
                );
            }),
        ),
    ];
    for (name, scene) in scenes {
        // In fog light is sampled at every scattering, the source of the noise.
        let spp = if name.contains("fog") || name.contains("milk") { 1536.0 } else { 128.0 };
        gives(&scene, 1.0, Terms { spp, sure: 1e-3, rounding: 1e-5 }, name);
    }
}

#[test]
fn nested_and_touching_glass_is_not_seen_in_a_white_box() {
    // A bubble of air in glass in water; two blocks that share a face; one block drawn twice; blocks that overlap.
    /// Index of refraction, lowest and highest corner.
    type Block = (f32, Vec3, Vec3);
    let cases: [(&str, Vec<Block>); 4] = [
        (
            "nested",
            vec![
                (1.33, Vec3::splat(-0.4), Vec3::splat(0.4)),
                (1.5, Vec3::splat(-0.3), Vec3::splat(0.3)),
                (1.0, Vec3::splat(-0.2), Vec3::splat(0.2)),
            ],
        ),
        (
            "touching",
            vec![
                (1.5, Vec3::splat(-0.3), Vec3::new(0.0, 0.3, 0.3)),
                (1.33, Vec3::new(0.0, -0.3, -0.3), Vec3::splat(0.3)),
            ],
        ),
        ("twice", vec![(1.5, Vec3::splat(-0.3), Vec3::splat(0.3)), (1.5, Vec3::splat(-0.3), Vec3::splat(0.3))]),
        ("overlapping", vec![(1.5, Vec3::splat(-0.3), Vec3::splat(0.1)), (1.33, Vec3::splat(-0.1), Vec3::splat(0.3))]),
    ];
    for (name, blocks) in cases {
        let scene = in_a_white_box(|b| {
            for &(ior, low, high) in &blocks {
                b.add("block", cuboid(low, high), clear(ior));
            }
        });
        // Edges where three solids meet may cost single rays.
        gives(&scene, 1.0, Terms { rounding: 1e-4, ..terms(64.0, 1e-3) }, name);
    }
}
