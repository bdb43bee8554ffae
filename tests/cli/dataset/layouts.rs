//! The tree of MVTec AD, pairs with and without defects, the shapes of YOLO, and the price of a set.

use super::bench::{Bench, STUDY, files};
use crate::bench::{PROGRAM, stderr, stdout};
use assert_cmd::Command;
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A plate, which cannot light itself, with stains and spots. The draws are two for training, then those of the pairs 2 and
/// 3, 4 and 5 and so on: a stain; a stain and a spot; nothing; a stain below the plate.
const PLATE: &str = r#"
scene = "none"

[study]
count = 10
train = 2
pairs = true
device = "each"

[study.images]
layout = "mvtec"
linear = "png"

[[study.label]]
category = "plate"
objects = "plate"

[[study.defect]]
kind = "stain"
on = "plate"
facing = [0, 1, 0]
length = { uniform = ["20mm", "30mm"] }
color = 0.05
count = { sequence = [1, 1, 1, 1, 0, 0] }

[[study.defect]]
kind = "stain"
category = "spot"
on = "plate"
facing = [0, 1, 0]
length = "12mm"
color = 0.9
count = { sequence = [1, 1, 0, 1, 0, 0] }

[[study.defect]]
kind = "stain"
name = "below"
on = "plate"
facing = [0, -1, 0]
length = "12mm"
count = { sequence = [0, 0, 0, 0, 0, 1] }

[camera]
position = [{ uniform = ["-5mm", "5mm"] }, "300mm", "1mm"]
look_at = [0, 0, 0]
vertical_fov = "20deg"

[film]
width = 64
height = 48

[budget]
spp = 8

[sensor]
model = "imx250"
exposure = "2ms"
exposure_noise = "plain"

[[object]]
name = "plate"
kind = "box"
size = ["120mm", "2mm", "120mm"]
translate = [0, "-1mm", 0]

[[light]]
name = "panel"
kind = "panel"
width = "100mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = "1.5W"
"#;

/// A picture of a tree: `train` or `test`, its kind, its path, and its mask.
type Sample = (String, String, PathBuf, Option<PathBuf>);

/// The pictures of a tree by the rules of `make_mvtec_ad_dataset` of anomalib 2: all PNG files below the folder, by the last
/// three parts of their paths. The masks, in the order of their paths, are those of the test pictures with a kind other than
/// `good`, in the order of theirs. The stem of a picture is part of that of its mask.
fn read_as_anomalib(root: &Path) -> Vec<Sample> {
    let mut paths: Vec<PathBuf> = files(root).into_keys().map(|name| root.join(name)).collect();
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "png"));
    paths.sort();
    let part = |path: &Path, up: usize| {
        let name = path.ancestors().nth(up).and_then(Path::file_name);
        name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    };
    let (masks, pictures): (Vec<PathBuf>, Vec<PathBuf>) =
        paths.into_iter().partition(|path| part(path, 2) == "ground_truth");
    let mut masks = masks.into_iter();
    let mut samples = Vec::new();
    for path in pictures {
        let (split, kind) = (part(&path, 2), part(&path, 1));
        let mask = (split == "test" && kind != "good").then(|| masks.next().expect("a mask"));
        if let Some(mask) = &mask {
            let stem = |path: &Path| path.file_stem().expect("a stem").to_string_lossy().into_owned();
            assert!(stem(mask).contains(&stem(&path)), "{mask:?} of {path:?}");
        }
        samples.push((split, kind, path, mask));
    }
    assert_eq!(masks.next(), None, "a mask without a picture");
    samples
}

fn gray(path: &Path) -> Vec<u16> {
    read_gray(path, &Limits::default()).unwrap_or_else(|e| panic!("{}: {e}", path.display())).values.data().to_vec()
}

#[test]
fn the_tree_of_mvtec_is_read_and_checked() {
    let bench = Bench::new(PLATE);
    bench.run("dataset study.toml -o a");
    bench.run("dataset --verify a");
    let root = bench.path("a/mvtec");
    let mut found: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (split, kind, path, mask) in read_as_anomalib(&root) {
        let index: usize = path.file_stem().expect("a stem").to_string_lossy().parse().expect("an index");
        found.entry(format!("{split}/{kind}")).or_default().push(index);
        let picture = bench.path("a").join(format!("images/{index:06}.png"));
        assert!(fs::read(&path).expect("a picture") == fs::read(picture).expect("a picture"), "{path:?}");
        let Some(mask) = mask else { continue };
        // The mask is that of the labels: 255 where an instance is a defect.
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let defects: BTreeSet<u64> = (record["instances"].as_array().expect("instances").iter())
            .filter(|instance| instance["defect"].is_string())
            .map(|instance| instance["id"].as_u64().expect("an id"))
            .collect();
        let ids = gray(&bench.path("a").join(format!("masks/{index:06}.png")));
        let expected: Vec<u16> = ids.iter().map(|id| 255 * u16::from(defects.contains(&u64::from(*id)))).collect();
        assert!(gray(&mask) == expected && expected.contains(&255), "{mask:?}");
    }
    let expected = [("test/combined", vec![5]), ("test/good", vec![2, 4, 6, 7, 8]), ("test/stain", vec![3])];
    let expected = expected.into_iter().chain([("train/good", vec![0, 1])]);
    assert_eq!(found, expected.map(|(folder, images)| (folder.to_owned(), images)).collect());

    let check = || bench.said("dataset --verify a", 1);
    let mask = root.join("ground_truth/stain/000003_mask.png");
    let before = fs::read(&mask).expect("a mask");
    fs::write(&mask, fs::read(root.join("ground_truth/combined/000005_mask.png")).expect("a mask")).expect("writable");
    assert!(check().contains("mvtec/ground_truth/stain/000003_mask.png differs from its hash"));
    fs::write(&mask, before).expect("writable");
    let moved = root.join("test/good/000003.png");
    fs::rename(root.join("test/stain/000003.png"), &moved).expect("moved");
    let message = check();
    assert!(message.contains("mvtec/test/stain/000003.png does not exist"), "{message}");
    assert!(message.contains("mvtec/test/good/000003.png belongs to no image"), "{message}");

    // Each capture has its tree, with the same masks.
    let captures = "[[capture]]\nname = \"full\"\nlights = [\"*\"]\n\
        [[capture]]\nname = \"weak\"\nlights = { panel = 0.2 }\n";
    fs::write(bench.path("captures.toml"), format!("{PLATE}{captures}")).expect("writable");
    bench.run("dataset captures.toml -o b --count 4");
    bench.run("dataset --verify b");
    let [full, weak] = ["full", "weak"].map(|name| read_as_anomalib(&bench.path("b/mvtec").join(name)));
    for ((_, kind, full, full_mask), (.., weak, weak_mask)) in full.iter().zip(&weak) {
        assert!(fs::read(full).expect("a picture") != fs::read(weak).expect("a picture"), "{kind}");
        assert_eq!(full_mask.as_ref().map(|path| gray(path)), weak_mask.as_ref().map(|path| gray(path)));
    }
    assert_eq!((full.len(), weak.len()), (4, 4));
}

/// The plate is flat: light does not go from its defects to other pixels of it. So the pixels differ in the defect and at its
/// edge alone, although frames have noise. The images for training have other draws.
#[test]
fn the_images_of_a_pair_differ_in_the_defect_alone() {
    let bench = Bench::new(PLATE);
    bench.run("dataset study.toml -o a --index 1,2,3,4,5,6,7");
    let image = |index: usize| gray(&bench.path(&format!("a/linear/{index:06}.png")));
    for good in [2, 4, 6] {
        let (without, with) = (image(good), image(good + 1));
        let [first, second] = [good, good + 1].map(|index| bench.json(&format!("a/records/{index:06}.json")));
        for key in ["seed", "frame", "exposure"] {
            assert_eq!(first[key], second[key], "{good}: {key}");
        }
        let drawn = |record: &Value| record["drawn"]["camera.position[0]"].clone();
        assert_eq!(drawn(&first), drawn(&second));
        assert!(!first["drawn"].as_object().expect("draws").keys().any(|name| name.starts_with("defect")));
        let plate = |record: &Value| record["instances"].as_array().expect("instances").len();
        assert_eq!((plate(&first), plate(&second)), (1, [2, 3, 1][good / 2 - 1]));
        // The plate has the id 1.
        let mask = gray(&bench.path(&format!("a/masks/{:06}.png", good + 1)));
        let near = |i: usize| {
            let (x, y) = (i % 64, i / 64);
            let [xs, ys] = [(x, 64), (y, 48)].map(|(v, end)| v.saturating_sub(2)..(v + 3).min(end));
            ys.into_iter().any(|y| xs.clone().any(|x| mask[y * 64 + x] > 1))
        };
        let differs: Vec<usize> = (0..mask.len()).filter(|i| without[*i] != with[*i]).collect();
        let far: Vec<_> = differs.iter().filter(|i| !near(**i)).collect();
        assert!(far.is_empty(), "{good}: {} of {} differing pixels are far", far.len(), differs.len());
        let inside = (0..mask.len()).filter(|i| mask[*i] > 1).count();
        assert!(
            2 * differs.len() >= inside && (good == 6) == differs.is_empty(),
            "{good}: {} of {inside}",
            differs.len()
        );
    }
    // Different draws have different noise: nearly all pixels.
    let different = image(1).iter().zip(image(2)).filter(|(a, b)| **a != *b).count();
    assert!(different > 64 * 48 / 2, "{different}");
}

#[test]
fn layouts_that_no_reader_accepts_are_refused() {
    let bench = Bench::new(PLATE);
    let defects = PLATE.split_once("[[study.defect]]").expect("a defect").1.split_once("[camera]").expect("a camera").0;
    let without = format!("[[study.defect]]{defects}");
    for (from, to, words) in [
        ("train = 2\n", "", "write their number as `train`"),
        ("linear = \"png\"", "picture = \"jpeg\"", "readers of MVTec AD need PNG files"),
        ("category = \"spot\"", "category = \"good\"", "the category \"good\" of a defect is no name of a folder"),
        ("category = \"spot\"", "category = \"a/b\"", "the category \"a/b\" of a defect is no name of a folder"),
        (&without, "", "there is no [[study.defect]]"),
    ] {
        let changed = PLATE.replacen(from, to, 1);
        assert_ne!(changed, PLATE, "{from}");
        fs::write(bench.path("bad.toml"), changed).expect("writable");
        let message = bench.refused("dataset bad.toml -o bad");
        assert!(message.contains("bad.toml") && message.contains(words), "{to}: {message}");
        assert!(!bench.path("bad").exists(), "{to}");
    }
}

/// The formula of Gauss \[pixels\].
fn area(corners: &[[f64; 2]]) -> f64 {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum()
}

#[test]
fn segments_and_oriented_boxes_are_around_the_pixels_of_the_masks() {
    let bench = Bench::new("");
    let mut turned = 0;
    for shapes in ["segments", "oriented"] {
        let text = STUDY.replace("yolo = true", &format!("yolo = \"{shapes}\""));
        fs::write(bench.path("study.toml"), text).expect("writable");
        bench.run(&format!("dataset study.toml -o {shapes}"));
        bench.run(&format!("dataset --verify {shapes}"));
        for index in 0..6 {
            let record = bench.json(&format!("{shapes}/records/{index:06}.json"));
            let text = fs::read_to_string(bench.path(&format!("{shapes}/labels/{index:06}.txt"))).expect("lines");
            let instances = record["instances"].as_array().expect("instances").iter();
            let visible: Vec<&Value> = instances.filter(|instance| instance["area"] != 0).collect();
            assert_eq!(text.lines().count(), visible.len());
            let mask = gray(&bench.path(&format!("{shapes}/masks/{index:06}.png")));
            for (line, instance) in text.lines().zip(visible) {
                let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
                assert_eq!(numbers[0] + 1.0, instance["category"].as_f64().expect("an id"));
                let corners: Vec<[f64; 2]> = numbers[1..].chunks_exact(2).map(|c| [64.0 * c[0], 48.0 * c[1]]).collect();
                let pixels: Vec<[f64; 2]> = (0..mask.len())
                    .filter(|i| u64::from(mask[*i]) == instance["id"].as_u64().expect("an id"))
                    .map(|i| [(i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5])
                    .collect();
                // Six decimals of a share of 64 pixels are 3e-5 pixels, over a circumference below 500.
                let close = |a: f64, b: f64| (a - b).abs() < 0.02;
                if shapes == "segments" {
                    assert!(close(area(&corners), pixels.len() as f64), "{index}: {line}");
                    continue;
                }
                assert_eq!(corners.len(), 4);
                let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
                let side = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
                for (a, b) in edges() {
                    // The centre of a pixel at an edge is at least half a pixel away from it.
                    let distance =
                        |p: &[f64; 2]| ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])) / side(a, b);
                    assert!(pixels.iter().all(|p| distance(p) > 0.49), "{index}: {line}");
                }
                assert!(close(side(&corners[0], &corners[1]), side(&corners[2], &corners[3])), "{line}");
                let bbox = instance["bbox"].as_array().expect("a box");
                let [w, h] = [2, 3].map(|k| bbox[k].as_f64().expect("a number"));
                assert!(area(&corners) < w * h + 0.02, "{index}: {line}");
                turned += u32::from(area(&corners) < 0.9 * w * h);
            }
        }
    }
    assert!(turned >= 3, "{turned}");
}

/// The price by two of the six images is that of the times in `costs/`.
#[test]
fn a_run_reports_the_price_of_the_whole_set() {
    let bench = Bench::new(STUDY);
    let run = |line: &str, progress: &str| {
        let mut command = Command::new(PROGRAM);
        command.current_dir(bench.folder.path()).args(line.split_whitespace()).args(["--progress", progress]);
        command.assert().success()
    };
    let first = run("dataset study.toml -o a --jobs 1 --threads 1 --index 0,1", "json");
    let lines: Vec<Value> = stderr(&first).lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let prices: Vec<&Value> = lines.iter().filter(|line| line["event"] == "price").collect();
    // One image is left after the first.
    assert_eq!(prices.len(), 1, "{lines:?}");
    assert_eq!((&prices[0]["measured"], &prices[0]["count"]), (&1.into(), &6.into()));
    let seconds = |index: usize| bench.json(&format!("a/costs/{index:06}.json"))["total"].as_f64().expect("seconds");
    let own = prices[0]["levels"].as_array().expect("levels").iter().find(|level| level["factor"] == 1.0).expect("one");
    let core_hours = own["core_hours"].as_f64().expect("a number");
    assert!((core_hours / (6.0 * seconds(0) / 3600.0) - 1.0).abs() < 1e-9, "{core_hours}");
    let p99 = bench.json("a/records/000000.json")["certificate"]["p99"].as_f64().expect("a ratio");
    assert!((own["k"].as_f64().expect("a number") - p99.sqrt()).abs() < 1e-12);
    let words = stdout(&first);
    assert!(words.contains("the set of 6 images costs ") && words.contains("hidden at k = "), "{words}");
    // A run that has nothing to make has no price.
    assert!(!stdout(&run("dataset study.toml -o a --index 0", "none")).contains("costs"));
}
