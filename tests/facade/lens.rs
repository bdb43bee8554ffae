//! Where lens, film and sensor meet: jobs become cameras whose rays and whose sensor agree with each other, with the
//! thin-lens equation, and with the light that a real aperture lets through.
//!
//! Replay: `cargo test -p dunkelfeld --test it lens::NAME`.

use crate::support::{RATE, build, film, pixel_moments, settings, square};
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Radiance;
use dunkelfeld::scene::shapes::rectangle;
use dunkelfeld::scene::{Aperture, Camera, Lens, Opening, Projection, SceneBuilder};
use dunkelfeld::sensor::Optics;
use dunkelfeld::{Project, RenderSettings, SensorChoice, find_sensor};
use dunkelfeld_testkit::{Claim, Estimate, SampleMoments, z_test};
use std::f64::consts::PI;
use std::fs;
use tempfile::TempDir;

/// A perspective and an orthographic camera.
const GLTF: &str = r#"{
  "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0, 1] }],
  "nodes": [{ "name": "wide", "camera": 0 }, { "name": "flat", "camera": 1 }],
  "cameras": [
    { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.01 } },
    { "type": "orthographic", "orthographic": { "xmag": 0.02, "ymag": 0.015, "zfar": 9, "znear": 0.01 } }
  ]
}"#;

/// A job with these keys and cameras.
fn open(job: &str) -> Project {
    let folder = TempDir::new().expect("a temporary folder");
    fs::write(folder.path().join("cameras.gltf"), GLTF).expect("writable");
    let path = folder.path().join("job.toml");
    fs::write(&path, format!("scene = \"cameras.gltf\"\n{job}")).expect("writable");
    Project::open(path).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

fn view(project: &Project) -> Camera {
    project.fitted().unwrap_or_else(|e| panic!("{e}\n{}", e.caret())).run.view.expect("a view")
}

fn field(project: &Project) -> f64 {
    match view(project).projection {
        Projection::Perspective { vertical_fov } => f64::from(vertical_fov),
        other => panic!("{other:?}"),
    }
}

fn opening(project: &Project) -> Opening {
    view(project).lens.aperture.expect("a finite aperture").opening
}

fn optics(settings: &RenderSettings) -> Optics {
    match &settings.sensor {
        SensorChoice::Emva { optics, .. } => optics.clone(),
        SensorChoice::None => panic!("no sensor"),
    }
}

fn close(got: f64, expected: f64) {
    assert!((got / expected - 1.0).abs() < 1e-6, "{got} instead of {expected}");
}

/// The pixels of the imx250 and the imx174 have 3.45 um and 5.86 um.
#[test]
fn the_field_of_a_focal_length_follows_film_and_sensor_as_they_are_when_rendered() {
    let mut project = open("[film]\nheight = 400\n[lens]\nfocal_length = \"12mm\"");
    let of = |rows: f64, pitch: f64| 2.0 * (0.5 * rows * pitch / 0.012).atan();
    close(field(&project), of(400.0, 3.45e-6));
    project.settings.height = 2048;
    close(field(&project), of(2048.0, 3.45e-6));
    // Another sensor has other pixels; without one, the lens keeps those that it had.
    let model = Box::new(find_sensor("imx174").expect("a preset"));
    project.settings.sensor = SensorChoice::Emva { model, optics: project.optics.clone(), exposure: None };
    close(field(&project), of(2048.0, 5.86e-6));
    project.settings.sensor = SensorChoice::None;
    close(field(&project), of(2048.0, 3.45e-6));
    // A film of given size on the sensor has the same field for any number of pixels.
    project = open("[film]\nsensor_height = \"7mm\"\n[lens]\nfocal_length = \"12mm\"");
    for height in [100, 900] {
        project.settings.height = height;
        close(field(&project), 2.0 * (0.5f64 * 0.007 / 0.012).atan());
    }
    project = open("[film]\nwidth = 200\nheight = 50\nsensor_width = \"8mm\"\n[lens]\nfocal_length = \"12mm\"");
    close(field(&project), 2.0 * (0.5f64 * 0.002 / 0.012).atan());
    // Close up, the film stands farther from the lens: f (1 + m).
    project = open("[film]\nheight = 400\n[lens]\nfocal_length = \"12mm\"\nmagnification = 0.5");
    close(field(&project), 2.0 * (0.5 * 400.0 * 3.45e-6 / 0.018f64).atan());
    // A job without keys leaves the camera as it is.
    close(field(&open("")), 0.5);
    assert_eq!(view(&open("")).lens, Lens::default());
}

#[test]
fn a_focused_lens_obeys_the_thin_lens_equation_on_both_sides() {
    let (f, n, u, rows) = (0.025f64, 2.8f64, 0.3f64, 1000.0f64);
    let project = open(
        "[film]\nheight = 1000\n[lens]\nfocal_length = \"25mm\"\nf_number = 2.8\nfocus_distance = \"300mm\"\nblades = 6",
    );
    let v = 1.0 / (1.0 / f - 1.0 / u);
    close(field(&project), 2.0 * (0.5 * rows * 3.45e-6 / v).atan());
    let Opening::Radius(radius) = opening(&project) else { panic!("a radius") };
    close(radius, 0.5 * f / n);
    let aperture = view(&project).lens.aperture.expect("finite");
    assert_eq!((aperture.focus_distance, aperture.blades.map(|b| b.count)), (u, Some(6)));
    // The sensor's irradiance is that of the cone that the pupil fills: pi L tau (r / v)^2.
    let light = optics(&project.fitted().expect("fits")).irradiance(Radiance(2.0)).0;
    close(light, PI * 2.0 * 0.9 * (radius / v).powi(2));
    // From the camera's own field of 0.5 rad the focal length follows, and the same relations hold.
    let project = open("[film]\nheight = 1000\n[lens]\nf_number = 2.8\nfocus_distance = \"300mm\"");
    let v = 0.5 * rows * 3.45e-6 / 0.25f64.tan();
    let Opening::Radius(radius) = opening(&project) else { panic!("a radius") };
    close(radius, 0.5 / (n * (1.0 / u + 1.0 / v)));
    close(optics(&project.fitted().expect("fits")).irradiance(Radiance(2.0)).0, PI * 2.0 * 0.9 * (radius / v).powi(2));
    // Focused at infinity: no magnification.
    let project = open("[lens]\nfocal_length = \"25mm\"\nfocus_distance = inf");
    assert_eq!(optics(&project.fitted().expect("fits")), Optics::new(4.0, 0.9, 0.0).expect("in range"));
    // Optics that were set by hand stay.
    let mut project = open("[lens]\nfocal_length = \"25mm\"\nfocus_distance = 1");
    let mine = Optics::new(11.0, 0.5, 0.25).expect("in range");
    let model = Box::new(find_sensor("imx174").expect("a preset"));
    project.settings.sensor = SensorChoice::Emva { model, optics: mine.clone(), exposure: None };
    assert_eq!(optics(&project.fitted().expect("fits")), mine);
}

#[test]
fn a_telecentric_lens_agrees_with_its_sensor() {
    let size = |project: &Project| match view(project).projection {
        Projection::Orthographic { half_width, half_height } => (f64::from(half_width), f64::from(half_height)),
        other => panic!("{other:?}"),
    };
    // 1000 rows of 3.45 um at magnification 0.25 cover 13.8 mm.
    let telecentric = "[film]\nwidth = 500\nheight = 1000\n[lens]\nprojection = \"telecentric\"\n";
    let project = open(&format!("{telecentric}magnification = 0.25\nf_number = 8\nfocus_distance = \"110mm\""));
    let (half_width, half_height) = size(&project);
    close(half_height, 0.0069);
    close(half_width, 0.00345);
    let Opening::NumericalAperture(sine) = opening(&project) else { panic!("a sine") };
    // The sine on the image's side is NA / m; it fills pi L tau (NA / m)^2.
    close(optics(&project.fitted().expect("fits")).irradiance(Radiance(2.0)).0, PI * 2.0 * 0.9 * (sine / 0.25).powi(2));
    // The other way round: field and numerical aperture are given, f-number and magnification follow.
    let project = open(&format!("{telecentric}field_height = \"34.5mm\"\nnumerical_aperture = 0.01"));
    assert_eq!(view(&project).lens.aperture, None, "no focus distance, no blur");
    close(
        optics(&project.fitted().expect("fits")).irradiance(Radiance(2.0)).0,
        PI * 2.0 * 0.9 * (0.01f64 / 0.1).powi(2),
    );
    // An orthographic camera of the scene keeps its field.
    let project = open("camera = \"flat\"\n[lens]\nf_number = 2\nfocus_distance = 0.2\n[film]\nheight = 1000");
    let (half_width, half_height) = size(&project);
    close(half_width, 0.02);
    close(half_height, 0.015);
    let m = 3.45e-3 / (2.0 * 0.02);
    let Opening::NumericalAperture(sine) = opening(&project) else { panic!("a sine") };
    // The film is 512 pixels wide: the camera's larger extent, its width of 40 mm at aspect 0.512, sets the height.
    let m = m * 0.512;
    close(sine, m / (2.0 * 2.0 * (1.0 + m)));
}

/// A bright square on the axis, half as wide as the blur that a far plane has in the aperture's image: the share of the
/// pupil through which the middle of the film sees it is one of areas.
#[test]
fn a_pixel_receives_the_unoccluded_share_of_the_pupil() {
    let (radius, focus, at) = (0.02, 2.0, 1.0);
    let side = 0.012f32;
    let mut b = SceneBuilder::default();
    let lamp = b.add_material(crate::support::emitter(1.0));
    b.add_object("lamp", square(0.0, side, false), lamp);
    let aperture = Some(Aperture { opening: Opening::Radius(radius), focus_distance: focus, blades: None });
    b.add_camera("camera", DVec3::new(0.0, 0.0, at), DVec3::ZERO, 1e-6);
    b.cameras[0].lens.aperture = aperture;
    let scene = build(b);
    let mean = pixel_moments(&film(&scene, &settings(32, 32, 256.0, 5)));
    // Rays from the whole pupil to the focus cross the plane of the lamp in a disc of half the pupil's radius.
    let crossed = radius * (1.0 - at / focus);
    let share = f64::from(side).powi(2) / (PI * crossed * crossed);
    assert!(f64::from(side) * 0.5f64.sqrt() < crossed, "the lamp lies inside the disc");
    z_test(mean.mean(), mean.standard_error(), share).assert(RATE, "share of the pupil");
    assert!(mean.standard_error() < 2e-3 * share);
}

/// The share of a telecentric pupil of numerical aperture `na` whose rays, a distance `t` times off the plane that is sharp,
/// cross it to the left of an edge: those of the disc of direction sines with `x / sqrt(1 - x^2 - y^2) < t`.
fn share_left_of(t: f64, na: f64) -> f64 {
    if t < 0.0 {
        return 1.0 - share_left_of(-t, na);
    }
    const STEPS: usize = 400;
    // y = na sin(angle): the rim of the disc has no root there.
    let strip = |k: usize| {
        let (sin, cos) = (PI * ((k as f64 + 0.5) / STEPS as f64 - 0.5)).sin_cos();
        let y = na * sin;
        (na * cos).min(t * ((1.0 - y * y) / (1.0 + t * t)).sqrt()) * cos
    };
    0.5 + (0..STEPS).map(strip).sum::<f64>() / (STEPS as f64 * na)
}

/// A lamp with a straight edge off the axis, at five depths: the edge's place on the film does not depend on the depth (the
/// magnification does not), nor does the light (the image's side has one aperture); and the edge is blurred as a disc of
/// radius |depth| tan(asin NA) blurs it, column by column.
#[test]
fn a_telecentric_lens_keeps_its_scale_and_blurs_by_its_aperture() {
    const PIXELS: usize = 64;
    let (na, m, focus, edge) = (0.1f64, 0.25f64, 0.11f64, 1e-4f64);
    let project = open(&format!(
        "[film]\nwidth = {PIXELS}\nheight = {PIXELS}\n[lens]\nprojection = \"telecentric\"\nmagnification = {m}\n\
         numerical_aperture = {na}\nfocus_distance = {focus}"
    ));
    // A pixel of the imx250, seen through the lens.
    let pixel = 3.45e-6 / m;
    let half = 0.5 * PIXELS as f64 * pixel;
    for depth in [-3e-3f64, -1e-3, 0.0, 1e-3, 3e-3] {
        let mut b = SceneBuilder::default();
        let lamp = b.add_material(crate::support::emitter(1.0));
        let corner = Vec3::new(-0.01, -0.01, (-focus - depth) as f32);
        b.add_object("lamp", rectangle(corner, Vec3::X * (0.01 + edge) as f32, Vec3::Y * 0.02), lamp);
        b.cameras.push(view(&project));
        let scene = build(b);
        // Each look renders once, for all columns.
        let mut films: Vec<Film> = Vec::new();
        let mut columns = |look: u32| -> Vec<SampleMoments> {
            while films.len() <= look as usize {
                let k = films.len() as u32;
                let spp = 128.0 * f64::from(1u32 << (2 * k));
                films.push(film(&scene, &settings(PIXELS as u32, PIXELS as u32, spp, 40 + u64::from(k))));
            }
            let pixels = films[look as usize].sums();
            (0..PIXELS).map(|x| pixels.data().iter().skip(x).step_by(PIXELS).map(|p| p.mean()[1]).collect()).collect()
        };
        let blur = depth.abs() * na.asin().tan();
        for x in 0..PIXELS {
            let left = x as f64 * pixel - half;
            let share = |k: usize| {
                let off = edge - (left + (k as f64 + 0.5) / 64.0 * pixel);
                if blur == 0.0 { f64::from(off > 0.0) } else { share_left_of(off / depth.abs(), na) }
            };
            // The sharp edge cuts one column at a known place.
            let expected = if blur == 0.0 {
                ((edge - left) / pixel).clamp(0.0, 1.0)
            } else {
                (0..64).map(share).sum::<f64>() / 64.0
            };
            // Rays start 1e-8 m from where they should, and of 8192 samples a share of 10 / n may go unseen.
            let unseen = expected.min(1.0 - expected).min(10.0 / 8192.0);
            let claim = Claim { expected, tolerance: 1e-8 / blur.max(pixel) + unseen, sure: 1e-2 };
            claim.assert(&format!("depth {depth} m, column {x}"), |look| columns(look)[x].into());
        }
        // All of the blur lies on the film: its mean is the place of the edge, to a fortieth of a pixel.
        assert!(edge + blur < half, "the blur of {blur} m fits");
        let claim = Claim { expected: 0.5 + 0.5 * edge / half, tolerance: 1e-5, sure: 4e-4 };
        claim.assert(&format!("depth {depth} m, the edge"), |look| {
            let columns = columns(look);
            let n = PIXELS as f64;
            let error = columns.iter().map(|c| Estimate::from(*c).standard_error.powi(2)).sum::<f64>().sqrt() / n;
            Estimate { value: columns.iter().map(SampleMoments::mean).sum::<f64>() / n, standard_error: error }
        });
    }
}
