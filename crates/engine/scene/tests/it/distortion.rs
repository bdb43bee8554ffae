//! Lens distortion against OpenCV itself, and against its own inverse.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it distortion::NAME`.

use dunkelfeld_geometry::DVec3;
use dunkelfeld_scene::camera::distortion::Undistorter;
use dunkelfeld_scene::{Camera, CameraError, Distortion, Lens, Projection, RayGenerator};

/// A camera of OpenCV: 640 x 480 pixels, fx = fy = 800, and the optical axis at (cx, cy) = (319.5, 239.5), which is the
/// middle of the film if pixel centres have whole coordinates.
fn camera(distortion: Distortion, principal_point: [f64; 2]) -> Result<RayGenerator, CameraError> {
    let projection = Projection::Perspective { vertical_fov: 2.0 * (240.0f32 / 800.0).atan() };
    let lens = Lens { distortion, principal_point, ..Lens::default() };
    let camera = Camera { name: "calibrated".into(), projection, lens, ..Camera::default() };
    RayGenerator::new(&camera, 640, 480, DVec3::ZERO, 1e3)
}

const BARREL: [f64; 5] = [-0.28, 0.09, 0.0012, -0.0007, -0.015];
const RATIONAL: [f64; 8] = [0.41, 0.065, -0.0009, 0.0015, 0.0021, 0.72, 0.148, 0.0093];

/// Points in the camera's frame (x right, y down, z forward), and their projections by `cv2.projectPoints` of
/// opencv-python-headless 5.0.0 with the two sets of coefficients above.
const OPENCV: [([f64; 3], [f64; 2], [f64; 2]); 6] = [
    ([0.0, 0.0, 1.0], [319.5, 239.5], [319.5, 239.5]),
    ([0.31, -0.22, 1.0], [557.601247210415, 70.606214237770], [557.575242045753, 70.562394677208]),
    ([-0.55, 0.37, 1.7], [70.832600723505, 406.874023004943], [72.624929854632, 405.592861721574]),
    ([0.9, 0.6, 2.0], [652.521486403125, 461.904324268750], [651.320018489856, 460.268745659904]),
    ([-0.02, 0.45, 0.8], [300.898780966174, 654.337184511086], [301.620836509208, 650.112759792827]),
    ([0.4, 0.3, 1.0], [618.736200000000, 464.272150000000], [617.734333997974, 462.770750498481]),
];

fn model(coefficients: &[f64]) -> Distortion {
    Distortion::from_opencv(coefficients).expect("4, 5 or 8 coefficients")
}

#[test]
fn projected_points_equal_those_of_opencv() {
    for (coefficients, which) in [(&BARREL[..], 0), (&RATIONAL[..], 1)] {
        let model = model(coefficients);
        let film = camera(model, [0.0; 2]).expect("invertible");
        for (p, barrel, rational) in OPENCV {
            let expected = [barrel, rational][which];
            let place = model.forward([p[0] / p[2], p[1] / p[2]]);
            for k in [0, 1] {
                let pixel = 800.0 * place[k] + [319.5, 239.5][k];
                assert!((pixel - expected[k]).abs() < 1e-8, "{p:?}: {pixel} instead of {expected:?}");
            }
            // Our world has y up and the viewing direction -z; our pixels count from a corner. The field of view is an
            // f32.
            let Some(seen) = film.project(DVec3::new(p[0], -p[1], -p[2])) else {
                assert!(expected[1] > 480.0, "{p:?} lies on the film and is not seen");
                continue;
            };
            for k in [0, 1] {
                assert!((seen[k] - expected[k] - 0.5).abs() < 1e-4, "{p:?}: {seen:?} instead of {expected:?}");
            }
        }
    }
}

/// Coefficients from mild to extreme. Those that cannot be inverted over the film are refused, all others are inverted.
#[test]
fn accepted_distortions_are_inverted_on_the_whole_film() {
    let mut state = 1u64;
    let mut next = |scale: f64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        scale * ((state >> 11) as f64 / (1u64 << 52) as f64 - 1.0)
    };
    let (mut accepted, mut refused) = (0, 0);
    for case in 0..600 {
        let wild = [0.1, 0.5, 2.0][case % 3];
        let radial = [next(wild), next(wild), next(wild), next(wild), next(wild), next(wild)];
        let m = Distortion { radial, tangential: [next(0.02 * wild), next(0.02 * wild)] };
        let reach = 0.9 + next(0.6);
        let Ok(undistorter) = Undistorter::new(m, reach) else {
            refused += 1;
            continue;
        };
        accepted += 1;
        for k in 0..400 {
            // A spiral over the whole disc, its rim included.
            let r = reach * f64::from(k) / 399.0;
            let (sin, cos) = (2.4 * f64::from(k)).sin_cos();
            let place = [r * cos, r * sin];
            let direction = undistorter.inverse(place);
            let back = m.forward(direction);
            let gap = (back[0] - place[0]).hypot(back[1] - place[1]);
            assert!(gap <= 1e-12 * reach && undistorter.is_valid(direction), "{m:?}: {gap} at {place:?} of {reach}");
            // There is no other one: the derivatives from the axis outward keep the order of places.
            let ahead = m.forward([0.999 * direction[0], 0.999 * direction[1]]);
            let along = (back[0] - ahead[0]) * direction[0] + (back[1] - ahead[1]) * direction[1];
            assert!(along > 0.0 || k == 0, "{m:?}: places turn back at {place:?}");
        }
    }
    assert!(accepted > 150 && refused > 150, "{accepted} accepted, {refused} refused");
}

/// Rays and projections of f32 and f64: the projection of a ray is its film point.
#[test]
fn rays_project_back_to_their_film_points() {
    for coefficients in [&BARREL[..], &RATIONAL[..]] {
        let film = camera(model(coefficients), [21.0, -13.5]).expect("invertible");
        for i in 0..=64u16 {
            for j in 0..=48u16 {
                let (x, y) = (f32::from(i) * 10.0, f32::from(j) * 10.0);
                let ray = film.ray(x, y);
                let seen = film.project(ray.at(2.0).as_dvec3()).expect("on the film");
                let gap = (seen[0] - f64::from(x)).hypot(seen[1] - f64::from(y));
                // A direction of f32, over 800 pixels of focal length.
                assert!(gap < 800.0 * 2e-7, "{seen:?} instead of {x}, {y}");
            }
        }
    }
}

/// x' = x (1 - r^2 / 3) folds back at r = 1, 45 degrees, where r' = 2/3: at 800 pixels focal length, 533.3 pixels out.
#[test]
fn a_distortion_that_folds_on_the_film_is_an_error_that_names_the_place() {
    let cubic = Distortion { radial: [-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
    // The corner lies 400 pixels out: fine. With the axis off the middle it lies farther.
    let film = camera(cubic, [0.0; 2]).expect("the fold is beyond the corner");
    let error = camera(cubic, [-320.0, -240.0]).expect_err("800 pixels to the far corner");
    let text = error.to_string();
    let CameraError::NotInvertible { x, y, pixels, degrees, reach, .. } = error else { panic!("{text}") };
    assert!((pixels - 533.33).abs() < 0.1 && (degrees - 45.0).abs() < 0.2 && (reach - 800.0).abs() < 1e-9, "{text}");
    assert!((x - 0.8 * pixels).abs() < 1e-6 && (y - 0.6 * pixels).abs() < 1e-6, "{text}");
    assert!(text.contains("not invertible") && text.contains("calibrated"), "{text}");
    // Beyond the fold, at r = 1.5, the formula gives 0.375: a place on the film of another direction.
    assert!((cubic.forward([1.5, 0.0])[0] - 0.375).abs() < 1e-12);
    assert_eq!(film.project(DVec3::new(1.5, 0.0, -1.0)), None);
    let seen = film.project(DVec3::new(0.4, 0.0, -1.0)).expect("in the field");
    assert!((seen[0] - (320.0 + 800.0 * 0.4 * (1.0 - 0.16 / 3.0))).abs() < 1e-3, "{seen:?}");
}
