//! EMVA 1288 from end to end: simulated cameras take a measurement, and the analyser, which shares no code with them, must find
//! what they are.
//!
//! Seeds are fixed. Replay: `cargo test -p dunkelfeld-cli --test it emva::NAME`.

use dunkelfeld::radiometry::{Nanometres, Seconds};
use dunkelfeld::sensor::{FilterColor, SensorModel};
use dunkelfeld::{Cancel, Session};
use dunkelfeld_io::sensor_file::{parse_sensor, preset};
use dunkelfeld_io::toml_file::TomlFile;
use dunkelfeld_studies::emva::{
    DESCRIPTOR, DatasetPlan, DatasetSettings, Findings, TRUTH, Truth, Vary, read_measurement, write_dataset,
};
use dunkelfeld_studies::emva1288::{AnalysisSettings, Quantity, analyse};
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
