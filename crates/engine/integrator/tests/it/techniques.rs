//! Techniques can be left out. The light sampling changes, the expected image stays the same.
//!
//! Replay: `cargo test -p dunkelfeld-integrator --test it techniques::NAME`.

use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelSample, TrainingBatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::{cuboid, rectangle};
use dunkelfeld_scene::{
    Camera, Effect, LightChoice, Material, Projection, PunctualKind, PunctualLight, RayGenerator, Scene, SceneBuilder,
    Surface, Volume, digest, look_at,
};
use dunkelfeld_testkit::{SampleMoments, welch_test};
use std::cell::Cell;

/// False-alarm rate of one comparison; there are four.
const RATE: f64 = 1e-9;

/// A glossy floor, a metal box that casts a shadow on it, and lights of three kinds.
fn room(count: usize) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material { roughness: 0.4.into(), ..Material::default() });
    b.add_object("floor", rectangle(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), floor);
    let metal = b.add_material(Material { metallic: 1.0.into(), roughness: 0.3.into(), ..Material::default() });
    b.add_object("box", cuboid(Vec3::new(0.1, -0.1, 0.0), Vec3::new(0.3, 0.1, 0.3)), metal);
    for (i, radiance) in [9.0, 1.0, 4.0].into_iter().enumerate().take(count) {
        let light = b.add_material(Material { emission: Rgb::splat(radiance).into(), ..Material::default() });
        let x = 0.7 * i as f32 - 0.9;
        b.add_object("panel", rectangle(Vec3::new(x, 0.2, 0.8), Vec3::X * 0.4, Vec3::NEG_Y * 0.4), light);
    }
    if count > 3 {
        b.lights.push(PunctualLight {
            name: "lamp".into(),
            to_world: DAffine3::from_translation(DVec3::new(-0.4, -0.5, 0.6)),
            kind: PunctualKind::Point { intensity: Rgb::splat(0.5) },
        });
    }
    b.cameras.push(Camera {
        name: "spot".into(),
        to_world: look_at(DVec3::new(0.2, -1.0, 1.0), DVec3::ZERO, DVec3::Z),
        projection: Projection::Orthographic { half_width: 0.3, half_height: 0.3 },
        ..Camera::default()
    });
    b
}

fn built(b: SceneBuilder) -> Scene {
    b.build().expect("the scene is valid").0
}

/// Side of the film \[pixels\].
const SIDE: u32 = 160;

fn camera(scene: &Scene) -> RayGenerator {
    scene.ray_generator(&scene.cameras()[0], SIDE, SIDE).expect("a camera")
}

/// One sample of each pixel of a film over the whole view. The samples are independent. The means of the pixels differ,
/// which makes the standard error a little too large and the comparison more careful.
fn moments(scene: &Scene, seed: u64) -> SampleMoments {
    moments_with(scene, None, seed, 1)
}

/// [`moments`] of several frames.
fn moments_with(scene: &Scene, roulette: Option<&LearnedRoulette>, seed: u64, frames: u32) -> SampleMoments {
    let camera = camera(scene);
    let estimator = |frame| Estimator { scene, camera: &camera, width: SIDE, seed, frame, roulette };
    let pixels = SIDE * SIDE;
    (0..pixels * frames)
        .map(|k| {
            let (frame, k) = (k / pixels, k % pixels);
            f64::from(estimator(frame).sample(PixelSample { x: k % SIDE, y: k / SIDE, index: 0 }).radiance.g)
        })
        .collect()
}

#[test]
fn without_every_light_the_mean_is_equal_and_the_choice_differs() {
    for count in [2, 4] {
        let with = built(room(count));
        let mut left_out = room(count);
        assert!(left_out.leave_out(Effect::EveryLight), "it can be left out");
        let without = built(left_out);

        assert_eq!(with.effects().users(Effect::EveryLight), [format!("{count} lights")]);
        assert!(!without.effects().has(Effect::EveryLight));
        assert_eq!([0, 1, 2].map(|v| with.light_choice_at(v, false)), [LightChoice::Each; 3]);
        assert_eq!(
            [0, 1, 2].map(|v| with.light_choice_at(v, true)),
            [LightChoice::Each, LightChoice::Each, LightChoice::One]
        );
        assert_eq!([0, 1, 2].map(|v| without.light_choice_at(v, false)), [LightChoice::One; 3]);
        assert!(without.light_choice().contains("one sampled at each surface"), "{}", without.light_choice());

        let (each, one) = (moments(&with, 1), moments(&without, 2));
        welch_test(&each, &one).assert(RATE, &format!("{count} lights, all against one"));
        assert!(each.standard_error() < 0.02 * each.mean(), "too noisy: {each:?}");
        // One sample for each light against one for a chosen light: the noise is lower. Otherwise the switch had no
        // effect.
        assert!(
            each.variance() < 0.9 * one.variance(),
            "{count} lights: {} of all, {} of one",
            each.variance(),
            one.variance()
        );
    }
}

// --- Learned Russian roulette -------------------------------------------------------------------------------------------

/// Frames of a comparison: few paths on the dark floor carry much light.
const FRAMES: u32 = 6;

/// A dark floor and a metal box under panels, where most paths end early. With `cover`, a clear sheet lies above them.
fn dark_room(count: usize, cover: bool) -> Scene {
    let mut b = room(count);
    b.materials[0].base_color.factor = Rgb::splat(0.04);
    if cover {
        let clear = b.add_material(Material {
            roughness: 0.0.into(),
            transmission: 1.0.into(),
            ior: 1.49,
            surface: Surface::Solid(Volume::default()),
            ..Material::default()
        });
        b.add_object("cover", cuboid(Vec3::new(-0.9, -0.9, 0.4), Vec3::new(0.9, 0.9, 0.41)), clear);
    }
    built(b)
}

/// Trains with batches in the given order of their computation.
fn trained(scene: &Scene, reversed: bool) -> LearnedRoulette {
    LearnedRoulette::train(scene, &camera(scene), [SIDE, SIDE], 6 * 256, |batches, trace| {
        if reversed {
            let mut found: Vec<_> = batches.rev().map(trace).collect();
            found.reverse();
            found
        } else {
            batches.map(trace).collect()
        }
    })
    .expect("paths meet surfaces")
}

#[test]
fn the_learned_roulette_changes_the_noise_and_not_the_mean() {
    for (count, cover) in [(4, false), (3, true)] {
        let scene = dark_room(count, cover);
        let name = format!("{count} lights, cover {cover}");
        let trained = trained(&scene, false);
        let (by_throughput, learned) =
            (moments_with(&scene, None, 1, FRAMES), moments_with(&scene, Some(&trained), 2, FRAMES));
        welch_test(&by_throughput, &learned).assert(RATE, &name);
        assert!(learned.standard_error() < 0.02 * learned.mean(), "{name}: too noisy: {learned:?}");
        // The technique is in use.
        assert!(cover || trained.children() > 1, "{name}: no sample is split");
        let same_seed = moments_with(&scene, Some(&trained), 1, FRAMES);
        assert_ne!(same_seed, by_throughput, "{name}");
    }
}

#[test]
fn training_does_not_depend_on_the_order_of_its_batches_in_time() {
    let scene = dark_room(3, true);
    assert_eq!(digest(&trained(&scene, false)), digest(&trained(&scene, true)));
}

/// Paths in a dense medium without absorption are scattered hundreds of times. A batch of them ends early.
#[test]
fn training_in_a_dense_medium_ends_early() {
    let mut b = room(3);
    let medium = Volume { scattering: Rgb::splat(3000.0), ..Volume::default() };
    let milk = b.add_material(Material {
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        ior: 1.3,
        surface: Surface::Solid(medium),
        ..Material::default()
    });
    b.add_object("milk", cuboid(Vec3::new(-0.9, -0.9, 0.2), Vec3::new(0.9, 0.9, 0.6)), milk);
    let scene = built(b);
    let largest = Cell::new(0f32);
    LearnedRoulette::train(&scene, &camera(&scene), [SIDE, SIDE], 3 * 256, |batches, trace| {
        let found: Vec<_> = batches.map(trace).collect();
        largest.set(found.iter().map(TrainingBatch::cost).fold(largest.get(), f32::max));
        found
    });
    // The limit, and the paths that are followed together.
    assert!((32.0 * 256.0..32.0 * 256.0 + 20_000.0).contains(&largest.get()), "{largest:?}");
}
