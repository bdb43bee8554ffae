//! The invariants that resume, merge and replay stand on: samples are pure functions of their names, sample sets are
//! additive, invalid samples are counted and named.
//!
//! Replay: `cargo test -p dunkelfeld --test it invariants::NAME`.

use crate::support::{self, Add, build, emitter, rendered, settings, square};
use dunkelfeld::film::{Accumulate, Film, PixelSums};
use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{Material, Scene, SceneBuilder, Surface, Volume};
use dunkelfeld::{Budget, RenderSettings};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_integrator::{Estimator, PixelSample};

/// A room in miniature: floor, glass ball, metal box, one light; enough for every kind of decision.
fn room() -> Scene {
    build(objects())
}

fn objects() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    b.add(
        "floor",
        square(0.0, 2.0, false),
        Material { base_color: Rgb::new(0.7, 0.5, 0.3).into(), ..Material::default() },
    );
    let volume = Volume { attenuation_color: Rgb::new(0.9, 0.8, 0.7), attenuation_distance: 0.1, ..Volume::default() };
    let glass = b.add_material(Material {
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        surface: Surface::Solid(volume),
        ..Material::default()
    });
    b.add_object("ball", sphere(Vec3::new(0.2, 0.0, 0.25), 0.2, 12, true), glass);
    b.add(
        "box",
        cuboid(Vec3::new(-0.5, -0.2, 0.01), Vec3::new(-0.1, 0.2, 0.3)),
        Material { metallic: 1.0.into(), roughness: 0.3.into(), ..Material::default() },
    );
    b.add("light", square(1.0, 0.5, true), emitter(8.0));
    b.add_camera("camera", DVec3::new(0.3, -1.5, 0.9), DVec3::new(0.0, 0.0, 0.15), 0.7);
    b
}

#[test]
fn the_film_is_bit_identical_for_any_number_of_threads() {
    let scene = room();
    for strategy in [Strategy::Uniform, Strategy::Sobel] {
        let strategy = Some(strategy);
        let with = |threads| {
            support::film(
                &scene,
                &settings(50, 37, 32.0, 11).running(|run| run.with_threads(threads)).with_strategy(strategy),
            )
        };
        let one = with(1);
        assert!(one.total_samples() > 0 && one == with(2) && one == with(7), "{strategy:?}");
    }
}

/// Training, samples, parts and a replay of the plan have the same bits on any number of threads.
#[test]
fn a_render_with_training_is_bit_identical_for_any_number_of_threads_and_in_parts() {
    let scene = room();
    let with = |threads, paths| {
        let s =
            settings(24, 20, 16.0, 4).running(|run| run.with_threads(threads)).with_strategy(Some(Strategy::Uniform));
        support::film(&scene, &s.running(|run| run.with_training_paths(paths)))
    };
    let one = with(1, 1024);
    assert!(one == with(3, 1024), "another number of threads");
    assert!(one != with(1, 0), "the training has an effect");
    let part = |samples| {
        let s = settings(24, 20, 16.0, 4).with_budget(Budget::default()).with_strategy(None);
        support::film(&scene, &s.running(|run| run.with_training_paths(1024)).running(|run| run.with_samples(samples)))
    };
    let (first, second) = (part(0..8), part(8..16));
    let mut whole = first;
    whole.merge(&second).expect("the same size");
    assert!(whole == one, "parts");
}

/// Scenes with a scattering medium track all solids around a path. The image is the same but for rounding, which now and
/// then sends a path elsewhere.
#[test]
fn a_hidden_medium_does_not_change_the_image() {
    let mean = |is_hidden_there: bool, seed: u64| {
        let mut b = objects();
        if is_hidden_there {
            let fog = Volume { scattering: Rgb::splat(10.0), ..Volume::default() };
            let surface = Surface::Solid(fog);
            b.add(
                "fog",
                sphere(Vec3::new(0.0, 0.0, -0.4), 0.1, 8, true),
                Material { transmission: 1.0.into(), surface, ..Material::default() },
            );
        }
        let scene = build(b);
        assert_eq!(scene.has_media(), is_hidden_there);
        let film = support::film(&scene, &settings(24, 18, 256.0, 3).with_seed(seed));
        let sums = film.sums();
        let pixels = sums.data();
        let n = pixels.len() as f64;
        let mean: f64 = pixels.iter().map(|p| p.mean()[1]).sum::<f64>() / n;
        let variance: f64 = pixels.iter().map(|p| p.variance_of_mean()[1]).sum::<f64>() / (n * n);
        (mean, variance)
    };
    let ((a, va), (b, vb)) = (mean(false, 1), mean(true, 2));
    // Independent seeds; 6.1 standard errors of the difference: one false alarm in 1e9.
    assert!((a - b).abs() < 6.1 * (va + vb).sqrt(), "{a} +- {} without media, {b} +- {} with", va.sqrt(), vb.sqrt());
    assert!((va + vb).sqrt() < 0.01 * a, "too noisy: {a} +- {}", (va + vb).sqrt());
}

#[test]
fn sample_sets_are_additive_to_the_last_bit() {
    let scene = room();
    let s = settings(24, 16, 1.0, 5);
    let camera = dunkelfeld::camera(&scene, &s).expect("there is one");
    let estimator =
        Estimator { scene: &scene, camera: &camera, width: s.width, seed: s.seed, frame: s.frame, roulette: None };
    let part = |range: std::ops::Range<u32>| {
        let mut sums = vec![PixelSums::default(); (s.width * s.height) as usize];
        for y in 0..s.height {
            for x in 0..s.width {
                for index in range.clone() {
                    let sample = estimator.sample(PixelSample { x, y, index });
                    sums[(y * s.width + x) as usize].add(index, &sample);
                }
            }
        }
        let mut film = Film::new(s.width, s.height);
        film.add_rows(0, &sums).expect("memory");
        film
    };
    let mut sum = part(64..128);
    sum.merge(&part(0..64)).expect("same size");
    let whole = part(0..128);
    assert!(sum == whole, "[0,64) + [64,128) differs from [0,128)");
    // And the renderer takes exactly these samples.
    let by_rounds = support::film(&scene, &s.with_budget(Budget::default().with_spp(128.0)));
    assert!(by_rounds == whole, "rounds differ from samples taken one by one");
}

#[test]
fn a_timed_render_replays_to_the_same_bits() {
    let scene = room();
    let timed =
        settings(64, 48, 1.0, 3).with_budget(Budget::default().with_seconds(0.6)).with_strategy(Strategy::Sobel);
    let run = |s: &RenderSettings| rendered(&scene, s);
    let first = run(&timed);
    let plan = first.plan();
    assert!(plan.data().iter().all(|&n| n > 0) && plan.data().iter().any(|&n| n != plan.data()[0]), "the plan adapts");
    let again = run(&timed.running(|run| run.with_replay(plan)).running(|run| run.with_threads(3)));
    assert!(first.film == again.film);
}

#[test]
fn invalid_samples_are_counted_and_named() {
    // A light beyond the range of f32 squared: the throughput overflows somewhere.
    let mut b = SceneBuilder::default();
    b.add("light", square(0.0, 1.0, false), Material { emission: Rgb::splat(f32::MAX).into(), ..emitter(1.0) });
    b.add_camera("camera", DVec3::Z, DVec3::ZERO, 0.5);
    let r = rendered(&build(b), &settings(8, 8, 4.0, 0));
    assert_eq!(r.film.sums.invalid_samples(), 8 * 8 * 4);
    assert!(!r.invalid.is_empty() && r.film.sums.mean().data().iter().all(|p| *p == [0.0; 3]));
}
