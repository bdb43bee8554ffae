//! Irradiance by light sampling against closed forms: rectangles and triangles from far to touching, points, spots and
//! measured profiles, with a sample of one light or of each, with a few lights or a thousand.
//!
//! False-alarm rate of each statistical check: 1e-10. Replay: `cargo test -p dunkelfeld-scene --test it irradiance::NAME`.

use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::lamps::irradiance_on_axis;
use dunkelfeld_scene::shapes::rectangle;
use dunkelfeld_scene::{
    EmissionProfile, Environment, EnvironmentSource, LampShape, Leds, LightChoice, LightProfile, Material,
    PunctualKind, PunctualLight, Receivers, Scene, SceneBuilder, Specular,
};
use dunkelfeld_testkit::{SampleMoments, welch_test, z_test};
use std::f64::consts::PI;

const RATE: f64 = 1e-10;

fn emitter(radiance: f32) -> Material {
    Material {
        base_color: Rgb::BLACK.into(),
        specular: Specular::NONE,
        emission: Rgb::splat(radiance).into(),
        ..Material::default()
    }
}

fn build(builder: SceneBuilder) -> Scene {
    builder.build().expect("the scene is valid").0
}

fn receiver(scene: &Scene, at: DVec3, normal: DVec3) -> Receivers<f32> {
    Receivers::single((at - scene.world_origin()).as_vec3(), normal.as_vec3(), false)
}

/// Irradiance [W/m^2] estimated by the light samples of one vertex, in the green channel.
fn estimate(scene: &Scene, r: &Receivers<f32>, choice: LightChoice, pixel: u32, index: u32) -> f64 {
    let sample = |question| {
        let [a, b, c, _] = Sampler::new(5, 0, pixel, index).get_4d(question);
        let s = scene.sample_lights::<f32>((), r, choice, question, c, [a, b], true);
        let is_some = s.pdf > 0.0;
        is_some.then(|| f64::from(s.radiance.g) / f64::from(s.pdf) * f64::from(s.direction.dot(r.normal).max(0.0)))
    };
    (0..scene.num_light_samples(choice)).filter_map(sample).sum()
}

/// Means over `count` samples each, in 16 independent runs.
fn runs(scene: &Scene, r: &Receivers<f32>, choice: LightChoice, count: u32) -> SampleMoments {
    let run = |pixel| (0..count).map(|i| estimate(scene, r, choice, pixel, i)).sum::<f64>() / f64::from(count);
    (0..16).map(run).collect()
}

/// The mean agrees with the expected one within its standard error and the rounding of single precision.
fn check(scene: &Scene, r: &Receivers<f32>, count: u32, expected: f64, what: &str) {
    let m = runs(scene, r, LightChoice::One, count);
    let error = m.standard_error().hypot(1e-6 * expected);
    z_test(m.mean(), error, expected).assert(RATE, &format!("{what}: {} instead of {expected}", m.mean()));
}

/// Irradiance under a uniform polygon of radiance 1 above the horizon, with its front to the receiver (Lambert 1760).
/// It is half of the sum over the edges of the angle that an edge subtends times the cosine between the normals of edge
/// plane and receiver.
fn lambert(corners: &[DVec3], at: DVec3, normal: DVec3) -> f64 {
    let edge = |i: usize| {
        let (a, b) = (corners[i] - at, corners[(i + 1) % corners.len()] - at);
        let across = a.cross(b);
        across.length().atan2(a.dot(b)) * across.normalize_or_zero().dot(normal)
    };
    0.5 * (0..corners.len()).map(edge).sum::<f64>().abs()
}

fn rectangle_light(center: DVec3, u: DVec3, v: DVec3) -> Scene {
    let mut b = SceneBuilder::default();
    let m = b.add_material(emitter(1.0));
    b.add_object("light", rectangle((center - 0.5 * (u + v)).as_vec3(), u.as_vec3(), v.as_vec3()), m);
    build(b)
}

/// A square over a receiver that faces it, at all sizes from 1 um to 1 km and all distances from a millionth to a
/// hundred of its sides, over its middle, its edge and beside it. Irradiance is independent of scale. The closed form
/// is that of the differential element under a parallel rectangle (Hottel 1931), a sum over the corners: `x / (2 sqrt(1
/// + x^2)) atan(y / sqrt(1 + x^2))` and the same with x and y exchanged, x and y in distances.
#[test]
fn squares_of_any_size_from_far_to_touching() {
    let corner = |x: f64, y: f64| {
        let part = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
        0.5 * (part(x, y) + part(y, x))
    };
    for scale in [1e-6, 1e-3, 1.0, 1e3] {
        let scene = rectangle_light(DVec3::ZERO, scale * DVec3::X, -scale * DVec3::Y);
        for height in [1e-6, 1e-3, 0.1, 1.0, 100.0] {
            for aside in [0.0, 0.3, 0.5, 0.8] {
                let at = scale * DVec3::new(aside, 0.1, -height);
                let [x, y] = [[-0.5 - aside, 0.5 - aside], [-0.6, 0.4]].map(|e| e.map(|e| e / height));
                let expected = corner(x[1], y[1]) - corner(x[0], y[1]) - corner(x[1], y[0]) + corner(x[0], y[0]);
                // Beside it and almost in its plane the corners cancel. The remainder is below their rounding error.
                if expected > 1e-9 {
                    let r = receiver(&scene, at, DVec3::Z);
                    check(&scene, &r, 1024, expected, &format!("scale {scale}, height {height}, aside {aside}"));
                }
            }
        }
    }
}

#[test]
fn triangles_by_their_contour() {
    let corners = [DVec3::new(-0.2, 0.1, 0.4), DVec3::new(0.9, -0.3, 0.7), DVec3::new(0.3, 0.8, 0.5)];
    let light = |scale: f64| {
        let mut b = SceneBuilder::default();
        let m = b.add_material(Material { double_sided: true, ..emitter(1.0) });
        let positions = corners.map(|c| (scale * c).as_vec3()).to_vec();
        b.add_object("light", Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() }, m);
        build(b)
    };
    for scale in [1e-6, 1.0, 1e3] {
        let scene = light(scale);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let near = middle - 1e-4 * normal;
        for (at, up) in [
            (DVec3::ZERO, DVec3::Z),
            (DVec3::new(0.5, 0.2, -3.0), DVec3::Z),
            (DVec3::new(0.3, 0.0, 0.3), DVec3::Z),
            // So near that its own plane is the horizon.
            (near, normal),
        ] {
            let expected = lambert(&corners, at, up);
            check(&scene, &receiver(&scene, scale * at, up), 4096, expected, &format!("scale {scale} from {at}"));
        }
    }
}

fn punctual(kind: PunctualKind, to_world: DAffine3, profiles: Vec<LightProfile>) -> Scene {
    let lights = vec![PunctualLight { name: "lamp".into(), to_world, kind }];
    build(SceneBuilder { lights, profiles, ..SceneBuilder::default() })
}

/// Points and spots obey the inverse square. A profile in the shape of a cosine gives I cos / d^2 in every direction,
/// also when it is turned. There is no noise.
#[test]
fn lights_without_extent_by_the_inverse_square() {
    let cosine: Vec<f64> = (0..=90).map(f64::from).collect();
    let lobe = cosine.iter().map(|t| 3.0 * t.to_radians().cos().max(0.0) as f32).collect();
    let profile = LightProfile::new("lobe", &cosine, &[0.0], lobe).expect("a profile");
    let position = DVec3::new(0.2, -0.3, 1.5);
    // Direction -z, then turned by 40 degrees.
    for turn in [0.0, 0.7] {
        let axis = DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), turn);
        let to_world = DAffine3::from_rotation_translation(axis, position);
        let forward = axis * DVec3::NEG_Z;
        let white = Rgb::splat(2.0);
        let scenes = [
            punctual(PunctualKind::Point { intensity: white }, to_world, vec![]),
            punctual(PunctualKind::Spot { intensity: white, inner: 0.2, outer: 0.9 }, to_world, vec![]),
            punctual(PunctualKind::Profile { profile: 0, scale: white }, to_world, vec![profile.clone()]),
        ];
        for at in [DVec3::new(0.2, -0.3, 0.0), DVec3::new(1.0, 0.4, 0.2), DVec3::new(-3.0, 1.0, -5.0)] {
            let to_light = position - at;
            let (d2, d) = (to_light.length_squared(), to_light.normalize());
            let cos = (-d).dot(forward);
            let (inner, outer) = (0.2f64.cos(), 0.9f64.cos());
            let ramp = ((cos - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
            for (scene, intensity) in scenes.iter().zip([2.0, 2.0 * ramp, 6.0 * cos.max(0.0)]) {
                let found = estimate(scene, &receiver(scene, at, DVec3::Z), LightChoice::One, 0, 0);
                let expected = intensity * d.z / d2;
                assert!(
                    (found - expected).abs() < 1e-4 * (expected + 0.01 * 2.0 * d.z / d2),
                    "{found} {expected} {at}"
                );
            }
        }
    }
    // 3 cos over the lower half space: 3 pi, doubled by the scale.
    let scene =
        punctual(PunctualKind::Profile { profile: 0, scale: Rgb::splat(2.0) }, DAffine3::IDENTITY, vec![profile]);
    let listed = &scene.light_inventory()[0];
    assert_eq!((listed.name.as_str(), listed.kind.as_str()), ("lamp", "profile lobe"));
    assert!((f64::from(listed.power.g) / (6.0 * PI) - 1.0).abs() < 1e-4);
}

/// A lit ceiling, a lit wall, a lamp, a sky.
fn four_lights() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let bright = b.add_material(emitter(5.0));
    let dim = b.add_material(emitter(1.0));
    b.add_object("ceiling", rectangle(Vec3::new(-0.5, 0.5, 1.0), Vec3::X, -Vec3::Y), bright);
    b.add_object("wall", rectangle(Vec3::new(1.5, -0.5, 0.0), Vec3::Z, Vec3::Y), dim);
    b.lights.push(PunctualLight {
        name: "lamp".into(),
        to_world: DAffine3::from_translation(DVec3::new(-0.4, 0.3, 0.8)),
        kind: PunctualKind::Point { intensity: Rgb::splat(0.8) },
    });
    b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.4)), rotation: 0.0 });
    b
}

#[test]
fn sampling_each_light_has_the_same_mean_and_less_noise() {
    let scene = build(four_lights());
    assert_eq!(
        [0, 1, 2].map(|v| scene.light_choice_at(v, true)),
        [LightChoice::Each, LightChoice::Each, LightChoice::One]
    );
    assert_eq!((scene.num_light_samples(LightChoice::Each), scene.num_light_samples(LightChoice::One)), (4, 1));
    for at in [DVec3::ZERO, DVec3::new(0.9, 0.3, 0.1)] {
        let r = receiver(&scene, at, DVec3::Z);
        let [each, one] = [LightChoice::Each, LightChoice::One].map(|choice| runs(&scene, &r, choice, 4096));
        welch_test(&each, &one).assert(RATE, "each against one");
        // Also at the same number of rays: four times the light samples for a fourth of the camera samples.
        let singles = |choice, count: u32| -> SampleMoments {
            (0..count).map(|i| estimate(&scene, &r, choice, 99 + i, 0)).collect()
        };
        let [each, one] =
            [(LightChoice::Each, 5000), (LightChoice::One, 20_000)].map(|(choice, n)| singles(choice, n).variance());
        assert!(4.0 * each < one, "variance {each} of all four, {one} of one");
    }
}

/// Fewer lights than a tree needs, weighed one by one, and more lights: the mean is the sum over all lights.
#[test]
fn sampling_one_of_many_lights_has_the_mean_of_all() {
    for count in [30u32, 1000] {
        let mut b = four_lights();
        let m = b.add_material(emitter(20.0));
        let mut mesh = Mesh::default();
        for i in 0..count {
            let [x, y, z, turn] = Sampler::new(1, 0, i, 0).get_4d(0);
            let at = Vec3::new(4.0 * x - 2.0, 4.0 * y - 2.0, 0.2 + 2.0 * z);
            let (sin, cos) = (6.3 * turn).sin_cos();
            let first = mesh.positions.len() as u32;
            let (u, v) = (Vec3::new(cos, sin, 0.0), Vec3::new(-sin * turn, cos * turn, 0.5 - x));
            mesh.positions.extend([at, at + 0.02 * u, at + 0.02 * v]);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        b.add_object("sparks", mesh, m);
        let scene = build(b);
        assert_eq!(scene.light_choice_at(0, false), LightChoice::One);
        assert_eq!(scene.light_choice().contains("tree of"), count > 64, "{}", scene.light_choice());
        for at in [DVec3::new(0.1, 0.0, 0.0), DVec3::new(1.0, -1.0, 1.0)] {
            let r = receiver(&scene, at, DVec3::Z);
            let each = runs(&scene, &r, LightChoice::Each, 24);
            let one = runs(&scene, &r, LightChoice::One, 4096);
            welch_test(&each, &one).assert(RATE, &format!("{count} lights from {at}"));
        }
    }
}

/// A lamp at the origin that shines along -z, with radiance 1 along the normal, as one light.
fn lamp(shape: LampShape, leds: Option<Leds>, profile: EmissionProfile) -> (Scene, Mesh) {
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material { emission_profile: profile, ..emitter(1.0) });
    let mesh = shape.meshes(leds).emitter;
    b.add_object("lamp", mesh.clone(), m);
    b.meshes[0].is_single_light = true;
    (build(b), mesh)
}

/// Lamps on their axis against the sum over their facets: round ones, and rings of LEDs with a lens, tilted and flat.
#[test]
fn lamps_on_their_axis() {
    let ring = |tilt| LampShape::Ring { outer_diameter: 0.1, inner_diameter: 0.06, tilt };
    let leds = Some(Leds { columns: 24, rows: 2, diameter: Some(0.004) });
    let lens = |degrees: f64| EmissionProfile::from_half_intensity_angle(degrees.to_radians());
    for (name, shape, leds, profile) in [
        ("disc", LampShape::Ellipse { width: 0.1, height: 0.1 }, None, EmissionProfile::Lambertian),
        ("dome", LampShape::Dome { diameter: 0.2, opening: 0.05 }, None, EmissionProfile::Lambertian),
        ("ring", ring(0.0), None, EmissionProfile::Lambertian),
        ("flat LEDs", ring(0.0), leds, lens(15.0)),
        ("tilted LEDs", ring(0.6), leds, lens(15.0)),
        ("steep LEDs", ring(1.2), leds, lens(30.0)),
    ] {
        let (scene, mesh) = lamp(shape, leds, profile);
        for height in [0.05, 0.2] {
            let expected = irradiance_on_axis(&mesh, &profile, height);
            let r = receiver(&scene, DVec3::new(0.0, 0.0, -height), DVec3::Z);
            check(&scene, &r, 8192, expected, &format!("{name}, height {height}"));
        }
    }
}
