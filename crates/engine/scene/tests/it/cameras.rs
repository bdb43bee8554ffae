//! Cameras against geometric optics: closed forms of the thin and the telecentric lens, apertures, the film's geometry.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it cameras::NAME`. Random numbers are fixed. False-alarm rate: 1e-9 for
//! each of fewer than 60 statistical checks.

use dunkelfeld_geometry::{DAffine3, DVec3, Ray};
use dunkelfeld_sampling::mix64;
use dunkelfeld_scene::{
    Aperture, Blades, Camera, CameraError, Distortion, FilmWindow, Lens, Opening, Projection, RayGenerator, ThinLens,
    Vignetting, look_at,
};
use dunkelfeld_testkit::{DensityTest, SampleMoments, z_test};
use std::f64::consts::{PI, TAU};

const RATE: f64 = 1e-9;
const SAMPLES: u64 = 40_000;

/// Two independent uniform numbers for every index.
fn uniform(i: u64) -> [f32; 2] {
    let bits = mix64(i.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    [bits >> 40, (bits >> 8) & 0xff_ffff].map(|v| v as f32 / (1u32 << 24) as f32)
}

fn perspective(vertical_fov: f64, lens: Lens) -> Camera {
    let projection = Projection::Perspective { vertical_fov: vertical_fov as f32 };
    Camera { name: "c".into(), projection, lens, ..Camera::default() }
}

/// A telecentric camera with a field of 20 mm by 15 mm.
fn telecentric(numerical_aperture: f64, focus_distance: f64, blades: Option<Blades>) -> Camera {
    let aperture = Aperture { opening: Opening::NumericalAperture(numerical_aperture), focus_distance, blades };
    Camera {
        projection: Projection::Orthographic { half_width: 0.01, half_height: 0.0075 },
        lens: Lens { aperture: Some(aperture), ..Lens::default() },
        ..perspective(1.0, Lens::default())
    }
}

/// Bound to 640 x 480 pixels; the radius is so large that every ray starts on its lens.
fn bound(camera: &Camera) -> RayGenerator {
    RayGenerator::new(camera, 640, 480, DVec3::ZERO, 1e6).unwrap_or_else(|e| panic!("{e}"))
}

/// The intersection of a ray with the plane at `distance` in front of a camera with direction -z at the origin.
fn at_depth(ray: &Ray, distance: f64) -> [f64; 2] {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let t = (-distance - o.z) / d.z;
    [o.x + t * d.x, o.y + t * d.y]
}

/// Points of the blur of a film point on a plane, relative to the intersection of its chief ray.
fn blur(camera: &RayGenerator, x: f32, y: f32, distance: f64) -> Vec<[f64; 2]> {
    let [cx, cy] = at_depth(&camera.ray(x, y), distance);
    let hit = |i| {
        let [px, py] = at_depth(&camera.camera_ray(x, y, Some(uniform(i))).ray, distance);
        [px - cx, py - cy]
    };
    (0..SAMPLES).map(hit).collect()
}

fn moments(values: impl Iterator<Item = f64>) -> SampleMoments {
    values.collect()
}

/// 50 mm, f/2, 24 mm of film: the diameter of the blur on the film is A |d - u| / d * f / (u - f), the textbook
/// formula. A blur on the film is one on the plane at d, scaled by v / d.
#[test]
fn the_blur_of_a_thin_lens_is_the_disc_of_the_textbook() {
    let (f, n, film_height) = (0.05, 2.0, 0.024);
    for u in [0.3, 2.0] {
        let thin = ThinLens { focal_length: f, f_number: n, focus_distance: u };
        let v = 1.0 / (1.0 / f - 1.0 / u);
        assert!(
            (thin.image_distance() / v - 1.0).abs() < 1e-12 && (thin.magnification() / (v / u) - 1.0).abs() < 1e-12
        );
        let fov = 2.0 * (0.5 * film_height / v).atan();
        assert!((thin.field_of_view(film_height) - fov).abs() < 1e-12);
        let opening = Opening::Radius(thin.aperture_radius());
        let aperture = Some(Aperture { opening, focus_distance: u, blades: None });
        let camera = bound(&perspective(fov, Lens { aperture, ..Lens::default() }));
        for (d, x, y) in [(0.2, 320.0, 240.0), (0.8, 600.5, 30.0), (5.0, 10.0, 470.0), (1e3, 320.0, 100.0)] {
            let on_film = (f / n) * (f64::abs(d - u) / d) * f / (u - f);
            let radius = 0.5 * on_film * d / v;
            let points = blur(&camera, x, y, d);
            let what = format!("u = {u}, d = {d}, film point {x}, {y}");
            let reach = points.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max) / radius;
            assert!(reach < 1.0 + 1e-4 && reach > 0.999, "{what}: reaches {reach} of the closed form");
            for k in [0, 1] {
                let mean = moments(points.iter().map(|p| p[k]));
                z_test(mean.mean(), mean.standard_error(), 0.0).assert(RATE, &format!("{what}: middle"));
                let square = moments(points.iter().map(|p| p[k] * p[k]));
                z_test(square.mean(), square.standard_error(), 0.25 * radius * radius).assert(RATE, &what);
            }
            // Equal areas of the disc as equal areas of the square.
            let mut points = points.iter();
            let test = DensityTest { samples: SAMPLES, ..DensityTest::default() };
            let next = || {
                points.next().map(|[x, y]| {
                    let share = (x * x + y * y) / (radius * radius);
                    [share.min(1.0), (y.atan2(*x) / TAU).rem_euclid(1.0)]
                })
            };
            test.run("blur disc", next, |_| 1.0).assert(RATE, &what);
        }
        // The plane in focus is sharp: all rays of a film point intersect there.
        let worst = blur(&camera, 77.0, 400.0, u).iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        assert!(worst < 2e-7 * u.max(f), "{worst} m at u = {u}");
    }
}

/// Corners of the polygon that replaces the unit disc.
fn corners(blades: Blades) -> Vec<[f64; 2]> {
    let n = f64::from(blades.count);
    // A regular polygon with circumradius c has area n c^2 sin(2 pi / n) / 2; here it is pi.
    let c = (PI / (0.5 * n * (TAU / n).sin())).sqrt();
    let angle = |k: u32| blades.rotation + TAU * f64::from(k) / n;
    (0..blades.count).map(|k| [c * angle(k).cos(), c * angle(k).sin()]).collect()
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[test]
fn a_polygon_of_blades_is_filled_evenly_and_has_the_area_of_its_circle() {
    for (count, rotation) in [(3, 0.0), (5, 0.3), (6, -2.0), (17, 1.0)] {
        let blades = Blades { count, rotation };
        let corners = corners(blades);
        let next = |k: usize| corners[(k + 1) % corners.len()];
        // The shoelace formula.
        let area: f64 = (0..corners.len()).map(|k| 0.5 * cross(corners[k], next(k))).sum();
        assert!((area - PI).abs() < 1e-12 && (blades.corner() - corners[0][0].hypot(corners[0][1])).abs() < 1e-12);
        assert!((blades.fill() - area / (PI * blades.corner() * blades.corner())).abs() < 1e-12);
        let opening = Opening::Radius(0.5);
        let aperture = Aperture { opening, focus_distance: 1.0, blades: Some(blades) };
        let points: Vec<[f64; 2]> = (0..SAMPLES).map(|i| aperture.sample(uniform(i)).map(|v| 2.0 * v)).collect();
        for p in &points {
            for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                let inside = cross([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
                assert!(inside > -1e-5, "{p:?} lies outside {count} blades");
            }
        }
        // Each sector between two corners, and in it each homothetic ring, has its share of the points.
        let mut points = points.iter();
        let sector_and_ring = || {
            let p = *points.next()?;
            let k = (0..corners.len()).find(|&k| cross(corners[k], p) >= 0.0 && cross(p, next(k)) > 0.0)?;
            let det = cross(corners[k], next(k));
            let (s, t) = (cross(p, next(k)) / det, cross(corners[k], p) / det);
            let along = (k as f64 + t / (s + t)) / corners.len() as f64;
            Some([along.clamp(0.0, 1.0), ((s + t) * (s + t)).min(1.0)])
        };
        let test = DensityTest { columns: 4 * count as usize, rows: 8, samples: SAMPLES };
        test.run("blades", sector_and_ring, |_| 1.0).assert(RATE, &format!("{count} blades"));
    }
}

#[test]
fn the_principal_point_is_where_the_axis_meets_the_film() {
    for camera in [perspective(0.6, Lens::default()), telecentric(0.05, 0.1, None)] {
        let offset = [31.25, -18.5];
        let shifted = Camera { lens: Lens { principal_point: offset, ..camera.lens }, ..camera.clone() };
        let (plain, shifted) = (bound(&camera), bound(&shifted));
        let on_axis = shifted.project(DVec3::new(0.0, 0.0, -0.7)).expect("in front");
        assert!((on_axis[0] - 351.25).abs() < 1e-9 && (on_axis[1] - 221.5).abs() < 1e-9, "{on_axis:?}");
        for (x, y) in [(100.0, 50.0), (320.0, 240.0), (500.0, 400.0)] {
            let (a, b) = (plain.ray(x, y), shifted.ray(x + offset[0] as f32, y + offset[1] as f32));
            assert!((a.origin - b.origin).length() < 1e-9 && (a.direction - b.direction).length() < 1e-7);
        }
    }
}

#[test]
fn vignetting_is_the_fourth_power_of_the_cosine_and_off_unless_requested() {
    let lens = Lens { vignetting: Vignetting::CosineFourth, principal_point: [40.0, 10.0], ..Lens::default() };
    let (plain, dark) = (bound(&perspective(1.2, Lens::default())), bound(&perspective(1.2, lens)));
    assert!(dark.has_vignetting() && !plain.has_vignetting());
    for (x, y) in [(0.0, 0.0), (360.0, 250.0), (640.0, 111.0)] {
        assert_eq!(plain.camera_ray(x, y, None).weight, 1.0);
        let ray = dark.camera_ray(x, y, None);
        let cosine = f64::from(-ray.ray.direction.z);
        assert!((f64::from(ray.weight) - cosine.powi(4)).abs() < 1e-6, "{} for {cosine}", ray.weight);
    }
    assert_eq!(dark.camera_ray(360.0, 250.0, None).weight, 1.0, "the axis keeps its light");
    let flat = Camera { lens, ..telecentric(0.1, 0.2, None) };
    assert_eq!(bound(&flat).camera_ray(0.0, 0.0, None).weight, 1.0, "chief rays are parallel to the axis");
}

/// Distance of a point from a ray's line, in f64.
fn miss(ray: &Ray, p: DVec3) -> f64 {
    let d = ray.direction.as_dvec3().normalize();
    (p - ray.origin.as_dvec3()).cross(d).length()
}

/// A scene of half a metre. From a kilometre away, f32 would place a ray that starts at the camera within 3e-5 m.
#[test]
fn a_camera_a_kilometre_away_is_as_exact_as_a_near_one() {
    let radius = 0.5f32;
    let eye = DVec3::new(600.3, 500.7, -624.9);
    let distance = eye.length();
    let aperture = Some(Aperture { opening: Opening::Radius(0.2), focus_distance: distance, blades: None });
    let long = |aperture| Camera {
        to_world: look_at(eye, DVec3::ZERO, DVec3::Y),
        ..perspective(2.0 * (0.4 / distance).atan(), Lens { aperture, ..Lens::default() })
    };
    for camera in [long(None), long(aperture)] {
        let film = RayGenerator::new(&camera, 640, 480, DVec3::ZERO, radius).expect("valid");
        let m = camera.to_world.matrix3;
        for i in 0..1000 {
            let [x, y] = [uniform(2 * i)[0] * 640.0, uniform(2 * i)[1] * 480.0];
            // The point of the middle plane at this place on the film.
            let Projection::Perspective { vertical_fov } = camera.projection else { unreachable!() };
            let scale = (0.5 * f64::from(vertical_fov)).tan() * distance / 240.0;
            let seen = m.x_axis * (f64::from(x) - 320.0) * scale - m.y_axis * (f64::from(y) - 240.0) * scale
                + (eye - m.z_axis * distance);
            let ray = film.camera_ray(x, y, Some(uniform(2 * i + 1)));
            assert!(ray.ray.origin.length() < 2.5 * radius, "the ray starts near the scene");
            let gap = miss(&ray.ray, seen);
            assert!(gap < 4e-7 * f64::from(radius), "off by {gap} m at {x}, {y}");
            // The start is part of the distance. The distance itself has the precision of f32.
            let way = f64::from(ray.start) + (seen.as_vec3() - ray.ray.origin).length() as f64;
            let from = if camera.lens.aperture.is_some() { 1e-3 } else { 1e-4 };
            assert!((way - (seen - eye).length()).abs() < from, "{way}");
        }
    }
}

#[test]
fn invalid_lenses_are_refused_with_a_message() {
    let aperture = |opening, focus_distance, count| {
        let blades = (count != 0).then_some(Blades { count, rotation: 0.0 });
        Lens { aperture: Some(Aperture { opening, focus_distance, blades }), ..Lens::default() }
    };
    let (radius, sine) = (Opening::Radius, Opening::NumericalAperture);
    let flat = |lens| Camera { lens, ..telecentric(0.1, 0.1, None) };
    let twisted = Distortion { radial: [f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
    let bent = Distortion { radial: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
    for (camera, word) in [
        (perspective(1.0, aperture(radius(0.0), 1.0, 0)), "aperture"),
        (perspective(1.0, aperture(radius(f64::NAN), 1.0, 0)), "aperture"),
        (perspective(1.0, aperture(radius(0.01), 0.0, 0)), "focus distance"),
        (perspective(1.0, aperture(radius(0.01), f64::NAN, 0)), "focus distance"),
        (perspective(1.0, aperture(radius(0.01), 1.0, 2)), "blades"),
        (perspective(1.0, aperture(sine(0.1), 1.0, 0)), "numerical aperture"),
        (flat(aperture(radius(0.01), 1.0, 0)), "numerical aperture"),
        (flat(aperture(sine(1.0), 1.0, 0)), "numerical aperture"),
        (flat(aperture(sine(0.1), f64::INFINITY, 0)), "focus distance"),
        (flat(Lens { distortion: bent, ..Lens::default() }), "distortion"),
        (perspective(1.0, Lens { distortion: twisted, ..Lens::default() }), "distortion"),
        (perspective(1.0, Lens { principal_point: [f64::INFINITY, 0.0], ..Lens::default() }), "principal point"),
        (Camera { to_world: DAffine3::from_translation(DVec3::NAN), ..Camera::default() }, "transform"),
    ] {
        let error = RayGenerator::new(&camera, 640, 480, DVec3::ZERO, 1.0).expect_err(word);
        assert!(matches!(error, CameraError::Value { .. }) && error.to_string().contains(word), "{word}: {error}");
    }
}

#[test]
fn a_window_has_the_rays_of_its_pixels_in_the_whole_film() {
    let distortion = Distortion::from_opencv(&[-0.2, 0.05, 0.001, -0.002]).expect("four");
    let lens = Lens { distortion, principal_point: [12.5, -7.25], pixel_aspect: 1.25, ..Lens::default() };
    for camera in [perspective(0.7, lens), perspective(0.7, Lens::default()), telecentric(0.02, 0.1, None)] {
        let whole = bound(&camera);
        let window = |origin, step, [width, height]: [u32; 2]| {
            let window = Some(FilmWindow { full: [640, 480], origin, step });
            let camera = Camera { window, ..camera.clone() };
            RayGenerator::new(&camera, width, height, DVec3::ZERO, 1e6).unwrap_or_else(|e| panic!("{e}"))
        };
        let roi = window([100.0, 52.0], 1.0, [64, 48]);
        let binned = window([0.0, 0.0], 2.0, [320, 240]);
        for i in 0..500 {
            // Sums of these places are exact in f32.
            let [x, y] = uniform(i).map(|u| (64.0 * 64.0 * u).floor() / 64.0);
            let u = Some(uniform(i + 1000));
            assert_eq!(roi.camera_ray(x, y, u), whole.camera_ray(x + 100.0, y + 52.0, u), "region at {x}, {y}");
            assert_eq!(binned.camera_ray(x, y, u), whole.camera_ray(2.0 * x, 2.0 * y, u), "binned at {x}, {y}");
            let ray = roi.ray(x, y);
            let point = (ray.origin + ray.direction).as_dvec3();
            let [px, py] = roi.project(point).expect("in front of the camera");
            assert!((px - f64::from(x)).hypot(py - f64::from(y)) < 1e-3, "{px}, {py} at {x}, {y}");
        }
    }
    for window in [
        FilmWindow { full: [0, 480], origin: [0.0; 2], step: 1.0 },
        FilmWindow { full: [640, 480], origin: [f64::NAN, 0.0], step: 1.0 },
        FilmWindow { full: [640, 480], origin: [0.0; 2], step: 0.0 },
    ] {
        let camera = Camera { window: Some(window), ..perspective(0.7, Lens::default()) };
        assert!(RayGenerator::new(&camera, 8, 8, DVec3::ZERO, 1.0).is_err(), "{window:?}");
    }
}
