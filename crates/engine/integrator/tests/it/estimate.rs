//! Estimates of single samples: the recorded path reproduces the sample, and pixel ids name the front surface.

use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Vec3};
use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelIds, PixelSample, pixel_ids, pixel_ids_of_row};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld_scene::{
    AlphaMode, Environment, EnvironmentSource, Material, PunctualKind, PunctualLight, RayGenerator, Scene,
    SceneBuilder, Specular, Surface, Volume,
};

const SIZE: u32 = 12;

/// A room with a floor, an absorbing glass ball, a veil, a box of metal, a panel, a dim sky.
fn room() -> (Scene, RayGenerator) {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material { base_color: Rgb::new(0.8, 0.5, 0.3).into(), ..Material::default() });
    b.add_object("floor", rectangle(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), floor);
    let volume = Volume { attenuation_color: Rgb::new(0.9, 0.5, 0.2), attenuation_distance: 0.2, ..Volume::default() };
    let surface = Surface::Solid(volume);
    let glass =
        b.add_material(Material { roughness: 0.0.into(), transmission: 1.0.into(), surface, ..Material::default() });
    b.add_object("ball", sphere(Vec3::new(0.2, 0.0, 0.3), 0.25, 12, true), glass);
    let metal = b.add_material(Material { metallic: 1.0.into(), roughness: 0.3.into(), ..Material::default() });
    b.add_object("box", cuboid(Vec3::new(-0.5, -0.2, 0.01), Vec3::new(-0.1, 0.2, 0.3)), metal);
    let veil = b.add_material(Material { alpha: 0.3.into(), alpha_mode: AlphaMode::Blend, ..Material::default() });
    b.add_object("veil", rectangle(Vec3::new(-2.0, -0.9, 0.0), Vec3::X * 4.0, Vec3::Z * 2.0), veil);
    let light = b.add_material(Material { emission: Rgb::splat(8.0).into(), ..Material::default() });
    b.add_object("light", rectangle(Vec3::new(-0.3, 0.3, 1.0), Vec3::X * 0.6, Vec3::NEG_Y * 0.6), light);
    b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.1)), rotation: 0.0 });
    b.add_camera("camera", DVec3::new(0.3, -1.5, 0.9), DVec3::new(0.0, 0.0, 0.15), 0.7);
    let scene = b.build().expect("valid").0;
    let camera = scene.ray_generator(&scene.cameras()[0], SIZE, SIZE).expect("a camera");
    (scene, camera)
}

#[test]
fn a_trace_sums_to_its_sample_and_its_throughputs_are_products() {
    let (scene, camera) = room();
    let learned = LearnedRoulette::train(&scene, &camera, [SIZE; 2], 768, |range, batch| range.map(batch).collect());
    let (mut longest, mut lit, mut splits) = (0, 0, 0);
    for k in 0..SIZE * SIZE {
        for (index, roulette) in (0..16).flat_map(|index| [(index, None), (index, learned.as_ref())]) {
            let estimator = Estimator { scene: &scene, camera: &camera, width: SIZE, seed: 4, frame: 2, roulette };
            let at = PixelSample { x: k % SIZE, y: k / SIZE, index };
            let (sample, trace) = estimator.trace(at);
            assert_eq!(sample, estimator.sample(at), "tracing {at:?} changes it");
            let sum = trace.vertices.iter().fold(Rgb::BLACK, |sum, v| sum + v.contribution());
            let (a, b) = (sum.to_array(), sample.radiance.to_array());
            assert!((0..3).all(|c| (a[c] - b[c]).abs() <= 1e-5 * b[c].max(1e-6)), "{at:?}: {a:?} is not {b:?}");
            // The throughput grows by the sampled weight over the survival probability, and decreases by absorption in
            // solids. No surface of this scene reflects more than it receives, except for radiance that refraction
            // compresses. Roulette raises the throughput at most to one.
            for vertex in trace.vertices.iter().filter(|_| roulette.is_none()) {
                assert!(vertex.throughput.max_channel() <= 1.5f32.powi(2) * 1.001, "{at:?}: {:?}", vertex.throughput);
            }
            // Every vertex before another has a sampled direction. The sky ends a path.
            for (number, vertex) in trace.vertices.iter().enumerate() {
                let after = trace.vertices.iter().filter(|v| v.before == Some(number)).count();
                assert_eq!(vertex.scattered.is_none(), after == 0, "{at:?}, vertex {number}");
                assert!(vertex.before.is_none_or(|before| before < number) && vertex.before.is_none() == (number == 0));
                assert!(vertex.material.is_some() || after == 0);
                assert!(after < 2 || roulette.is_some(), "{at:?}: nothing is split without training");
                splits += u32::from(after > 1);
            }
            longest = longest.max(trace.vertices.len());
            lit += u32::from(!sample.radiance.is_black());
        }
    }
    assert!(longest > 5 && lit > 2000, "the room shows something: {longest} vertices, {lit} lit samples");
    assert!(splits > 100, "{splits} paths are split");
}

/// First light on a floor beside a wall is all the light of the floor alone, which has no other surface to get light from.
#[test]
fn first_light_is_that_of_a_floor_without_a_wall() {
    let of = |has_wall| {
        let mut b = SceneBuilder::default();
        let white = b.add_material(Material { base_color: Rgb::splat(0.8).into(), ..Material::default() });
        b.add_object("floor", rectangle(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), white);
        if has_wall {
            b.add_object("wall", rectangle(Vec3::new(-1.0, 1.0, 0.0), Vec3::X * 2.0, Vec3::Z * 2.0), white);
        }
        let kind = PunctualKind::Directional { irradiance: Rgb::WHITE };
        b.lights.push(PunctualLight { name: "sun".into(), to_world: DAffine3::from_rotation_x(0.5), kind });
        b.add_camera("camera", DVec3::new(0.0, -0.5, 2.0), DVec3::new(0.0, 0.1, 0.0), 0.7);
        let scene = b.build().expect("valid").0;
        let camera = scene.ray_generator(&scene.cameras()[0], SIZE, SIZE).expect("a camera");
        let of_pixel = |k| {
            let at = PixelSample { x: k % SIZE, y: k / SIZE, index: 0 };
            let roulette = None;
            Estimator { scene: &scene, camera: &camera, width: SIZE, seed: 1, frame: 0, roulette }.sample(at)
        };
        (0..SIZE * SIZE).map(of_pixel).collect::<Vec<_>>()
    };
    let (alone, beside) = (of(false), of(true));
    let brighter = beside.iter().filter(|s| s.radiance.luminance() > 1.01 * s.first_light.luminance()).count();
    assert!(brighter > 20, "{brighter} samples have light of the wall");
    for (alone, beside) in alone.iter().zip(&beside) {
        assert_eq!((alone.first_light, alone.first_light), (alone.radiance, beside.first_light));
        assert!(alone.radiance.luminance() > 0.1);
    }
}

#[test]
fn pixel_ids_ignore_surfaces_that_cover_less_than_half() {
    // The veil stands between camera and room and covers 0.3 of it. No pixel has its ids.
    let (scene, camera) = room();
    let labels: Vec<Option<PixelIds>> =
        (0..SIZE * SIZE).map(|k| pixel_ids(&scene, &camera, k % SIZE, k / SIZE)).collect();
    for (y, expected) in (0..).zip(labels.chunks(SIZE as usize)) {
        let mut row = vec![None; SIZE as usize];
        pixel_ids_of_row(&scene, &camera, y, &mut row);
        assert_eq!(row, expected, "row {y}");
    }
    let count = |object| labels.iter().flatten().filter(|l| l.object() == object).count();
    let names = ["floor", "ball", "box", "veil", "light"];
    assert_eq!(scene.object_names(), names);
    assert!(count(0) > 20 && count(1) > 5 && count(2) > 5 && count(3) == 0, "{labels:?}");
    assert!(labels.iter().flatten().all(|l| l.object() == l.material()), "each object has its own material");
}

/// A plate that emits outward, with a body on it whose lower face is the upper one of the plate. Both are turned, so that
/// the distances of the faces round differently. With `is_covered`, an absorbing slab of index 1 is between them.
fn contact(alpha: Option<f32>, is_covered: bool) -> (Scene, RayGenerator) {
    let turn = DAffine3::from_quat(DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(0.4));
    let mut b = SceneBuilder::default();
    let add = |b: &mut SceneBuilder, name: &str, low: Vec3, high: Vec3, material: Material| {
        let material = b.add_material(material);
        b.add_object(name, cuboid(low, high), material);
        if let Some(object) = b.instances.last_mut() {
            object.to_world = turn;
        }
    };
    let emitter = Material {
        emission: Rgb::WHITE.into(),
        base_color: Rgb::BLACK.into(),
        specular: Specular::NONE,
        ..Material::default()
    };
    let ground = if is_covered { -0.07 } else { 0.0 };
    add(&mut b, "plate", Vec3::new(-1.0, -1.0, -0.2), Vec3::new(1.0, 1.0, ground), emitter);
    if is_covered {
        let volume = Volume { attenuation_color: Rgb::splat(0.5), attenuation_distance: 0.05, ..Volume::default() };
        let slab = Material {
            roughness: 0.0.into(),
            transmission: 1.0.into(),
            ior: 1.0,
            surface: Surface::Solid(volume),
            ..Material::default()
        };
        add(&mut b, "slab", Vec3::new(-0.9, -0.9, -0.05), Vec3::new(0.9, 0.9, 0.0), slab);
    }
    if let Some(alpha) = alpha {
        let body = Material {
            base_color: Rgb::BLACK.into(),
            alpha: alpha.into(),
            alpha_mode: AlphaMode::Blend,
            ..Material::default()
        };
        add(&mut b, "body", Vec3::new(-0.37, -0.41, 0.0), Vec3::new(0.33, 0.29, 0.3), body);
    }
    let (eye, at) = (DVec3::new(0.4, -1.1, 1.6), DVec3::new(0.0, 0.0, 0.0));
    b.add_camera("camera", turn.transform_point3(eye), turn.transform_point3(at), 0.35);
    let scene = b.build().expect("valid").0;
    let camera = scene.ray_generator(&scene.cameras()[0], 32, 32).expect("a camera");
    (scene, camera)
}

#[test]
fn an_absent_surface_in_contact_with_another_one_does_not_hide_it() {
    for is_covered in [false, true] {
        let [with, without] = [Some(0.0), None].map(|alpha| contact(alpha, is_covered));
        let of = |(scene, camera): &(Scene, RayGenerator), at| {
            Estimator { scene, camera, width: 32, seed: 3, frame: 0, roulette: None }.sample(at).radiance.g
        };
        for k in 0..32 * 32 {
            let (x, y) = (k % 32, k / 32);
            for index in 0..8 {
                let at = PixelSample { x, y, index };
                let (seen, expected) = (of(&with, at), of(&without, at));
                assert!(
                    expected > 0.1 && (seen / expected - 1.0).abs() < 1e-4,
                    "{is_covered} {at:?}: {seen}, {expected}"
                );
            }
            let ids = [&with, &without].map(|(scene, camera)| pixel_ids(scene, camera, x, y).map(|ids| ids.object()));
            assert_eq!(ids, [Some(0); 2], "{is_covered} {x} {y}");
        }
    }
}
