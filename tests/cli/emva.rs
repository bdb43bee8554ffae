//! EMVA 1288 from end to end: simulated cameras take a measurement, and the analyser, which shares no code with them, must find
//! what they are.
//!
//! Seeds are fixed. Replay: `cargo test -p dunkelfeld-cli --test it emva::NAME`.

use dunkelfeld::film::Plane;
use dunkelfeld::radiometry::{Electrons, Nanometres, Seconds};
use dunkelfeld::sensor::{FilterColor, PixelMap, SensorModel};
use dunkelfeld::{Cancel, Session};
use dunkelfeld_io::sensor_file::{load_sensor, parse_sensor, preset};
use dunkelfeld_io::toml_file::TomlFile;
use dunkelfeld_studies::emva::{
    AnalyseOptions, DESCRIPTOR, DatasetPlan, DatasetSettings, Findings, ReadMeasurement, TRUTH, Truth, Vary,
    read_measurement, write_dataset,
};
use dunkelfeld_studies::emva1288::{AnalysisSettings, Quantity, analyse};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::BTreeMap;
use std::path::Path;

use crate::markup::as_xml;

/// A camera with everything in it that the standard measures.
const EVERYTHING: &str = r#"
name = "everything"
source = "made up"
bit_depth = 12
pixel_pitch_um = 3.45
quantum_efficiency = [[400, 0.5], [545, 0.65], [700, 0.3]]
full_well_e = 9000
dark_noise_e = 4.0
row_noise_e = 0.5
gain_dn_per_e = 0.4
offset_dn = 60
dsnu_e = 3.0
dsnu_row_e = 0.8
dsnu_column_e = 1.2
prnu_percent = 1.0
prnu_row_percent = 0.3
prnu_column_percent = 0.4
temperature_c = 40
[dark_current]
e_per_s = 200
at_c = 40
doubling_k = 7
"#;

fn everything() -> SensorModel {
    parse_sensor(&TomlFile::from_text("everything.toml", EVERYTHING)).expect("a sensor")
}

fn small() -> DatasetSettings {
    DatasetSettings::default().with_width(160).with_height(120).with_seed(5)
}

/// Every figure against the truth: (estimate - truth) / error; of nonuniformities, which are roots, the squares.
fn scores<'a>(quantities: &'a [Quantity], truth: &Truth) -> Vec<(&'a Quantity, f64, f64)> {
    let score = |q: &Quantity, t: f64| {
        let (value, error) = (q.value, q.standard_error);
        if !q.symbol.contains("NU") {
            return (value - t) / error;
        }
        // The error of a root is error / (2 root), or at zero the root of the error.
        (value * value - t * t) / if value > 0.5 * error { 2.0 * value * error } else { error * error }
    };
    quantities.iter().filter_map(|q| truth.quantities.get(q.symbol).map(|&t| (q, t, score(q, t)))).collect()
}

/// Bounds of 6.5 standard errors, 8e-11 each for normal numbers; a hundred figures.
fn find(model: &SensorModel, settings: &DatasetSettings) {
    let plan = DatasetPlan::new(model, settings).expect("a plan");
    let truth = plan.truth();
    let found = analyse(&plan.measure().expect("frames"), &AnalysisSettings::default()).expect("a measurement");
    let all = scores(&found.quantities, &truth);
    assert!(all.len() >= 23, "{} figures", all.len());
    for (q, truth, z) in all {
        assert!(q.value.is_finite() && q.standard_error > 0.0, "{q}");
        assert!(z.abs() < 6.5, "{}: {q}, truth {truth}, {z:.2} standard errors off", model.spec().name);
    }
    let gain = found.get("K").expect("a gain");
    assert!(gain.standard_error < 0.005 * gain.value, "{gain}");
}

#[test]
fn a_camera_with_everything_is_found() {
    find(&everything(), &small());
}

#[test]
fn cameras_of_data_sheets_are_found() {
    for (seed, name) in (6..).zip(["imx174", "imx900-hcg", "imx250"]) {
        find(&preset(name).expect("a preset"), &small().with_seed(seed));
    }
}

#[test]
fn light_may_vary_instead_of_time_and_bits_may_be_others() {
    let settings = small().with_vary(Vary::Irradiance).with_exposure(Seconds(0.02)).with_bit_depth(10);
    let plan = DatasetPlan::new(&everything(), &settings).expect("a plan");
    assert_eq!(plan.shots().iter().filter(|s| s.photons == 0.0).count(), 2);
    let found = analyse(&plan.measure().expect("frames"), &AnalysisSettings::default()).expect("a measurement");
    assert!(found.get("mu_I.mean").is_none() && found.notes.iter().any(|n| n.contains("dark current")));
    // A quarter of the gain, and 4 electrons of dark current in 20 ms.
    for (q, truth, z) in scores(&found.quantities, &plan.truth()) {
        assert!(z.abs() < 6.5, "{q}, truth {truth}, {z:.2} standard errors off");
    }
    assert!((plan.truth().quantities["K"] - 0.1).abs() < 1e-12);
    assert!((plan.truth().quantities["sigma_d"] - 20f64.sqrt()).abs() < 1e-9);
}

/// More dark electrons than photo-electrons at saturation: an IMX900 that looks for a quarter of an hour.
#[test]
fn a_camera_whose_well_fills_with_dark_current_is_found() {
    let model = preset("imx900-hcg").expect("a preset");
    let settings = small().with_exposure(Seconds(1000.0));
    let plan = DatasetPlan::new(&model, &settings).expect("a plan");
    let truth = plan.truth();
    let end = truth.quantities["mu_e.sat"];
    assert!(end < 0.5 * model.spec().full_well.0, "{end}");
    let found = analyse(&plan.measure().expect("frames"), &AnalysisSettings::default()).expect("a measurement");
    for (q, truth, z) in scores(&found.quantities, &truth) {
        assert!(z.abs() < 6.5, "{q}, truth {truth}, {z:.2} standard errors off");
    }
    // The stack is where it was meant to be.
    assert!(!found.notes.iter().any(|n| n.contains("bright stack")), "{:?}", found.notes);
}

/// The pixels of one colour: the efficiency is that of their filter.
#[test]
fn of_a_mosaic_the_pixels_of_one_colour_are_measured() {
    let text = EVERYTHING.replace("quantum_efficiency = [[400, 0.5], [545, 0.65], [700, 0.3]]", "") + MOSAIC;
    let model = parse_sensor(&TomlFile::from_text("mosaic.toml", text)).expect("a sensor");
    let refusal = DatasetPlan::new(&model, &small()).expect_err("which colour?");
    assert!(refusal.to_string().contains("red, green or blue"), "{refusal}");
    let settings = small().with_color(FilterColor::Red).with_wavelength(Nanometres(600.0));
    let plan = DatasetPlan::new(&model, &settings).expect("a plan");
    assert_eq!(plan.truth().quantities["eta"], 0.4);
    let found = analyse(&plan.measure().expect("frames"), &AnalysisSettings::default()).expect("a measurement");
    let eta = found.get("eta").expect("an efficiency");
    assert!(((eta.value - 0.4) / eta.standard_error).abs() < 6.5, "{eta}");
}

const MOSAIC: &str = r#"
[color_filter]
pattern = "rggb"
red = [[500, 0.0001], [600, 0.4]]
green = [[450, 0.1], [540, 0.5], [650, 0.1]]
blue = [[450, 0.45], [600, 0.05]]
"#;

fn written(folder: &Path, settings: &DatasetSettings, threads: usize) -> Truth {
    let plan = DatasetPlan::new(&everything(), settings).expect("a plan");
    let written = write_dataset(&plan, folder, &Session::new(threads).expect("threads"))
        .expect("written")
        .expect("not cancelled");
    assert_eq!(written.descriptor, folder.join(DESCRIPTOR));
    written.truth
}

/// The written frames are the simulated ones: the analysis of the files is that of the frames, to the last bit, for 8 and 12 bits, and
/// the files do not depend on the number of threads.
#[test]
fn a_data_set_survives_the_way_through_files() {
    let home = tempfile::tempdir().expect("a temporary folder");
    for bits in [8, 12] {
        let settings = small().with_width(64).with_height(48).with_levels(20).with_stack(4).with_bit_depth(bits);
        let folder = home.path().join(format!("sets/{bits}"));
        let truth = written(&folder, &settings, 2);
        let read = read_measurement(&folder.join(DESCRIPTOR), &Session::new(2).expect("threads"));
        let read = read.expect("readable").expect("not cancelled");
        assert!(read.warnings.is_empty() && read.size == [64, 48] && read.frames == 20 * 4 + 8);
        let plan = DatasetPlan::new(&everything(), &settings).expect("a plan");
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs().max(b.abs());
        let taken = plan.measure().expect("frames");
        assert!(
            read.measurement
                .levels
                .iter()
                .zip(&taken.levels)
                .all(|(a, b)| a.pair == b.pair && close(a.exposure, b.exposure))
        );
        assert!(read.measurement.stacks.iter().zip(&taken.stacks).all(|(a, b)| a.stack == b.stack));
        let stored: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(folder.join(TRUTH)).expect("the truth")).expect("JSON");
        assert_eq!(stored["quantities"]["K"].as_f64(), truth.quantities.get("K").copied());
        let again = home.path().join(format!("again-{bits}"));
        written(&again, &settings, 1);
        for name in ["images/b_001_0.png", DESCRIPTOR, TRUTH] {
            assert_eq!(
                std::fs::read(folder.join(name)).expect("there"),
                std::fs::read(again.join(name)).expect("there")
            );
        }
        let found = Findings::linear(&read, &AnalysisSettings::default()).expect("a measurement");
        assert!(found.table().lines().any(|l| l.starts_with("eta ") && l.contains("e-/photon")), "{}", found.table());
        let json: serde_json::Value = serde_json::from_str(&found.json()).expect("JSON");
        assert!(json["quantities"].as_array().is_some_and(|q| q.len() > 25) && json["module"] == "linear");
        let html = found.html(&read);
        // Stands alone, and is well-formed.
        let body = as_xml(&html);
        let document = roxmltree::Document::parse(&body).unwrap_or_else(|e| panic!("{e}"));
        assert!(document.descendants().filter(|n| n.has_tag_name("svg")).count() >= 18);
        assert!(!html.contains("NaN") && !html.contains("http://") && !html.contains("https://"));
        let general = Findings::general(&read, &AnalysisSettings::default()).expect("a measurement");
        assert!(general.quantities().iter().any(|q| q.symbol == "sigma_p.dark"));
        assert!(roxmltree::Document::parse(&as_xml(&general.html(&read))).is_ok());
    }
}

#[test]
fn a_cancelled_data_set_leaves_nothing() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let settings = small().with_width(32).with_height(32).with_levels(10);
    let plan = DatasetPlan::new(&everything(), &settings).expect("a plan");
    let cancel = Cancel::new();
    cancel.cancel();
    let folder = home.path().join("set");
    assert!(
        write_dataset(&plan, &folder, &Session::new(1).expect("threads").with_cancel(&cancel))
            .expect("no error")
            .is_none()
    );
    assert_eq!(std::fs::read_dir(home.path()).expect("there").count(), 0);
}

/// The page names every figure that an analysis can have, and no other.
#[test]
fn the_page_names_every_figure_and_no_other() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../docs/emva.md");
    let page = std::fs::read_to_string(page).expect("docs/emva.md");
    let (_, rest) = page.split_once("## Figures").expect("the section");
    let rows = rest.lines().filter_map(|l| l.strip_prefix("| `")?.split_once('`').map(|(symbol, _)| symbol));
    let named: std::collections::BTreeSet<&str> = rows.collect();
    let settings = small().with_width(48).with_height(48).with_levels(20).with_stack(4);
    let measured = DatasetPlan::new(&everything(), &settings).expect("a plan").measure().expect("frames");
    let rules = AnalysisSettings::default().with_pixel_pitch(3.45);
    let found = analyse(&measured, &rules).expect("a measurement");
    let symbols: std::collections::BTreeSet<&str> = found.quantities.iter().map(|q| q.symbol).collect();
    assert_eq!(named, symbols, "left the page, right the analyser");
}

/// A measurement as if its frames had been read.
fn measured(plan: &DatasetPlan) -> ReadMeasurement {
    let size = [plan.settings().width, plan.settings().height];
    let measurement = plan.measure().expect("frames");
    ReadMeasurement { file: "set/emva.txt".into(), measurement, size, frames: 0, warnings: Vec::new() }
}

/// The camera that the sensor file of an analysis describes, and the figures of that analysis.
fn written_camera(read: &ReadMeasurement, path: &Path, maps: bool) -> (SensorModel, Findings) {
    let options = AnalyseOptions::default()
        .with_pixel_pitch(Some(3.45))
        .with_wavelength(Some(545.0))
        .with_sensor(path.to_path_buf())
        .with_maps(maps);
    let findings = options.analyse(read).expect("a measurement");
    let files = findings.save_sensor(read, &options).expect("a sensor file");
    assert_eq!(files.len(), if maps { 4 } else { 1 });
    (load_sensor(path).unwrap_or_else(|e| panic!("{e}")), findings)
}

/// A camera is measured, its sensor file is simulated and measured again. The figures of the file are those of the first
/// measurement. Over ten cameras, the sum of the squared deviations of the second is chi-squared for each figure: a correct
/// program fails once in 1e9, by the bound of Bonferroni.
#[test]
fn a_measured_camera_is_measured_again() {
    const CAMERAS: u32 = 10;
    let home = tempfile::tempdir().expect("a temporary folder");
    let settings = small().with_levels(20).with_stack(8);
    let mut sums: BTreeMap<&str, f64> = BTreeMap::new();
    for seed in 0..CAMERAS.into() {
        let first = measured(&DatasetPlan::new(&everything(), &settings.clone().with_seed(seed)).expect("a plan"));
        let (camera, findings) = written_camera(&first, &home.path().join("mine.toml"), false);
        let plan = DatasetPlan::new(&camera, &settings.clone().with_seed(100 + seed)).expect("a plan");
        let truth = plan.truth();
        for q in findings.quantities() {
            let Some(&again) = truth.quantities.get(q.symbol) else { continue };
            // Parts whose bound alone is known are left out of the file. Saturation and what follows from it is where
            // 0.15 % of the values are the largest, and the linearity error of a simulated camera is 0.
            let is_stated =
                findings.bound(q.symbol).is_none() && !["sat", "SNR", "DR", "LE"].iter().any(|s| q.symbol.contains(s));
            // The dark current counts by its mean, and the parts of pixels are what the others leave.
            if is_stated && !q.symbol.ends_with(".pixel") && q.symbol != "mu_I.var" {
                assert!((again - q.value).abs() < 1e-5 * q.value.abs(), "{q}: the file says {again}");
            }
            if q.symbol.ends_with("sat") {
                assert!((again - q.value).abs() < 6.5 * q.standard_error, "{q}: the file says {again}");
            }
        }
        let second = analyse(&measured(&plan).measurement, &AnalysisSettings::default()).expect("a measurement");
        for (q, _, z) in scores(&second.quantities, &truth).into_iter().filter(|(q, ..)| q.symbol != "LE") {
            *sums.entry(q.symbol).or_default() += z * z;
        }
    }
    assert!(sums.len() >= 23, "{sums:?}");
    let limit = ChiSquared::new(f64::from(CAMERAS)).expect("a freedom").inverse_cdf(1.0 - 1e-9 / sums.len() as f64);
    assert!(sums.values().all(|sum| *sum < limit), "more than {limit}: {sums:?}");
}

/// The correlation of two images, whose standard error is (1 - r^2) / sqrt(n) for normal pixels.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// The maps are those of the pixels, as far as the noise of the stacks allows: with the spread s of pixels and the noise n of
/// their means the correlation is s / sqrt(s^2 + n^2), for the first and for the second measurement. The bounds are 6.5
/// standard errors, 8e-11 each.
#[test]
fn the_maps_of_a_camera_are_those_of_its_pixels() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let settings = small().with_levels(20);
    let [width, height] = [settings.width, settings.height];
    let shading = |x: u32, y: u32| {
        let [x, y] = [(x, width), (y, height)].map(|(v, n)| (f64::from(v) + 0.5) / f64::from(n) - 0.5);
        (1.0 + 0.3 * (x * x + y * y)).powi(-2)
    };
    let mean = (0..width * height).map(|i| shading(i % width, i / width)).sum::<f64>() / f64::from(width * height);
    let shade = Plane::from_fn(width, height, |x, y| (shading(x, y) / mean) as f32);
    let mut spec = everything().spec().clone();
    spec.row_noise.0 = 0.0;
    for part in [&mut spec.fixed_pattern.dsnu_row, &mut spec.fixed_pattern.dsnu_column] {
        *part = Electrons(0.0);
    }
    (spec.fixed_pattern.prnu_row, spec.fixed_pattern.prnu_column) = (0.0, 0.0);
    spec.fixed_pattern.maps.flat_field = Some(PixelMap::new(shade.clone()).expect("finite"));
    let model = SensorModel::new(spec).expect("valid");
    let plan = DatasetPlan::new(&model, &settings).expect("a plan");
    let (camera, findings) = written_camera(&measured(&plan), &home.path().join("mine.toml"), true);
    assert_eq!(camera.spec().resolution, Some([width, height]));
    let maps = |model: &SensorModel| -> [Vec<f64>; 3] {
        let maps = &model.spec().fixed_pattern.maps;
        [&maps.dsnu, &maps.prnu, &maps.flat_field]
            .map(|m| m.as_ref().expect("a map").values().data().iter().map(|v| f64::from(*v)).collect())
    };
    let pixels = (0..width * height).map(|i| plan.device().pixel(i % width, i / width).expect("inside"));
    let (dark, detail): (Vec<f64>, Vec<f64>) =
        pixels.zip(shade.data()).map(|(p, f)| (f64::from(p.dark), f64::from(p.response / f))).unzip();
    let first = maps(&camera);
    // In a corner, a polynomial has the variance of a pixel times the sum of (2 p + 1) (2 q + 1), p + q <= 6, over the pixels.
    let error = 0.01 * (532.0 / f64::from(width * height)).sqrt();
    let worst = first[2].iter().zip(shade.data()).map(|(a, b)| (a - f64::from(*b)).abs()).fold(0.0, f64::max);
    assert!(worst < 6.5 * error, "{worst}");

    let again = DatasetPlan::new(&camera, &settings.clone().with_seed(77)).expect("a plan");
    let (other, found) = written_camera(&measured(&again), &home.path().join("again.toml"), true);
    let second = maps(&other);
    // Variances of the noise of the mean images over the square of their unit, electrons and 1.
    let noises = |plan: &DatasetPlan| {
        let (model, stack) = (plan.device().model(), plan.shots().last().expect("a stack"));
        let light = model.spec().quantum_efficiency.of_pixel(0, 0).peak().1 * stack.photons;
        let of = |e: f64| model.temporal_variance(Electrons(e), stack.exposure.time()) / f64::from(stack.frames);
        [of(0.0), (of(light) + of(0.0)) / (light * light)]
    };
    let noises = [noises(&plan), noises(&again)];
    for (i, (truth, spread)) in [(dark, 3.0), (detail, 0.01)].into_iter().enumerate() {
        for (n, r) in [correlation(&truth, &first[i]), correlation(&first[i], &second[i])].into_iter().enumerate() {
            let expected = spread / (spread * spread + noises[n][i]).sqrt();
            let error = (1.0 - expected * expected) / f64::from(width * height).sqrt();
            assert!(
                (r - expected).abs() < 6.5 * error,
                "map {i}, measurement {n}: {r}, expected {expected} +- {error}"
            );
        }
    }
    // Without maps another device would differ by its standard error. These are the same pixels.
    for (a, b) in findings.quantities().iter().zip(found.quantities()).filter(|(a, _)| a.symbol.ends_with("NU1288")) {
        assert!((a.value - b.value).abs() < 2.0 * b.standard_error, "{a}; again {b}");
    }
    let refusal = DatasetPlan::new(&camera, &settings.with_width(64)).expect_err("another size").to_string();
    assert!(refusal.contains("64 x 120") && refusal.contains("160 x 120"), "{refusal}");
}
