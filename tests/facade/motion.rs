//! Motion during the exposure and line scans, against closed forms and against renders at rest.
//!
//! The objects of most tests are black before an environment of radiance 1, so that the mean of a pixel is the share of
//! its area and of the exposure that is not covered. Replay: `cargo test -p dunkelfeld --test it motion::NAME`.

use crate::support::{RATE, black, build, emitter, film, settings, sky, square};
use dunkelfeld::Project;
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DAffine3, DVec3, Mesh, RigidMotion, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld::scene::{
    Camera, Effect, LineScan, Material, Projection, Scene, SceneBuilder, Shutter, Surface, Volume, look_at,
};
use dunkelfeld::trace::{Estimator, PixelSample};
use dunkelfeld_testkit::{ImageEstimate, ImageTest, SampleMoments, student_t_test, welch_test};
use std::f64::consts::PI;

/// Side of a pixel \[m\].
const PIXEL: f64 = 1e-3;

/// A scene of radiance 1 from everywhere, seen along -z by parallel rays on a film of `width * height` pixels around
/// the origin: columns along +x, rows along -y.
fn bright(width: u32, height: u32) -> SceneBuilder {
    let half = |n: u32| (0.5 * f64::from(n) * PIXEL) as f32;
    SceneBuilder {
        environment: sky(1.0),
        cameras: vec![Camera {
            name: "above".into(),
            to_world: look_at(DVec3::Z, DVec3::ZERO, DVec3::Y),
            projection: Projection::Orthographic { half_width: half(width), half_height: half(height) },
            ..Camera::default()
        }],
        ..SceneBuilder::default()
    }
}

/// Adds a black object that moves.
fn add_black(b: &mut SceneBuilder, name: &str, mesh: Mesh, motion: RigidMotion) {
    let material = b.add_material(black());
    let object = b.add_object(name, mesh, material);
    b.instances[object].motion = motion;
}

/// Rectangles of the plane z = 0, each by its lowest x and y and its size, in pixels.
fn rectangles(list: impl IntoIterator<Item = [f64; 4]>) -> Mesh {
    let mut mesh = Mesh::default();
    for [x, y, width, height] in list {
        let [x, y, width, height] = [x, y, width, height].map(|v| (v * PIXEL) as f32);
        let more = rectangle(Vec3::new(x, y, 0.0), Vec3::X * width, Vec3::Y * height);
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(more.positions);
        mesh.triangles.extend(more.triangles.iter().map(|t| t.map(|v| v + base)));
    }
    mesh
}

fn linear(x: f64, y: f64) -> RigidMotion {
    RigidMotion::linear(DVec3::new(x, y, 0.0))
}

/// Means of the pixels of each column.
fn columns(film: &Film) -> Vec<SampleMoments> {
    let width = film.width() as usize;
    let sums = film.sums();
    let rows = sums.data().chunks(width);
    let mut moments = vec![SampleMoments::default(); width];
    for row in rows {
        moments.iter_mut().zip(row).for_each(|(m, p)| m.push(p.mean()[0]));
    }
    moments
}

/// The image over 24 seeds.
fn image(scene: &Scene, width: u32, height: u32, spp: f64, first_seed: u64) -> ImageEstimate {
    let films = (0..24).map(|i| film(scene, &settings(width, height, spp, first_seed + i)));
    estimate(&films.collect::<Vec<_>>())
}

/// Mean and variance over films of independent seeds.
fn estimate(films: &[Film]) -> ImageEstimate {
    let (width, height) = (films[0].width() as usize, films[0].height() as usize);
    let mut image = ImageEstimate { width, height, freedom: films.len() as f64 - 1.0, ..ImageEstimate::default() };
    for pixel in 0..width * height {
        let channel = |c: usize| films.iter().map(|f| f.sums().data()[pixel].mean()[c]).collect::<SampleMoments>();
        let moments = [channel(0), channel(1), channel(2)];
        image.mean.push(moments.map(|m| m.mean()));
        image.variance.push(moments.map(|m| m.standard_error().powi(2)));
    }
    image
}

/// The edge of a half-plane moves by d pixels during the exposure. A place x before its middle is uncovered for the share
/// `clamp(x / d + 1/2, 0, 1)` of the time, and a pixel has the mean of this over its width.
#[test]
fn a_moving_edge_has_the_exact_profile_of_the_box() {
    let travel = 6.6;
    let integral = |x: f64| {
        let s = (x / travel + 0.5).clamp(0.0, 1.0);
        0.5 * travel * s * s + (x - 0.5 * travel).max(0.0)
    };
    let exposure = 3.3e-3;
    let mut b = bright(24, 64);
    let edge = rectangles([[-100.0, -100.0, 100.0, 200.0]]);
    add_black(&mut b, "plate", edge, linear(travel * PIXEL / exposure, 0.0));
    b.shutter = Some(Shutter::Frame { exposure });
    let film = film(&build(b), &settings(24, 64, 32.0, 5));
    let mut blurred = 0;
    for (column, moments) in columns(&film).iter().enumerate() {
        let left = column as f64 - 12.0;
        let expected = integral(left + 1.0) - integral(left);
        blurred += usize::from(expected > 0.0 && expected < 1.0);
        if expected == 0.0 || expected == 1.0 {
            assert_eq!((moments.mean(), moments.variance()), (expected, 0.0), "column {column}");
        } else {
            student_t_test(moments, expected).assert(RATE, &format!("column {column}"));
        }
    }
    assert_eq!(blurred, 8, "the edge is blurred over 6.6 pixels and a pixel");
}

/// The modulation of a grating of period P that moves by d pixels is that of the pixel times `sinc(d / P)`.
///
/// Bars of half the period have the Fourier coefficients `i / (pi k)` for odd k. Pixels sample the grating eight times a
/// period, so the harmonics k = 1 + 8 m have one frequency in the image. Its amplitude is the sum of
/// `(-1)^m / (pi k) sinc(k / 8) sinc(k d / 8)`, with `sinc(x) = sin(pi x) / (pi x)`.
#[test]
fn the_modulation_of_a_moving_grating_is_the_sinc_of_its_travel() {
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
    for (case, travel) in [0.0, 2.0, 4.0, 6.0, 8.0, 12.0].into_iter().enumerate() {
        let mut b = bright(16, 64);
        let bars = rectangles((-10..10).map(|i| [8.0 * f64::from(i), -100.0, 4.0, 200.0]));
        add_black(&mut b, "bars", bars, linear(travel * PIXEL / 1e-3, 0.0));
        b.shutter = Some(Shutter::Frame { exposure: 1e-3 });
        let film = film(&build(b), &settings(16, 64, 64.0, 30 + case as u64));
        let amplitude = |row: &[f64]| {
            let phase = |i: usize| (2.0 * PI * (i as f64 - 7.5) / 8.0).sin();
            -row.iter().enumerate().map(|(i, v)| v * phase(i)).sum::<f64>() / 16.0
        };
        let values: Vec<f64> = film.sums().data().iter().map(|p| p.mean()[0]).collect();
        let measured: SampleMoments = values.chunks(16).map(amplitude).collect();
        let expected: f64 = (-200_000i32..=200_000)
            .map(|m| {
                let k = f64::from(1 + 8 * m);
                let sign = if m % 2 == 0 { 1.0 } else { -1.0 };
                sign / (PI * k) * sinc(k / 8.0) * sinc(k * travel / 8.0)
            })
            .sum();
        // The aliases are below 6 % of the first harmonic, so this is the modulation transfer of the motion.
        assert!((expected * PI / sinc(0.125) - sinc(travel / 8.0)).abs() < 0.06, "{travel}: {expected}");
        // The sum of 1 / k^2 is (pi / 8)^2 / sin^2(pi / 8).
        let still = 1.0 / (8.0 * (PI / 8.0).sin());
        println!(
            "| {} | {:.4} | {:.4} | {:.4} ± {:.4} |",
            travel / 8.0,
            sinc(travel / 8.0),
            expected / still,
            measured.mean() / still,
            measured.standard_error() / still
        );
        if travel == 0.0 {
            // Bars end at the borders of pixels: there is no noise. The terms are `8 sin(pi / 8) / (pi k)^2`, so those
            // beyond the sum are 5e-8 together.
            assert!((measured.mean() - expected).abs() < 1e-7 && measured.variance() < 1e-20, "{measured:?}");
            continue;
        }
        student_t_test(&measured, expected).assert(RATE, &format!("travel of {travel} pixels"));
    }
}

/// A part with a diffuse box, a smooth ball and a clear solid under a lamp, over a floor. `pose` and `motion` are those of
/// the part.
fn turning(pose: DAffine3, motion: RigidMotion) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let grey = b.add_material(Material {
        base_color: Rgb::new(0.7, 0.5, 0.3).into(),
        roughness: 0.6.into(),
        ..Material::default()
    });
    let volume = Volume { absorption: Rgb::new(5.0, 10.0, 20.0), ..Volume::default() };
    let glass = b.add_material(Material {
        transmission: 1.0.into(),
        roughness: 0.25.into(),
        ior: 1.5,
        surface: Surface::Solid(volume),
        ..Material::default()
    });
    let lamp = b.add_material(emitter(6.0));
    b.add_object("floor", square(-0.5, 4.0, false), grey);
    b.add_object("lamp", square(2.0, 1.5, true), lamp);
    let parts = [
        ("box", cuboid(Vec3::new(0.2, -0.3, -0.2), Vec3::new(0.9, 0.1, 0.2)), grey),
        ("ball", sphere(Vec3::new(-0.5, 0.3, 0.0), 0.3, 10, true), grey),
        ("clear", cuboid(Vec3::new(-0.6, -0.7, -0.2), Vec3::new(-0.1, -0.2, 0.3)), glass),
    ];
    for (name, mesh, material) in parts {
        let object = b.add_object(name, mesh, material);
        b.instances[object].to_world = pose;
        b.instances[object].motion = motion;
    }
    b.add_camera("camera", DVec3::new(0.4, -2.5, 2.2), DVec3::ZERO, 0.8);
    b
}

fn turn() -> RigidMotion {
    let spin = RigidMotion::rotation(DVec3::new(0.2, 0.1, 1.0), DVec3::new(0.1, 0.0, 0.0), 80.0).expect("an axis");
    RigidMotion { velocity: DVec3::new(3.0, -1.0, 2.0), ..spin }
}

/// The blurred image is the mean of images at rest, each at a random time.
#[test]
fn a_turning_part_is_the_mean_of_its_poses() {
    const POSES: u32 = 48;
    let exposure = 1.5e-2;
    let size = 16;
    let mut moving = turning(DAffine3::IDENTITY, turn());
    moving.shutter = Some(Shutter::Frame { exposure });
    let scene = build(moving);
    let moving = image(&scene, size, size, 256.0, 100);
    // One stratum of the exposure for each pose, and a place of its own in it for each of the 24 films.
    let mut films: Vec<Option<Film>> = vec![None; 24];
    for (batch, film_of_batch) in films.iter_mut().enumerate() {
        for pose in 0..POSES {
            let place = (0.618_033_988_75 * f64::from(batch as u32 * POSES + pose)).fract();
            let time = exposure * ((f64::from(pose) + place) / f64::from(POSES) - 0.5);
            let scene = build(turning(turn().at(time), RigidMotion::default()));
            assert!(scene.shutter().is_none());
            let seed = 10_000 + 100 * batch as u64 + u64::from(pose);
            let still = film(&scene, &settings(size, size, 8.0, seed));
            // The samples of a film have their own indices; sums of different poses are merged as those of parts.
            match film_of_batch {
                None => *film_of_batch = Some(still),
                Some(sum) => sum.merge(&still).expect("equal sizes"),
            }
        }
    }
    let still = estimate(&films.into_iter().flatten().collect::<Vec<_>>());
    // Few bright paths through the clear solid make a pixel far from normal.
    let test = ImageTest { minimum_pass_share: 0.98, rounding: 1e-4 };
    test.run("turning", &moving, &still).assert(RATE, "motion against poses at rest");
    // The test has power: the pose of the middle is another image.
    let middle = image(&build(turning(DAffine3::IDENTITY, RigidMotion::default())), size, size, 64.0, 7000);
    assert!(test.run("middle", &moving, &middle).p_value < RATE, "blur must be visible");
}

/// Rectangles without any relation to the pixels.
fn pattern() -> Mesh {
    rectangles((0..9).map(|i| {
        let i = f64::from(i);
        [(2.7 * i).rem_euclid(15.0) - 9.0, (4.3 * i).rem_euclid(17.0) - 10.0, 1.3 + 0.4 * i, 3.1 - 0.25 * i]
    }))
}

fn scan(exposure: f64, stages: u32) -> LineScan {
    LineScan { period: 1e-4, exposure, stages, jitter: 0.0, line: 0.5, rows: 20, in_turn: 1 }
}

/// A plate that moves by one row in each period, toward the top of the image, under a line-scan camera.
fn scanned(lines: LineScan, rows_per_period: f64) -> Scene {
    let mut b = bright(18, 20);
    add_black(&mut b, "plate", pattern(), linear(0.0, rows_per_period * PIXEL / lines.period));
    b.shutter = Some(Shutter::Lines(lines));
    build(b)
}

#[test]
fn a_line_scan_of_a_plate_in_step_is_the_image_of_the_plate_at_rest() {
    let mut b = bright(18, 20);
    add_black(&mut b, "plate", pattern(), RigidMotion::default());
    let still = image(&build(b), 18, 20, 16.0, 1);
    let test = ImageTest { minimum_pass_share: 1.0, rounding: 1e-4 };
    // Lines and stages of TDI, with an exposure so short that nothing blurs.
    for (case, stages) in [1, 4, 7].into_iter().enumerate() {
        let lines = image(&scanned(scan(1e-9, stages), 1.0), 18, 20, 16.0, 100 * (case as u64 + 1));
        test.run("scan", &lines, &still).assert(RATE, &format!("{stages} stages"));
    }
    // The test has power: a plate out of step by a tenth is another image.
    let late = image(&scanned(scan(1e-9, 1), 1.1), 18, 20, 16.0, 900);
    assert!(test.run("late", &late, &still).p_value < RATE);
}

/// At rest each row shows the lines of its stages: the mean of N neighbouring rows of the image, and all rows are equal.
#[test]
fn stages_average_neighbouring_rows_of_an_object_at_rest() {
    let mut b = bright(18, 20);
    add_black(&mut b, "plate", pattern(), RigidMotion::default());
    let frame = film(&build(b.clone()), &settings(18, 20, 4096.0, 3));
    b.shutter = Some(Shutter::Lines(LineScan { line: 0.475, ..scan(1e-4, 3) }));
    let scene = build(b);
    assert!(scene.effects().has(Effect::LineScan) && !scene.effects().has(Effect::Motion));
    let lines = film(&scene, &settings(18, 20, 512.0, 4));
    for (column, moments) in columns(&lines).iter().enumerate() {
        // The line at 0.475 of 20 rows is row 9.
        let expected = [8, 9, 10].map(|row: usize| frame.sums().data()[row * 18 + column].mean()[0]);
        let expected = expected.iter().sum::<f64>() / 3.0;
        // Rectangles end within pixels: the frame has 4096 samples, each 0 or 1, in each of three pixels.
        let error = (moments.standard_error().powi(2) + 0.25 / (3.0 * 4096.0)).sqrt();
        assert!((moments.mean() - expected).abs() < 6.5 * error, "{column}: {} and {expected}", moments.mean());
    }
}

#[test]
fn a_scene_at_rest_keeps_its_bits_with_a_shutter_and_without_motion() {
    let still = build(turning(DAffine3::IDENTITY, RigidMotion::default()));
    let bits = |scene: &Scene| film(scene, &settings(24, 20, 16.0, 9));
    let expected = bits(&still);
    let mut with_shutter = turning(DAffine3::IDENTITY, RigidMotion::default());
    with_shutter.shutter = Some(Shutter::Frame { exposure: 1e-3 });
    let with_shutter = build(with_shutter);
    assert!(bits(&with_shutter) == expected && with_shutter.fingerprint() == still.fingerprint());
    let mut left_out = turning(DAffine3::IDENTITY, turn());
    left_out.shutter = Some(Shutter::Frame { exposure: 1e-3 });
    let moving = build(left_out.clone());
    assert!(moving.effects().users(Effect::Motion).len() == 3 && bits(&moving) != expected);
    assert!(left_out.leave_out(Effect::Motion));
    let left_out = build(left_out);
    assert!(bits(&left_out) == expected && !left_out.effects().has(Effect::Motion));
    // Motions without a shutter have no effect.
    assert!(bits(&build(turning(DAffine3::IDENTITY, turn()))) == expected);
    // Motion and exposure are parts of the fingerprint.
    let fingerprint = |exposure: f64, speed: f64| {
        let mut b = turning(DAffine3::IDENTITY, linear(speed, 0.0));
        b.shutter = Some(Shutter::Frame { exposure });
        build(b).fingerprint()
    };
    let base = fingerprint(1e-3, 1.0);
    assert!(base == fingerprint(1e-3, 1.0) && base != fingerprint(2e-3, 1.0) && base != fingerprint(1e-3, 1.1));
}

/// Labels, depth and normals are those of the moving part: at the middle of the exposure the plate is over the centre.
#[test]
fn auxiliary_layers_follow_the_motion() {
    let mut b = bright(8, 8);
    // Far away at time 0 for a scan of 8 rows: only the rows after the middle see it.
    let plate = rectangles([[-20.0, -30.0, 40.0, 29.9]]);
    add_black(&mut b, "plate", plate, linear(0.0, PIXEL / 1e-4));
    b.shutter = Some(Shutter::Lines(LineScan { rows: 8, ..scan(1e-9, 1) }));
    let scene = build(b);
    let camera = scene.ray_generator(&scene.cameras()[0], 8, 8).expect("a camera");
    for row in 0..8 {
        let ids = dunkelfeld_integrator::pixel_ids(&scene, &camera, 4, row);
        assert_eq!(ids.is_some(), row >= 4, "row {row}");
        let estimator = Estimator { scene: &scene, camera: &camera, width: 8, seed: 1, frame: 0, roulette: None };
        let sample = estimator.sample(PixelSample { x: 4, y: row, index: 0 });
        assert_eq!(sample.hit, row >= 4, "row {row}");
        if sample.hit {
            assert!((sample.depth - 1.0).abs() < 1e-5 && sample.normal[2] == 1.0, "{sample:?}");
        }
    }
}

/// Connections through a cover at rest treat moving parts as receivers and as occluders; a cover that moves is not
/// connected through. Both have the mean of scattering alone.
#[test]
fn connections_through_covers_stay_unbiased_beside_moving_parts() {
    let clear = Material {
        transmission: 1.0.into(),
        roughness: 0.0.into(),
        ior: 1.49,
        surface: Surface::Solid(Volume::default()),
        ..Material::default()
    };
    let set_up = |cover_moves: bool| {
        let mut b = SceneBuilder::default();
        let paint = b.add_material(Material {
            base_color: Rgb::splat(0.7).into(),
            roughness: 0.9.into(),
            ..Material::default()
        });
        let clear = b.add_material(clear.clone());
        let lamp = b.add_material(emitter(5.0));
        b.add_object("floor", square(0.0, 0.3, false), paint);
        let cover = cuboid(Vec3::new(-0.08, -0.08, 0.010), Vec3::new(0.08, 0.08, 0.014));
        let cover = b.add_object("cover", cover, clear);
        // A flag that covers the light half of the time, below the cover and above it.
        let flag = |z: f32| rectangle(Vec3::new(0.0, -0.1, z), Vec3::X * 0.05, Vec3::Y * 0.2);
        let flags = [b.add_object("low flag", flag(0.005), paint), b.add_object("high flag", flag(0.02), paint)];
        b.add_object("light", rectangle(Vec3::new(0.1, -0.15, 0.02), Vec3::Z * 0.18, Vec3::Y * 0.3), lamp);
        for flag in flags {
            b.instances[flag].motion = linear(10.0, 0.0);
        }
        if cover_moves {
            b.instances[cover].motion = linear(1.0, 0.0);
        }
        b.shutter = Some(Shutter::Frame { exposure: 4e-3 });
        crate::support::spot_camera(&mut b, DVec3::new(-0.01, 0.0, 0.3), DVec3::new(-0.01, 0.0, 0.0), 1e-4);
        b
    };
    let moments =
        |b: SceneBuilder, seed| crate::support::pixel_moments(&film(&build(b), &settings(16, 16, 1024.0, seed)));
    assert_eq!(build(set_up(false)).covers().len(), 1);
    assert!(build(set_up(true)).covers().is_empty(), "a cover that moves is not connected through");
    let with = moments(set_up(false), 1);
    for (case, moves) in [(2, false), (3, true)] {
        let mut left_out = set_up(moves);
        assert!(left_out.leave_out(Effect::CoverConnection));
        let without = moments(left_out, case);
        assert!(without.mean() > 0.0);
        // A displacement of a plane-parallel cover does not change the image.
        welch_test(&with, &without).assert(RATE, &format!("cover moves: {moves}"));
    }
}

#[test]
fn lights_that_move_and_wrong_shutters_are_refused() {
    let mut b = turning(DAffine3::IDENTITY, RigidMotion::default());
    b.shutter = Some(Shutter::Frame { exposure: 1e-3 });
    b.instances[1].motion = linear(1.0, 0.0);
    let message = b.clone().build().expect_err("a moving lamp").to_string();
    assert!(message.contains("\"lamp\"") && message.contains("emits light and moves"), "{message}");
    b.instances[1].motion = linear(f64::NAN, 0.0);
    assert!(b.clone().build().expect_err("NaN").to_string().contains("finite"));
    b.instances[1].motion = RigidMotion::default();
    for (lines, word) in [
        (LineScan { exposure: 2e-4, ..scan(1e-4, 1) }, "at most the period"),
        (LineScan { period: 0.0, ..scan(1e-4, 1) }, "period"),
        (LineScan { stages: 0, ..scan(1e-4, 1) }, "stages"),
        (LineScan { jitter: -1.0, ..scan(1e-4, 1) }, "deviation"),
        (LineScan { line: 1.5, ..scan(1e-4, 1) }, "between 0 and 1"),
        (LineScan { rows: 0, ..scan(1e-4, 1) }, "row"),
    ] {
        let mut b = b.clone();
        b.shutter = Some(Shutter::Lines(lines));
        let message = b.build().expect_err(word).to_string();
        assert!(message.contains(word), "{message}");
    }
}

/// A job with a plate in the plane y = 0 under a telecentric camera from above: 20 rows of 1 mm. `motion` are keys of the plate.
fn open(tables: &str, motion: &str) -> Result<Project, dunkelfeld::Error> {
    let text = format!(
        "scene = \"none\"\nfilm = {{ width = 20, height = 20 }}\nenvironment = {{ radiance = 1 }}\n\
         camera = {{ position = [0, 1, 0], look_at = [0, 0, 0], up = [0, 0, -1] }}\n\
         lens = {{ projection = \"telecentric\", field_height = \"20mm\" }}\n{tables}\
         [[object]]\nname = \"part\"\nkind = \"box\"\nsize = [\"20mm\", \"1mm\", \"20mm\"]\n{motion}"
    );
    Project::from_text("job.toml", &text)
}

const MOVING: &str = "velocity = [0, 0, \"-10m/s\"]\n";

#[test]
fn a_job_moves_objects_and_scans_lines() {
    let still = open("", "").expect("a job");
    assert!(still.scene.shutter().is_none() && still.findings().hazards().next().is_none(), "{:?}", still.report);
    let moving = open("[sensor]\nexposure = \"100us\"\n", MOVING).expect("a job");
    assert_eq!(moving.scene.shutter(), Some(&Shutter::Frame { exposure: 100.0 * 1e-6 }));
    assert!(moving.scene.effects().has(Effect::Motion) && moving.findings().hazards().next().is_none());
    moving.fitted().expect("the exposure is that of the shutter");
    // 10 m/s are 10 000 rows of 1 mm a second, up in the image.
    let lines = "[line_scan]\nline_rate = \"10kHz\"\ntdi_stages = 4\n";
    let mut scan = open(&format!("[sensor]\nexposure = 1e-5\n{lines}"), MOVING).expect("a job");
    assert!(scan.findings().hazards().next().is_none(), "{:?}", scan.report);
    assert!(scan.scene.effects().has(Effect::LineScan) && scan.inspect().hazards.is_empty());
    let dunkelfeld::SensorChoice::Emva { exposure: Some(exposure), .. } = scan.fitted().expect("valid").sensor else {
        panic!("a fixed exposure")
    };
    assert!((exposure.time().0 - 4e-5).abs() < 1e-15, "the light of four stages");
    scan.settings.height = 30;
    assert!(scan.fitted().expect_err("another film").to_string().contains("20 rows"));
    // Hazards: too slow a line rate, the wrong direction, nothing that moves, motion beyond the film.
    let backward = MOVING.replace('-', "");
    let turning = "rotation = { axis = [0, 1, 0], speed = \"2turn/s\" }\n";
    let slow = "[line_scan]\nline_rate = \"8kHz\"\n";
    for (exposure, lines, motion, part) in [
        ("2e-5", slow, MOVING, "\"10000Hz\""),
        ("2e-5", lines, &backward, "upside down"),
        ("2e-5", lines, "", "no object moves"),
        ("\"1s\"", "", MOVING, "times the film"),
        ("\"1s\"", "", turning, "turns 2.0 times"),
    ] {
        let project = open(&format!("[sensor]\nexposure = {exposure}\n{lines}"), motion).expect("a job");
        let hazards: Vec<String> = project.findings().hazards().map(|h| h.message.clone()).collect();
        assert!(hazards.iter().any(|h| h.contains(part)), "{part}: {hazards:?}");
    }
    let error = open("", MOVING).expect_err("automatic exposure").to_string();
    assert!(error.contains("automatic") && error.contains("help"), "{error}");
}
