//! Next-event estimation: the density that is used in the weights of scattering must be the density with which
//! directions toward lights are drawn, for every kind of light and every mixture of them.
//!
//! False-alarm rate of each statistical check: 1e-10. Replay: `cargo test -p dunkelfeld-scene --test it lights::NAME`.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::lamps::area;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld_scene::{
    AlphaMode, EmissionProfile, Environment, EnvironmentSource, LampShape, Leds, LightChoice, LightSamples, Material,
    PunctualKind, PunctualLight, Receivers, Scene, SceneBuilder, Specular,
};
use dunkelfeld_testkit::{DensityTest, SampleMoments, direction_to_square, square_to_direction, welch_test};
use std::f64::consts::PI;

const RATE: f64 = 1e-10;

const ONE: LightChoice = LightChoice::One;

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

/// A rectangle of two triangles around `center`; its front is on the side of `u x v`.
fn panel(center: Vec3, u: Vec3, v: Vec3) -> Mesh {
    rectangle(center - 0.5 * (u + v), u, v)
}

/// A receiver at a place in world space.
fn receiver(scene: &Scene, at: DVec3, normal: Vec3, both_sides: bool) -> Receivers<f32> {
    Receivers::single((at - scene.world_origin()).as_vec3(), normal, both_sides)
}

/// A sample of one light, if there is one.
fn sample_light(scene: &Scene, receiver: &Receivers<f32>, u_choice: f32, u: [f32; 2]) -> Option<LightSamples<f32>> {
    let sample = scene.sample_lights::<f32>((), receiver, ONE, 0, u_choice, u, true);
    (sample.pdf > 0.0).then_some(sample)
}

/// The density [1/sr] of direction `d` in light sampling. It is that of the nearest light, as in the weight of a
/// scattered ray, plus that of the environment, which is drawn also if it is occluded.
fn density(scene: &Scene, receiver: &Receivers<f32>, d: Vec3) -> f32 {
    let hit = scene.intersect(&Ray::new(receiver.point.into(), d)).filter(|p| !scene.emitted(p, -d).is_black());
    hit.map_or(0.0, |p| scene.light_pdf::<f32>(receiver, true, &(&p).into()))
        + scene.environment_pdf::<f32>(receiver, true, d.into())
}

/// The direction of one sample. Also checks that the weight of scattering uses the same density there.
fn draw(scene: &Scene, receiver: &Receivers<f32>, index: u32, agreed: &mut u32) -> Option<Vec3> {
    let [a, b, c, _] = Sampler::new(3, 0, 0, index).get_4d(1);
    // A point that emits nothing toward the receiver is no sample, as in `density`.
    let s = sample_light(scene, receiver, a, [b, c]).filter(|s| !s.radiance.is_black())?;
    assert!((s.direction.length() - 1.0).abs() < 1e-5 && s.pdf > 0.0 && s.pdf.is_finite() && !s.is_delta);
    let direction = s.direction.into();
    let found = if s.is_finite {
        // Directions toward an edge may miss the light by rounding.
        let hit = scene.intersect(&Ray::new(receiver.point.into(), direction));
        hit.map_or(0.0, |p| scene.light_pdf::<f32>(receiver, true, &(&p).into()))
    } else {
        scene.environment_pdf::<f32>(receiver, true, s.direction)
    };
    *agreed += u32::from((found / s.pdf - 1.0).abs() < 1e-3);
    Some(direction)
}

fn assert_agreement(name: &str, agreed: u32, drawn: u32) {
    let share = f64::from(agreed) / f64::from(drawn);
    assert!(
        drawn > 0 && share > 0.99,
        "{name}: only {share} of {drawn} samples have the density that scattering finds"
    );
}

/// Histogram of sampled directions against the density, cell by cell over the sphere; and sample by sample.
fn check(name: &str, scene: &Scene, receiver: &Receivers<f32>) {
    let (mut index, mut drawn, mut agreed) = (0, 0, 0);
    let sample = || {
        index += 1;
        let d = draw(scene, receiver, index, &mut agreed)?;
        drawn += 1;
        Some(direction_to_square(d.to_array()))
    };
    let to_density = |p| {
        let d = Vec3::from_array(square_to_direction(p).map(|v| v as f32)).normalize();
        4.0 * PI * f64::from(density(scene, receiver, d))
    };
    // Cubature over the edges of lights has an error of a few parts in ten thousand. More samples would detect it.
    DensityTest { columns: 24, rows: 16, samples: 10_000 }.run(name, sample, to_density).assert(RATE, name);
    assert_agreement(name, agreed, drawn);
}

/// The share of draws with a direction against the integral of the density, estimated by directions uniform over the
/// sphere; and sample by sample. For densities that are too discontinuous for cubature.
fn check_total(name: &str, scene: &Scene, receiver: &Receivers<f32>) {
    let (mut drawn, mut agreed) = (0, 0);
    let shares: SampleMoments = (0..40_000)
        .map(|i| {
            let found = draw(scene, receiver, i, &mut agreed).is_some();
            drawn += u32::from(found);
            f64::from(u8::from(found))
        })
        .collect();
    let integral: SampleMoments = (0..200_000)
        .map(|i| {
            let [x, y] = Sampler::new(4, 0, 0, i).get_2d(0).map(f64::from);
            let d = Vec3::from_array(square_to_direction([x, y]).map(|v| v as f32)).normalize();
            4.0 * PI * f64::from(density(scene, receiver, d))
        })
        .collect();
    welch_test(&shares, &integral).assert(RATE, name);
    assert_agreement(name, agreed, drawn);
}

#[test]
fn a_rectangle_and_a_triangle() {
    let near = panel(Vec3::new(0.1, 0.0, 0.5), Vec3::new(1.2, 0.0, 0.2), Vec3::new(0.0, -0.7, 0.0));
    let mut triangle = near.clone();
    triangle.triangles.truncate(1);
    for (name, mesh, double_sided) in
        [("rectangle", &near, false), ("triangle", &triangle, false), ("two-sided triangle", &triangle, true)]
    {
        let mut b = SceneBuilder::default();
        let m = b.add_material(Material { double_sided, ..emitter(2.0) });
        b.add_object("light", mesh.clone(), m);
        let scene = build(b);
        check(name, &scene, &receiver(&scene, DVec3::ZERO, Vec3::Z, false));
        if double_sided {
            check("from behind", &scene, &receiver(&scene, DVec3::new(0.2, 0.1, 1.3), Vec3::NEG_Z, false));
        } else {
            // Behind a one-sided light no direction is drawn, and the density is zero.
            let behind = receiver(&scene, DVec3::new(0.2, 0.1, 1.3), Vec3::NEG_Z, true);
            assert!(sample_light(&scene, &behind, 0.5, [0.5; 2]).is_none());
            assert_eq!(density(&scene, &behind, Vec3::NEG_Z), 0.0);
        }
    }
}

/// Three lights around the origin that do not occlude each other: two rectangles of one mesh, a box, a triangle below.
fn mixture() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let [dim, bright] = [1.0, 6.0].map(|l| b.add_material(emitter(l)));
    let mut pair = panel(Vec3::new(0.8, 0.0, 0.6), Vec3::Y * 0.8, Vec3::new(0.5, 0.0, -0.5));
    let second = panel(Vec3::new(-0.9, 0.3, 0.5), Vec3::Y * 0.9, Vec3::new(0.4, 0.0, 0.5));
    pair.positions.extend(&second.positions);
    pair.triangles.extend(second.triangles.iter().map(|t| t.map(|i| i + 4)));
    pair.uvs[0].clear();
    b.add_object("pair", pair, dim);
    // No face covers so little of a cell of the histogram that the cubature misses it.
    b.add_object("box", cuboid(Vec3::new(-0.1, -0.9, 0.1), Vec3::new(0.45, -0.6, 0.5)), bright);
    let mut triangle = panel(Vec3::new(0.2, 0.5, -0.7), Vec3::X, Vec3::Y);
    triangle.triangles.truncate(1);
    b.add_object("below", triangle, bright);
    b
}

#[test]
fn a_mixture_of_area_lights() {
    let scene = build(mixture());
    check("one side", &scene, &receiver(&scene, DVec3::ZERO, Vec3::Z, false));
    check("both sides", &scene, &receiver(&scene, DVec3::new(0.05, 0.1, -0.02), Vec3::Z, true));
}

#[test]
fn more_lights_than_are_weighted_one_by_one() {
    // A ball of 180 triangles, half of which face away from the receiver: those draws return no light.
    let mut b = mixture();
    b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.02)), rotation: 0.0 });
    let m = b.add_material(emitter(4.0));
    b.add_object("ball", sphere(Vec3::new(0.0, 1.1, 0.6), 0.5, 7, true), m);
    let scene = build(b);
    let lights: usize = scene.part_inventory().iter().map(|p| p.triangles).sum();
    assert!(lights > 100, "{lights} triangles");
    check_total("many", &scene, &receiver(&scene, DVec3::ZERO, Vec3::Z, false));
}

#[test]
fn instanced_lights_under_mirroring_and_uneven_scales() {
    // A panel of many triangles, used twice: too many to be copied.
    let n = 96;
    let mut panel = Mesh::default();
    for i in 0..=n {
        panel.positions.extend((0..=n).map(|j| Vec3::new(i as f32 / n as f32 - 0.5, j as f32 / n as f32 - 0.5, 0.0)));
    }
    for i in 0..n {
        for j in 0..n {
            let at = |a: u32, b: u32| (i + a) * (n + 1) + j + b;
            // Facing -z; the first halves of a column first, so that no two in a row form a rectangle.
            panel.triangles.push([at(0, 0), at(1, 1), at(1, 0)]);
        }
        panel.triangles.extend((0..n).map(|j| [i * (n + 1) + j, i * (n + 1) + j + 1, (i + 1) * (n + 1) + j + 1]));
    }
    let mut b = SceneBuilder::default();
    let m = b.add_material(emitter(1.0));
    b.add_object("panel", panel, m);
    b.instances[0].to_world =
        DAffine3::from_translation(DVec3::new(0.2, 0.1, 0.4)) * DAffine3::from_scale(DVec3::new(-1.5, 0.5, 1.0));
    let mut second = b.instances[0].clone();
    // Upright at the side: its front faces the middle.
    second.to_world = DAffine3::from_translation(DVec3::new(-1.2, 0.0, 0.3))
        * DAffine3::from_rotation_y(-std::f64::consts::FRAC_PI_2)
        * DAffine3::from_scale(DVec3::new(0.6, 2.0, 3.0));
    b.instances.push(second);
    let scene = build(b);
    assert_eq!(scene.summary().instanced_parts, 2, "the parts must stay instanced");
    check_total("instances", &scene, &receiver(&scene, DVec3::ZERO, Vec3::Z, false));
}

/// Lamps as single lights, alone and beside others, in front of the receiver, around it and behind it.
#[test]
fn lamps_and_suns() {
    let ring = LampShape::Ring { outer_diameter: 0.9, inner_diameter: 0.5, tilt: 0.4 };
    let leds = Leds { columns: 6, rows: 1, diameter: Some(0.2) };
    let dome = LampShape::Dome { diameter: 1.2, opening: 0.3 };
    for (name, shape, leds, profile) in [
        ("ring", ring, None, EmissionProfile::Lambertian),
        ("LEDs", ring, Some(leds), EmissionProfile::CosinePower { exponent: 3.0 }),
        ("LEDs with narrow lenses", ring, Some(leds), EmissionProfile::CosinePower { exponent: 8.0 }),
        ("LEDs behind louvers", ring, Some(leds), EmissionProfile::Louver { half_angle: 1.3 }),
        ("spots", ring, Some(leds), EmissionProfile::Spot { cos_inner: 0.9, cos_outer: 0.2 }),
        ("dome", dome, None, EmissionProfile::Lambertian),
        ("sphere", LampShape::Sphere { diameter: 0.3 }, None, EmissionProfile::Lambertian),
    ] {
        for (place, both_sides) in [(DVec3::new(0.1, 0.05, -0.3), false), (DVec3::new(0.5, 0.2, -0.1), true)] {
            for beside in [false, true] {
                let mut b = SceneBuilder::default();
                let m = b.add_material(Material { emission_profile: profile, ..emitter(2.0) });
                b.add_object("lamp", shape.meshes(leds).emitter, m);
                b.meshes[0].is_single_light = true;
                if beside {
                    let panel = panel(Vec3::new(0.0, 0.8, -0.6), Vec3::new(0.4, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.4));
                    b.add_object("panel", panel, m);
                }
                let scene = build(b);
                let r = receiver(&scene, place, Vec3::new(0.1, 0.2, 1.0).normalize(), both_sides);
                check_total(&format!("{name}, {both_sides}, {beside}"), &scene, &r);
            }
        }
    }
    let mut b = SceneBuilder::default();
    let m = b.add_material(emitter(1.0));
    b.add_object("panel", panel(Vec3::new(0.0, 0.8, 0.6), Vec3::X, Vec3::new(0.0, 0.0, 0.4)), m);
    for (i, half_angle) in [0.2f32, 0.5].into_iter().enumerate() {
        let kind = PunctualKind::Sun { irradiance: Rgb::splat(1.0), half_angle };
        let to_world = DAffine3::from_rotation_x(0.7 * i as f64);
        b.lights.push(PunctualLight { name: "sun".into(), to_world, kind });
    }
    let scene = build(b);
    let r = receiver(&scene, DVec3::ZERO, Vec3::Z, false);
    let (mut drawn, mut agreed) = (0, 0);
    for index in 0..4000 {
        let [a, b, c, _] = Sampler::new(3, 0, 0, index).get_4d(1);
        let Some(s) = sample_light(&scene, &r, a, [b, c]).filter(|s| !s.is_finite) else { continue };
        drawn += 1;
        // Of two suns with common directions, one of them has the density of the sample.
        let same = |sun| (scene.sun_pdf::<f32>(&r, true, sun, s.direction) / s.pdf - 1.0).abs() < 1e-4;
        agreed += u32::from(scene.suns().any(same));
    }
    assert_agreement("suns", agreed, drawn);
}

/// The LEDs of a ring with narrow lenses light the middle of their axes. Beside it most of them shine past the receiver,
/// and the light sample prefers the others: the relative variance of the irradiance is at most a fifth of that of a point
/// drawn uniformly over all LEDs. On the axis all LEDs are equal, and it stays below 1.
#[test]
fn a_sample_prefers_leds_that_shine_toward_the_receiver() {
    let ring = LampShape::Ring { outer_diameter: 0.12, inner_diameter: 0.1, tilt: 1.2 };
    let leds = Leds { columns: 72, rows: 1, diameter: None };
    let profile = EmissionProfile::from_half_intensity_angle(15f64.to_radians());
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material { emission_profile: profile, ..emitter(1.0) });
    b.add_object("lamp", ring.meshes(Some(leds)).emitter, m);
    b.meshes[0].is_single_light = true;
    let scene = build(b);
    for x in [0.0, 0.02, 0.04] {
        let r = receiver(&scene, DVec3::new(x, 0.0, -0.02), Vec3::Z, false);
        let (mut drawn, mut uniform) = (SampleMoments::default(), SampleMoments::default());
        for index in 0..20_000 {
            let [a, b, c, _] = Sampler::new(3, 0, 0, index).get_4d(1);
            let Some(s) = sample_light(&scene, &r, a, [b, c]) else {
                drawn.push(0.0);
                uniform.push(0.0);
                continue;
            };
            let irradiance = f64::from(s.radiance.g * s.direction.z);
            drawn.push(irradiance / f64::from(s.pdf));
            // The same points, weighted to be uniform over the area: the second moment of that estimator.
            assert!(s.is_finite, "a lamp has a surface");
            let to_light = s.point - r.point;
            let cosine = -to_light.normalize().dot(s.normal);
            let per_area = f64::from(cosine / to_light.length_squared());
            uniform.push((irradiance * per_area).powi(2) / (f64::from(s.pdf) * per_area));
        }
        let area = area(&ring.meshes(Some(leds)).emitter);
        let relative = |second_moment: f64| second_moment / drawn.mean().powi(2) - 1.0;
        let drawn_variance = drawn.variance() / drawn.mean().powi(2);
        let uniform_variance = relative(uniform.mean() * area);
        println!("at {x} m: relative variance {drawn_variance:.3}, of uniform points {uniform_variance:.3}");
        assert!(drawn_variance < 1.0 && (x == 0.0 || drawn_variance < 0.2 * uniform_variance), "at {x} m");
    }
}

/// A surface whose back is invisible lets rays from behind pass, and emits and occludes toward its front.
#[test]
fn an_invisible_back() {
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material { alpha_mode: AlphaMode::FrontOnly, ..emitter(2.0) });
    b.add_object("lamp", panel(Vec3::Z, Vec3::X, Vec3::Y), m);
    let floor = b.add_material(Material::default());
    b.add_object("floor", panel(Vec3::ZERO, Vec3::X, Vec3::Y), floor);
    let scene = build(b);
    let at = |z: f64| (DVec3::new(0.1, 0.1, z) - scene.world_origin()).as_vec3();
    // The front of the lamp is on the side of +z.
    for (from, direction, open, radiance) in [(0.5, Vec3::Z, 1.0, 0.0), (1.5, Vec3::NEG_Z, 0.0, 2.0)] {
        let ray = Ray::with_end(at(from), direction, 0.8);
        assert_eq!(scene.transmittance(&ray), open);
        let hit = scene.intersect(&ray).expect("the lamp");
        assert_eq!(scene.coverage(&hit, direction), 1.0 - open);
        assert_eq!(scene.emitted(&hit, -direction).g, radiance);
    }
}
