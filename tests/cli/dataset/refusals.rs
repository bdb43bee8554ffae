//! Parts of a study that contradict each other or have no effect, and sets that were changed by hand.

use super::bench::{Bench, STUDY};
use dunkelfeld::Cancel;
use dunkelfeld_dataset::{Study, Worker};
use std::fs;
use std::sync::Arc;

/// The study with a line of it replaced.
fn changed(from: &str, to: &str) -> String {
    assert!(STUDY.contains(from), "{from}");
    STUDY.replacen(from, to, 1)
}

#[test]
fn parts_that_contradict_each_other_are_refused_at_their_key() {
    let again = |list: &str, rest: &str| changed("[camera]", &format!("[[study.{list}]]\n{rest}\n[camera]"));
    let defect = |rest: &str| again("defect", &format!("on = \"block 1\"\n{rest}"));
    for (study, words) in [
        (
            again("label", "category = \"part\"\nobjects = \"block 2\""),
            ["[[study.label]] 3", "\"block 2\" is in entry 1"],
        ),
        (changed("objects = [\"ball\"]", "objects = []"), ["[[study.label]] 2, objects", "the list is empty"]),
        (
            changed("objects = \"block *\"\ncenter", "objects = []\ncenter"),
            ["[[study.place]] 1, objects", "list is empty"],
        ),
        (
            defect("kind = \"dust\"\nlength = \"1mm\"").replace("on = \"block 1\"", "on = []"),
            ["[[study.defect]] 2, on", "list is empty"],
        ),
        (changed("[film]", "[line_scan]\nline_rate = \"25Hz\"\n[film]"), ["[study.labels] bop", "line scan"]),
        (defect("kind = \"dust\"\nlength = true"), ["[[study.defect]] 2, length", "length"]),
        (
            defect("kind = \"scratch\"\nlength = \"2mm\"\nwidth = \"1mm\"\ndepth = \"0.9mm\""),
            ["[[study.defect]] 2, depth", "too deep"],
        ),
        (
            defect("kind = \"dust\"\nlength = { uniform = [nan, 1] }"),
            ["[[study.defect]] 2, length", "two finite numbers"],
        ),
        (
            defect("kind = \"dust\"\nlength = { normal = [1, 1], max = inf }"),
            ["[[study.defect]] 2, length", "not a finite quantity"],
        ),
    ] {
        let message = Bench::new(&study).refused("dataset study.toml -o a");
        assert!(words.iter().all(|words| message.contains(words)), "{words:?}: {message}");
    }
    let message = Bench::new(STUDY).refused("dataset study.toml -o a --time 1e300s");
    assert!(message.contains("out of range"), "{message}");
}

#[test]
fn a_defect_with_the_name_of_an_object_is_refused() {
    let object = |name: &str, rest: &str| {
        format!(
            "[[object]]\nname = \"{name}\"\nkind = \"sphere\"\ndiameter = \"5mm\"\ntranslate = [0, \"30mm\", 0]\n{rest}"
        )
    };
    let entry =
        "[[study.defect]]\nname = \"x\"\nkind = \"dust\"\non = \"plate\"\nlength = \"4mm\"\ncount = 2\n[camera]";
    let study = |objects: &str| changed("[camera]", entry) + objects;
    // An object, and one of the copies of an object.
    let grid = "grid = { count = [3, 1, 1], step = [\"9mm\", 0, 0] }\n";
    for objects in [object("x 2", ""), object("x", grid)] {
        let message = Bench::new(&study(&objects)).refused("dataset study.toml -o a");
        assert!(message.contains("[[study.defect]] 2, name") && message.contains("and so is an object"), "{message}");
    }
    // Names that differ are fine, and an object that no image of the first ones has may have a label.
    let rare = "visible = { choice = [true, false], weights = [1, 99999] }\n[[study.label]]\ncategory = \"rare\"\nobjects = \"x 4\"\n";
    let bench = Bench::new(&study(&(object("x 3", "") + &object("x 4", rare))));
    bench.run("dataset study.toml -o a --count 1");
    // A name of later images is known there.
    let mut names: Vec<String> = (0..299).map(|n| format!("\"n{n}\"")).collect();
    names.push("\"x 1\"".into());
    let text = study(&object("y", "")).replace("\"y\"", &format!("{{ sequence = [{}] }}", names.join(", ")));
    fs::write(bench.path("study.toml"), text).expect("writable");
    let message = bench.said("dataset study.toml -o b --count 300 --index 0,299 --jobs 2", 1);
    assert!(message.contains("image 299: a defect of this entry is called \"x 1\""), "{message}");
    assert!(bench.path("b/records/000000.json").is_file() && !bench.path("b/records/000299.json").exists());
}

#[test]
fn devices_without_an_effect_and_defects_that_are_not_made_are_named() {
    let study = changed("[camera]", "[[study.defect]]\nkind = \"missing\"\non = \"block *\"\ncount = 5\n[camera]")
        .replace("exposure = \"20ms\"", "exposure = \"20ms\"\nmodel = \"imx250\"");
    let bench = Bench::new(&study);
    let message = bench.said("dataset study.toml -o a --count 1", 0);
    assert!(message.contains("`device` varies"), "{message}");
    let record = bench.json("a/records/000000.json");
    for number in 3..=5 {
        let note = record["drawn"][format!("defect[missing][{number}]")].as_str().expect("a note").to_owned();
        assert!(note.contains("not made"), "{note}");
    }
    assert!(record["drawn"].get("defect[missing][2]").is_none());
}

#[test]
fn a_colour_of_a_defect_may_be_one_number() {
    let dust = |color: &str| {
        let entry = format!("[[study.defect]]\nkind = \"dust\"\non = \"plate\"\nlength = \"8mm\"\ncolor = {color}\n");
        let bench = Bench::new(&changed("[camera]", &format!("{entry}[camera]")));
        bench.run("dataset study.toml -o a --count 1");
        fs::read(bench.path("a/raw/000000.raw")).expect("an image")
    };
    assert!(dust("0.5") == dust("[0.5, 0.5, 0.5]") && dust("0.5") != dust("0.9"));
}

#[test]
fn verify_finds_a_changed_description_and_a_changed_study() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a --count 2");
    bench.run("dataset --verify a");
    for (file, from, to, words) in [
        ("a/set.json", "\"ball\"", "\"bell\"", "coco.json differs from the file"),
        ("a/study.toml", "seed = 3", "seed = 4", "it differs from the study of the set"),
    ] {
        let before = fs::read_to_string(bench.path(file)).expect("a file");
        assert!(before.contains(from), "{before}");
        fs::write(bench.path(file), before.replace(from, to)).expect("writable");
        let message = bench.said("dataset --verify a", 1);
        assert!(message.contains(words), "{message}");
        fs::write(bench.path(file), before).expect("writable");
    }
    // The folder of the files may be another one.
    let text = fs::read_to_string(bench.path("a/study.toml")).expect("a file");
    fs::write(bench.path("a/study.toml"), text.replace("[study]\n", "[study]\nfolder = \"../b\"\n")).expect("writable");
    bench.run("dataset --verify a");
}

#[test]
fn a_set_takes_only_images_of_its_study() {
    let bench = Bench::new(STUDY);
    fs::write(bench.path("other.toml"), changed("seed = 3", "seed = 4")).expect("writable");
    let worker =
        |name: &str| Worker::open(&Arc::new(Study::open(bench.path(name)).expect("a study")), 1).expect("a worker");
    let (mut own, mut other) = (worker("study.toml"), worker("other.toml"));
    let set = own.open_set(&bench.path("a"), Some(2)).expect("a set");
    let made = |worker: &mut Worker, index| worker.make(index, None, &Cancel::new()).expect("an image").expect("whole");
    let foreign = set.write(made(&mut other, 0)).expect_err("another study").to_string();
    assert!(foreign.contains("of another study than \"blocks\""), "{foreign}");
    let beyond = set.write(made(&mut own, 2)).expect_err("an index outside").to_string();
    assert!(beyond.contains("there is no image 2"), "{beyond}");
    assert!(!bench.path("a/images").exists() && set.missing() == [0, 1]);
    assert!(own.make(1_000_000, None, &Cancel::new()).is_err());
    set.write(made(&mut own, 0)).expect("written");
}
