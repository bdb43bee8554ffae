//! Tests of the forecast of a run with a time.

use super::*;
use crate::record::CertificateRecord;
use std::collections::BTreeMap;

#[test]
fn a_small_set_has_one_test_image_and_others_three() {
    assert_eq!(test_positions(11), [0]);
    assert_eq!(test_positions(12), [0, 6, 11]);
    assert_eq!(test_positions(0), [0; 0]);
}

/// All pilots together take at most 2 % of the time, also with the changes of the scene.
#[test]
fn the_pilots_fit_into_their_allowance() {
    let measured = |change, rate| Measured { outside: 0.3, change, expose: 0.1, rate: Some(rate) };
    for (seconds, workers, change) in [(60.0, 2, 0.1), (600.0, 1, 0.5), (28_800.0, 16, 1.0), (12.0, 3, 0.0)] {
        let allowance = ALLOWANCE * seconds;
        let round = Round::choose(allowance, TESTS, workers, measured(change, 1e5), 1e6).expect("there is time");
        assert_eq!((round.tests, round.workers, round.pilots), (TESTS, workers, TESTS.div_ceil(workers)));
        let all = round.pilots as f64 * (change + round.limit);
        assert!(all <= allowance + 1e-9, "{all} s of {seconds} s");
        // They are expected to take less.
        let expected = f64::from(PILOT_SPP + PILOT_SPP / FIRST) * round.pixels / round.rate + ANALYSIS * round.pixels;
        assert!(expected <= AIM * round.limit + 1e-9 && round.pixels >= LEAST_PIXELS, "{expected} s");
    }
    // A change of the scene takes too long, also that to one other image: the first worker has the first image.
    let round = Round::choose(0.24, TESTS, 2, measured(0.2, 1e5), 1e6).expect("there is time");
    assert_eq!((round.tests, round.workers, round.pilots), (1, 1, 1));
    // 576 pixels with 20 samples take 0.12 s at 100000 samples per second.
    assert_eq!(Round::choose(0.1, TESTS, 2, measured(0.2, 1e5), 1e6), None);
    // An image with 100 pixels needs no more.
    assert!(Round::choose(0.1, TESTS, 2, measured(0.2, 1e5), 100.0).is_some());
}

#[test]
fn sets_of_short_images_have_a_larger_allowance() {
    for (left, share, expected) in [(600.0, 5.0, 12.0), (12.0, 1.0, 0.24), (12.0, 0.9, 0.4), (1.0, 0.1, 0.1)] {
        assert!((allowance(left, share) - expected).abs() < 1e-12, "{left} s, {share} s for each");
    }
    assert_eq!(allowance(0.0, 0.02), 0.0);
}

#[test]
fn a_pilot_has_the_samples_that_fit() {
    assert_eq!(size_of_pilot([640, 480], 3072.0, 1000.0), ([64, 48], 16));
    assert_eq!(size_of_pilot([640, 480], 307_200.0, 1000.0), ([640, 480], 16));
    assert_eq!(size_of_pilot([64, 48], 5.0 * 3072.0, 1000.0), ([64, 48], 64));
    // A fifth of the samples of the image suffices.
    assert_eq!(size_of_pilot([64, 48], 50.0 * 3072.0, 40.0), ([64, 48], 32));
    assert_eq!(size_of_pilot([64, 48], 50.0 * 3072.0, 3.0), ([64, 48], 16));
}

/// 10 s, of which the exposure takes 1 s and the plan 2 s, at 8 samples per pixel and second.
#[test]
fn the_samples_of_an_image_are_those_of_the_time_beside_exposure_and_plan() {
    // Half of an exposure measures its time.
    assert_eq!(samples_per_pixel(10.0, 8.0, 2.0, 1.0), 52.0);
    // Without a plan there are 8.5, and no more than 16.
    assert_eq!(samples_per_pixel(10.0, 1.0, 2.0, 1.0), 8.5);
    assert_eq!(samples_per_pixel(10.0, 2.0, 3.0, 1.0), 16.0);
    assert_eq!(samples_per_pixel(0.02, 8.0, 2.0, 1.0), 0.0);
}

#[test]
fn an_image_without_a_level_has_its_true_reason() {
    let certificate = CertificateRecord { k: 1.0, hidden: 0.5, median: None, p99: Some(0.25), saturated: 0.5 };
    let record = |certificate| Record {
        study: "study".into(),
        index: 0,
        drawn: BTreeMap::new(),
        seed: 0,
        frame: 0,
        width: 1,
        height: 1,
        exposure: None,
        samples: 1,
        certificate,
        matched: None,
        instances: Vec::new(),
        files: BTreeMap::new(),
    };
    for (certificate, expected) in [
        (Some(certificate), Ok(0.5)),
        (Some(CertificateRecord { p99: None, ..certificate }), Err(LevelGap::UnknownNoise)),
        (Some(CertificateRecord { saturated: 1.0, ..certificate }), Err(LevelGap::Saturated)),
        (None, Err(LevelGap::NoSensor)),
    ] {
        assert_eq!(LevelGap::level(&record(certificate)), expected);
    }
}

/// A plate with a glossy ball and a scratch under a panel.
const STUDY: &str = r#"
scene = "none"
[study]
name = "plates"
count = 4
device = "each"
[[study.label]]
category = "ball"
objects = "ball"
[[study.defect]]
kind = "scratch"
on = "plate"
facing = [0, 1, 0]
length = "20mm"
width = "2mm"
depth = "100um"
[camera]
name = "above"
position = [{ uniform = ["-5mm", "5mm"] }, "300mm", "1mm"]
look_at = [0, 0, 0]
vertical_fov = "25deg"
[film]
width = 64
height = 48
[budget]
spp = 64
[sensor]
exposure = "20ms"
[[object]]
name = "plate"
kind = "box"
size = ["120mm", "2mm", "120mm"]
translate = [0, "-1mm", 0]
[[object]]
name = "ball"
kind = "sphere"
diameter = { uniform = ["15mm", "25mm"] }
translate = [{ uniform = ["-30mm", "30mm"] }, "12mm", 0]
[[light]]
name = "panel"
kind = "panel"
width = "100mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = "1.5W"
"#;

/// A study in a folder of its own.
fn study(text: &str) -> (tempfile::TempDir, Arc<Study>) {
    let folder = tempfile::TempDir::new().expect("a temporary folder");
    let path = folder.path().join("study.toml");
    std::fs::write(&path, text).expect("writable");
    let study = Study::open(&path).expect("a study");
    (folder, Arc::new(study))
}

/// A round for one pilot with so many pixels, without a limit that a slow machine could reach.
fn round(pixels: f64) -> Round {
    Round { tests: 1, workers: 1, pilots: 1, pixels, rate: 1e5, limit: 1e6 }
}

/// The level of the image at its number of samples, from a pilot, against that of its certificate. Nothing depends on a
/// clock. The scene has rare bright light, for which 16 samples per pixel are few: measured ratios are 0.6 to 2.7. The levels
/// themselves span a factor of 100.
#[test]
fn the_forecast_is_near_the_level_of_the_image() {
    const FACTOR: f64 = 3.5;
    let mut found = Vec::new();
    for spp in [8.0, 64.0, 256.0] {
        let (_folder, study) = study(&STUDY.replace("spp = 64", &format!("spp = {spp}")));
        let mut worker = Worker::open(&study, 1).expect("a scene");
        for index in 0..2 {
            let made = worker.make(index, None, &Cancel::new()).expect("an image").expect("not cancelled");
            let reached = LevelGap::level(&made.record).expect("a level");
            for pixels in [64.0 * 48.0, 768.0] {
                let pilot = Pilot::run(&mut worker, index, round(pixels), 1.0, &Cancel::new());
                let pilot = pilot.expect("an image").expect("not cancelled");
                let level = pilot.level(spp).expect("known");
                found.push((index, spp, pixels, level, reached));
            }
        }
    }
    let is_near = |ratio: f64| (FACTOR.recip()..FACTOR).contains(&ratio);
    assert!(found.iter().all(|(.., level, reached)| is_near(level / reached)), "{found:?}");
    let reached: Vec<f64> = found.iter().map(|(.., reached)| *reached).collect();
    let [least, most] = [f64::min, f64::max].map(|of| reached.iter().copied().reduce(of).expect("levels"));
    assert!(most > 20.0 * least, "a constant would not pass: {least} to {most}");
}

#[test]
fn a_pilot_changes_no_bit_of_an_image() {
    let (_folder, study) = study(STUDY);
    let made = |worker: &mut Worker, index| {
        worker.make(index, None, &Cancel::new()).expect("an image").expect("not cancelled").files
    };
    let mut alone = Worker::open(&study, 1).expect("a scene");
    let mut tested = Worker::open(&study, 1).expect("a scene");
    for index in [0, 3] {
        let expected = made(&mut alone, index);
        for other in [index, 2] {
            let pilot = Pilot::run(&mut tested, other, round(700.0), 3.0, &Cancel::new());
            assert!(pilot.expect("an image").is_some());
        }
        assert!(made(&mut tested, index) == expected, "image {index}");
    }
}

#[test]
fn a_pilot_ends_at_its_limit_and_with_the_run() {
    let (_folder, study) = study(STUDY);
    let mut worker = Worker::open(&study, 1).expect("a scene");
    let late = Round { limit: 0.0, ..round(3072.0) };
    assert!(Pilot::run(&mut worker, 0, late, 1.0, &Cancel::new()).expect("an image").is_none());
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(Pilot::run(&mut worker, 0, round(3072.0), 1.0, &cancel).expect("an image").is_none());
}

#[test]
fn gaps_have_their_reasons() {
    let gap = |text: &str| {
        let (_folder, study) = study(text);
        let mut worker = Worker::open(&study, 1).expect("a scene");
        let pilot = Pilot::run(&mut worker, 0, round(3072.0), 1.0, &Cancel::new());
        pilot.expect("an image").expect("not cancelled").level(1.0)
    };
    let sensor = "[sensor]\nexposure = \"20ms\"";
    assert_eq!(gap(&STUDY.replace(sensor, "[sensor]\nmodel = \"none\"")), Err(LevelGap::NoSensor));
    // One sample per pixel.
    assert_eq!(gap(STUDY), Err(LevelGap::UnknownNoise));
}
