//! Runs: repeated, grown, killed, shared, refused.

use super::bench::{Bench, STUDY, assert_same, files};
use crate::bench::PROGRAM;
use serde_json::Value;
use std::fs;
use std::process::{Command as Process, Stdio};
use std::time::Duration;

/// Each image has the files of all captures, whose lights may be drawn, and one record.
#[test]
fn a_set_has_the_captures_of_each_image() {
    let captures = "[[capture]]\nname = \"full\"\nlights = [\"*\"]\n\
        [[capture]]\nname = \"weak\"\nlights = { panel = { uniform = [0.1, 0.2] } }\n";
    let bench = Bench::new(&format!("{STUDY}{captures}"));
    bench.run("dataset study.toml -o a --count 2");
    bench.run("dataset --verify a");
    let all = files(&bench.path("a"));
    for index in 0..2 {
        for folder in [["images", "png"], ["linear", "tif"], ["raw", "raw"]] {
            let [full, weak] =
                ["full", "weak"].map(|name| &all[&format!("{}/{index:06}-{name}.{}", folder[0], folder[1])]);
            assert_ne!(full, weak);
        }
        assert!(!all.contains_key(&format!("images/{index:06}.png")));
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let captures = record["captures"].as_object().expect("captures");
        assert_eq!(captures.keys().collect::<Vec<_>>(), ["full", "weak"]);
        assert_eq!(captures["full"]["exposure"], record["exposure"]);
        let factor = record["drawn"]["capture[weak].lights.panel"].as_f64().expect("drawn");
        assert!((0.1..=0.2).contains(&factor), "{factor}");
        let mean = |name: &str| {
            let bytes = &all[&format!("raw/{index:06}-{name}.raw")];
            bytes.chunks(2).map(|v| f64::from(u16::from_le_bytes([v[0], v[1]]))).sum::<f64>() / bytes.len() as f64
        };
        assert!(mean("weak") < mean("full"), "{index}");
    }
}

/// Labels are of one camera and of all lines.
#[test]
fn captures_that_labels_do_not_fit_are_refused() {
    let two = "[[capture]]\nname = \"a\"\n[[capture]]\nname = \"b\"\n";
    let lines = STUDY.replace("[sensor]\n", "[line_scan]\nline_rate = \"10Hz\"\nalternate = true\n[sensor]\n");
    let other = two.replacen("name = \"a\"", "name = \"a\"\ncamera = \"side\"", 1);
    for (text, wanted) in [(format!("{lines}{two}"), "alternate"), (format!("{STUDY}{other}"), "of several")] {
        let run = Bench::new(&text).refused("dataset study.toml -o a");
        assert!(run.contains(wanted), "{run}");
    }
}

#[test]
fn a_set_has_its_files_and_is_the_same_with_any_number_of_jobs() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a --jobs 1 --threads 1");
    bench.run("dataset study.toml -o b --jobs 3 --threads 2");
    assert_same(&bench.path("a"), &bench.path("b"));
    bench.run("dataset --verify a");

    let all = files(&bench.path("a"));
    for name in [
        "set.json",
        "study.toml",
        "coco.json",
        "records.jsonl",
        "scene_camera.json",
        "scene_gt.json",
        "data.yaml",
        "images/000005.png",
        "linear/000005.tif",
        "raw/000005.raw",
        "masks/000005.png",
        "semantic/000005.png",
        "depth/000005.png",
        "normals/000005.png",
        "labels/000005.json",
        "labels/000005.txt",
        "records/000005.json",
    ] {
        assert!(all.contains_key(name), "{name}");
    }
    assert!(!all.keys().any(|name| name.contains("000006") || name.ends_with(".lock")), "{:?}", all.keys());
    assert_eq!(all["raw/000000.raw"].len(), 64 * 48 * 2);

    // Two images in a row are of one device, and each image has its own frame.
    let records: Vec<Value> = (0..6).map(|i| bench.json(&format!("a/records/{i:06}.json"))).collect();
    assert_eq!(records[0]["seed"], records[1]["seed"]);
    assert_ne!(records[1]["seed"], records[2]["seed"]);
    assert_eq!(records[4]["frame"], 4);
    for record in &records {
        let drawn = record["drawn"].as_object().expect("draws");
        for name in [
            "camera.position[0]",
            "draw.supply",
            "draw.twice",
            "light[panel].power",
            "object[ball].diameter",
            "defect[scratch].count",
            "place[block 1].turn",
        ] {
            assert!(drawn.contains_key(name), "{name} in {:?}", drawn.keys());
        }
        let number = |name: &str| drawn[name].as_f64().expect("a number");
        assert!((number("draw.twice") - 2.0 * number("draw.supply")).abs() < 1e-12);
        assert!(record["matched"].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share)));
        assert_eq!(record["samples"], 8 * 64 * 48);
    }
    // Categories are those of the set, whatever an image shows, and instances are counted in each image.
    let set = bench.json("a/set.json");
    let names: Vec<&str> =
        (set["categories"].as_array().expect("a list").iter()).map(|c| c["name"].as_str().expect("a name")).collect();
    assert_eq!(names, ["block", "ball", "scratch"]);
    for record in &records {
        let instances = record["instances"].as_array().expect("instances");
        for (k, instance) in instances.iter().enumerate() {
            assert_eq!(instance["id"], k + 1);
            let category = instance["category"].as_u64().expect("an id") as usize;
            assert!(instance["name"].as_str().expect("a name").starts_with(names[category - 1]), "{instance}");
        }
    }
}

#[test]
fn one_image_is_the_same_alone_and_the_set_grows() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a");
    bench.run("dataset study.toml -o b --count 5 --index 4,1");
    let (a, b) = (files(&bench.path("a")), files(&bench.path("b")));
    let of_images: Vec<&String> = b.keys().filter(|name| name.contains('/')).collect();
    assert!(of_images.iter().all(|name| name.contains("000001") || name.contains("000004")), "{of_images:?}");
    for name in of_images {
        assert!(a[name] == b[name], "{name} differs");
    }
    // The set goes on and grows, and is that of one run.
    bench.run("dataset study.toml -o b");
    assert_same(&bench.path("a"), &bench.path("b"));
}

#[test]
fn a_time_for_the_whole_set_replaces_the_budget_of_the_job() {
    let bench = Bench::new(&STUDY.replace("count = 6", "count = 16"));
    bench.run("dataset study.toml -o a --time 8s --jobs 2");
    let samples: Vec<u64> =
        (0..16).map(|i| bench.json(&format!("a/records/{i:06}.json"))["samples"].as_u64().expect("a number")).collect();
    // With the budget of the job each image would have as many samples. How many a time gives is up to the machine.
    assert!(samples.iter().any(|n| *n != 8 * 64 * 48), "{samples:?}");
    // A time in which not even the scenes are loaded.
    let message = bench.said("dataset study.toml -o b --count 6 --time 10ms --jobs 1", 0);
    assert!(message.contains("warning: the time budget of 0.0 s was missed by"), "{message}");
}

#[test]
fn images_that_do_not_fit_have_the_same_effect_with_any_number_of_jobs() {
    let sizes = |sizes: &str| {
        STUDY.replace("size = [\"90mm\", 0, \"90mm\"]", &format!("size = [{{ sequence = {sizes} }}, 0, \"90mm\"]"))
    };
    let bench = Bench::new(&sizes("[\"90mm\", \"12mm\", \"12mm\"]"));
    for (set, jobs) in [("a", 1), ("b", 4)] {
        let message = bench.said(&format!("dataset study.toml -o {set} --jobs {jobs}"), 1);
        assert!(message.contains("finds no place") && message.contains("help:"), "{message}");
        let flagged: Vec<bool> = (0..6).map(|i| message.contains(&format!("image {i}: "))).collect();
        assert_eq!(flagged, [false, true, true, false, true, true], "{message}");
    }
    assert_same(&bench.path("a"), &bench.path("b"));
    // The images that can be made are a set of their own.
    assert_eq!(bench.json("a/coco.json")["images"].as_array().map(Vec::len), Some(2));
    bench.said("dataset --verify a", 1);
    // The first image of an empty set has no room; the others have it.
    fs::write(bench.path("study.toml"), sizes("[\"12mm\", \"90mm\", \"90mm\"]")).expect("writable");
    for jobs in [1, 4] {
        let message = bench.refused(&format!("dataset study.toml -o c --jobs {jobs}"));
        assert!(message.contains("image 0: ") && !message.contains("image 3: "), "{message}");
        assert!(!bench.path("c").exists(), "{jobs}");
    }
    // An index may be there twice.
    let message = bench.said("dataset study.toml -o c --index 1,3,3 --jobs 4", 1);
    assert_eq!(message.matches("image 3: ").count(), 1, "{message}");
}

#[test]
fn a_study_that_made_nothing_can_be_corrected() {
    let small = STUDY.replace("size = [\"90mm\", 0, \"90mm\"]", "size = [\"20mm\", 0, \"20mm\"]");
    let bench = Bench::new(&small);
    assert!(bench.refused("dataset study.toml -o a --count 1").contains("finds no place"));
    assert!(!bench.path("a").exists(), "nothing was made, and nothing was there before");
    fs::create_dir(bench.path("a")).expect("free");
    assert!(bench.refused("dataset study.toml -o a --count 1").contains("finds no place"));
    assert_eq!(fs::read_dir(bench.path("a")).expect("the folder was there before").count(), 0);
    fs::write(bench.path("study.toml"), STUDY).expect("writable");
    bench.run("dataset study.toml -o a --count 1");
    let written = fs::read_to_string(bench.path("a/study.toml")).expect("a study");
    assert_eq!(written, format!("# The study of study.toml.\n{STUDY}"));
    // A set that was edited by hand is refused, and ends.
    let text = fs::read_to_string(bench.path("a/set.json")).expect("a set");
    fs::write(bench.path("a/set.json"), text.replace("\"count\":1,", "\"count\":18446744073709551615,"))
        .expect("writable");
    assert!(bench.refused("dataset --verify a").contains("count"));
    assert!(bench.refused("dataset study.toml -o a").contains("count"));
}

#[test]
fn sensors_and_their_noise_may_vary() {
    let drawn = "[sensor]\nexposure = { sequence = [\"20ms\", \"10ms\"] }\nexposure_noise = { sequence = [\"matched\", \"plain\"] }\n\
        gain = { uniform = [0.5, 2] }\nmodel = { choice = [\"imx250\", \"imx174\"] }";
    let bench = Bench::new(&STUDY.replace("[sensor]\nexposure = \"20ms\"", drawn));
    let message = bench.said("dataset study.toml -o a --count 4 --jobs 1", 0);
    assert!(message.contains("warning: noise-matched exposure holds for only"), "{message}");
    let matched: Vec<bool> =
        (0..4).map(|i| bench.json(&format!("a/records/{i:06}.json"))["matched"].is_number()).collect();
    assert_eq!(matched, [true, false, true, false]);
}

/// The kill comes at another moment in each run; the result must not depend on it.
#[test]
fn a_killed_run_goes_on_and_two_processes_share_a_set() {
    let bench = Bench::new(&STUDY.replace("count = 6", "count = 12"));
    bench.run("dataset study.toml -o alone");
    let start = || {
        Process::new(PROGRAM)
            .current_dir(bench.folder.path())
            .args(["dataset", "study.toml", "-o", "shared", "--jobs", "2", "--progress", "none"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts")
    };
    for wait in [150, 400] {
        let mut child = start();
        std::thread::sleep(Duration::from_millis(wait));
        child.kill().expect("it can be killed");
        child.wait().expect("it ends");
    }
    let (mut a, mut b) = (start(), start());
    assert!(a.wait().expect("it ends").success());
    assert!(b.wait().expect("it ends").success());
    assert_same(&bench.path("alone"), &bench.path("shared"));
    bench.run("dataset --verify shared");
    // One of two dies: the other one makes its images.
    fs::remove_dir_all(bench.path("shared")).expect("there");
    let (mut a, mut b) = (start(), start());
    std::thread::sleep(Duration::from_millis(400));
    a.kill().expect("it can be killed");
    a.wait().expect("it ends");
    assert!(b.wait().expect("it ends").success());
    assert_same(&bench.path("alone"), &bench.path("shared"));
}

#[test]
fn a_check_finds_what_was_changed() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a --count 2");
    let check = || bench.said("dataset --verify a", 1);
    let image = bench.path("a/images/000001.png");
    let before = fs::read(&image).expect("there");
    fs::write(&image, b"no image").expect("writable");
    assert!(check().contains("images/000001.png differs from its hash"));
    fs::remove_file(&image).expect("there");
    assert!(check().contains("images/000001.png does not exist"));
    fs::write(&image, before).expect("writable");
    bench.run("dataset --verify a");

    // The annotations against the mask: the record with the hash is changed as well. A mask of another size is not decoded.
    let mut labels = bench.json("a/labels/000000.json");
    labels["annotations"][1]["segmentation"]["size"] = serde_json::json!([65_535, 65_537]);
    let annotation = &mut labels["annotations"][0];
    annotation["instance"] = Value::from(annotation["instance"].as_u64().expect("an id") + 1);
    fs::write(bench.path("a/labels/000000.json"), labels.to_string()).expect("writable");
    let message = check();
    assert!(message.contains("labels/000000.json differs from its hash"), "{message}");
    assert_eq!(message.matches("differs from the annotation").count(), 2, "{message}");
    fs::remove_file(bench.path("a/records/000001.json")).expect("there");
    assert!(check().contains("flagged: 1 of 2 images are not finished; help:"));
    // A set of another version: its images are checked, and not compared with what this version makes of them.
    let text = fs::read_to_string(bench.path("a/set.json")).expect("a set");
    let program = concat!("dunkelfeld ", env!("CARGO_PKG_VERSION"));
    fs::write(bench.path("a/set.json"), text.replace(program, "dunkelfeld 0.0.1")).expect("writable");
    let message = check();
    assert!(message.contains(&format!("holds a set of dunkelfeld 0.0.1, and this is {program}")), "{message}");
    assert!(!message.contains("coco.json") && message.contains("labels/000000.json differs"), "{message}");
    fs::write(bench.path("a/set.json"), text).expect("writable");
    bench.refused("dataset --verify no-such-folder");
    fs::write(bench.path("a/set.json"), "{}").expect("writable");
    assert!(bench.refused("dataset --verify a").contains("set.json"));
}

#[test]
fn bad_studies_are_refused_before_anything_is_written() {
    let bench = Bench::new(STUDY);
    for (from, to, words) in [
        ("count = 6", "count = 0", "out of range"),
        ("seed = 3", "sead = 3", "sead"),
        ("device = 2", "device = 0", "each"),
        ("spp = 8", "spp = { uniform = [8, 4] }", "above the upper end"),
        ("spp = 8", "spp = { draw = \"none\" }", "no draw `none`"),
        ("spp = 8", "sp = { uniform = [4, 8] }", "unknown key"),
        ("\"2 * supply\"", "\"2 * twice\"", "depends on itself"),
        ("\"2 * supply\"", "\"1 / (supply - supply)\"", "inf"),
        ("[film]", "[output]\nimage = \"a.png\"\n\n[film]", "not for the images of a set"),
        ("objects = [\"ball\"]", "objects = [\"bal\"]", "no object is called \"bal\""),
        ("on = \"plate\"", "on = \"plat\"", "no object is called \"plat\""),
        ("on = \"plate\"", "on = [\"plate\", \"plat\"]", "no object is called \"plat\""),
        ("on = \"plate\"", "on = { choice = [\"plate\", [\"ball\", \"bal\"]] }", "[[study.defect]] 1, on"),
        ("objects = \"block *\"\ncenter", "objects = [\"block *\", \"bal\"]\ncenter", "[[study.place]] 1, objects"),
        ("width = \"2mm\"", "width = \"-2mm\"", "[[study.defect]] 1, width"),
        ("depth = \"100um\"", "depth = \"100um\"\nroughness = 1.9", "[[study.defect]] 1, roughness"),
        ("depth = \"100um\"", "depth = \"100um\"\ncolor = [0, 2, 0]", "[[study.defect]] 1, color"),
        ("facing = [0, 1, 0]", "facing = [0, 0, 0]", "[[study.defect]] 1, facing"),
        ("kind = \"scratch\"", "kind = \"scrath\"", "[[study.defect]] 1, kind"),
        ("kind = \"scratch\"", "kind = \"scrath\"", "did you mean \"scratch\"? The kinds are scratch, dent,"),
        ("width = \"2mm\"\n", "", "the key `width` is missing"),
        ("on = \"plate\"\n", "", "needs the key `on`"),
        ("size = [\"90mm\", 0, \"90mm\"]", "size = [\"20mm\", 0, \"20mm\"]", "finds no place"),
        ("count = { integer = [0, 2] }", "count = { uniform = [0, 2] }", "number of defects \"scratch\" is"),
        ("count = { integer = [0, 2] }", "count = { draw = \"supply\" }", "by the draw `supply`"),
        ("count = { integer = [0, 2] }", "count = { expression = \"supply / 9\" }", "number of defects \"scratch\""),
        ("depth = \"100um\"", "strength = 0.5", "[[study.defect]] 1, strength"),
        ("{ uniform = [0.8, 1.2] }", "{ uniform = [1.2, 0.8] }", "[study.draw] supply"),
        ("power = { expression", "pawer = { expression", "pawer"),
        ("name = \"blocks\"", "name = \"../blocks\"", "not the name of a set"),
        ("center = [0, 0, 0]", "center = [nan, 0, 0]", "finite"),
        ("linear = \"tiff\"", "picture = \"none\"\nlinear = \"tiff\"", "[study.labels] yolo"),
        (
            "diameter = { log_uniform = [\"6mm\", \"12mm\"] }",
            "diameter = { log_uniform = [\"6ms\", \"12ms\"] }",
            "diameter",
        ),
    ] {
        let changed = STUDY.replacen(from, to, 1);
        assert_ne!(changed, STUDY, "{from}");
        fs::write(bench.path("bad.toml"), changed).expect("writable");
        let message = bench.refused("dataset bad.toml -o bad");
        assert!(
            message.contains("bad.toml") && message.contains(words) && message.contains("help:"),
            "{to}: {message}"
        );
        let written = bench.path("bad").join("records");
        let images = fs::read_dir(written).map_or(0, |entries| entries.count());
        assert_eq!(images, 0, "{to}");
        let _ = fs::remove_dir_all(bench.path("bad"));
    }
    assert!(bench.refused("dataset study.toml -o x --index 6").contains("no image 6"));
    assert!(bench.refused("dataset study.toml -o x --index -1").contains("write a whole number from 0 to 999999"));
    assert!(bench.refused("dataset no.toml -o x").contains("no.toml"));
    fs::create_dir(bench.path("mine")).expect("free");
    fs::write(bench.path("mine/letter.txt"), "dear").expect("writable");
    assert!(bench.refused("dataset study.toml -o mine").contains("not empty"));
    assert!(bench.refused("dataset study.toml -o .").contains("holds"));
    assert!(bench.refused("dataset study.toml -o study.toml").contains("study.toml"));
}

/// A long exposure: the run and the page have the share.
#[test]
fn a_set_with_saturated_pixels_says_so() {
    for (exposure, is_bright) in [("1ms", false), ("20ms", true)] {
        let bench = Bench::new(&STUDY.replace("exposure = \"20ms\"", &format!("exposure = \"{exposure}\"")));
        let message = bench.said("dataset study.toml -o a --count 1", 0);
        let page = fs::read_to_string(bench.path("a/report.html")).expect("a page");
        assert_eq!(message.contains("% of the pixels of these images are saturated"), is_bright, "{message}");
        assert_eq!(page.contains("of the pixels are saturated"), is_bright);
    }
}
