//! Camera rays of several film points at once have the bits of single ones, for each kind of camera.

use dunkelfeld_geometry::DVec3;
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, dispatch};
use dunkelfeld_scene::{
    Aperture, Blades, Camera, CameraRays, Distortion, FilmWindow, Lens, Opening, Projection, RayGenerator, Vignetting,
    look_at,
};

type Row = [f32; MAX_WIDTH];

#[inline(always)]
fn rays<F: Lanes>(token: F::Token, camera: &RayGenerator, [x, y]: &[Row; 2], lens: Option<&[Row; 2]>) -> [Row; 8] {
    let mut out = [[0.0; MAX_WIDTH]; 8];
    for at in (0..MAX_WIDTH).step_by(F::WIDTH) {
        let u = lens.map(
            #[inline(always)]
            |[u, v]| [F::load(token, &u[at..]), F::load(token, &v[at..])],
        );
        let CameraRays { origin, direction, weight, start } =
            camera.camera_rays(token, F::load(token, &x[at..]), F::load(token, &y[at..]), u);
        let all = [origin.x, origin.y, origin.z, direction.x, direction.y, direction.z, weight, start];
        for (row, value) in out.iter_mut().zip(all) {
            value.store(&mut row[at..]);
        }
    }
    out
}

fn cameras() -> Vec<RayGenerator> {
    let eye = DVec3::new(0.7, 1.2, -2.0);
    let plain = Camera {
        to_world: look_at(eye, DVec3::new(0.1, 0.2, 0.3), DVec3::Y),
        projection: Projection::Perspective { vertical_fov: 0.6 },
        ..Camera::default()
    };
    let distant = look_at(eye * 400.0, DVec3::ZERO, DVec3::Y);
    let parallel = Projection::Orthographic { half_width: 0.01, half_height: 0.0075 };
    let window = Some(FilmWindow { full: [20_000, 15_000], origin: [19_000.0, 100.0], step: 2.0 });
    let aperture = |opening, count| {
        let blades = (count != 0).then_some(Blades { count, rotation: -3.7 });
        Some(Aperture { opening, focus_distance: 1.5, blades })
    };
    let (radius, sine) = (Opening::Radius(0.02), Opening::NumericalAperture(0.1));
    let distortion = Distortion { radial: [-0.2, 0.05, 0.0, 0.0, 0.0, 0.0], tangential: [1e-3, -2e-3] };
    let bent = Lens { distortion, principal_point: [12.5, -7.25], pixel_aspect: 1.25, ..Lens::default() };
    let with = |lens| Camera { lens, ..plain.clone() };
    let flat = |lens| Camera { lens, projection: parallel, ..plain.clone() };
    let narrow = Projection::Perspective { vertical_fov: 1f32.to_radians() };
    [
        plain.clone(),
        Camera { to_world: distant, projection: narrow, window, ..plain.clone() },
        with(Lens { aperture: aperture(radius, 0), vignetting: Vignetting::CosineFourth, ..Lens::default() }),
        with(Lens { aperture: aperture(radius, 7), ..Lens::default() }),
        with(bent),
        with(Lens { aperture: aperture(radius, 5), ..bent }),
        flat(Lens::default()),
        flat(Lens { aperture: aperture(sine, 0), ..Lens::default() }),
        flat(Lens { aperture: aperture(sine, 3), ..Lens::default() }),
    ]
    .iter()
    .map(|camera| RayGenerator::new(camera, 640, 480, DVec3::ZERO, 1.0).unwrap_or_else(|e| panic!("{e}")))
    .collect()
}

#[test]
fn all_widths_have_the_same_bits() {
    let mut state = 3u64;
    let mut random = |scale: f32| -> Row {
        std::array::from_fn(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            scale * ((state >> 40) as f32 / (1 << 24) as f32)
        })
    };
    for (index, camera) in cameras().iter().enumerate() {
        for round in 0..200 {
            let (place, u) = ([random(640.0), random(480.0)], [random(1.0), random(1.0)]);
            let lens = (round % 4 != 0).then_some(&u);
            for set in InstructionSet::all() {
                let found = dispatch!(set, F, token => rays::<F>(token, camera, &place, lens));
                for lane in 0..MAX_WIDTH {
                    let (x, y) = (place[0][lane], place[1][lane]);
                    let one = camera.camera_ray(x, y, lens.map(|u| [u[0][lane], u[1][lane]]));
                    let (origin, direction) = (one.ray.origin.to_array(), one.ray.direction.to_array());
                    let expected = [&origin[..], &direction[..], &[one.weight, one.start]].concat();
                    let bits = |x: &f32| x.to_bits();
                    assert_eq!(
                        found.iter().map(|row| bits(&row[lane])).collect::<Vec<_>>(),
                        expected.iter().map(bits).collect::<Vec<_>>(),
                        "camera {index} at {x}, {y} with {set:?}"
                    );
                }
            }
        }
    }
}

/// A field of one degree, a window of 20 000 pixels and a distance of a kilometre. The reference is the projection.
#[test]
fn directions_have_the_precision_of_single_numbers() {
    let camera = &cameras()[1];
    for k in 0..1000u16 {
        let (x, y) = (f32::from(k) * 0.64, f32::from(k % 480));
        let ray = camera.ray(x, y);
        // A point in the scene has the error of the start, one far behind it that of the direction.
        for t in [0.5, 1e7] {
            let point = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
            let found = camera.project(point).expect("in front of the camera");
            // A rendered pixel has 2.33e-6 rad.
            let error = (found[0] - f64::from(x)).hypot(found[1] - f64::from(y)) * 2.33e-6;
            assert!(error < 1e-7, "{error:e} rad at {x}, {y}, {t} m");
        }
    }
}
