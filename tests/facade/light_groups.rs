//! Films of groups of lights: they add up to the film of all lights, and each is that of a render with its lights.
//! `crates/engine/film/src/weighted.rs` has the variance of a sum. Replay: `cargo test -p dunkelfeld --test it light_groups::NAME`.

use crate::support::RATE;
use dunkelfeld::film::{CheckpointSettings, mean_image};
use dunkelfeld::film::{FilmLayers, PixelSums};
use dunkelfeld::light_layers::{add_light_layers, sum_of_means};
use dunkelfeld::outputs::encode_layers;
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{Budget, ExposeSettings, Exposer, Project, RenderedFilm, develop_film};
use dunkelfeld_testkit::z_test;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
/// Side of the regions whose means are compared \[pixels\].
const REGION: u32 = 16;

/// A plate with a metal ball under all kinds of light: a panel, LEDs before a plate, two boxes that glow and share a
/// name, a point light, a sun and an environment.
const JOB: &str = r#"
scene = "none"
seed = 3
film = { width = 64, height = 48 }
sensor = { model = "imx250", exposure = "4ms" }
camera = { position = [0, "300mm", 0], look_at = [0, 0, 0], up = [0, 0, -1], vertical_fov = "30deg" }
environment = { radiance = [0.2, 0.3, 0.4] }

[[object]]
name = "plate"
kind = "box"
size = ["300mm", "4mm", "300mm"]
translate = [0, "-2mm", 0]

[[object]]
name = "ball"
kind = "sphere"
diameter = "50mm"
translate = ["-40mm", "25mm", 0]

[[object]]
name = "glow"
kind = "box"
size = ["10mm", "10mm", "50mm"]
translate = ["40mm", "5mm", 0]

[[object]]
name = "other glow"
kind = "box"
size = ["10mm", "10mm", "10mm"]
translate = ["20mm", "5mm", "40mm"]

[[material]]
name = "plate"
base_color = 0.4
roughness = 0.8

[[material]]
name = "ball"
base_color = [0.9, 0.8, 0.6]
metallic = 1
roughness = 0.3

[[light]]
name = "glow"
radiance = [2, 1, 0.5]

[[light]]
name = "other glow"
radiance = 3

[[light]]
name = "panel"
kind = "panel"
width = "60mm"
height = "60mm"
position = ["-150mm", "200mm", 0]
target = [0, 0, 0]
power = 0.3

[[light]]
name = "bar"
kind = "bar"
width = "80mm"
height = "20mm"
leds = [6, 2]
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = 0.2

[[light]]
name = "point"
kind = "point"
position = [0, "250mm", "80mm"]
power = 0.3

[[light]]
name = "sun"
kind = "sun"
irradiance = 2
direction = [1, 2, 0.5]
"#;

const LIGHTS: [&str; 7] = ["glow", "other glow", "panel", "bar", "point", "sun", "environment"];

fn opened(spp: f64) -> Project {
    let mut project = Project::from_text("lights.toml", JOB).expect("a valid job");
    project.settings.budget = Budget::default().with_spp(spp);
    project.settings.run.layers = FilmLayers::All;
    project
}

fn film(project: &Project) -> RenderedFilm {
    project.render().expect("rendered").rendering.film
}

/// A group for each of these names.
fn groups(names: &[&str]) -> Vec<Vec<String>> {
    names.iter().map(|name| vec![(*name).to_owned()]).collect()
}

/// Mean and variance of the mean of each region and channel.
fn regions(film: &dunkelfeld::film::Film) -> Vec<[f64; 2]> {
    let corners =
        (0..HEIGHT).step_by(REGION as usize).flat_map(|y| (0..WIDTH).step_by(REGION as usize).map(move |x| (x, y)));
    let region = |(x0, y0): (u32, u32)| {
        let mut channels = [[0.0; 2]; 3];
        for (x, y) in (y0..y0 + REGION).flat_map(|y| (x0..x0 + REGION).map(move |x| (x, y))) {
            let sums = film.pixel(x, y);
            let (mean, variance) = (sums.mean(), sums.variance_of_mean());
            for (channel, [sum, of_sum]) in channels.iter_mut().enumerate() {
                *sum += mean[channel];
                *of_sum += variance[channel];
            }
        }
        let pixels = f64::from(REGION * REGION);
        channels.map(|[sum, variance]| [sum / pixels, variance / (pixels * pixels)])
    };
    corners.flat_map(region).collect()
}

/// Compares the regions of two independent films. The false-alarm rate of a region is 1e-9. Regions in `noisy` may be noisier
/// than 5 % of their mean.
fn assert_equal(a: &[[f64; 2]], b: &[[f64; 2]], what: &str) {
    for (number, (a, b)) in a.iter().zip(b).enumerate() {
        z_test(b[0] - a[0], (a[1] + b[1]).sqrt(), 0.0).assert(RATE, &format!("{what}: region and channel {number}"));
    }
}

/// The film of all lights has the same bits with groups and without, on any number of threads. The groups have its samples,
/// and add up to it: each of the few contributions to a sample is rounded to 2^-24 of it.
#[test]
fn groups_change_no_bit_and_add_up() {
    let mut project = opened(20.0);
    let plain = film(&project);
    assert_eq!(project.scene.light_names(), LIGHTS);
    project.settings.run.light_groups =
        vec![vec!["glow".into(), "sun".into()], vec!["panel".into()], vec!["bar".into()]];
    project.settings.run.threads = 1;
    let one = film(&project);
    project.settings.run.threads = 3;
    let three = film(&project);
    assert_eq!((one.sums == plain.sums, three.sums == plain.sums), (true, true));
    assert_eq!(one.groups.len(), 4, "the other lights have a film");
    assert!(one.groups == three.groups);
    for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
        let whole = plain.sums.pixel(x, y);
        let of_groups: Vec<PixelSums> = one.groups.iter().map(|film| film.pixel(x, y)).collect();
        assert!(of_groups.iter().all(|group| group.counts == whole.counts && group.invalid == whole.invalid));
        for channel in 0..3 {
            let sum: f64 = of_groups.iter().map(|group| group.mean()[channel]).sum();
            assert!((sum / whole.mean()[channel] - 1.0).abs() < 1e-5, "{x}, {y}");
        }
    }
    // Factors of 1 are the render.
    let same = one.weighted(&[1.0; 4]).expect("four factors");
    assert!(same == plain);
}

/// The film of a group is that of a render in which the other lights are dark.
#[test]
fn a_group_is_a_render_with_its_lights() {
    let mut project = opened(64.0);
    project.settings.run.light_groups = groups(&LIGHTS);
    let films = film(&project).groups;
    assert_eq!(films.len(), LIGHTS.len());
    let all: Vec<_> = films.iter().map(regions).collect();
    for (number, name) in LIGHTS.iter().enumerate() {
        let dark = LIGHTS[..6].iter().filter(|other| *other != name);
        let dark = dark.map(|other| format!("[[light]]\nname = \"{other}\"\nscale = 0\n")).collect::<String>();
        let sky = if *name == "environment" { "" } else { "[environment]\nradiance = 0\n" };
        let mut alone = opened(64.0);
        alone.set_overrides(&format!("{sky}{dark}")).expect("names of the job");
        alone.settings.seed = 100 + number as u64;
        let alone = regions(&film(&alone).sums);
        assert_equal(&all[number], &alone, name);
        // The test finds the light of another group.
        let other = &all[(number + 1) % LIGHTS.len()];
        let error = |(a, b): (&[f64; 2], &[f64; 2])| ((a[0] - b[0]).powi(2) / (a[1] + b[1])).sqrt();
        let largest = other.iter().zip(&alone).map(error).fold(0.0, f64::max);
        assert!(largest > 10.0, "{name}: {largest}");
    }
}

/// The settings of the exposure of the job.
fn camera(project: &Project, noise: ExposureNoise) -> ExposeSettings {
    let settings = project.fitted().expect("a valid job");
    ExposeSettings::of_render(&settings).expect("valid").expect("a sensor").with_exposure_noise(noise)
}

/// Electrons and their variances \[e^-2\], as certified.
fn certified_variances(film: &RenderedFilm, settings: &ExposeSettings) -> (Vec<f32>, Vec<f64>) {
    let exposer = Exposer::of_film(film, settings).expect("valid");
    let ratios = exposer.certify(film, 1.0).expect("a sensor").ratios;
    let model = exposer.model();
    let of_sensor =
        |&e: &f32| model.temporal_variance(dunkelfeld::radiometry::Electrons(e.into()), exposer.exposure().time());
    let found = exposer.electrons().data().iter().zip(ratios.data()).map(|(e, ratio)| of_sensor(e) * f64::from(*ratio));
    (exposer.electrons().data().to_vec(), found.collect())
}

/// The means of groups add up to the mean of the weighted film, and an EXR has the layers of the groups.
#[test]
fn an_exr_has_the_sum_and_a_layer_for_each_group() {
    let mut project = opened(16.0);
    project.settings.run.light_groups = groups(&LIGHTS);
    let (rendered, factors) = (film(&project), [0.5, 0.0, 3.0, 1.0, 2.0, 0.25, 4.0]);
    let weighted = rendered.weighted(&factors).expect("seven factors");
    let means: Vec<_> = rendered.groups.iter().map(|film| mean_image(film, rendered.is_spread)).collect();
    let sum = sum_of_means(&means.iter().zip(factors).collect::<Vec<_>>()).expect("one size");
    let mean = mean_image(&weighted.sums, weighted.is_spread);
    for (sum, mean) in sum.radiance.data().iter().flatten().zip(mean.radiance.data().iter().flatten()) {
        assert!((sum - mean).abs() <= 1e-6 * mean, "{sum} {mean}");
    }
    let settings = project.fitted().expect("a valid job");
    let frame = develop_film(&weighted, &settings).expect("a frame");
    let mut layers = encode_layers(&weighted, &frame, &settings);
    let before = layers.channels.len();
    let lights: Vec<_> = LIGHTS.into_iter().zip(factors).collect();
    add_light_layers(&mut layers, &rendered, &lights);
    assert_eq!(layers.channels.len(), before + 3 * LIGHTS.len());
    for (name, mean) in LIGHTS.iter().zip(&means) {
        let green: Vec<f32> = mean.radiance.data().iter().map(|pixel| pixel[1]).collect();
        let channel = layers.channel(&format!("light.{name}.G")).expect("a layer");
        assert!(*channel == dunkelfeld_io::exr::Channel::F32(green), "{name}");
    }
    let attributes: serde_json::Value = serde_json::from_str(&layers.attributes).expect("JSON");
    assert_eq!((&attributes["lights"][2]["factor"], &attributes["seed"]), (&3.0.into(), &3.into()));
}

/// A variance that is unknown stays unknown, and an image without light has none.
#[test]
fn unknown_variances_stay_unknown() {
    let mut project = opened(1.0);
    project.settings.run.light_groups = groups(&["sun"]);
    let settings = camera(&project, ExposureNoise::Matched);
    let film = film(&project);
    let share = |factors: [f64; 2]| {
        let weighted = film.weighted(&factors).expect("two factors");
        let (_, variances) = certified_variances(&weighted, &settings);
        variances.iter().filter(|v| v.is_finite()).count() as f64 / variances.len() as f64
    };
    assert_eq!(share([0.5, 1.0]), 0.0);
}

#[test]
fn wrong_groups_are_refused() {
    let mut project = opened(1.0);
    let error = |project: &Project| project.render().expect_err("refused").to_string();
    project.settings.run.light_groups = groups(&["moon"]);
    assert!(error(&project).contains("no light \"moon\""), "{}", error(&project));
    project.settings.run.light_groups = groups(&["sun"; 64]);
    assert!(error(&project).contains("64 groups"), "{}", error(&project));
    project.settings.run.light_groups = groups(&["sun"]);
    project.settings.run.checkpoint = Some(CheckpointSettings::new("none.ckpt"));
    assert!(error(&project).contains("checkpoint"), "{}", error(&project));
    project.settings.run.checkpoint = None;
    let film = film(&project);
    assert_eq!(film.groups.len(), 2);
    for wrong in [&[][..], &[1.0], &[1.0, -1.0], &[f64::NAN, 1.0], &[f64::INFINITY, 1.0]] {
        assert!(film.weighted(wrong).is_err(), "{wrong:?}");
    }
}

/// With covers of clear plastic, whose light the connection through covers samples.
#[test]
#[ignore = "long: .ci/run runs it"]
fn groups_behind_covers_add_up() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/inspection/inspection.toml");
    let mut project = Project::open(path).expect("a shipped scene");
    project.resize_keeping_view(WIDTH, HEIGHT);
    project.settings.budget = Budget::default().with_spp(32.0);
    let plain = film(&project);
    project.settings.run.light_groups = project.scene.light_names().into_iter().map(|name| vec![name]).collect();
    let film = film(&project);
    assert!(film.sums == plain.sums);
    let whole = regions(&film.sums);
    let groups: Vec<_> = film.groups.iter().map(regions).collect();
    for (number, whole) in whole.iter().enumerate() {
        let sum: f64 = groups.iter().map(|group| group[number][0]).sum();
        assert!((sum / whole[0] - 1.0).abs() < 1e-5, "region and channel {number}");
    }
}
