//! Objects of some images, cameras, key points and poses.

use super::bench::{Bench, STUDY};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;

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
    bench.run("dataset --verify a");
    let set = bench.json("a/set.json");
    let categories: BTreeMap<&str, u64> = (set["categories"].as_array().expect("categories").iter())
        .map(|c| (c["name"].as_str().expect("a name"), c["id"].as_u64().expect("an id")))
        .collect();
    assert_eq!(categories.keys().copied().collect::<Vec<_>>(), ["ball", "block", "dust", "fastener", "scratch"]);
    let mut names = Vec::new();
    for index in 0..6 {
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let instances = record["instances"].as_array().expect("instances");
        let found: Vec<&str> = [("washer", "fastener"), ("nut", "fastener"), ("dust 1", "dust")]
            .into_iter()
            .filter(|(name, of)| instances.iter().any(|i| i["name"] == *name && i["category"] == categories[of]))
            .map(|(name, _)| name)
            .collect();
        assert_eq!(record["drawn"].get("place[washer].x").is_some(), found.contains(&"washer"), "{index}");
        names.push(found.join(" and "));
    }
    // Image 0 lacks the washer, and image 3 has the nut.
    assert_eq!(names, ["", "washer and dust 1", "washer and dust 1", "nut", "", "washer and dust 1"]);
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
    fs::write(bench.path("both.toml"), format!("[study]\n{choice}\njob = \"station.toml\"{scene}")).expect("writable");
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
        bench.run(&format!("dataset --verify {set}"));
    }
    // A telecentric lens of the job, and one of a camera: the images of these cameras have no matrix.
    let lens = "[lens]\nprojection = \"telecentric\"\nfield_height = \"100mm\"\n";
    let own = "vertical_fov = \"30deg\"\n";
    let of_job =
        one.replace("vertical_fov = \"25deg\"\n", "").replace(own, "").replace("[film]", &format!("{lens}[film]"));
    let of_camera = one.replace(own, &lens.replace("[lens]", "[camera.lens]"));
    for (set, text) in [("c", of_job), ("d", of_camera)] {
        fs::write(bench.path("flat.toml"), text).expect("writable");
        bench.run(&format!("dataset flat.toml -o {set} --count 2"));
        let cameras = bench.json(&format!("{set}/scene_camera.json"));
        assert_eq!(cameras.as_object().map(|c| c.len()), Some(usize::from(set == "d")));
    }
    fs::write(bench.path("bad.toml"), one.replace("[\"right\", \"left\"]", "[\"right\", \"top\"]")).expect("writable");
    let message = bench.said("dataset bad.toml -o e --count 2 --jobs 1", 1);
    assert!(message.contains("no camera \"top\"") && message.contains("left, right"), "{message}");
}

#[test]
fn key_points_are_in_all_files() {
    let points = "keypoints = [{ name = \"low\", at = [\"-5mm\", 0, 0] }, { name = \"high\", at = [\"5mm\", 0, 0] }]\n\
        skeleton = [[1, 2]]\n";
    let text = STUDY
        .replace("objects = \"block *\"\n\n", &format!("objects = \"block *\"\n{points}\n"))
        .replace("objects = [\"ball\"]\n", &format!("objects = [\"ball\"]\n{points}"));
    let text = text.split("[[study.defect]]").next().expect("a part").to_owned()
        + "[camera]"
        + text.split("[camera]").nth(1).expect("a camera");
    let bench = Bench::new(&text);
    bench.run("dataset study.toml -o a");
    bench.run("dataset --verify a");
    let coco = bench.json("a/coco.json");
    for category in coco["categories"].as_array().expect("categories") {
        assert_eq!(category["keypoints"], serde_json::json!(["low", "high"]));
        assert_eq!(category["skeleton"], serde_json::json!([[1, 2]]));
    }
    let yaml = fs::read_to_string(bench.path("a/data.yaml")).expect("data.yaml");
    assert!(yaml.contains("kpt_shape: [2, 3]"), "{yaml}");
    for index in 0..6 {
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
    }
    let three = points.replacen("[{", "[{ name = \"top\", at = [0, \"4mm\", 0] }, {", 1);
    fs::write(bench.path("bad.toml"), text.replacen(points, &three, 1)).expect("writable");
    assert!(bench.refused("dataset bad.toml -o bad").contains("same number, or write `yolo = \"none\"`"));
    // The lines of a category without key points, and of defects, are filled with points that are not labelled.
    let scratch = "[[study.defect]]\nkind = \"scratch\"\non = \"plate\"\nfacing = [0, 1, 0]\nlength = \"40mm\"\nwidth = \"4mm\"\n\
        depth = \"100um\"\ncount = 3\n[camera]";
    let text = text.replacen(points, "", 1).replacen("[camera]", scratch, 1);
    fs::write(bench.path("study.toml"), text).expect("writable");
    bench.run("dataset study.toml -o b --count 2");
    let yaml = fs::read_to_string(bench.path("b/data.yaml")).expect("data.yaml");
    assert!(yaml.contains("kpt_shape: [2, 3]") && yaml.contains("2: \"scratch\""), "{yaml}");
    let mut classes = std::collections::BTreeSet::new();
    for index in 0..2 {
        let lines = fs::read_to_string(bench.path(&format!("b/labels/{index:06}.txt"))).expect("lines");
        for line in lines.lines() {
            let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
            assert_eq!(numbers.len(), 5 + 6, "{line}");
            // The ball has key points; blocks and scratches have none.
            assert_eq!(numbers[5..].iter().any(|v| *v != 0.0), numbers[0] == 1.0, "{line}");
            classes.insert(numbers[0] as u32);
        }
    }
    assert_eq!(Vec::from_iter(classes), [0, 1, 2]);
    bench.run("dataset --verify b");
}

/// Two blocks of one shape have one model, also if one is rotated by a matrix with four decimals; a longer one has another. A
/// mirrored one has no pose but its matrix.
#[test]
fn objects_of_one_shape_have_one_model() {
    let block = |name: &str, size: &str, rest: &str| {
        format!("[[object]]\nname = \"{name}\"\nkind = \"box\"\nsize = [\"12mm\", \"6mm\", \"{size}\"]\n{rest}\n")
    };
    let placed = |x: i32| format!("translate = [\"{x}mm\", \"3mm\", \"30mm\"]");
    let rounded = "matrix = [0.8660, 0, 0.5, -0.02, 0, 1, 0, 0.003, -0.5, 0, 0.8660, -0.03, 0, 0, 0, 1]";
    let mirrored = "matrix = [-1, 0, 0, 0.02, 0, 1, 0, 0.003, 0, 0, 1, -0.03, 0, 0, 0, 1]";
    let text = STUDY.split("[[study.place]]").next().expect("a part").to_owned()
        + "[camera]"
        + STUDY.split("[camera]").nth(1).expect("a camera").split("[[object]]").next().expect("a part")
        + &block("block 1", "20mm", &placed(-20))
        + &block("block 2", "12mm", &placed(20))
        + &block("block 3", "20mm", rounded)
        + &block("block 4", "20mm", mirrored)
        + &block("ball", "20mm", &placed(0));
    let bench = Bench::new(&text);
    bench.run("dataset study.toml -o a --count 1");
    let poses = bench.json("a/scene_gt.json")["0"].as_array().expect("poses").clone();
    let models: Vec<[u64; 2]> =
        poses.iter().map(|p| ["obj_id", "instance"].map(|key| p[key].as_u64().expect("an id"))).collect();
    assert_eq!(models, [[1, 1], [2, 2], [1, 3], [1, 5]]);
    let record = bench.json("a/records/000000.json");
    let matrix = |k: usize| &record["instances"][k]["matrix"];
    // It mirrors, and takes metres to millimetres.
    let m: Vec<f64> = matrix(3).as_array().expect("a matrix").iter().map(|v| v.as_f64().expect("a number")).collect();
    let minor = |a: usize, b: usize| m[4 + a] * m[8 + b] - m[4 + b] * m[8 + a];
    let determinant = m[0] * minor(1, 2) - m[1] * minor(0, 2) + m[2] * minor(0, 1);
    assert!(m.len() == 12 && (determinant + 1e9).abs() < 1.0, "{m:?}");
    assert!(matrix(0).is_null());
    bench.run("dataset --verify a");
}

/// The first 64 images do not have the objects.
#[test]
fn objects_of_rare_images_have_the_category_of_their_label() {
    let object = |name: &str, first: bool| {
        format!(
            "[[object]]\nname = \"{name}\"\nkind = \"sphere\"\ndiameter = \"20mm\"\ntranslate = [\"-40mm\", \"10mm\", 0]\n\
             visible = {{ sequence = [false, {first}, {}], repeat = 64 }}\n",
            !first
        )
    };
    let labels = "[[study.label]]\ncategory = \"extra\"\nobjects = \"extra *\"\n[[study.place]]\n";
    let text = STUDY.replace("[[study.place]]\n", labels) + &object("extra 32", true) + &object("extra 70", false);
    let bench = Bench::new(&text);
    bench.run("dataset study.toml -o a --count 200 --index 70,140");
    let categories = &bench.json("a/set.json")["categories"];
    for (index, name) in [(70, "extra 32"), (140, "extra 70")] {
        let record = bench.json(&format!("a/records/{index:06}.json"));
        let instances = record["instances"].as_array().expect("instances");
        let category = instances.iter().find(|i| i["name"] == name).expect(name)["category"].as_u64().expect("an id");
        assert_eq!(categories[category as usize - 1]["name"], "extra");
    }
}

#[test]
fn a_study_changes_cameras_of_its_job_key_by_key() {
    let (before, rest) = STUDY.split_once("[camera]").expect("a camera");
    let (_, after) = rest.split_once("[film]").expect("a film");
    let camera = |name: &str| {
        format!(
            "[[camera]]\nname = \"{name}\"\nposition = [0, \"300mm\", \"1mm\"]\nlook_at = [0, 0, 0]\nvertical_fov = \"25deg\"\n"
        )
    };
    let fixed = |cameras: &str| {
        format!("scene = \"none\"\n{cameras}[film]{after}")
            .replace("{ expression = \"1.5 * supply\", unit = \"W\" }", "\"1.5W\"")
            .replace("{ log_uniform = [\"6mm\", \"12mm\"] }", "\"8mm\"")
    };
    let tables = before.split_once("[study]").expect("a study").1;
    let study = |own: &str| format!("[study]\njob = \"station.toml\"\n{tables}{own}");
    let bench = Bench::new(STUDY);
    let write = |name: &str, text: &str| fs::write(bench.path(name), text).expect("writable");
    write("station.toml", &fixed(&camera("above")));
    let field = "vertical_fov = { uniform = [\"20deg\", \"40deg\"] }\n";
    for own in [format!("[camera]\n{field}"), format!("[[camera]]\nname = \"above\"\n{field}")] {
        write("one.toml", &study(&own));
        bench.run("dataset one.toml -o one --count 2");
        let focal =
            |index| bench.json(&format!("one/labels/{index:06}.json"))["camera"]["k"][0].as_f64().expect("a number");
        assert_ne!(focal(0), focal(1));
        fs::remove_dir_all(bench.path("one")).expect("removed");
    }
    write("station.toml", &fixed(&(camera("above") + &camera("aside"))));
    for (own, words) in [
        (format!("[camera]\n{field}"), "the job has several cameras"),
        (format!("[camera]\nname = \"abuve\"\n{field}"), "no camera of this name"),
    ] {
        write("two.toml", &study(&own));
        let message = bench.refused("dataset two.toml -o two");
        assert!(message.contains(words) && message.contains("above, aside"), "{message}");
    }
    write("two.toml", &study(&format!("[[camera]]\nname = \"above\"\n{field}")));
    bench.run("dataset two.toml -o two --count 1");
}
