//! Key points against closed forms of the camera.

use crate::encode::ImageLabels;
use crate::make::{Made, Worker};
use crate::study::Study;
use dunkelfeld::Cancel;
use std::sync::Arc;

fn make(text: &str) -> Made {
    let study = Arc::new(Study::from_text("test.toml", text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())));
    let mut worker = Worker::open(&study, 2).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    worker.make(0, None, &Cancel::new()).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())).expect("an image")
}

/// x, y and v of the key points of an object, in their order.
fn points(made: &Made, object: &str) -> Vec<(f64, f64, u8)> {
    let (_, bytes) = made.files.iter().find(|(name, _)| name == "labels/000000.json").expect("labels");
    let labels: ImageLabels = serde_json::from_slice(bytes).expect("labels");
    let found = labels.keypoints.iter().find(|points| points.name == object).expect("key points");
    found.points.iter().map(|point| (point.x, point.y, point.v)).collect()
}

fn label(objects: &str, at: &[[&str; 3]]) -> String {
    let point =
        |(i, [x, y, z]): (usize, &[&str; 3])| format!("{{ name = \"p{i}\", at = [\"{x}\", \"{y}\", \"{z}\"] }}");
    let list: Vec<String> = at.iter().enumerate().map(point).collect();
    format!("[[study.label]]\ncategory = \"part\"\nobjects = \"{objects}\"\nkeypoints = [{}]\n", list.join(", "))
}

fn assert_near(found: (f64, f64, u8), expected: (f64, f64, u8), tolerance: f64, what: &str) {
    let is_near = (found.0 - expected.0).abs() <= tolerance && (found.1 - expected.1).abs() <= tolerance;
    assert!(is_near && found.2 == expected.2, "{what}: {found:?} and {expected:?}");
}

const FLOOR: &str = "[[object]]\nname = \"floor\"\nkind = \"plane\"\nsize = [\"200mm\", \"200mm\"]\n";

/// A view from above: 64 x 64 pixels of 40 x 40 mm, right is +x and down is +z.
fn telecentric(study: &str, scene: &str) -> String {
    format!(
        "scene = \"none\"\n[study]\nname = \"test\"\n{study}\n[film]\nwidth = 64\nheight = 64\n[budget]\nspp = 1\n\
         [sensor]\nmodel = \"none\"\n[camera]\nname = \"above\"\nposition = [0, \"200mm\", 0]\nlook_at = [0, 0, 0]\n\
         [lens]\nprojection = \"telecentric\"\nfield_height = \"40mm\"\n[environment]\nradiance = 1\n{scene}"
    )
}

#[test]
fn points_move_with_their_object_and_are_hidden_under_surfaces() {
    let study = label(
        "block",
        &[
            ["5mm", "2mm", "-3mm"],
            ["0", "2mm", "0"],
            ["0", "1.99mm", "1mm"],
            ["0", "1mm", "0"],
            ["0", "-2mm", "0"],
            ["-4mm", "2mm", "0"],
            ["0", "30mm", "0"],
            ["60mm", "0", "0"],
        ],
    );
    let block = "[[object]]\nname = \"block\"\nkind = \"box\"\nsize = [\"10mm\", \"4mm\", \"6mm\"]\n\
        rotate = [0, \"90deg\", 0]\ntranslate = [\"6mm\", \"2mm\", \"-3mm\"]\n";
    let lid = "[[object]]\nname = \"lid\"\nkind = \"box\"\nsize = [\"6mm\", \"1mm\", \"3mm\"]\n\
        translate = [\"6mm\", \"9mm\", \"1mm\"]\n";
    let made = make(&telecentric(&study, &format!("{FLOOR}{block}{lid}")));
    // The rotation by 90 degrees about y takes (x, z) to (z, -x).
    let place = |x: f64, z: f64| (32.0 + (6.0 + z) * 1.6, 32.0 + (-3.0 - x) * 1.6);
    let expected = [
        (place(5.0, -3.0), 2, "a corner"),
        (place(0.0, 0.0), 2, "on the surface"),
        (place(0.0, 1.0), 2, "10 um under the surface"),
        (place(0.0, 0.0), 1, "1 mm under the surface"),
        (place(0.0, 0.0), 1, "on the lower side"),
        (place(-4.0, 0.0), 1, "under the lid"),
        (place(0.0, 0.0), 2, "in the air above the block"),
    ];
    let found = points(&made, "block");
    for (found, ((x, y), v, what)) in found.iter().zip(expected) {
        // The extents of the film are f32.
        assert_near(*found, (x, y, v), 1e-5, what);
    }
    assert_eq!(found[7], (0.0, 0.0, 0), "outside of the film");
}

/// A tetrahedron in an STL file, which has millimetres and z up, twice as large by the job: its points have the coordinates
/// of the file.
#[test]
fn points_of_a_file_have_its_axes_and_true_lengths() {
    let folder = tempfile::tempdir().expect("a folder");
    let corners = ["0 0 0", "6 0 0", "0 4 0", "0 0 3"];
    let facets: String = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        .iter()
        .map(|t| {
            let vertices: String = t.iter().map(|i: &usize| format!("vertex {}\n", corners[*i])).collect();
            format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
        })
        .collect();
    let file = folder.path().join("part.stl");
    std::fs::write(&file, format!("solid part\n{facets}endsolid part\n")).expect("writable");
    let study = label("*", &[["6mm", "0", "0"], ["0", "4mm", "0"], ["0", "0", "3mm"]]);
    let job = "[[object]]\nname = \"*\"\nscale = 2\n";
    let text =
        telecentric(&study, job).replace("scene = \"none\"", &format!("scene = {:?}", file.display().to_string()));
    let made = make(&text);
    let name = made.record.instances[0].name.clone();
    let found = points(&made, &name);
    // x stays, y of the file is -z of the world (up in the image), and z is up.
    assert_near(found[0], (32.0 + 12.0 * 1.6, 32.0, 2), 1e-4, "x");
    assert_near(found[1], (32.0, 32.0 - 8.0 * 1.6, 2), 1e-4, "y");
    assert_near(found[2], (32.0, 32.0, 2), 1e-4, "z");
}

/// The camera model of OpenCV (Brown 1971, with k4 to k6 below the line).
fn opencv(k: [f64; 4], d: [f64; 8], point: [f64; 3]) -> (f64, f64) {
    let [fx, fy, cx, cy] = k;
    let [k1, k2, p1, p2, k3, k4, k5, k6] = d;
    let (x, y) = (point[0] / point[2], point[1] / point[2]);
    let r = x * x + y * y;
    let radial = (1.0 + r * (k1 + r * (k2 + r * k3))) / (1.0 + r * (k4 + r * (k5 + r * k6)));
    let u = x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x);
    let v = y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y;
    (fx * u + cx + 0.5, fy * v + cy + 0.5)
}

#[test]
fn a_lens_with_errors_images_points_as_opencv() {
    let at = [["3mm", "2mm", "-4mm"], ["-8mm", "2mm", "6mm"], ["0", "2mm", "0"]];
    let (k, d) = ([150.0, 160.0, 40.0, 27.0], [-0.2, 0.05, 0.003, -0.002, 0.01, 0.0, 0.0, 0.0]);
    // x right is the world's x, y down its z, and forward -y; the camera is at (2, 100, 3) mm.
    let text = format!(
        "scene = \"none\"\n[study]\nname = \"test\"\n{}\n[film]\nwidth = 80\nheight = 60\n[budget]\nspp = 1\n\
         [sensor]\nmodel = \"none\"\n[camera]\nname = \"c\"\nK = [[150, 0, 40], [0, 160, 27], [0, 0, 1]]\n\
         R = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]\nt = [\"-2mm\", \"-3mm\", \"100mm\"]\n\
         lens = {{ distortion = [-0.2, 0.05, 0.003, -0.002, 0.01, 0, 0, 0] }}\n[environment]\nradiance = 1\n\
         {FLOOR}[[object]]\nname = \"block\"\nkind = \"box\"\nsize = [\"20mm\", \"4mm\", \"20mm\"]\n\
         translate = [\"5mm\", \"2mm\", 0]\n",
        label("block", &at)
    );
    let found = points(&make(&text), "block");
    for (found, local) in found.iter().zip([[3.0, 2.0, -4.0], [-8.0, 2.0, 6.0], [0.0, 2.0, 0.0]]) {
        let world = [local[0] + 5.0, local[1] + 2.0, local[2]];
        let (x, y) = opencv(k, d, [world[0] - 2.0, world[2] - 3.0, 100.0 - world[1]]);
        assert_near(*found, (x, y, 2), 1e-4, "a point on the upper side");
    }
}

/// A camera 200 mm above a plane, and a plate of the index 1.5 and the thickness 20 mm between: the ray at the angle a meets
/// the plane at (200 - 20) tan a + 20 tan b, with sin a = 1.5 sin b (Snell's law).
#[test]
fn a_point_behind_a_cover_is_where_the_bent_ray_meets_it() {
    let at = [["30mm", "0", "0"], ["0", "0", "-40mm"], ["30mm", "-1mm", "0"]];
    let cover = "[[object]]\nname = \"sheet\"\nkind = \"box\"\nsize = [\"300mm\", \"20mm\", \"300mm\"]\n\
        translate = [0, \"50mm\", 0]\nmaterial = \"glass\"\n[[material]]\nname = \"glass\"\nnew = true\nbase_color = 1\n\
        transmission = 1\nroughness = 0\nior = 1.5\nsolid = true\n";
    let text = |cover: &str| {
        format!(
            "scene = \"none\"\n[study]\nname = \"test\"\n{}\n[film]\nwidth = 64\nheight = 64\n[budget]\nspp = 1\n\
             [sensor]\nmodel = \"none\"\n[camera]\nname = \"c\"\nposition = [0, \"200mm\", 0]\nlook_at = [0, 0, 0]\n\
             vertical_fov = \"40deg\"\n[environment]\nradiance = 1\n{FLOOR}{cover}",
            label("floor", &at)
        )
    };
    let focal = 32.0 / 20f64.to_radians().tan();
    // The reach grows with the tangent: bisection.
    let (mut low, mut high) = (0.0f64, 0.4f64);
    let reach = |tangent: f64| {
        let inside = (tangent.atan().sin() / 1.5).asin().tan();
        180.0 * tangent + 20.0 * inside
    };
    let mut solve = |goal: f64| {
        (low, high) = (0.0, 0.4);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if reach(middle) < goal { low = middle } else { high = middle }
        }
        low
    };
    let covered = points(&make(&text(cover)), "floor");
    assert_near(covered[0], (32.0 + focal * solve(30.0), 32.0, 2), 0.02, "to the right");
    assert_near(covered[1], (32.0, 32.0 - focal * solve(40.0), 2), 0.02, "up");
    assert_eq!(covered[2].2, 1, "under the floor");
    let open = points(&make(&text("")), "floor");
    assert_near(open[0], (32.0 + focal * 0.15, 32.0, 2), 1e-6, "without a cover");
    assert!(covered[0].0 - open[0].0 > 0.3, "the cover moves the image outward: {covered:?}");
}

#[test]
fn a_mirror_in_front_hides_a_point() {
    let mirror = "[[object]]\nname = \"mirror\"\nkind = \"box\"\nsize = [\"8mm\", \"1mm\", \"8mm\"]\n\
        translate = [0, \"20mm\", 0]\nmaterial = \"chrome\"\n[[material]]\nname = \"chrome\"\nnew = true\nbase_color = 0.9\n\
        metallic = 1\nroughness = 0\n";
    let study = label("floor", &[["0", "0", "0"], ["10mm", "0", "0"]]);
    let found = points(&make(&telecentric(&study, &format!("{FLOOR}{mirror}"))), "floor");
    assert_near(found[0], (32.0, 32.0, 1), 1e-5, "under the mirror");
    assert_near(found[1], (48.0, 32.0, 2), 1e-5, "beside it");
}

/// The line exposes the middle of the film, z = 0. A point at z that moves by two pixels a row reaches it z / 2 pixels after
/// the middle row.
#[test]
fn key_points_that_do_not_fit_are_refused() {
    let scene = format!("{FLOOR}[[object]]\nname = \"b\"\nkind = \"sphere\"\ndiameter = \"5mm\"\n");
    let entry = |rest: &str| format!("[[study.label]]\ncategory = \"part\"\nobjects = \"b\"\n{rest}\n");
    let point = |name: &str| format!("{{ name = \"{name}\", at = [0, 0, 0] }}");
    let ab = format!("keypoints = [{}, {}]", point("a"), point("b"));
    let c = format!("keypoints = [{}]", point("c"));
    for (study, words) in [
        (entry(&format!("keypoints = [{}, {}]", point("a"), point("a"))), "there twice"),
        (entry(&format!("{ab}\nskeleton = [[1, 3]]")), "joins no two"),
        (entry("skeleton = [[1, 2]]"), "joins no two"),
        (format!("{}{}", entry(&ab), entry(&c).replace("\"b\"", "\"floor\"")), "other key points"),
        (entry(&ab.replace("at = [0, 0, 0]", "at = [\"1deg\", 0, 0]")), "deg"),
    ] {
        let error = Study::from_text("test.toml", &telecentric(&study, &scene)).expect_err(words);
        assert!(error.to_string().contains(words) && error.to_string().contains("help:"), "{error}");
    }
    // YOLO has one number of key points for all categories that have any.
    let study = format!(
        "[study.labels]\nyolo = true\n{}[[study.label]]\ncategory = \"floor\"\nobjects = \"floor\"\nkeypoints = [{}]\n",
        entry(&ab),
        point("a")
    );
    let study = Arc::new(Study::from_text("test.toml", &telecentric(&study, &scene)).expect("a study"));
    let error = Worker::open(&study, 1).err().expect("different numbers").to_string();
    assert!(error.contains("one number of key points in all rows"), "{error}");
    let lines = format!("{scene}[line_scan]\nline_rate = \"1kHz\"\n");
    let text = telecentric(&entry(&ab), &lines).replace("model = \"none\"", "exposure = \"20us\"");
    let study = Arc::new(Study::from_text("test.toml", &text).expect("a study"));
    let error = Worker::open(&study, 1).err().expect("a line scan").to_string();
    assert!(error.contains("[[study.label]] 1, keypoints") && error.contains("line scan"), "{error}");
}

/// A faded block in the category of the others: readers of COCO expect key points of each annotation of the category.
#[test]
fn a_defect_in_a_category_with_key_points_has_points_without_labels() {
    let change = "[[study.defect]]\nkind = \"faded\"\nname = \"change\"\ncategory = \"part\"\non = \"block 2\"\nstrength = 0.3\n";
    let study = format!("{}{change}", label("block *", &[["1mm", "2mm", "0"], ["0", "2mm", "0"]]));
    let block = |name: &str, x: &str| {
        format!(
            "[[object]]\nname = \"{name}\"\nkind = \"box\"\nsize = [\"8mm\", \"4mm\", \"8mm\"]\n\
             translate = [\"{x}\", \"2mm\", 0]\n"
        )
    };
    let made = make(&telecentric(&study, &format!("{FLOOR}{}{}", block("block 1", "-9mm"), block("block 2", "9mm"))));
    let (_, bytes) = made.files.iter().find(|(name, _)| name == "labels/000000.json").expect("labels");
    let labels: ImageLabels = serde_json::from_slice(bytes).expect("labels");
    let of = |name: &str| labels.annotations.iter().find(|a| a.name == name).expect("an annotation");
    let (part, defect) = (of("block 1"), of("change 1"));
    assert_eq!((part.category_id, part.num_keypoints), (defect.category_id, Some(2)));
    assert_eq!((defect.num_keypoints, defect.keypoints.as_deref()), (Some(0), Some(&[0.0; 6][..])));
}
