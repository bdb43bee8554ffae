//! Samples of the wavefront: the same bits with all lanes, in all batches. Single samples in one lane are the reference.
//!
//! Replay: `cargo test -p dunkelfeld-integrator --test it wavefront::NAME`.

use dunkelfeld_film::Sample;
use dunkelfeld_geometry::{DAffine3, DVec3, RigidMotion, Vec2, Vec3};
use dunkelfeld_integrator::{ConnectionTally, Estimator, LearnedRoulette, PixelSample, Wavefront};
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::mix64;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld_scene::{
    AlphaMode, Anisotropy, Clearcoat, ColorEncoding, DiffuseTransmission, EmissionProfile, Environment,
    EnvironmentSource, Finish, Grain, HeightField, Image, ImageId, LampShape, Leds, LightProfile, Material, NormalMap,
    Parameter, Process, PunctualKind, PunctualLight, Scene, SceneBuilder, Sheen, Shutter, Surface, Texels, Texture,
    Volume,
};

const SIZE: u32 = 24;

/// Compares all samples of a scene. Returns the number of paths that samples are split into.
fn compare(b: SceneBuilder, what: &str) -> u32 {
    let scene: Scene = b.build().expect("the scene is valid").0;
    let camera = scene.ray_generator(&scene.cameras()[0], SIZE, SIZE).expect("a camera");
    let learned = LearnedRoulette::train(&scene, &camera, [SIZE; 2], 3000, |range, batch| range.map(batch).collect());
    let at: Vec<_> =
        (0..SIZE * SIZE * 6).map(|k| PixelSample { x: k / 6 % SIZE, y: k / 6 / SIZE, index: 3 * (k % 6) }).collect();
    for roulette in [None, learned.as_ref()] {
        let estimator = Estimator { scene: &scene, camera: &camera, width: SIZE, seed: 7, frame: 1, roulette };
        let (mut reference, mut one) = (Wavefront::new(&estimator, InstructionSet::Scalar), Vec::new());
        let mut expected_tally = ConnectionTally::default();
        let single = |at: &PixelSample| {
            reference.samples(&[*at], &mut expected_tally, &mut one);
            one[0]
        };
        let expected: Vec<_> = at.iter().map(single).collect();
        assert!(expected.iter().any(|s| !s.radiance.is_black()), "{what} is dark");
        for set in InstructionSet::all() {
            let mut wavefront = Wavefront::new(&estimator, set);
            let (mut found, mut tally) = (Vec::new(), ConnectionTally::default());
            wavefront.samples(&at, &mut tally, &mut found);
            assert_eq!(tally, expected_tally, "{what} with {set:?}");
            for ((at, found), expected) in at.iter().zip(&found).zip(&expected) {
                assert_eq!(found, expected, "{what}, {at:?}, {set:?}, learned: {}", roulette.is_some());
            }
            // Another order and other batches.
            let some: Vec<_> = at.iter().rev().step_by(5).copied().collect();
            let of_some: Vec<_> = expected.iter().rev().step_by(5).copied().collect();
            wavefront.samples(&some, &mut tally, &mut found);
            assert_eq!(found, of_some, "{what}, a part of the samples, {set:?}");
        }
        compare_groups(&estimator, &at, &expected, what);
    }
    learned.map_or(1, |learned| learned.children())
}

/// Compares the light of groups of lights in all lanes with that of single samples in one lane. The samples are those without
/// groups, and the groups add up to them.
fn compare_groups(estimator: &Estimator<'_>, at: &[PixelSample], expected: &[Sample], what: &str) {
    let mut names: Vec<String> = estimator.scene.light_inventory().into_iter().map(|light| light.name).collect();
    names.dedup();
    // The others are in the last group.
    let groups: Vec<_> = names.iter().step_by(2).map(std::slice::from_ref).collect();
    let groups = estimator.scene.light_groups(&groups).expect("names of lights");
    let wavefront = |set| Wavefront::new(estimator, set).with_light_groups(Some(&groups));
    let lists = || vec![Vec::new(); 1 + groups.len()];
    let (mut reference, mut one, mut singles) = (wavefront(InstructionSet::Scalar), lists(), lists());
    for at in at {
        reference.samples_by_group(&[*at], &mut ConnectionTally::default(), &mut one);
        singles.iter_mut().zip(&one).for_each(|(all, one)| all.extend(one));
    }
    assert_eq!(singles[0], expected, "{what} with groups");
    for (sample, whole) in expected.iter().enumerate() {
        for first in [false, true] {
            let light = |sample: &Sample| if first { sample.first_light } else { sample.radiance };
            let sum = singles[1..].iter().fold(Rgb::BLACK, |sum, group| sum + light(&group[sample]));
            let error = (sum + light(whole) * -1.0).to_array().map(f32::abs);
            let most = light(whole).max_channel() * 1e-5;
            assert!(error.iter().all(|e| *e <= most), "{what}, {:?}: {sum:?}, {whole:?}", at[sample]);
        }
    }
    let is_dark = |group: &Vec<Sample>| group.iter().all(|sample| sample.radiance.is_black());
    assert!(!singles.iter().any(is_dark), "{what}: a group is dark");
    for set in InstructionSet::all() {
        let mut found = lists();
        wavefront(set).samples_by_group(at, &mut ConnectionTally::default(), &mut found);
        assert_eq!(found, singles, "{what} with groups and {set:?}");
    }
}

/// A floor of plastic, a smooth ball and a box of metal under a panel.
fn station() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material {
        base_color: Rgb::new(0.8, 0.5, 0.3).into(),
        roughness: 0.4.into(),
        ..Material::default()
    });
    b.add_object("floor", rectangle(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), floor);
    let metal = b.add_material(Material {
        metallic: 1.0.into(),
        roughness: 0.3.into(),
        anisotropy: Anisotropy { strength: 0.5.into(), ..Anisotropy::default() },
        ..Material::default()
    });
    b.add_object("box", cuboid(Vec3::new(-0.5, -0.2, 0.01), Vec3::new(-0.1, 0.2, 0.3)), metal);
    let coated = b.add_material(Material {
        clearcoat: Clearcoat { strength: 1.0.into(), ..Clearcoat::default() },
        sheen: Sheen { color: Rgb::splat(0.5).into(), ..Sheen::default() },
        ..Material::default()
    });
    b.add_object("ball", sphere(Vec3::new(0.3, 0.1, 0.3), 0.25, 8, true), coated);
    panel(&mut b, -0.3, 8.0);
    b.add_camera("camera", DVec3::new(0.3, -1.5, 0.9), DVec3::new(0.0, 0.0, 0.15), 0.7);
    b
}

fn panel(b: &mut SceneBuilder, x: f32, radiance: f32) {
    let light = b.add_material(Material { emission: Rgb::splat(radiance).into(), ..Material::default() });
    b.add_object(&format!("light at {x}"), rectangle(Vec3::new(x, 0.3, 1.0), Vec3::X * 0.6, Vec3::NEG_Y * 0.2), light);
}

fn sky(b: &mut SceneBuilder) {
    b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.1)), rotation: 0.0 });
}

#[test]
fn opaque_surfaces() {
    let children = compare(station(), "one light");
    assert!(children > 1, "samples of plain surfaces are split");
    let mut b = station();
    for k in 0..5 {
        panel(&mut b, -2.0 + 0.7 * k as f32, 3.0);
    }
    compare(b, "six lights");
}

#[test]
fn lights_of_all_kinds() {
    let mut b = station();
    sky(&mut b);
    for kind in [
        PunctualKind::Point { intensity: Rgb::splat(0.5) },
        PunctualKind::Spot { intensity: Rgb::splat(0.5), inner: 0.2, outer: 0.6 },
        PunctualKind::Sun { irradiance: Rgb::splat(0.5), half_angle: 0.05 },
        PunctualKind::Directional { irradiance: Rgb::splat(0.5) },
    ] {
        let to_world = DAffine3::from_translation(DVec3::new(-0.4, -0.5, 0.6));
        b.lights.push(PunctualLight { name: format!("{kind:?}"), to_world, kind });
    }
    let mut under_an_image = b.clone();
    compare(b, "lights of all kinds");
    let texels = (0..32).map(|i| [0.1 * (i % 7) as f32; 3]).collect();
    under_an_image.images.push(Image {
        name: "sky".into(),
        width: 8,
        height: 4,
        texels: Texels::RgbF32(texels).into(),
    });
    let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
    under_an_image.environment = Some(Environment { source, rotation: 0.4 });
    under_an_image.lights.truncate(1);
    compare(under_an_image, "a point and an image");
}

#[test]
fn a_choice_among_many_lights() {
    let mut b = station();
    for k in 0..12 {
        panel(&mut b, -2.0 + 0.3 * k as f32, 1.0 + k as f32);
    }
    compare(b, "thirteen lights");
}

#[test]
fn glass_and_veils() {
    let mut b = station();
    sky(&mut b);
    let volume = Volume { attenuation_color: Rgb::new(0.9, 0.5, 0.2), attenuation_distance: 0.2, ..Volume::default() };
    for (x, roughness) in [(0.0, 0.0), (0.6, 0.3)] {
        let surface = Surface::Solid(volume);
        let glass = b.add_material(Material {
            roughness: roughness.into(),
            transmission: 1.0.into(),
            surface,
            ..Material::default()
        });
        b.add_object("glass", sphere(Vec3::new(x, -0.3, 0.2), 0.15, 8, true), glass);
    }
    let sheet = b.add_material(Material { transmission: 0.6.into(), roughness: 0.0.into(), ..Material::default() });
    b.add_object("sheet", rectangle(Vec3::new(-0.9, -0.8, 0.0), Vec3::X * 0.7, Vec3::Z * 0.5), sheet);
    let paper = b.add_material(Material {
        diffuse_transmission: DiffuseTransmission { share: 0.5.into(), ..DiffuseTransmission::default() },
        ..Material::default()
    });
    b.add_object("paper", rectangle(Vec3::new(-0.9, 0.5, 0.0), Vec3::X * 0.7, Vec3::Z * 0.7), paper);
    compare(b.clone(), "glass");
    let veil = b.add_material(Material { alpha: 0.3.into(), alpha_mode: AlphaMode::Blend, ..Material::default() });
    b.add_object("veil", rectangle(Vec3::new(-2.0, -0.9, 0.0), Vec3::X * 4.0, Vec3::Z * 2.0), veil);
    compare(b, "a veil");
}

#[test]
fn media_and_nested_solids() {
    let mut b = station();
    sky(&mut b);
    let milk = Volume {
        scattering: Rgb::new(20.0, 30.0, 40.0),
        absorption: Rgb::new(1.0, 0.5, 2.0),
        scattering_anisotropy: 0.6,
        ..Volume::default()
    };
    let (outer, inner) = (Surface::Solid(milk), Surface::Solid(Volume { scattering_anisotropy: -0.3, ..milk }));
    let wax = b.add_material(Material {
        roughness: 0.2.into(),
        transmission: 1.0.into(),
        surface: outer,
        ..Material::default()
    });
    b.add_object("wax", sphere(Vec3::new(0.0, -0.3, 0.25), 0.22, 8, true), wax);
    let core = b.add_material(Material { ior: 1.3, transmission: 1.0.into(), surface: inner, ..Material::default() });
    b.add_object("core", cuboid(Vec3::new(-0.1, -0.4, 0.2), Vec3::new(0.1, -0.2, 0.3)), core);
    compare(b.clone(), "media");
    for k in 0..12 {
        panel(&mut b, -2.0 + 0.3 * k as f32, 1.0 + k as f32);
    }
    compare(b, "media and many lights");
}

#[test]
fn light_through_a_cover() {
    let mut b = station();
    let surface = Surface::Solid(Volume::default());
    let glass =
        b.add_material(Material { roughness: 0.0.into(), transmission: 1.0.into(), surface, ..Material::default() });
    b.add_object("plate", cuboid(Vec3::new(-0.9, -0.9, 0.6), Vec3::new(0.9, 0.9, 0.65)), glass);
    compare(b, "a cover");
}

/// Lamps that are one light each, and points with a measured profile.
#[test]
fn lamps_and_light_profiles() {
    let mut b = station();
    for (columns, emission_profile, z) in [
        (0, EmissionProfile::Lambertian, 1.2),
        (24, EmissionProfile::CosinePower { exponent: 3.0 }, 1.3),
        (150, EmissionProfile::Louver { half_angle: 1.3 }, 1.4),
    ] {
        let leds = (columns > 0).then_some(Leds { columns, rows: 1, diameter: Some(0.01) });
        let m = b.add_material(Material { emission: Rgb::splat(2.0).into(), emission_profile, ..Material::default() });
        let shape = LampShape::Ring { outer_diameter: 0.9, inner_diameter: 0.5, tilt: 0.4 };
        let lamp = b.add_object("lamp", shape.meshes(leds).emitter, m);
        b.instances[lamp].to_world = DAffine3::from_translation(DVec3::Z * z);
        b.meshes[lamp].is_single_light = true;
    }
    let vertical: Vec<f64> = (0..19).map(|i| f64::from(i) * 10.0).collect();
    for (profile, horizontal) in [&[0.0][..], &[0.0, 90.0, 200.0, 360.0]].into_iter().enumerate() {
        let intensity = (0..19 * horizontal.len()).map(|i| 20.0 - (i % 19) as f32 + (i / 19 % 3) as f32).collect();
        b.profiles.push(LightProfile::new("p", &vertical, horizontal, intensity).expect("the angles ascend"));
        let kind = PunctualKind::Profile { profile, scale: Rgb::splat(0.02) };
        let to_world = DAffine3::from_translation(DVec3::new(0.4, -0.5, 0.6));
        b.lights.push(PunctualLight { name: "point".into(), to_world, kind });
    }
    compare(b, "lamps and profiles");
}

/// Textures of several kinds on balls at rest, and on balls that move and turn.
#[test]
fn textured_and_moving_surfaces() {
    let mut b = station();
    let texels = (0..64).map(|i| [0, 1, 2, 3].map(|channel| (mix64(4 * i + channel) >> 48) as u16)).collect();
    b.images.push(Image { name: "noise".into(), width: 8, height: 8, texels: Texels::Rgba16(texels).into() });
    let texture = Texture::new(ImageId(0), ColorEncoding::Linear);
    let by_channel = Some(Texture { channel: 1, ..texture });
    let finish = |process| HeightField::Finish(Finish { process, mean_deviation: 2e-4, seed: 1 });
    let turned = Process::Turned { feed: 0.01, axis: Vec3::Z, origin: Vec3::ZERO };
    let anisotropy = Anisotropy { strength: 0.5.into(), ..Anisotropy::default() };
    let ringed = Anisotropy { grain: Some(Grain::Around { axis: Vec3::Y, origin: Vec3::X }), ..anisotropy };
    let balls = [
        Material { base_color: Parameter { factor: Rgb::WHITE, texture: Some(texture) }, ..Material::default() },
        Material { normal_map: NormalMap { texture: Some(texture), scale: 1.3 }, ..Material::default() },
        Material {
            anisotropy: Anisotropy {
                strength: Parameter { factor: 0.5, texture: Some(Texture { channel: 2, ..texture }) },
                ..Anisotropy::default()
            },
            ..Material::default()
        },
        Material { transmission: Parameter { factor: 0.6, texture: by_channel }, ..Material::default() },
        Material { height: Some(finish(Process::Grained { size: 0.01 })), ..Material::default() },
        Material { height: Some(finish(turned)), anisotropy, metallic: 1.0.into(), ..Material::default() },
        Material { anisotropy: ringed, ..Material::default() },
    ];
    for (k, material) in balls.into_iter().enumerate() {
        let m = b.add_material(material);
        let mut mesh = sphere(Vec3::ZERO, 0.15, 9, true);
        mesh.uvs[0] = mesh.positions.iter().map(|p| Vec2::new(3.0 * p.x + p.z, 4.0 * p.y)).collect();
        mesh.colors = mesh.positions.iter().map(|p| (Vec3::splat(0.5) + *p).extend(1.0)).collect();
        let ball = b.add_object("ball", mesh, m);
        b.instances[ball].to_world = DAffine3::from_translation(DVec3::new(0.3 * k as f64 - 0.5, -0.5, 0.2));
    }
    compare(b.clone(), "textures");
    b.shutter = Some(Shutter::Frame { exposure: 0.5 });
    for instance in b.instances.iter_mut().rev().take(7) {
        let spin = RigidMotion::rotation(DVec3::Z, instance.to_world.translation, 0.5).expect("an axis");
        instance.motion = RigidMotion { velocity: DVec3::new(0.1, 0.0, 0.05), ..spin };
    }
    compare(b, "balls that move");
}
