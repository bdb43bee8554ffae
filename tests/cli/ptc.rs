//! `dunkelfeld ptc` as its users have it: the report and its numbers, more frames later, what it refuses.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it ptc::NAME`.

use crate::lab::{Lab, complaint, same_numbers, square, stands_alone};
use crate::markup::as_xml;
use dunkelfeld::{DenoiseMethod, Project, Session};
use dunkelfeld_studies::StudyOutcome;
use dunkelfeld_studies::photon_transfer::{PtcSettings, ptc};

/// A tiny measurement with everything in it.
const TINY: &str =
    "ptc <scene>.obj --width 24 --height 16 --frames 5 --spp 4,16 --denoise builtin --progress none -o out";

/// A floor under a lamp, with a post and its soft shadow.
fn lab() -> Lab {
    let objects = square(1.0, 0.0, false) + &square(0.2, 0.3, false) + &square(0.5, 1.0, true);
    let faces = "usemtl floor\nf 1 2 3 4\nf 5 6 7 8\nusemtl lamp\nf 9 10 11 12\n";
    Lab::new(&(objects + faces), "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 3 3\n")
}

/// The tiny measurement through the library.
fn call(lab: &Lab, folder: &str, frames: u32) -> StudyOutcome {
    let input = lab.path("<scene>.obj");
    let mut project = Project::open(&input).expect("a scene");
    (project.settings.width, project.settings.height) = (24, 16);
    let settings =
        PtcSettings::default().with_frames(frames).with_spp(vec![4, 16]).with_denoise(DenoiseMethod::Builtin);
    ptc(project, &input, &settings, &lab.path(folder), false, &Session::new(0).expect("threads"))
        .expect("a measurement")
}

#[test]
fn a_report_stands_alone_and_its_numbers_are_those_of_the_tables() {
    let lab = lab();
    let done = lab.run(TINY).code(0);
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(said.contains("report.html") && said.contains("more samples per pixel leave less"), "{said}");
    let page = as_xml(&lab.read("out/report.html"));
    let document = stands_alone(&page);
    for heading in ["Figure 2", "Figure 3", "Figure 5", "Figure 6", "Figure 7", "Figure 8", "Findings of the paper"] {
        assert!(page.contains(heading), "{heading}");
    }
    for name in ["series", "lines"] {
        same_numbers(&document, name, &lab.read(&format!("out/{name}.csv")));
    }
    // Two numbers of samples, as they are and denoised; seven statements of the paper.
    assert_eq!(lab.table("out/series.csv").len(), 4);
    let id = Some("table-findings");
    let findings = document.descendants().find(|n| n.attribute("id") == id).expect("the findings");
    assert_eq!(findings.descendants().filter(|n| n.has_tag_name("tr")).count(), 1 + 7);
    let charts = lab.names("out").into_iter().filter(|n| n.ends_with(".svg")).count();
    // The sensor; transfer with and without edges and linear curves of four series; the camera's of two.
    assert_eq!(charts, 1 + 3 * 4 + 2);
}

#[test]
fn matched_frames_have_the_slope_of_the_sensor_and_plain_ones_scatter_more() {
    let lab = lab();
    // The exposure leaves some hundred electrons: the render's noise is hidden, but not far below.
    let size = "--width 64 --height 64 --frames 16 --spp 64 --denoise off --exposure 2ms";
    lab.run(&format!("ptc <scene>.obj {size} --progress none -o out")).code(0);
    let text = lab.read("out/lines.csv");
    let row = |what: &str| -> Vec<f64> {
        let line = text.lines().find(|l| l.contains(what)).unwrap_or_else(|| panic!("{what}: {text}"));
        let numbers = line.rsplit(',').take(10).map(|c| c.parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>();
        numbers.into_iter().rev().collect()
    };
    // Samples, frames, pixels, gain, its error, over the truth, ...
    let (sensor, matched, plain) = (row("even light"), row("matched"), row("plain"));
    assert!((sensor[5] - 1.0).abs() < 5.0 * sensor[4] / sensor[3], "even light: {sensor:?}");
    assert!(matched[2] > 80.0, "it holds nearly everywhere: {matched:?}");
    // Five standard errors (6e-7 for normal errors), and 2 % for what an estimated variance costs (docs/exposure.md).
    assert!((matched[5] - 1.0).abs() < 5.0 * matched[4] / matched[3] + 0.02, "matched: {matched:?}");
    // The render's noise is about a tenth of the sensor's variance, and rises with the light.
    assert!(plain[5] > matched[5] + 0.03 && plain[5] > 1.04, "plain {plain:?}, matched {matched:?}");
}

#[test]
fn more_frames_later_are_the_same_as_all_at_once() {
    let lab = lab();
    let whole = call(&lab, "whole", 6);
    assert!(!whole.interrupted && whole.finished == [24, 24], "{whole:?}");
    call(&lab, "grown", 4);
    call(&lab, "grown", 6);
    assert_eq!(lab.read("grown/curves.csv"), lab.read("whole/curves.csv"));
}

#[test]
fn frames_that_come_as_files_have_the_slope_of_their_camera() {
    let lab = lab();
    let scene = "<scene>.obj --width 64 --height 64 --spp 64 --exposure 2ms --exposure-noise matched --progress none";
    for frame in 0..12 {
        lab.run(&format!("render {scene} --frame {frame} --linear f{frame:02}.png -o x.png")).code(0);
    }
    let frames: String = (0..12).map(|frame| format!(" f{frame:02}.png")).collect();
    let done = lab.run(&format!("ptc{frames} --dark 32 --saturation 4095 --progress none -o out")).code(0);
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    let line = said.lines().find(|l| l.starts_with("all pixels")).unwrap_or_else(|| panic!("{said}"));
    let numbers: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
    let (gain, error) = (numbers[0], numbers[1]);
    // Five standard errors, and 5 % for the few pixels at edges where the render is noisier than the camera.
    assert!((gain / 0.379_65 - 1.0).abs() < 5.0 * error / gain + 0.05, "{line}");
    assert!(error < 0.03 * gain, "{line}");
    let names = lab.names("out");
    assert!(["report.html", "curves.csv", "transfer.svg", "transfer-flat.svg"].iter().all(|n| names.contains(*n)));
    let page = as_xml(&lab.read("out/report.html"));
    roxmltree::Document::parse(&page).expect("well-formed");

    // Dark above all light: the first frame has no steepness that could correlate with anything.
    let done = lab.run("ptc f00.png f01.png f02.png --dark 4094 --saturation 4095 --progress none -o dark").code(0);
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(said.contains("nothing correlates") && !said.contains("NaN"), "{said}");

    lab.run("render <scene>.obj --width 32 --height 64 --spp 1 --linear small.png -o x.png --progress none").code(0);
    let cases = [
        ("ptc f00.png f01.png", "2 frames"),
        ("ptc f00.png f00.png f00.png", "copies of one frame"),
        ("ptc f00.png f01.png small.png", "small.png"),
        ("ptc f00.png f01.png x.png", "8 bits per value"),
        ("ptc f00.png f01.png f02.png --saturation 90", "above 90"),
        ("ptc f00.png f01.png nosuch.png", "nosuch.png"),
        ("ptc f00.png f01.png <scene>.obj", "neither one scene"),
        ("ptc f00.png f01.png f02.png --spp 4", "spp: is a setting of a render"),
        ("ptc f00.png f01.png f02.png --dark 5000 --saturation 4095", "saturation"),
        ("ptc f00.png f01.png f02.png --edges 2", "edges"),
        ("ptc <scene>.obj --dark 3", "dark: is for frames"),
        ("ptc", "SCENE"),
    ];
    for (line, word) in cases {
        let said = complaint(&lab.run(line).code(2));
        assert!(said.contains(word) && !said.contains("panicked"), "{line}: {said}");
    }
}

#[test]
fn inputs_that_cannot_be_measured_are_refused_with_help() {
    let lab = lab();
    lab.write("taken", "a file");
    let cases = [
        ("ptc nothing.glb", "nothing.glb"),
        ("ptc <scene>.obj --frames 3", "frames"),
        ("ptc <scene>.obj --spp 8,4", "spp"),
        ("ptc <scene>.obj --edges 1", "edges"),
        ("ptc <scene>.obj --edges -0.1", "edges"),
        ("ptc <scene>.obj --denoise builtin --oidn lib", "oidn"),
        ("ptc <scene>.obj --oidn nosuch", "nosuch"),
        ("ptc <scene>.obj --sensor nosuch", "nosuch"),
        ("ptc <scene>.obj --width 8 --height 8 --frames 4 --spp 1 -o taken", "in the way"),
    ];
    for (line, word) in cases {
        let said = complaint(&lab.run(line).code(2));
        assert!(said.contains(word), "{line}: {said}");
        assert!(!said.contains("panicked"), "{line}: {said}");
    }
    assert_eq!(lab.names(".").len(), 3, "{:?}", lab.names("."));
}
