//! `dunkelfeld mtf`: the MTF of a simulated lens is measured as that of a real one, and used again.
//!
//! Replay: `cargo test -p dunkelfeld-cli --test it mtf::NAME`.

use crate::bench::{Bench, stderr, stdout};
use std::f64::consts::PI;

/// A luminous plate whose edge is tilted by 5 degrees and passes through the middle of the image, in light of 550 nm.
const EDGE: &str = r#"scene = "none"
[camera]
position = [0, 1, 0]
look_at = [0, 0, 0]
vertical_fov = "1deg"
[[object]]
name = "plate"
kind = "plane"
size = [1, 1]
rotate = [0, "5deg", 0]
translate = [0.4980973, 0, -0.0435779]
[[light]]
name = "plate"
radiance = 1
wavelength = "0.55um"
[sensor]
model = "imx250"
exposure_noise = "plain"
[lens]
f_number = 8
[film]
width = 192
height = 192
[budget]
spp = 144
[allocate]
strategy = "uniform"
"#;

/// Frequency [cycles/pixel], MTF of the camera, its standard error, and that of the lens, from the printed table.
fn table(text: &str) -> Vec<[f64; 4]> {
    let numbers = |line: &str| line.split_whitespace().map(|w| w.parse().ok()).collect::<Option<Vec<f64>>>();
    text.lines().filter_map(numbers).filter_map(|n| Some([*n.first()?, *n.get(2)?, *n.get(3)?, *n.get(4)?])).collect()
}

/// The MTF of diffraction differs from the closed form of lens and pixel (Goodman 2005) by at most 0.008 at f/8, which
/// docs/lens.md states, that of the lens by its table once more; and by noise: 5 standard errors, 6e-7 for each of ten
/// frequencies.
#[test]
fn the_mtf_of_a_lens_is_measured_and_used_again() {
    let bench = Bench::new();
    bench.write("edge.toml", EDGE);
    bench.run("render edge.toml --exr edge.exr -o edge.png --progress none").code(0);
    let frames = 30;
    let names: Vec<String> = (0..frames).map(|i| format!("raw-{i:04}.tif")).collect();
    let measure = |lens: &str, table_name: &str| {
        bench.run(&format!("expose edge.exr {lens} --frames {frames} --linear raw.tif --progress none")).code(0);
        let run = bench
            .run(&format!("mtf {} --pixel-pitch 3.45 --roi 6,16,180,160 -o {table_name}", names.join(" ")))
            .code(0);
        assert!(
            stdout(&run).contains("edge tilted by 5.0") && stdout(&run).contains("MTF50 of the camera: 0.27"),
            "{}",
            stdout(&run)
        );
        table(&stdout(&run))
    };
    let first = measure("", "lens.csv");
    let again = measure("--psf lens.csv --seed 5", "again.csv");
    assert!(first.len() == 10 && again.len() == 10, "{first:?}");
    for (limit, [frequency, camera, error, lens]) in
        first.iter().map(|p| (0.008, *p)).chain(again.iter().map(|p| (0.016, *p)))
    {
        let x = frequency * 8.0 * 0.55 / 3.45;
        let diffraction = 2.0 / PI * (x.acos() - x * (1.0 - x * x).sqrt());
        let sinc = |x: f64| (PI * x).sin() / (PI * x);
        let (sine, cosine) = 5f64.to_radians().sin_cos();
        let pixel = sinc(frequency * cosine) * sinc(frequency * sine);
        let off = camera - diffraction * pixel;
        assert!(off.abs() < limit + 5.0 * error, "{frequency}: {camera} +- {error}, {off} off");
        assert!(
            (lens - diffraction).abs() < (limit + 5.0 * error) / pixel,
            "{frequency}: {lens}, expected {diffraction}"
        );
    }
    for (a, b) in first.iter().zip(&again) {
        assert!((a[1] - b[1]).abs() < 0.008 + 5.0 * a[2].hypot(b[2]), "{a:?} {b:?}");
    }
}

#[test]
fn frames_without_an_edge_and_other_requests_are_refused() {
    let bench = Bench::new();
    bench
        .run("render job.toml --sensor imx250 --linear flat.tif -o flat.png --width 40 --height 40 --progress none")
        .code(0);
    let flat = bench.read("flat.tif");
    for (words, says) in [
        ("flat.tif --pixel-pitch 3.45", &["flat.tif", "edge", "help:"][..]),
        ("flat.tif --pixel-pitch 3.45 --roi 30,0,20,20", &["40 x 40 pixels", "ends outside", "help:"]),
        ("flat.tif --pixel-pitch 3.45 --roi 30,0,20", &["--roi", "100,80,200,160"]),
        ("flat.tif --pixel-pitch 3.45 -o flat.tif", &["flat.tif", "is a frame", "help:"]),
        ("no.tif --pixel-pitch 3.45", &["no.tif", "help:"]),
        ("flat.tif", &["--pixel-pitch"]),
    ] {
        let run = bench.run(&format!("mtf {words}")).code(2);
        for part in says {
            assert!(stderr(&run).contains(part), "mtf {words}: `{part}` is not in\n{}", stderr(&run));
        }
    }
    assert_eq!(bench.read("flat.tif"), flat);
}
