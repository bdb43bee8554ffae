//! `dunkelfeld dataset` as its users have it: a small study, its files, and what happens when a run is killed, repeated or
//! shared by two processes.
//!
//! Replay: `cargo test --workspace --test dataset NAME`.

use assert_cmd::Command;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};
use std::time::Duration;
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

/// A plate with two blocks and a ball under a lamp, from above.
const STUDY: &str = r#"
scene = "none"

[study]
name = "blocks"
count = 6
seed = 3
device = 2

[study.draw]
supply = { uniform = [0.8, 1.2] }
twice = { expression = "2 * supply" }

[study.images]
linear = "tiff"
raw = true

[study.labels]
semantic = true
depth = true
normals = true
yolo = true
bop = true

[[study.label]]
category = "block"
objects = "block *"

[[study.label]]
category = "ball"
objects = ["ball"]

[[study.place]]
objects = "block *"
center = [0, 0, 0]
size = ["90mm", 0, "90mm"]
turn = "360deg"
clearance = "1mm"

[[study.defect]]
kind = "scratch"
on = "plate"
facing = [0, 1, 0]
count = { integer = [0, 2] }
length = { uniform = ["10mm", "30mm"] }
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
spp = 8

[sensor]
exposure = "20ms"

[[object]]
name = "plate"
kind = "box"
size = ["120mm", "2mm", "120mm"]
translate = [0, "-1mm", 0]

[[object]]
name = "block 1"
kind = "box"
size = ["12mm", "6mm", "12mm"]
translate = [0, "3mm", 0]

[[object]]
name = "block 2"
kind = "box"
size = ["10mm", "8mm", "20mm"]
translate = [0, "4mm", 0]

[[object]]
name = "ball"
kind = "sphere"
diameter = { log_uniform = ["6mm", "12mm"] }
translate = ["40mm", "12mm", "30mm"]

[[light]]
name = "panel"
kind = "panel"
width = "100mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = { expression = "1.5 * supply", unit = "W" }
"#;

struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new(study: &str) -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        fs::write(folder.path().join("study.toml"), study).expect("writable");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(PROGRAM);
        command.current_dir(self.folder.path()).args(line.split_whitespace()).args(["--progress", "none"]);
        command
    }

    fn run(&self, line: &str) {
        self.command(line).assert().success();
    }

    /// Standard error of a command that is refused with exit code 2.
    fn refused(&self, line: &str) -> String {
        let assert = self.command(line).assert().code(2);
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).expect(name)).expect(name)
    }
}

/// All files of a set but the times, which differ from run to run.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(folder).expect("below").to_string_lossy().replace('\\', "/");
            if path.is_dir() {
                folders.push(path);
            } else if !name.starts_with("costs/") && name != "report.html" {
                found.insert(name, fs::read(&path).expect("readable"));
            }
        }
    }
    found
}

fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, content) in &a {
        assert!(b[name] == *content, "{name} differs");
    }
}

#[test]
fn a_set_has_its_files_and_is_the_same_with_any_number_of_jobs() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a --jobs 1 --threads 1");
    bench.run("dataset study.toml -o b --jobs 3 --threads 2");
    assert_same(&bench.path("a"), &bench.path("b"));
    bench.command("dataset --verify a").assert().success();

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
    // Ids are those of the set, whatever an image shows.
    let set = bench.json("a/set.json");
    let ids: BTreeMap<String, u64> = (set["instances"].as_array().expect("instances").iter())
        .map(|i| (i["name"].as_str().expect("a name").to_owned(), i["id"].as_u64().expect("an id")))
        .collect();
    assert_eq!(
        ids.keys().map(String::as_str).collect::<Vec<_>>(),
        ["ball", "block 1", "block 2", "scratch 1", "scratch 2"]
    );
    for instance in records.iter().flat_map(|r| r["instances"].as_array().expect("instances")) {
        assert_eq!(instance["id"].as_u64(), ids.get(instance["name"].as_str().expect("a name")).copied());
    }
}

#[test]
fn one_image_is_the_same_alone() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a");
    bench.run("dataset study.toml -o b --index 4,1");
    let (a, b) = (files(&bench.path("a")), files(&bench.path("b")));
    let of_images: Vec<&String> = b.keys().filter(|name| name.contains('/')).collect();
    assert!(of_images.iter().all(|name| name.contains("000001") || name.contains("000004")), "{of_images:?}");
    for name in of_images {
        assert!(a[name] == b[name], "{name} differs");
    }
    // The same command without the index goes on, and the set is that of one run.
    bench.run("dataset study.toml -o b");
    assert_same(&bench.path("a"), &bench.path("b"));
}

#[test]
fn a_set_grows_and_refuses_another_study() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o grown --count 2");
    bench.run("dataset study.toml -o grown --count 4");
    bench.run("dataset study.toml -o at-once --count 4");
    assert_same(&bench.path("grown"), &bench.path("at-once"));
    fs::write(bench.path("other.toml"), STUDY.replace("seed = 3", "seed = 4")).expect("writable");
    let message = bench.refused("dataset other.toml -o grown --count 4");
    assert!(message.contains("another study") && message.contains("help:"), "{message}");
}

#[test]
fn a_time_for_the_whole_set_replaces_the_budget_of_the_job() {
    let bench = Bench::new(&STUDY.replace("count = 6", "count = 16"));
    let assert = bench.command("dataset study.toml -o a --time 8s --jobs 2").assert().success();
    let message = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(message.contains("forecast:") && message.contains("hidden at k ="), "{message}");
    let samples: Vec<u64> =
        (0..16).map(|i| bench.json(&format!("a/records/{i:06}.json"))["samples"].as_u64().expect("a number")).collect();
    // With the budget of the job each image would have as many samples. How many a time gives is up to the machine.
    assert!(samples.iter().any(|n| *n != 8 * 64 * 48), "{samples:?}");
}

#[test]
fn an_image_whose_draws_do_not_fit_does_not_end_the_set() {
    let wide = "size = [{ sequence = [\"90mm\", \"90mm\", \"12mm\"] }, 0, \"90mm\"]";
    let bench = Bench::new(&STUDY.replace("size = [\"90mm\", 0, \"90mm\"]", wide));
    let assert = bench.command("dataset study.toml -o a --jobs 1").assert().code(1);
    let message = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    for words in ["image 2", "image 5", "finds no place", "help:"] {
        assert!(message.contains(words), "{words} in {message}");
    }
    let finished = (0..6).filter(|i| bench.path(&format!("a/records/{i:06}.json")).is_file()).collect::<Vec<_>>();
    assert_eq!(finished, [0, 1, 3, 4]);
    // The images that can be made are a set of their own, also after another run.
    bench.command("dataset study.toml -o a --jobs 1").assert().code(1);
    assert_eq!(bench.json("a/coco.json")["images"].as_array().map(Vec::len), Some(4));
    bench.command("dataset --verify a").assert().code(1);
}

#[test]
fn a_study_that_made_nothing_can_be_corrected() {
    let small = STUDY.replace("size = [\"90mm\", 0, \"90mm\"]", "size = [\"20mm\", 0, \"20mm\"]");
    let bench = Bench::new(&small);
    assert!(bench.refused("dataset study.toml -o a --count 1").contains("finds no place"));
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
    bench.run("dataset study.toml -o a --count 4 --jobs 1");
    let matched: Vec<bool> =
        (0..4).map(|i| bench.json(&format!("a/records/{i:06}.json"))["matched"].is_number()).collect();
    assert_eq!(matched, [true, false, true, false]);
    bench.run("dataset study.toml -o b --count 4 --index 3,1 --jobs 1");
    for name in ["images/000001.png", "raw/000003.raw", "records/000003.json"] {
        assert!(fs::read(bench.path("a").join(name)).ok() == fs::read(bench.path("b").join(name)).ok(), "{name}");
    }
}

/// A bench with a study whose job and scene are in other folders, and whose file alone has no name for the set.
fn split_bench() -> Bench {
    let bench = Bench::new("");
    for folder in ["studies", "jobs"] {
        fs::create_dir(bench.path(folder)).expect("free");
    }
    let obj = "o tile\nv -0.02 0 -0.02\nv 0.02 0 -0.02\nv 0.02 0 0.02\nv -0.02 0 0.02\nf 4 3 2 1\n";
    fs::write(bench.path("jobs/tile.obj"), obj).expect("writable");
    let job = "scene = \"tile.obj\"\n[film]\nwidth = 24\nheight = 16\n[budget]\nspp = 4\n[sensor]\nexposure = \"20ms\"\n\
        [camera]\nposition = [0, \"200mm\", \"1mm\"]\nlook_at = [0, 0, 0]\n[environment]\nradiance = 1\n";
    fs::write(bench.path("jobs/job.toml"), job).expect("writable");
    let study = "[study]\njob = \"../jobs/job.toml\"\ncount = 3 # images\n[study.draw]\nn = { integer = [0, 3] }\n\
        [study.labels]\nyolo = true\nbop = true\n[[study.label]]\ncategory = \"tile\"\nobjects = \"tile\"\n\
        [[study.defect]]\nkind = \"dust\"\non = \"tile\"\nlength = \"2mm\"\ncount = { draw = \"n\" }\n\
        [environment]\nradiance = { uniform = [1, 2] }\n[budget]\nspp = { expression = \"8 * n + 8\" }\n";
    fs::write(bench.path("studies/tiles.toml"), study).expect("writable");
    bench
}

#[test]
fn the_study_of_a_set_makes_the_same_images_from_its_folder() {
    let bench = split_bench();
    bench.run("dataset studies/tiles.toml -o sets/one --jobs 1");
    let text = fs::read_to_string(bench.path("sets/one/study.toml")).expect("a study");
    assert!(text.starts_with("# The study of tiles.toml") && text.contains("count = 3 # images"), "{text}");
    assert!(text.contains("name = \"tiles\"") && text.contains("folder = \"../../studies\""), "{text}");
    assert!(!text.contains(&*bench.folder.path().to_string_lossy()), "{text}");
    bench.run("dataset sets/one/study.toml -o again --jobs 1");
    let (a, b) = (files(&bench.path("sets/one")), files(&bench.path("again")));
    for name in a.keys().filter(|name| name.contains('/')) {
        assert!(a[name] == b[name], "{name} differs");
    }
    // The draw is the number of defects, and the formula of it the number of samples.
    for i in 0..3 {
        let record = bench.json(&format!("sets/one/records/{i:06}.json"));
        let n = record["drawn"]["draw.n"].as_u64().expect("a whole number");
        assert_eq!(record["drawn"]["defect[dust].count"].as_u64(), Some(n));
        assert_eq!(record["samples"].as_u64(), Some((8 * n + 8) * 24 * 16));
    }
}

#[test]
fn a_set_has_hashes_of_its_inputs_and_refuses_others() {
    let bench = split_bench();
    bench.run("dataset studies/tiles.toml -o a --count 1 --jobs 1");
    let set = bench.json("a/set.json");
    let inputs: Vec<&str> =
        set["inputs"].as_array().expect("a list").iter().map(|i| i["path"].as_str().expect("a path")).collect();
    assert_eq!(inputs, ["../jobs/job.toml", "../jobs/tile.obj", "tiles.toml"]);
    for file in ["jobs/tile.obj", "jobs/job.toml"] {
        let before = fs::read_to_string(bench.path(file)).expect(file);
        fs::write(bench.path(file), format!("{before}\n# a comment\n")).expect("writable");
        let message = bench.refused("dataset studies/tiles.toml -o a --count 2");
        assert!(message.contains(&format!("another \"../{file}\"")) && message.contains("help:"), "{message}");
        fs::write(bench.path(file), before).expect("writable");
    }
    bench.run("dataset studies/tiles.toml -o a --count 2 --jobs 1");
    // A set of the format without hashes.
    fs::write(bench.path("a/set.json"), "{\"format\":1,\"study\":\"tiles\"}").expect("writable");
    for line in ["dataset studies/tiles.toml -o a", "dataset --verify a"] {
        let message = bench.refused(line);
        assert!(message.contains("format 1, of an older version") && message.contains("help:"), "{message}");
    }
}

#[test]
fn a_check_compares_the_files_of_the_whole_set() {
    let bench = split_bench();
    bench.run("dataset studies/tiles.toml -o a --jobs 1");
    bench.run("dataset --verify a");
    let check = || {
        let assert = bench.command("dataset --verify a").assert().code(1);
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    for name in ["coco.json", "records.jsonl", "data.yaml", "scene_camera.json", "scene_gt.json", "sheet.png"] {
        let path = bench.path("a").join(name);
        let before = fs::read(&path).expect(name);
        let mut other = before.clone();
        let middle = other.len() / 2;
        other[middle] ^= 1;
        for (changed, words) in [
            (Some(other), "differs from the file that the finished images give"),
            (Some(before[..before.len() - 1].to_vec()), "differs from the file"),
            (Some([&before[..], b"\n"].concat()), "differs from the file"),
            (None, "does not exist"),
        ] {
            match changed {
                Some(content) => fs::write(&path, content).expect("writable"),
                None => fs::remove_file(&path).expect("there"),
            }
            let message = check();
            assert!(message.contains(&format!("{name} {words}")), "{name}: {message}");
            assert_eq!(message.matches("flagged:").count(), 1, "{message}");
        }
        fs::write(&path, before).expect("writable");
    }
    // The page contains times, and is only there.
    fs::write(bench.path("a/report.html"), "a page").expect("writable");
    bench.run("dataset --verify a");
    fs::remove_file(bench.path("a/report.html")).expect("there");
    assert!(check().contains("report.html does not exist"));
}

/// A washer that image 0 does not have, and a nut in its place in one image of four.
const VARIANTS: &str = r#"
[[object]]
name = { sequence = ["washer", "washer", "washer", "nut"] }
kind = "cylinder"
diameter = "10mm"
height = "2mm"
translate = ["-40mm", "1mm", "-30mm"]
visible = { sequence = [false, true, true, true] }
"#;

#[test]
fn objects_of_some_images_have_labels_placements_and_defects_there() {
    let added = "[[study.label]]\ncategory = \"fastener\"\nobjects = [\"washer\", \"nut\"]\n\
        [[study.place]]\nobjects = \"washer\"\ncenter = [\"-40mm\", 0, \"-30mm\"]\nsize = [\"20mm\", 0, \"20mm\"]\n\
        [[study.defect]]\nkind = \"dust\"\non = \"washer\"\nlength = \"8mm\"\n";
    let text = STUDY.replace("[[study.place]]\n", &format!("{added}[[study.place]]\n")) + VARIANTS;
    let bench = Bench::new(&text);
    bench.run("dataset study.toml -o a");
    bench.command("dataset --verify a").assert().success();
    let set = bench.json("a/set.json");
    let ids: BTreeMap<&str, u64> = (set["instances"].as_array().expect("instances").iter())
        .map(|i| (i["name"].as_str().expect("a name"), i["id"].as_u64().expect("an id")))
        .collect();
    let expected = ["ball", "block 1", "block 2", "dust 1", "nut", "scratch 1", "scratch 2", "washer"];
    assert_eq!(ids.keys().copied().collect::<Vec<_>>(), expected);
    let mut names = Vec::new();
    for index in 0..6 {
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let instances = record["instances"].as_array().expect("instances");
        let found: Vec<&str> = ["washer", "nut", "dust 1"]
            .into_iter()
            .filter(|name| instances.iter().any(|i| i["name"] == **name && i["id"].as_u64() == ids.get(name).copied()))
            .collect();
        assert_eq!(record["drawn"].get("place[washer].x").is_some(), found.contains(&"washer"), "{index}");
        names.push(found.join(" and "));
    }
    // Image 0 lacks the washer, and image 3 has the nut.
    assert_eq!(names, ["", "washer and dust 1", "washer and dust 1", "nut", "", "washer and dust 1"]);
    // Alone and in a larger set the ids are the same.
    bench.run("dataset study.toml -o b --count 1");
    bench.run("dataset study.toml -o b --count 4");
    for name in ["masks/000003.png", "labels/000001.json"] {
        assert!(fs::read(bench.path("a").join(name)).ok() == fs::read(bench.path("b").join(name)).ok(), "{name}");
    }
    for (from, to) in
        [("\"nut\"]\n[[study.place]]", "\"nat\"]\n[[study.place]]"), ("on = \"washer\"", "on = \"wascher\"")]
    {
        fs::write(bench.path("bad.toml"), text.replace(from, to)).expect("writable");
        let message = bench.refused("dataset bad.toml -o bad");
        assert!(message.contains("bad.toml") && message.contains("no object"), "{message}");
    }
    fs::write(bench.path("bad.toml"), text.replace("objects = \"washer\"", "objects = \"wascher\"")).expect("writable");
    assert!(bench.refused("dataset bad.toml -o bad").contains("no object has such a name"));
}

#[test]
fn a_study_draws_one_of_several_cameras() {
    let (before, rest) = STUDY.split_once("[camera]").expect("a camera");
    let (_, after) = rest.split_once("[film]").expect("a film");
    let cameras = "[[camera]]\nname = \"left\"\nposition = [\"-80mm\", \"300mm\", \"1mm\"]\nlook_at = [0, 0, 0]\n\
        vertical_fov = \"25deg\"\n[[camera]]\nname = \"right\"\nposition = [\"80mm\", \"280mm\", \"1mm\"]\n\
        look_at = [0, 0, 0]\nvertical_fov = \"30deg\"\n";
    let choice = "camera = { sequence = [\"right\", \"left\"] }";
    // In one file, and in a study of a job with the cameras.
    let one = format!("{before}{cameras}[film]{after}").replace("device = 2", &format!("device = 2\n{choice}"));
    let bench = Bench::new(&one);
    bench.run("dataset study.toml -o a --count 4");
    let scene = before.split_once("[study]").expect("a study").1;
    let fixed = format!("scene = \"none\"\n{cameras}[film]{after}")
        .replace("{ expression = \"1.5 * supply\", unit = \"W\" }", "\"1.5W\"")
        .replace("{ log_uniform = [\"6mm\", \"12mm\"] }", "\"8mm\"");
    fs::write(bench.path("station.toml"), fixed).expect("writable");
    fs::write(bench.path("both.toml"), format!("{choice}\n[study]\njob = \"station.toml\"{scene}")).expect("writable");
    bench.run("dataset both.toml -o b --count 4");
    for set in ["a", "b"] {
        let cameras = bench.json(&format!("{set}/scene_camera.json"));
        for index in 0..4 {
            let record = bench.json(&format!("{set}/records/{index:06}.json"));
            let is_right = index % 2 == 0;
            assert_eq!(record["drawn"]["camera"], if is_right { "right" } else { "left" });
            let camera = &cameras[index.to_string()];
            // The focal length is 24 pixels over the tangent of half of the field.
            let (half, place) = if is_right { (15f64, [80.0, 280.0, 1.0]) } else { (12.5, [-80.0, 300.0, 1.0]) };
            let focal = camera["cam_K"][4].as_f64().expect("a number");
            assert!((focal - 24.0 / half.to_radians().tan()).abs() < 1e-3, "{set} {index}: {focal}");
            // R c + t = 0 at the place of the camera.
            let number = |key: &str, i: usize| camera[key][i].as_f64().expect("a number");
            for row in 0..3 {
                let sum: f64 = (0..3).map(|k| number("cam_R_w2c", 3 * row + k) * place[k]).sum();
                assert!((sum + number("cam_t_w2c", row)).abs() < 1e-6, "{set} {index}");
            }
        }
        bench.command(&format!("dataset --verify {set}")).assert().success();
    }
    fs::write(bench.path("bad.toml"), one.replace("[\"right\", \"left\"]", "[\"right\", \"top\"]")).expect("writable");
    let assert = bench.command("dataset bad.toml -o c --count 2 --jobs 1").assert().code(1);
    let message = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(message.contains("no camera \"top\"") && message.contains("left, right"), "{message}");
}

#[test]
fn key_points_and_stable_poses_are_in_all_files() {
    let points = "keypoints = [{ name = \"low\", at = [\"-5mm\", 0, 0] }, { name = \"high\", at = [\"5mm\", 0, 0] }]\n\
        skeleton = [[1, 2]]\n";
    let text = STUDY
        .replace("objects = \"block *\"\n\n", &format!("objects = \"block *\"\n{points}\n"))
        .replace("objects = [\"ball\"]\n", &format!("objects = [\"ball\"]\n{points}"))
        .replace("turn = \"360deg\"", "rest = \"stable\"");
    let text = text.split("[[study.defect]]").next().expect("a part").to_owned()
        + "[camera]"
        + text.split("[camera]").nth(1).expect("a camera");
    let bench = Bench::new(&text);
    bench.run("dataset study.toml -o a");
    bench.command("dataset --verify a").assert().success();
    let coco = bench.json("a/coco.json");
    for category in coco["categories"].as_array().expect("categories") {
        assert_eq!(category["keypoints"], serde_json::json!(["low", "high"]));
        assert_eq!(category["skeleton"], serde_json::json!([[1, 2]]));
    }
    let yaml = fs::read_to_string(bench.path("a/data.yaml")).expect("data.yaml");
    assert!(yaml.contains("kpt_shape: [2, 3]"), "{yaml}");
    let mut faces = std::collections::BTreeSet::new();
    for index in 0..6 {
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let labels = bench.json(&format!("a/labels/{index:06}.json"));
        let (camera, poses) = (&labels["camera"], labels["poses"].as_array().expect("poses"));
        let lines = fs::read_to_string(bench.path(&format!("a/labels/{index:06}.txt"))).expect("lines");
        assert!(lines.lines().all(|line| line.split(' ').count() == 5 + 6), "{lines}");
        for entry in labels["keypoints"].as_array().expect("key points") {
            // By the pose and the camera matrix of the same file: u = fx x / z + cx.
            let Some(pose) = poses.iter().find(|pose| pose["instance"] == entry["instance"]) else { continue };
            let number = |value: &Value| value.as_f64().expect("a number");
            for (at, point) in [-5.0, 5.0].into_iter().zip(entry["points"].as_array().expect("points")) {
                let [x, y, z] = [0, 1, 2].map(|k| number(&pose["r"][3 * k]) * at + number(&pose["t"][k]));
                let u = number(&camera["k"][0]) * x / z + number(&camera["k"][2]) + 0.5;
                let v = number(&camera["k"][4]) * y / z + number(&camera["k"][5]) + 0.5;
                assert!((number(&point["x"]) - u).abs() < 1e-4 && (number(&point["y"]) - v).abs() < 1e-4, "{point}");
            }
            let annotation = (labels["annotations"].as_array().expect("annotations").iter())
                .find(|annotation| annotation["instance"] == entry["instance"])
                .expect("an annotation");
            assert_eq!(annotation["num_keypoints"], 2);
        }
        for name in ["block 1", "block 2"] {
            let drawn = |key: &str| record["drawn"][format!("place[{name}].{key}")].as_f64().expect("a number");
            faces.insert((name, drawn("face") as i64));
            assert!((0.0..1.0).contains(&drawn("probability")));
        }
        // A block of 10 x 8 x 20 mm rests: the height of its centre above the plane is half of an edge.
        let lift = record["drawn"]["place[block 2].y"].as_str().expect("a length");
        let height = 4.0 + lift.trim_end_matches("mm").parse::<f64>().expect("a number");
        assert!([5.0, 4.0, 10.0].iter().any(|half| (height - half).abs() < 1e-6), "{height}");
    }
    assert!(faces.len() > 3, "{faces:?}");
    fs::write(bench.path("bad.toml"), text.replacen(points, "", 1)).expect("writable");
    assert!(bench.refused("dataset bad.toml -o bad").contains("same number of key points"));
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
    bench.command("dataset --verify shared").assert().success();
}

#[test]
fn a_check_finds_what_was_changed() {
    let bench = Bench::new(STUDY);
    bench.run("dataset study.toml -o a --count 2");
    let check = || {
        let assert = bench.command("dataset --verify a").assert().code(1);
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    let image = bench.path("a/images/000001.png");
    let before = fs::read(&image).expect("there");
    fs::write(&image, b"no image").expect("writable");
    assert!(check().contains("images/000001.png differs from its hash"));
    fs::remove_file(&image).expect("there");
    assert!(check().contains("images/000001.png does not exist"));
    fs::write(&image, before).expect("writable");
    bench.command("dataset --verify a").assert().success();

    // The annotations against the mask: the record with the hash is changed as well.
    let mut labels = bench.json("a/labels/000000.json");
    let annotation = &mut labels["annotations"][0];
    annotation["instance"] = Value::from(annotation["instance"].as_u64().expect("an id") + 1);
    fs::write(bench.path("a/labels/000000.json"), labels.to_string()).expect("writable");
    let message = check();
    assert!(message.contains("labels/000000.json differs from its hash"), "{message}");
    assert!(message.contains("differs from the annotation"), "{message}");
    fs::remove_file(bench.path("a/records/000001.json")).expect("there");
    check();
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
        ("on = \"plate\"", "on = \"plat\"", "no object has such a name"),
        ("kind = \"scratch\"", "kind = \"scrath\"", "scrath"),
        ("size = [\"90mm\", 0, \"90mm\"]", "size = [\"20mm\", 0, \"20mm\"]", "finds no place"),
        ("count = { integer = [0, 2] }", "count = { uniform = [0, 2] }", "not known"),
        ("count = { integer = [0, 2] }", "count = { draw = \"supply\" }", "in the draw `supply`"),
        ("count = { integer = [0, 2] }", "count = { expression = \"supply / 9\" }", "number of defects \"scratch\""),
        ("depth = \"100um\"", "strength = 0.5", "[[study.defect]] 1, strength"),
        ("{ uniform = [0.8, 1.2] }", "{ uniform = [1.2, 0.8] }", "[study.draw] supply"),
        ("power = { expression", "pawer = { expression", "pawer"),
        ("name = \"blocks\"", "name = \"../blocks\"", "not the name of a set"),
        ("center = [0, 0, 0]", "center = [nan, 0, 0]", "finite"),
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
    assert!(bench.refused("dataset no.toml -o x").contains("no.toml"));
    fs::create_dir(bench.path("mine")).expect("free");
    fs::write(bench.path("mine/letter.txt"), "dear").expect("writable");
    assert!(bench.refused("dataset study.toml -o mine").contains("not empty"));
    assert!(bench.refused("dataset study.toml -o .").contains("holds"));
    assert!(bench.refused("dataset study.toml -o study.toml").contains("study.toml"));
}
