//! Cameras of a job through the whole program: pose and camera matrix of OpenCV, working distance, parts of the film.
//!
//! Replay: `cargo test -p dunkelfeld --test it job_cameras::NAME`.

use dunkelfeld::geometry::DVec3;
use dunkelfeld::scene::RayGenerator;
use dunkelfeld::{Error, Project, RenderOptions, RenderSettings, SensorChoice};
use std::fs;
use tempfile::TempDir;

/// A folder with a square of 2 m x 2 m in the plane y = 0.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        fs::write(folder.path().join("square.obj"), "o square\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nf 1 2 3 4\n")
            .expect("writable");
        Self(folder)
    }

    fn try_open(&self, job: &str) -> Result<Project, Error> {
        let path = self.0.path().join("job.toml");
        fs::write(&path, format!("scene = \"square.obj\"\n{job}")).expect("writable");
        Project::open(path)
    }

    fn open(&self, job: &str) -> Project {
        self.try_open(job).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
    }
}

fn fitted(project: &Project) -> RenderSettings {
    project.fitted().unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

/// The rays of a project, in world space.
fn film(project: &Project) -> RayGenerator {
    let settings = fitted(project);
    let view = settings.run.view.as_ref().expect("a view");
    RayGenerator::new(view, settings.width, settings.height, DVec3::ZERO, 1e3).expect("valid")
}

/// OpenCV's projection of a point of the world to a film point: u = fx x'' + cx of the distorted place x'', plus 0.5,
/// because OpenCV counts from the middle of the first pixel.
fn opencv(point: [f64; 3]) -> [f64; 2] {
    let [x, y, z] = [0, 1, 2].map(|i| (0..3).map(|j| R[i][j] * point[j]).sum::<f64>() + T[i]);
    let (x, y) = (x / z, y / z);
    let [k1, k2, p1, p2, k3] = DISTORTION;
    let s = x * x + y * y;
    let radial = 1.0 + k1 * s + k2 * s * s + k3 * s * s * s;
    let u = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x);
    let v = y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y;
    [FX * u + CX + 0.5, FY * v + CY + 0.5]
}

/// A camera 0.8 m above the plane, tilted by the rotation about its x axis with the sine 0.28 and the cosine 0.96.
const R: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.28, 0.96], [0.0, -0.96, 0.28]];
const T: [f64; 3] = [0.05, -0.02, 0.8];
const FX: f64 = 900.0;
const FY: f64 = 850.0;
const CX: f64 = 310.5;
const CY: f64 = 250.25;
const DISTORTION: [f64; 5] = [-0.18, 0.06, 0.0008, -0.0011, -0.01];

fn calibrated(film: &str) -> String {
    format!(
        "[film]\n{film}\n[lens]\ndistortion = {DISTORTION:?}\n[camera]\nR = {R:?}\nt = {T:?}\n\
         K = [[{FX:?}, 0, {CX:?}], [0, {FY:?}, {CY:?}], [0, 0, 1]]\n"
    )
}

/// Points of the plane near the middle of the view.
fn points() -> impl Iterator<Item = [f64; 3]> {
    (0..25).map(|i| [0.09 * f64::from(i % 5 - 2), 0.0, 0.07 * f64::from(i / 5 - 2)])
}

#[test]
fn a_calibrated_camera_projects_as_opencv_does() {
    let bench = Bench::new();
    let project = bench.open(&calibrated("width = 640\nheight = 480"));
    let camera = film(&project);
    for point in points() {
        let (found, expected) = (camera.project(DVec3::from_array(point)).expect("in view"), opencv(point));
        for k in 0..2 {
            assert!((found[k] - expected[k]).abs() < 1e-3, "{point:?}: {found:?} instead of {expected:?}");
        }
    }
    // With half of the pixels the field of view stays.
    let mut half = project;
    (half.settings.width, half.settings.height) = (320, 240);
    let camera = film(&half);
    for point in points() {
        let (found, expected) = (camera.project(DVec3::from_array(point)).expect("in view"), opencv(point));
        for k in 0..2 {
            assert!((2.0 * found[k] - expected[k]).abs() < 1e-3, "{point:?}: {found:?}, half of {expected:?}");
        }
    }
}

#[test]
fn a_region_of_interest_has_the_rays_of_the_whole_film() {
    let bench = Bench::new();
    let whole = film(&bench.open(&calibrated("width = 640\nheight = 480")));
    let region = bench.open(&calibrated("width = 640\nheight = 480\nroi = [100, 52, 64, 48]"));
    assert_eq!((region.settings.width, region.settings.height), (64, 48));
    let region = film(&region);
    for (x, y) in (0..64).flat_map(|x| (0..48).map(move |y| (x as f32 + 0.5, y as f32 + 0.5))) {
        assert_eq!(region.ray(x, y), whole.ray(x + 100.0, y + 52.0), "{x}, {y}");
    }
    let binned = bench.open(&calibrated("width = 640\nheight = 480\nbinning = 2"));
    let pitch = |settings: &RenderSettings| match &settings.sensor {
        SensorChoice::Emva { model, .. } => model.spec().pixel_pitch.micrometres(),
        SensorChoice::None => panic!("no sensor"),
    };
    assert_eq!((binned.settings.width, binned.settings.height), (320, 240));
    assert!((pitch(&fitted(&binned)) - 6.9).abs() < 1e-9, "two pixels of 3.45 um");
    let binned = film(&binned);
    assert_eq!(binned.ray(17.25, 203.5), whole.ray(34.5, 407.0));
}

#[test]
fn a_full_film_has_the_resolution_of_its_sensor() {
    let bench = Bench::new();
    let mut project = bench.open("[film]\nfull = true\n");
    assert_eq!((project.settings.width, project.settings.height), (2448, 2048));
    let options = RenderOptions::default().with_keys("sensor.model = 'imx174'");
    project.apply_options(options).expect("a known resolution");
    assert_eq!((project.settings.width, project.settings.height), (1920, 1200));
    for (name, _) in dunkelfeld::sensor::PRESETS {
        assert!(bench.try_open(&format!("[film]\nfull = true\n[sensor]\nmodel = \"{name}\"")).is_ok(), "{name}");
    }
    // A sensor file need not contain a resolution.
    let sensor = include_str!("../../crates/camera/sensor/presets/imx492.toml");
    let sensor: String =
        sensor.lines().filter(|line| !line.starts_with("resolution")).map(|l| format!("{l}\n")).collect();
    fs::write(bench.0.path().join("own.toml"), sensor).expect("writable");
    for (job, place, problem) in [
        ("[film]\nfull = true\n[sensor]\nmodel = \"own.toml\"", "[film] full", "resolution"),
        ("[film]\nfull = true\nroi = [2400, 0, 49, 1]", "[film] roi", "ends at 2449, 1"),
        ("[film]\nwidth = 64\nroi = [0, 0, 65, 1]", "[film] roi", "ends at 65, 1"),
    ] {
        match bench.try_open(job) {
            Err(Error::Input(e)) => assert!(e.place == place && e.problem.contains(problem), "{e}"),
            other => panic!("{job}: {:?}", other.map(|_| ())),
        }
    }
}

/// The image of the plane at the working distance u has the magnification m = f / (u - f).
#[test]
fn a_working_distance_and_a_focal_length_give_the_size_of_the_image() {
    let bench = Bench::new();
    let lens = |keys: &str| {
        format!(
            "[film]\nfull = true\n[camera]\nlook_at = \"square\"\nworking_distance = \"200mm\"\nlens = {{ {keys} }}\n"
        )
    };
    let (f, u) = (0.025, 0.2);
    let m = f / (u - f);
    // The camera looks down, with -z of the world up in the image.
    let edge = 1024.0 * 3.45e-6 / m;
    for keys in ["focal_length = \"25mm\"".to_string(), format!("magnification = {m}")] {
        let project = bench.open(&lens(&keys));
        let camera = film(&project);
        let [x, y] = camera.project(DVec3::new(0.0, 0.0, -edge)).expect("in view");
        assert!((x - 1224.0).abs() < 1e-3 && y.abs() < 1e-3, "{keys}: {x}, {y}");
        let settings = fitted(&project);
        let SensorChoice::Emva { optics, .. } = &settings.sensor else { panic!("no sensor") };
        assert!((optics.magnification() - m).abs() < 1e-9, "{keys}: the light of the image");
        assert_eq!(settings.run.view.expect("a view").lens.aperture, None, "everything is sharp");
    }
}
