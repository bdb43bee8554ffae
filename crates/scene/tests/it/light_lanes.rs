//! Light samples of several receivers at once have the bits of single ones, for each kind of light and each choice. So do
//! radiance and density of light from infinitely far away, and of surfaces.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Ray, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{Sampler, mix64};
use dunkelfeld_scene::shapes::{rectangle, sphere};
use dunkelfeld_scene::{
    ColorEncoding, EmissionProfile, Environment, EnvironmentSource, Image, ImageId, LampShape, Leds, LightChoice,
    LightProfile, Material, PunctualKind, PunctualLight, Receivers, Scene, SceneBuilder, SurfacePoint, SurfacePoints,
    Texels, Texture,
};

fn emitter(radiance: f32) -> Material {
    Material { base_color: Rgb::BLACK, specular: 0.0, emission: Rgb::new(radiance, 0.5, 2.0), ..Material::default() }
}

fn panel(center: Vec3, u: Vec3, v: Vec3) -> Mesh {
    rectangle(center - 0.5 * (u + v), u, v)
}

/// Panels around the origin, of which some have a texture or two sides, and triangles.
fn panels(b: &mut SceneBuilder, count: u32, triangles: bool) {
    let image =
        Image { name: "halves".into(), width: 2, height: 1, texels: Texels::RgbF32(vec![[1.0; 3], [0.25; 3]]).into() };
    let texture = Texture::new(ImageId(b.images.len() as u32), ColorEncoding::Linear);
    b.images.push(image);
    let plain = b.add_material(emitter(1.0));
    let two_sided = b.add_material(Material { double_sided: true, ..emitter(3.0) });
    let varying = b.add_material(Material { emission_texture: Some(texture), ..emitter(2.0) });
    for k in 0..count {
        let turn = k as f32 * 2.4;
        let center = Vec3::new(turn.cos(), turn.sin(), 0.2 + 0.03 * k as f32);
        let along = Vec3::new(-turn.sin(), turn.cos(), 0.0);
        let size = 0.1 + 0.02 * (k % 7) as f32;
        let mut mesh = panel(center, along * -size, along.cross(center).normalize() * (2.5 * size));
        if triangles && k % 3 == 0 {
            mesh.triangles.truncate(1);
        }
        b.add_object(&format!("panel {k}"), mesh, [plain, two_sided, varying][k as usize % 3]);
    }
}

fn lamp(b: &mut SceneBuilder, columns: u32, profile: EmissionProfile) {
    let shape = LampShape::Ring { outer_diameter: 0.9, inner_diameter: 0.5, tilt: 0.4 };
    let leds = (columns > 0).then_some(Leds { columns, rows: 1, diameter: Some(0.01) });
    let m = b.add_material(Material { emission_profile: profile, ..emitter(2.0) });
    b.add_object("lamp", shape.meshes(leds).emitter, m);
    if let Some(mesh) = b.meshes.last_mut() {
        mesh.is_single_light = true;
    }
}

fn punctual(b: &mut SceneBuilder) {
    let vertical: Vec<f64> = (0..19).map(|i| f64::from(i) * 10.0).collect();
    for horizontal in [&[0.0][..], &[0.0, 90.0, 200.0, 360.0]] {
        let intensity = (0..19 * horizontal.len()).map(|i| 20.0 - (i % 19) as f32 + (i / 19 % 3) as f32).collect();
        b.profiles.push(LightProfile::new("p", &vertical, horizontal, intensity).expect("the angles ascend"));
    }
    let white = Rgb::new(1.0, 2.0, 3.0);
    for (i, kind) in [
        PunctualKind::Point { intensity: white },
        PunctualKind::Spot { intensity: white, inner: 0.3, outer: 0.9 },
        PunctualKind::Directional { irradiance: white },
        PunctualKind::Sun { irradiance: white, half_angle: 0.2 },
        PunctualKind::Profile { profile: 0, scale: white },
        PunctualKind::Profile { profile: 1, scale: white },
    ]
    .into_iter()
    .enumerate()
    {
        let to_world = DAffine3::from_translation(DVec3::new(0.1, 0.2 * i as f64, 1.0));
        b.lights.push(PunctualLight { name: format!("light {i}"), to_world, kind });
    }
}

fn sky(b: &mut SceneBuilder) {
    let texels = (0..32).map(|i| [0.2 + (i % 5) as f32 * 0.1, 0.3, if i == 11 { 9.0 } else { 0.1 }]).collect();
    let image = ImageId(b.images.len() as u32);
    b.images.push(Image { name: "sky".into(), width: 8, height: 4, texels: Texels::RgbF32(texels).into() });
    b.environment = Some(Environment { source: EnvironmentSource::Image { image, scale: Rgb::WHITE }, rotation: 0.9 });
}

struct Rays {
    receivers: [Receivers<f32>; MAX_WIDTH],
    u: [[f32; 3]; MAX_WIDTH],
    active: u32,
}

#[inline(always)]
fn sample<F: Lanes>(
    token: F::Token,
    scene: &Scene,
    rays: &Rays,
    choice: LightChoice,
    index: u32,
    out: &mut [Option<[f32; 22]>; MAX_WIDTH],
) {
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let (mut points, mut normals, mut both) = ([Vec3::ZERO; MAX_WIDTH], [Vec3::ZERO; MAX_WIDTH], 0);
        let mut u = [[0.0; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            let r = &rays.receivers[at + lane];
            (points[lane], normals[lane]) = (r.point.into(), r.normal.into());
            both |= u32::from(r.both_sides) << lane;
            for (row, x) in u.iter_mut().zip(rays.u[at + lane]) {
                row[lane] = x;
            }
        }
        let receivers = Receivers {
            point: V3::from_lanes(token, &points),
            normal: V3::from_lanes(token, &normals),
            both_sides: F::mask(token, both),
        };
        let [choose, x, y] = [F::load(token, &u[0]), F::load(token, &u[1]), F::load(token, &u[2])];
        let active = F::mask(token, rays.active >> at);
        let s = scene.sample_lights(token, &receivers, choice, index, choose, [x, y], active);
        let (d, p, n, pdf) = (s.direction.to_lanes(), s.point.to_lanes(), s.normal.to_lanes(), s.pdf.to_array());
        let (r, g, b) = (s.radiance.r.to_array(), s.radiance.g.to_array(), s.radiance.b.to_array());
        let (finite, delta) = (s.is_finite.bits(), s.is_delta.bits());
        let chosen = F::mask(token, if choice == LightChoice::One { u32::MAX } else { 0 });
        let mut sky_pdf = scene.environment_pdf(&receivers, chosen, s.direction);
        let mut sky = scene.environment_radiance(s.direction);
        for sun in scene.suns() {
            sky_pdf += scene.sun_pdf(&receivers, chosen, sun, s.direction);
            sky += scene.sun_radiance(sun, s.direction);
        }
        let (sky_pdf, sky) = (sky_pdf.to_array(), sky.to_lanes());
        let mut hits = [SurfacePoint::in_medium(&Ray::new(Vec3::ZERO, Vec3::Z), 0.0); MAX_WIDTH];
        let (mut is_hit, mut emitted, mut light_pdf) = ([false; MAX_WIDTH], [Rgb::BLACK; MAX_WIDTH], [0.0; MAX_WIDTH]);
        for lane in 0..F::WIDTH {
            if let Some(hit) = scene.intersect(&Ray::new(points[lane], d[lane])).filter(|_| pdf[lane] > 0.0) {
                (hits[lane], is_hit[lane]) = (hit, true);
            }
        }
        let points = SurfacePoints::from_lanes(token, &hits);
        for lane in (0..F::WIDTH).filter(|lane| is_hit[*lane]) {
            light_pdf[lane] = scene.light_pdf(&receivers, chosen, &points).to_array()[lane];
            emitted[lane] = scene.emitted_lanes(hits[lane].material(), &points, -s.direction).to_lanes()[lane];
        }
        for lane in 0..F::WIDTH {
            let is_finite = finite >> lane & 1 == 1;
            let (d, p, n) =
                (d[lane], if is_finite { p[lane] } else { Vec3::ZERO }, if is_finite { n[lane] } else { Vec3::ZERO });
            out[at + lane] = (pdf[lane] > 0.0).then_some([
                d.x,
                d.y,
                d.z,
                p.x,
                p.y,
                p.z,
                n.x,
                n.y,
                n.z,
                r[lane],
                g[lane],
                b[lane],
                pdf[lane],
                (delta >> lane & 1) as f32,
                sky_pdf[lane],
                sky[lane].r,
                sky[lane].g,
                sky[lane].b,
                light_pdf[lane],
                emitted[lane].r,
                emitted[lane].g,
                emitted[lane].b,
            ]);
        }
    }
}

fn check(name: &str, build: impl Fn(&mut SceneBuilder)) {
    let mut b = SceneBuilder::default();
    build(&mut b);
    let scene = b.build().expect("the scene is valid").0;
    let mut found_samples = 0;
    for round in 0..300u64 {
        let mut rays = Rays {
            receivers: [Receivers::single(Vec3::ZERO, Vec3::Z, false); MAX_WIDTH],
            u: [[0.0; 3]; MAX_WIDTH],
            active: mix64(round) as u32 | 0x11,
        };
        for lane in 0..MAX_WIDTH {
            let sampler = Sampler::new(round, 0, lane as u32, 0);
            let ([x, y, z, w], [a, b, c, d]) = (sampler.get_4d(0), sampler.get_4d(1));
            let at = DVec3::new(f64::from(x) - 0.5, f64::from(y) - 0.5, f64::from(z) * 0.4 - 0.1);
            let normal = Vec3::new(a - 0.5, b - 0.5, 1.5 * c - 0.4).normalize();
            let normal = if w < 0.2 { Vec3::ZERO } else { normal };
            let point = (at - scene.world_origin()).as_vec3();
            rays.receivers[lane] = Receivers::single(point, normal, w < 0.2 || d < 0.3);
            let [a, b, c, _] = sampler.get_4d(2);
            rays.u[lane] = [a, b, c];
        }
        let each = (0..scene.num_light_samples(LightChoice::Each)).map(|index| (LightChoice::Each, index));
        for (choice, index) in each.take(9).chain([(LightChoice::One, 0)]) {
            let mut expected = [None; MAX_WIDTH];
            sample::<f32>((), &scene, &rays, choice, index, &mut expected);
            assert!((0..MAX_WIDTH).all(|lane| rays.active >> lane & 1 == 1 || expected[lane].is_none()));
            found_samples += expected.iter().flatten().count();
            for set in InstructionSet::all() {
                let mut found = [None; MAX_WIDTH];
                dispatch!(set, F, token => sample::<F>(token, &scene, &rays, choice, index, &mut found));
                let bits = |s: [Option<[f32; 22]>; MAX_WIDTH]| s.map(|s| s.map(|s| s.map(f32::to_bits)));
                assert_eq!(bits(found), bits(expected), "{name}, {set:?}, {choice:?} {index}, round {round}");
            }
        }
    }
    assert!(found_samples > 500, "{name}: only {found_samples} samples");
}

#[test]
fn rectangles_and_triangles() {
    check("rectangles", |b| panels(b, 6, false));
    check("rectangles and triangles", |b| panels(b, 8, true));
    check("60 rectangles", |b| panels(b, 60, false));
    check("40 rectangles and triangles", |b| panels(b, 40, true));
}

#[test]
fn lamps() {
    check("ring", |b| lamp(b, 0, EmissionProfile::Lambertian));
    check("LEDs", |b| lamp(b, 24, EmissionProfile::CosinePower { exponent: 3.0 }));
    check("LEDs behind louvers", |b| lamp(b, 24, EmissionProfile::Louver { half_angle: 1.3 }));
    check("many LEDs", |b| lamp(b, 150, EmissionProfile::Spot { cos_inner: 0.9, cos_outer: 0.2 }));
}

#[test]
fn lights_without_a_surface() {
    check("punctual lights", punctual);
    check("sky", sky);
    check("constant sky", |b| {
        b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.5)), rotation: 0.0 });
    });
}

#[test]
fn mixtures() {
    let all = |b: &mut SceneBuilder| {
        panels(b, 20, true);
        lamp(b, 24, EmissionProfile::CosinePower { exponent: 8.0 });
        punctual(b);
        sky(b);
    };
    check("by weight", all);
    check("by a tree", |b| {
        all(b);
        let m = b.add_material(emitter(4.0));
        b.add_object("ball", sphere(Vec3::new(0.0, 1.1, 0.6), 0.5, 7, true), m);
    });
}
