//! Films of single lights: they add up to the film of all lights, and the variance of their sum is the one that repeated
//! renders have. Replay: `cargo test --workspace --test it light_films::NAME`.

use crate::support::RATE;
use dunkelfeld::film::{FilmLayers, MeanImage, Plane};
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{
    Budget, ExposeSettings, Exposer, FilmOfLight, Project, RenderedFilm, develop_film, develop_films, encode_layers,
    encode_light_layers, mean_image, sum_of_means,
};
use dunkelfeld_io::exr::ExrLayers;
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_testkit::{SampleMoments, student_t_test, z_test};

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
    project.settings.layers = FilmLayers::All;
    project
}

fn film(project: &Project) -> RenderedFilm {
    project.render().expect("rendered").rendering.film
}

/// The films of all lights, each with its own seed.
fn films(project: &mut Project, seed: u64) -> Vec<(String, RenderedFilm)> {
    let names = project.light_names();
    let of_light = |(name, number): (String, u64)| {
        let mut one = project.only_light(&name).expect("a scene");
        one.settings.seed = seed + number;
        (name, film(&one))
    };
    names.into_iter().zip(1..).map(of_light).collect()
}

/// Mean and variance of the mean of each region and channel, of films with factors.
fn regions(films: &[(&RenderedFilm, f64)]) -> Vec<[f64; 2]> {
    let corners =
        (0..HEIGHT).step_by(REGION as usize).flat_map(|y| (0..WIDTH).step_by(REGION as usize).map(move |x| (x, y)));
    let region = |(x0, y0): (u32, u32)| {
        let mut channels = [[0.0; 2]; 3];
        for (film, factor) in films {
            for (x, y) in (y0..y0 + REGION).flat_map(|y| (x0..x0 + REGION).map(move |x| (x, y))) {
                let sums = film.sums.pixel(x, y);
                let (mean, variance) = (sums.mean(), sums.variance_of_mean());
                for (channel, [sum, of_sum]) in channels.iter_mut().enumerate() {
                    *sum += factor * mean[channel];
                    *of_sum += factor * factor * variance[channel];
                }
            }
        }
        let pixels = f64::from(REGION * REGION);
        channels.map(|[sum, variance]| [sum / pixels, variance / (pixels * pixels)])
    };
    corners.flat_map(region).collect()
}

fn standard_errors(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]).powi(2) / (a[1] + b[1])).sqrt()
}

/// Each source of light is in exactly one film. The false-alarm rate of a region is 1e-9.
#[test]
fn films_of_lights_add_up_to_the_film_of_all() {
    let mut project = opened(64.0);
    assert_eq!(project.light_names(), LIGHTS);
    let whole = regions(&[(&film(&project), 1.0)]);
    let lights = films(&mut project, 100);
    let weighted = |leave_out: Option<usize>| -> Vec<(&RenderedFilm, f64)> {
        (0..).zip(&lights).map(|(i, (_, film))| (film, f64::from(u8::from(Some(i) != leave_out)))).collect()
    };
    for (number, (whole, sum)) in whole.iter().zip(regions(&weighted(None))).enumerate() {
        let error = (whole[1] + sum[1]).sqrt();
        assert!(error < 0.05 * whole[0], "region {number} is too noisy: {error}");
        z_test(sum[0] - whole[0], error, 0.0).assert(RATE, &format!("region and channel {number}"));
    }
    // The test finds a light that is missing, and so one that is in two films.
    for (light, (name, _)) in lights.iter().enumerate() {
        let without = regions(&weighted(Some(light)));
        let largest = whole.iter().zip(without).map(|(a, b)| standard_errors(*a, b)).fold(0.0, f64::max);
        assert!(largest > 10.0, "{name}: {largest}");
    }
}

/// Factors are those of the strengths in a job.
#[test]
fn factors_of_films_are_those_of_the_power_of_lights() {
    let mut project = opened(64.0);
    let lights = films(&mut project, 200);
    let factors = [0.5, 0.0, 3.0, 1.0, 2.0, 0.25, 4.0];
    let weighted: Vec<(&RenderedFilm, f64)> = lights.iter().map(|(_, film)| film).zip(factors).collect();
    let sum = regions(&weighted);
    project
        .set_overrides(
            r#"
[environment]
radiance = [0.8, 1.2, 1.6]
[[light]]
name = "glow"
radiance = [1, 0.5, 0.25]
[[light]]
name = "other glow"
radiance = 0
[[light]]
name = "panel"
power = 0.9
[[light]]
name = "point"
power = 0.6
[[light]]
name = "sun"
irradiance = 0.5
"#,
        )
        .expect("names of the job");
    for (number, (whole, sum)) in regions(&[(&film(&project), 1.0)]).into_iter().zip(sum).enumerate() {
        z_test(sum[0] - whole[0], (whole[1] + sum[1]).sqrt(), 0.0)
            .assert(RATE, &format!("region and channel {number}"));
    }
}

/// The settings of the exposure of the job.
fn camera(project: &Project, noise: ExposureNoise) -> ExposeSettings {
    let settings = project.fitted().expect("a valid job");
    ExposeSettings::of_render(&settings).expect("valid").expect("a sensor").with_exposure_noise(noise)
}

fn exposer(films: &[(&RenderedFilm, f64)], settings: &ExposeSettings) -> Exposer {
    let means: Vec<MeanImage> = films.iter().map(|(film, _)| mean_image(&film.sums, film.is_spread)).collect();
    let means: Vec<_> = means.iter().zip(films).map(|(mean, (_, factor))| (mean, *factor)).collect();
    Exposer::of_films(films, &sum_of_means(&means).expect("one size"), None, settings).expect("valid")
}

/// Variances of the electrons \[e^-2\], as certified.
fn certified_variances(films: &[(&RenderedFilm, f64)], settings: &ExposeSettings) -> (Exposer, Vec<f64>) {
    let exposer = exposer(films, settings);
    let variances: Vec<_> = films.iter().map(|(film, factor)| (exposer.film_variances(film), *factor)).collect();
    let variances: Vec<_> = variances.iter().map(|(variances, factor)| (variances, *factor)).collect();
    let ratios = exposer.certify_sum(&variances, 1.0).expect("one size").ratios;
    let model = exposer.model();
    let of_sensor =
        |&e: &f32| model.temporal_variance(dunkelfeld::radiometry::Electrons(e.into()), exposer.exposure().time());
    let found = exposer.electrons().data().iter().zip(ratios.data()).map(|(e, ratio)| of_sensor(e) * f64::from(*ratio));
    let found = found.collect();
    (exposer, found)
}

/// The certified variance of a sum with factors is the variance over renders with other seeds. The sum over the pixels is
/// compared, render by render, with the squared deviations from the mean of these renders.
#[test]
fn the_certified_variance_of_a_sum_is_that_of_repeated_renders() {
    const RENDERS: u64 = 72;
    let mut project = opened(16.0);
    // Without caustics, whose rare samples make any estimate of a variance imprecise.
    project.set_overrides("[[material]]\nname = \"ball\"\nmetallic = 0\nroughness = 0.8\n").expect("a material");
    project.resize_keeping_view(24, 16);
    let factors = [("panel", 2.5), ("bar", 0.4), ("sun", 0.7)];
    let mut scenes = factors.map(|(name, factor)| (project.only_light(name).expect("a scene"), factor));
    let settings = camera(&project, ExposureNoise::Plain);
    let renders: Vec<(Vec<f32>, Vec<f64>)> = (0..RENDERS)
        .map(|render| {
            let mut seeds = 10 * render..;
            let films = scenes.each_mut().map(|(scene, factor)| {
                scene.settings.seed = seeds.next().expect("no end");
                (film(scene), *factor)
            });
            let films: Vec<(&RenderedFilm, f64)> = films.iter().map(|(film, factor)| (film, *factor)).collect();
            let (exposer, variances) = certified_variances(&films, &settings);
            (exposer.electrons().data().to_vec(), variances)
        })
        .collect();
    // The first renders give all pixels about the same weight. The weights are independent of the renders that are compared.
    let (first, compared) = renders.split_at(8);
    let pixels = 0..first[0].0.len();
    let sum_of = |renders: &[(Vec<f32>, Vec<f64>)], pixel: usize| renders.iter().map(|(_, v)| v[pixel]).sum::<f64>();
    let weights: Vec<f64> = pixels.clone().map(|pixel| 8.0 / (sum_of(first, pixel) + 1.0)).collect();
    let count = compared.len() as f64;
    let means: Vec<f64> =
        (pixels.clone()).map(|pixel| compared.iter().map(|(e, _)| f64::from(e[pixel])).sum::<f64>() / count).collect();
    let certified = |variances: &[f64]| -> f64 { pixels.clone().map(|p| weights[p] * variances[p]).sum() };
    let squares = |electrons: &[f32]| -> f64 {
        let square = |p: usize| weights[p] * (f64::from(electrons[p]) - means[p]).powi(2);
        pixels.clone().map(square).sum::<f64>() * count / (count - 1.0)
    };
    let differences: SampleMoments = compared.iter().map(|(e, variances)| squares(e) - certified(variances)).collect();
    let level = compared.iter().map(|(_, variances)| certified(variances)).sum::<f64>() / count;
    let error = differences.standard_error() / level;
    assert!(error < 0.05, "the comparison is too noisy: {error}");
    student_t_test(&differences, 0.0).assert(RATE, "variance over renders against certified variance");
}

/// A single film with the factor 1 is that film, and a factor acts as a longer exposure would.
#[test]
fn one_film_has_the_exposure_and_the_certificate_of_its_render() {
    let mut project = opened(32.0);
    let of_sun = project.only_light("sun").expect("a scene");
    let film = film(&of_sun);
    for noise in [ExposureNoise::Plain, ExposureNoise::Matched] {
        let settings = camera(&project, noise);
        let (one, sum) = (Exposer::of_film(&film, &settings).expect("valid"), exposer(&[(&film, 1.0)], &settings));
        assert!(one.frame(3).expect("a frame") == sum.frame(3).expect("a frame"), "{noise:?}");
        assert_eq!(one.matched(), sum.matched());
    }
    // 4 ms are analysed at 1/256 s.
    let settings = camera(&project, ExposureNoise::Plain).with_exposure(
        dunkelfeld::sensor::Exposure::new(dunkelfeld::radiometry::Seconds(1.0 / 256.0)).expect("in range"),
    );
    let one = Exposer::of_film(&film, &settings).expect("valid");
    let wanted = one.certify(&film, 0.5).expect("a sensor");
    let found = one.certify_sum(&[(&one.film_variances(&film), 1.0)], 0.5).expect("one film");
    let is_close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * b;
    // The electrons are rounded once more.
    assert!(found.ratios.data().iter().zip(wanted.ratios.data()).all(is_close));
    assert_eq!(found.certificate.saturated, wanted.certificate.saturated);
    assert!((found.certificate.p99 / wanted.certificate.p99 - 1.0).abs() < 1e-5);
    // Twice the light has four times the variance, over the variance of the sensor at twice the electrons.
    let double = exposer(&[(&film, 2.0)], &settings);
    let variances = double.film_variances(&film);
    let ratios = double.certify_sum(&[(&variances, 2.0)], 0.5).expect("one film").ratios;
    let model = one.model();
    let of_sensor =
        |e: f32| model.temporal_variance(dunkelfeld::radiometry::Electrons(e.into()), one.exposure().time());
    let single = one.certify(&film, 0.5).expect("a sensor").ratios;
    for (pixel, (&double, &single)) in ratios.data().iter().zip(single.data()).enumerate() {
        let e = one.electrons().data()[pixel];
        let wanted = 4.0 * f64::from(single) * of_sensor(e) / of_sensor(2.0 * e);
        assert!((f64::from(double) - wanted).abs() <= 1e-4 * wanted, "pixel {pixel}: {double} {wanted}");
    }
}

/// Values of a channel.
fn channel(layers: &ExrLayers, name: &str) -> Vec<f32> {
    let triples =
        |layer: Triple, component: usize| layers.triples(layer).expect("a layer").map(|v| v[component]).into_vec();
    match name {
        "R" => triples(Triple::Mean, 0),
        "variance.G" => triples(Triple::Variance, 1),
        _ => match layers.channel(name).unwrap_or_else(|| panic!("the channel {name}")) {
            dunkelfeld_io::exr::Channel::F32(values) => values.clone(),
            dunkelfeld_io::exr::Channel::U32(_) => panic!("{name} contains integers"),
        },
    }
}

#[test]
fn an_exr_has_the_sum_and_a_layer_for_each_light() {
    let mut project = opened(16.0);
    let lights = films(&mut project, 300);
    let factors = [0.5, 0.0, 3.0, 1.0, 2.0, 0.25, 4.0];
    let weighted: Vec<FilmOfLight<'_>> =
        lights.iter().zip(factors).map(|((name, film), factor)| FilmOfLight { name, film, factor }).collect();
    let settings = project.fitted().expect("a valid job");
    let frame = develop_films(&weighted, None, &settings).expect("a frame");
    let layers = encode_light_layers(&weighted, &frame, &settings).expect("layers");
    let red = channel(&layers, "R");
    let of_lights: Vec<(Vec<f32>, f64)> =
        LIGHTS.iter().zip(factors).map(|(name, f)| (channel(&layers, &format!("light.{name}.R")), f)).collect();
    for (pixel, &red) in red.iter().enumerate() {
        let sum: f64 = of_lights.iter().map(|(values, factor)| factor * f64::from(values[pixel])).sum();
        assert!((f64::from(red) - sum).abs() <= 1e-5 * sum, "pixel {pixel}");
    }
    // The electrons of the frame are those of this sum.
    let exposer = exposer(
        &weighted.iter().map(|light| (light.film, light.factor)).collect::<Vec<_>>(),
        &camera(&project, ExposureNoise::Plain),
    );
    let sensor = frame.sensor.as_ref().expect("a sensor");
    assert!(&sensor.electrons == exposer.electrons(), "electrons");
    assert!(sensor.values == exposer.frame(settings.frame).expect("a frame"), "grey values");
    assert!(sensor.certified.is_some());
    // Samples are those of all films; their seed is not that of the job.
    let samples: u64 = lights.iter().map(|(_, film)| film.sums.total_samples()).sum();
    let counts = layers.integers(Single::SampleCount).expect("samples");
    assert_eq!(counts.data().iter().map(|&n| u64::from(n)).sum::<u64>(), samples);
    let attributes: serde_json::Value = serde_json::from_str(&layers.attributes).expect("JSON");
    assert!(attributes.get("seed").is_none() && attributes["lights"][2]["factor"] == 3.0, "{attributes}");
    // One film with the factor 1 has the layers of its render.
    let one = [FilmOfLight { name: "panel", film: &lights[2].1, factor: 1.0 }];
    let frame = develop_film(&lights[2].1, &settings).expect("a frame");
    let (sum, plain) =
        (encode_light_layers(&one, &frame, &settings).expect("layers"), encode_layers(&lights[2].1, &frame, &settings));
    for (name, values) in &plain.channels {
        assert!(sum.channel(name) == Some(values), "{name}");
    }
    assert!(encode_light_layers(&[], &frame, &settings).is_err() && develop_films(&[], None, &settings).is_err());
}

/// Frames of independent renders with matched noise scatter as frames of the camera do, also for a sum with factors.
#[test]
#[ignore = "long: .ci/run runs it"]
fn matched_noise_of_a_sum_has_the_variance_of_the_camera() {
    const FRAMES: u32 = 40;
    let mut project = opened(48.0);
    project.set_overrides("[[material]]\nname = \"ball\"\nmetallic = 0\nroughness = 0.8\n").expect("a material");
    project.resize_keeping_view(48, 36);
    let mut scenes =
        [("panel", 2.0), ("bar", 0.5)].map(|(name, factor)| (project.only_light(name).expect("a scene"), factor));
    let settings = [ExposureNoise::Plain, ExposureNoise::Matched]
        .map(|noise| project.fitted().expect("a valid job").with_exposure_noise(noise));
    let mut seeds = 5000..;
    let mut frames: [Vec<Plane<u16>>; 2] = [Vec::new(), Vec::new()];
    let mut electrons = vec![0.0; 48 * 36];
    let mut is_held = vec![true; 48 * 36];
    for number in 0..FRAMES {
        let films = scenes.each_mut().map(|(scene, factor)| {
            scene.settings.seed = seeds.next().expect("no end");
            (film(scene), *factor)
        });
        let films = films.each_ref().map(|(film, factor)| FilmOfLight { name: "", film, factor: *factor });
        for (frames, settings) in frames.iter_mut().zip(&settings) {
            let frame = develop_films(&films, None, &settings.clone().with_frame(number)).expect("a frame");
            let sensor = frame.sensor.expect("a sensor");
            let means = electrons.iter_mut().zip(sensor.electrons.data());
            means.for_each(|(sum, &e)| *sum += 0.5 * f64::from(e) / f64::from(FRAMES));
            if let Some(matched) = sensor.matched {
                is_held.iter_mut().zip(matched.held.data()).for_each(|(all, held)| *all &= held);
            }
            frames.push(sensor.values);
        }
    }
    let camera = camera(&project, ExposureNoise::Plain);
    let time = camera.exposure.expect("a fixed one").time();
    let [plain, matched] = frames.map(|frames| -> SampleMoments {
        let held = (0..electrons.len()).filter(|pixel| is_held[*pixel]);
        held.map(|pixel| {
            let values: SampleMoments = frames.iter().map(|frame| f64::from(frame.data()[pixel])).collect();
            let of_camera = camera.model.temporal_variance(dunkelfeld::radiometry::Electrons(electrons[pixel]), time);
            values.variance() / (camera.model.spec().system_gain.powi(2) * of_camera)
        })
        .collect()
    });
    // With all of the noise of the camera, that of the renders is too much.
    assert!(matched.count() > 200 && matched.standard_error() < 0.02, "{}", matched.count());
    assert!(plain.mean() > 1.0 + 6.0 * plain.standard_error(), "{}", plain.mean());
    student_t_test(&matched, 1.0).assert(RATE, "variance of frames with matched noise over that of the camera");
}
