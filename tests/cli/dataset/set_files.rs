//! The study, the inputs and the files of a set.

use super::bench::{Bench, files};
use std::fs;

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
    // The study is compared by its keys: a comment and another name of the file change no image.
    let study = fs::read_to_string(bench.path("studies/tiles.toml")).expect("a study");
    fs::write(bench.path("studies/tiles.toml"), format!("# a comment\n{study}")).expect("writable");
    bench.run("dataset studies/tiles.toml -o a --count 2 --jobs 1");
    let named = study.replace("[study]\n", "# another comment\n[study]\nname = \"tiles\"\n");
    fs::write(bench.path("studies/renamed.toml"), named).expect("writable");
    bench.run("dataset studies/renamed.toml -o a --count 2 --jobs 1");
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
    let check = || bench.said("dataset --verify a", 1);
    for name in ["coco.json", "records.jsonl", "data.yaml", "scene_camera.json", "scene_gt.json"] {
        let path = bench.path("a").join(name);
        let before = fs::read(&path).expect(name);
        let mut other = before.clone();
        let middle = other.len() / 2;
        other[middle] ^= 1;
        for (changed, words) in
            [(Some(other), "differs from the file that the finished images give"), (None, "does not exist")]
        {
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
    // Files of no image.
    for name in ["images/000099.jpg", "masks/000001.tif", "records/000003.json", "labels/notes"] {
        fs::write(bench.path("a").join(name), "foreign").expect("writable");
        let message = check();
        assert!(message.contains(&format!("{name} belongs to no image of the set")), "{message}");
        fs::remove_file(bench.path("a").join(name)).expect("there");
    }
    // A partial file of an image that is not finished is none, and files beside the folders may be there.
    bench.run("dataset studies/tiles.toml -o b --jobs 1 --index 0");
    fs::write(bench.path("b/images/000002.png"), "a part").expect("writable");
    fs::write(bench.path("b/labels.cache"), "of a reader").expect("writable");
    let message = bench.said("dataset --verify b", 1);
    assert!(
        !message.contains("belongs to no image") && message.contains("2 of 3 images are not finished"),
        "{message}"
    );
    // The page contains times, and is only there.
    fs::write(bench.path("a/report.html"), "a page").expect("writable");
    bench.run("dataset --verify a");
    fs::remove_file(bench.path("a/report.html")).expect("there");
    assert!(check().contains("report.html does not exist"));
}
