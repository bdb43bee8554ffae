//! Faults of a study and of a folder that are found before they cost images.

use super::bench::{Bench, STUDY};
use dunkelfeld::Cancel;
use dunkelfeld_dataset::{Study, Worker};
use std::fs;
use std::sync::Arc;

/// The study with smaller images, and with changes.
fn changed(changes: &[(&str, &str)]) -> String {
    let small =
        STUDY.replace("width = 64", "width = 24").replace("height = 48", "height = 18").replace("spp = 8", "spp = 2");
    changes.iter().fold(small, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    })
}

#[test]
fn a_set_in_use_takes_no_other_study() {
    let size = "size = [{ sequence = [\"20mm\", \"90mm\"], repeat = 2 }, 0, \"90mm\"]";
    let bench = Bench::new(&changed(&[("size = [\"90mm\", 0, \"90mm\"]", size)]));
    let study = Arc::new(Study::open(bench.path("study.toml")).expect("a study"));
    let mut worker = Worker::open(&study, 1).expect("a worker");
    let failing = "dataset study.toml -o a --count 4 --index 0,1";
    assert!(bench.said(failing, 2).contains("finds no place") && !bench.path("a").exists());
    let set = worker.open_set(&bench.path("a"), Some(4)).expect("a set");
    let claim = set.claim(2).expect("a folder").expect("a claim");
    fs::write(bench.path("other.toml"), changed(&[("seed = 3", "seed = 4")])).expect("writable");
    let refused = bench.said("dataset other.toml -o a --count 1", 2);
    assert!(refused.contains("holds a set of another study"), "{refused}");
    let image = worker.make(2, None, &Cancel::new()).expect("an image").expect("whole");
    set.commit(claim, image).expect("written");
    assert!(bench.path("a/records/000002.json").is_file());
    // Without an image and a process that makes one it may be another set.
    worker.open_set(&bench.path("b"), Some(4)).expect("a set");
    bench.run("dataset other.toml -o b --count 1");
    bench.run("dataset --verify b");
}

#[test]
fn a_sensor_with_the_name_of_the_study_is_an_input() {
    let sensor = include_str!("../../../crates/camera/sensor/presets/imx250.toml");
    let text = changed(&[
        ("name = \"blocks\"", "name = \"blocks\"\nfolder = \"..\""),
        ("[sensor]", "[sensor]\nmodel = \"cam.toml\""),
    ]);
    let (head, rest) = text.split_once("[study]").expect("a table");
    let (own, job) = rest.split_once("[camera]").expect("a camera");
    // Without draws in the job.
    let job = format!("{head}[camera]{job}")
        .replace("{ uniform = [\"-5mm\", \"5mm\"] }", "0")
        .replace("{ log_uniform = [\"6mm\", \"12mm\"] }", "\"8mm\"")
        .replace("{ expression = \"1.5 * supply\", unit = \"W\" }", "\"1W\"");
    let of_job = format!("[study]{own}").replace("folder = \"..\"", "folder = \"..\"\njob = \"job.toml\"");
    for (study, inputs) in [(&text, vec!["cam.toml", "cam.toml"]), (&of_job, vec!["cam.toml", "cam.toml", "job.toml"])]
    {
        let bench = Bench::new("");
        fs::create_dir(bench.path("studies")).expect("free");
        fs::write(bench.path("job.toml"), &job).expect("writable");
        fs::write(bench.path("cam.toml"), sensor).expect("writable");
        fs::write(bench.path("studies/cam.toml"), study).expect("writable");
        bench.run("dataset studies/cam.toml -o a --count 2 --index 0");
        let set = bench.json("a/set.json");
        let found: Vec<&str> =
            set["inputs"].as_array().expect("a list").iter().map(|i| i["path"].as_str().expect("a path")).collect();
        assert_eq!(found, inputs);
        // The study is known by its keys, and the sensor by its content.
        fs::write(bench.path("studies/cam.toml"), format!("# a comment\n{study}")).expect("writable");
        fs::write(bench.path("cam.toml"), format!("{sensor}\n# changed\n")).expect("writable");
        let refused = bench.said("dataset studies/cam.toml -o a --count 2", 2);
        assert!(refused.contains("another \"cam.toml\""), "{refused}");
        fs::write(bench.path("cam.toml"), sensor).expect("writable");
        bench.run("dataset studies/cam.toml -o a --count 2");
    }
}

#[test]
fn a_missing_file_of_costs_is_found_and_an_empty_set_may_shrink() {
    let bench = Bench::new(&changed(&[]));
    bench.run("dataset study.toml -o a --count 2");
    fs::remove_file(bench.path("a/costs/000001.json")).expect("there");
    assert!(bench.said("dataset --verify a", 1).contains("costs/000001.json does not exist"));
    bench.run("dataset study.toml -o c --count 6 --index 5");
    fs::remove_file(bench.path("c/records/000005.json")).expect("there");
    bench.run("dataset study.toml -o c --count 1");
    assert_eq!(bench.json("c/set.json")["count"], 1);
}

#[test]
fn an_image_that_the_set_does_not_have_does_not_count() {
    let bench = Bench::new(&changed(&[("spp = 2", "spp = { sequence = [2, 2, 2, -1] }")]));
    bench.run("dataset study.toml -o a --count 2");
    let refused = bench.said("dataset study.toml -o a --count 4", 2);
    assert!(refused.contains("image 3") && refused.contains("-1"), "{refused}");
}

#[test]
fn an_image_without_a_sensor_has_no_grey_values() {
    let bench = Bench::new(&changed(&[(
        "[sensor]\nexposure = \"20ms\"",
        "[sensor]\nmodel = { sequence = [\"imx250\", \"none\"] }",
    )]));
    let named = bench.said("dataset study.toml -o a --count 2", 1);
    assert!(named.contains("study.toml: [study.images] raw: image 1: there is no sensor"), "{named}");
    assert!(bench.path("a/records/000000.json").is_file() && !bench.path("a/records/000001.json").exists());
}

/// A link in the folder of a set leads to a file and to a folder of the user: nothing is written there, and a check finds both.
#[cfg(unix)]
#[test]
fn links_in_a_set_are_not_followed() {
    use std::os::unix::fs::symlink;
    let bench = Bench::new(&changed(&[]));
    bench.run("dataset study.toml -o a --count 2");
    let mine = bench.path("mine");
    for name in ["images/000001.png", "records/000001.json", "labels", "coco.json"] {
        let path = bench.path("a").join(name);
        fs::rename(&path, &mine).expect("moved");
        symlink(&mine, &path).expect("a link");
        let before = mine.is_file().then(|| fs::read(&mine).expect("readable"));
        let found = bench.said("dataset --verify a", 1);
        let is_record = name.starts_with("records");
        assert!(found.contains(if is_record { "1 of 2 images" } else { "is a symbolic link" }), "{name}: {found}");
        if !name.starts_with("images") {
            let refused = bench.said("dataset study.toml -o a --count 2", 2);
            assert!(refused.contains(name) && refused.contains("is a symbolic link"), "{name}: {refused}");
        }
        assert_eq!(before, mine.is_file().then(|| fs::read(&mine).expect("readable")));
        fs::remove_file(&path).expect("a link");
        fs::rename(&mine, &path).expect("moved back");
    }
    bench.run("dataset --verify a");
}
