//! Finishes of machined surfaces, and height images: they reflect as their geometry does. Replay: `cargo test -p dunkelfeld --test it finish::NAME`.

use crate::support::{RATE, build, emitter, film, settings, spot_camera};
use dunkelfeld::geometry::{DAffine3, DVec3, Mesh, Vec2, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{
    Anisotropy, Camera, ColorEncoding, Environment, EnvironmentSource, Finish, Grain, HeightField, HeightImage, Image,
    ImageId, Material, Process, Projection, Scene, SceneBuilder, Texels, Texture, TextureTransform, look_at,
    shapes::rectangle,
};
use dunkelfeld_testkit::z_test;
use std::f32::consts::{PI, TAU};

/// Feed of the cusps \[m\].
const FEED: f32 = 0.01;
/// Size of the film \[pixels\].
const FILM: [u32; 2] = [96, 96];
/// Slope at the edge of a cusp.
const STEEPEST: f32 = 0.12;
/// Mean deviation of a cusp over its height.
const DEVIATION: f32 = 0.256_600_1;

fn metal(height: Option<HeightField>) -> Material {
    Material {
        base_color: Rgb::splat(0.9).into(),
        metallic: 1.0.into(),
        roughness: 0.2.into(),
        height,
        ..Material::default()
    }
}

/// Cusps along x with a feed \[m\].
fn turned(feed: f32) -> HeightField {
    let process = Process::Turned { feed, axis: Vec3::X, origin: Vec3::ZERO };
    HeightField::Finish(Finish { process, mean_deviation: DEVIATION * 0.25 * STEEPEST * feed, seed: 1 })
}

/// A period of waves along x as an image, whose width is that of a feed: as steep as the cusps where they are steepest.
fn waves(size: Option<f32>, transform: TextureTransform) -> HeightField {
    let texture = Texture { transform, ..Texture::new(ImageId(0), ColorEncoding::Linear) };
    HeightField::Image(HeightImage { texture: Some(texture), depth: STEEPEST * FEED / PI, size })
}

fn wave_image() -> Image {
    let texel = |i: u32| [((0.5 - 0.5 * ((i as f32 + 0.5) / 64.0 * TAU).cos()) * 65535.0).round() as u16];
    let texels = Texels::Gray16((0..128).map(|i| texel(i % 64)).collect());
    Image { name: "waves".into(), width: 64, height: 2, texels: texels.into() }
}

/// Height of a cusp over its feed, at shares of it: lowest in the middle.
fn cusp(share: f32) -> f32 {
    STEEPEST * (share - 0.5).powi(2)
}

/// Height of a wave over its length.
fn wave(share: f32) -> f32 {
    -0.5 * STEEPEST / PI * (share * TAU).cos()
}

/// A plate of 0.8 m with a profile of triangles along x.
fn ridges(height: fn(f32) -> f32) -> Mesh {
    const SEGMENTS: usize = 24;
    let (n, mut mesh) = (80 * SEGMENTS, Mesh::default());
    for k in 0..=n {
        let x = FEED * (k as f32 / SEGMENTS as f32 - 40.0);
        let z = FEED * height((k % SEGMENTS) as f32 / SEGMENTS as f32);
        mesh.positions.extend([Vec3::new(x, -0.4, z), Vec3::new(x, 0.4, z)]);
    }
    for k in 0..n as u32 {
        mesh.triangles.extend([[2 * k, 2 * k + 2, 2 * k + 1], [2 * k + 2, 2 * k + 3, 2 * k + 1]]);
    }
    mesh
}

/// A plate under a lamp at an angle \[degrees\] from above. The film shows so much of its x \[m\], from 20 degrees on the other side.
fn scene(mesh: Mesh, material: Material, angle: f32, seen: f32) -> Scene {
    let mut b = SceneBuilder { images: vec![wave_image()], ..SceneBuilder::default() };
    let m = b.add_material(material);
    b.add_object("plate", mesh, m);
    let lamp = b.add_material(emitter(10.0));
    let (sin, cos) = angle.to_radians().sin_cos();
    let (across, center) = (Vec3::new(cos, 0.0, sin), Vec3::new(-sin, 0.0, cos));
    b.add_object("lamp", rectangle(center - 0.1 * across - Vec3::Y * 0.3, Vec3::Y * 0.6, across * 0.2), lamp);
    let eye = DVec3::new(20f64.to_radians().sin(), 0.0, 20f64.to_radians().cos());
    let half_width = 0.5 * seen * 20f32.to_radians().cos();
    b.cameras.push(Camera {
        to_world: look_at(2.0 * eye, DVec3::ZERO, DVec3::Y),
        projection: Projection::Orthographic { half_width, half_height: 1e-3 * half_width },
        ..Camera::default()
    });
    build(b)
}

fn plate() -> Mesh {
    rectangle(Vec3::new(-0.4, -0.4, 0.0), Vec3::X * 0.8, Vec3::Y * 0.8)
}

/// Mean radiance with its standard error.
fn mean(scene: &Scene, [width, height]: [u32; 2], seed: u64) -> [f64; 2] {
    let film = film(scene, &settings(width, height, 256.0, seed));
    let (mut sum, mut variance) = (0.0, 0.0);
    for p in film.sums().data() {
        sum += p.mean()[1];
        variance += p.variance_of_mean()[1];
    }
    let n = film.sums().data().len() as f64;
    [sum / n, variance.sqrt() / n]
}

/// Equal within half a percent.
fn assert_same(a: [f64; 2], b: [f64; 2], what: &str) {
    let error = a[1].hypot(b[1]);
    assert!(error < 3e-3 * b[0], "{what}: too noisy, {a:?} and {b:?}");
    let off = (a[0] - b[0]).abs() - 0.005 * b[0];
    z_test(off.max(0.0), error, 0.0).assert(RATE, what);
}

/// In the light of a lamp that the plane mirrors, beside it, and in a dark field that sees the tail of the lobe alone: the finish
/// has the radiance of its geometry, which differs from that of a plane.
#[test]
fn a_finish_reflects_as_its_geometry() {
    for angle in [20.0, 35.0, 55.0] {
        let finish = mean(&scene(plate(), metal(Some(turned(FEED))), angle, 0.4), FILM, 1);
        let geometry = mean(&scene(ridges(cusp), metal(None), angle, 0.4), FILM, 2);
        assert_same(finish, geometry, &format!("lamp at {angle} degrees"));
        let plane = mean(&scene(plate(), metal(None), angle, 0.4), FILM, 3);
        assert!((plane[0] / finish[0] - 1.0).abs() > 0.03, "{angle}: {plane:?}");
    }
}

/// A height image has the radiance of its geometry, by the object's axes in metres, and by texture coordinates with a transform.
#[test]
fn an_image_reflects_as_its_geometry() {
    let mut by_uv = plate();
    by_uv.uvs[0] = by_uv.positions.iter().map(|p| Vec2::new(p.y, p.x + 0.4)).collect();
    let transform = TextureTransform {
        scale: Vec2::splat(1.0 / FEED),
        rotation: std::f32::consts::FRAC_PI_2,
        ..TextureTransform::default()
    };
    let by_size = waves(Some(FEED), TextureTransform::default());
    for angle in [20.0, 35.0, 55.0] {
        let geometry = mean(&scene(ridges(wave), metal(None), angle, 0.4), FILM, 2);
        for (mesh, height, what) in [(plate(), by_size, "size"), (by_uv.clone(), waves(None, transform), "uv")] {
            let image = mean(&scene(mesh, metal(Some(height)), angle, 0.4), FILM, 1);
            assert_same(image, geometry, &format!("by {what}, lamp at {angle} degrees"));
        }
        let plane = mean(&scene(plate(), metal(None), angle, 0.4), FILM, 3);
        assert!((plane[0] / geometry[0] - 1.0).abs() > 0.03, "{angle}: {plane:?}");
    }
}

/// The mean does not depend on the distance: from a hundred pixels for a mark to a hundredth of a pixel.
#[test]
fn the_mean_is_the_same_at_every_distance() {
    const WIDE: [u32; 2] = [1000, 8];
    for angle in [20.0, 55.0] {
        let near = mean(&scene(plate(), metal(Some(turned(0.002))), angle, 0.02), WIDE, 4);
        for feed in [2e-4, 2e-5, 2e-7] {
            let far = mean(&scene(plate(), metal(Some(turned(feed))), angle, 0.02), WIDE, 5);
            assert_same(far, near, &format!("lamp at {angle} degrees, feed {feed} m"));
        }
    }
}

/// A white surface under uniform light reflects all of it, whatever its heights, and no more at grazing views.
#[test]
fn no_light_is_lost_or_made() {
    let processes = [
        Process::Milled { feed: 0.002, radius: 0.1, direction: Vec3::X },
        Process::Grooved { width: 0.002, length: 0.05, direction: Vec3::Y },
        Process::Grained { size: 0.002 },
    ];
    let finish = |process| HeightField::Finish(Finish { process, mean_deviation: 2e-5, seed: 3 });
    for height in processes.map(finish).into_iter().chain([waves(Some(FEED), TextureTransform::default())]) {
        let render = |height: HeightField, degrees: f64| {
            let (energy_compensation, images) = (true, vec![wave_image()]);
            let mut b = SceneBuilder { energy_compensation, images, ..SceneBuilder::default() };
            let base_color = Rgb::WHITE.into();
            let m = Material {
                base_color,
                metallic: 1.0.into(),
                roughness: 0.1.into(),
                height: Some(height),
                ..Material::default()
            };
            let m = b.add_material(m);
            b.add_object("plate", plate(), m);
            let source = EnvironmentSource::Constant(Rgb::WHITE);
            b.environment = Some(Environment { source, rotation: 0.0 });
            let (sin, cos) = degrees.to_radians().sin_cos();
            spot_camera(&mut b, DVec3::new(0.8 * sin, 0.6 * sin, cos), DVec3::ZERO, 1e-3 + 0.2 * cos as f32);
            mean(&build(b), [48, 48], 7)
        };
        for degrees in [30.0, 60.0, 80.0, 88.0] {
            let [found, error] = render(height, degrees);
            let most = if degrees > 60.0 { 0.02 } else { 0.005 };
            assert!((found - 1.0).abs() < most + 6.0 * error, "{height:?}, {degrees} degrees: {found}");
        }
    }
}

/// Lengths are those of the world: an object that its scale stretches has the marks of one that is made in its size.
#[test]
fn a_stretched_object_has_the_marks_of_its_size() {
    let finish = Finish { process: Process::Grained { size: 0.002 }, mean_deviation: 2e-5, seed: 3 };
    let finish = HeightField::Finish(finish);
    let render = |mesh: Mesh, scale: DVec3, seed: u64| {
        let mut b = SceneBuilder::default();
        let m = b.add_material(metal(Some(finish)));
        let plate = b.add_object("plate", mesh, m);
        b.instances[plate].to_world = DAffine3::from_scale(scale);
        let lamp = b.add_material(emitter(10.0));
        b.add_object("lamp", rectangle(Vec3::new(-0.7, -0.3, 0.6), Vec3::Y * 0.6, Vec3::new(0.1, 0.0, 0.2)), lamp);
        spot_camera(&mut b, DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 0.1);
        mean(&build(b), FILM, seed)
    };
    let small = rectangle(Vec3::new(-0.004, -0.4, 0.0), Vec3::X * 0.008, Vec3::Y * 0.8);
    let (made, stretched) = (render(plate(), DVec3::ONE, 1), render(small, DVec3::new(100.0, 1.0, 1.0), 2));
    z_test(stretched[0] - made[0], stretched[1].hypot(made[1]), 0.0).assert(RATE, "stretched");
}

/// The grain gives the axis of the anisotropy without texture coordinates, in the frame of the object, and a turned object turns
/// its grain.
#[test]
fn grain_is_in_the_frame_of_the_object() {
    let anisotropy = |grain| Anisotropy { strength: 0.9.into(), grain: Some(Grain::Straight(grain)), rotation: 0.0 };
    let brushed = |grain| Material { anisotropy: anisotropy(grain), roughness: 0.4.into(), ..metal(None) };
    let turned_by = |quarters: f64, grain: Vec3, seed: u64| {
        let mut b = SceneBuilder::default();
        let m = b.add_material(brushed(grain));
        let plate = b.add_object("plate", plate(), m);
        b.instances[plate].to_world = DAffine3::from_rotation_z(quarters * std::f64::consts::FRAC_PI_2);
        let lamp = b.add_material(emitter(10.0));
        b.add_object("lamp", rectangle(Vec3::new(-0.9, -0.1, 0.6), Vec3::Y * 0.2, Vec3::new(0.1, 0.0, 0.2)), lamp);
        spot_camera(&mut b, DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 0.1);
        mean(&build(b), FILM, seed)
    };
    let (along, across) = (turned_by(0.0, Vec3::X, 1), turned_by(0.0, Vec3::Y, 2));
    // The lamp lies in the plane of grooves along y: their streak reaches it.
    assert!(across[0] > 3.0 * along[0], "{across:?} {along:?}");
    z_test(turned_by(1.0, Vec3::X, 3)[0] - across[0], across[1] * 2f64.sqrt(), 0.0).assert(RATE, "turned");
}
