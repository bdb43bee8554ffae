//! Labels against closed forms: areas, occlusion, clear covers, defects.

use crate::make::{Made, Worker};
use crate::record::InstanceRecord;
use crate::study::Study;
use dunkelfeld::Cancel;
use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::png_bytes;
use std::sync::Arc;

/// Pixels on each side of the film, which is 40 mm wide.
const SIDE: u32 = 64;

/// A telecentric view from above.
fn make(study: &str, scene: &str) -> Made {
    let text = format!(
        "scene = \"none\"\n[study]\nname = \"test\"\n{study}\n[film]\nwidth = {SIDE}\nheight = {SIDE}\n[budget]\nspp = 1\n\
         [sensor]\nmodel = \"none\"\n[camera]\nname = \"above\"\nposition = [0, \"200mm\", 0]\nlook_at = [0, 0, 0]\n\
         [lens]\nprojection = \"telecentric\"\nfield_height = \"40mm\"\n[environment]\nradiance = 1\n{scene}"
    );
    let study = Arc::new(Study::from_text("test.toml", &text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())));
    let mut worker = Worker::open(&study, 2).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    worker.make(0, None, &Cancel::new()).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())).expect("an image")
}

fn instance<'a>(made: &'a Made, name: &str) -> &'a InstanceRecord {
    made.record.instances.iter().find(|i| i.name == name).unwrap_or_else(|| panic!("{name} in {:?}", made.record))
}

fn file<'a>(made: &'a Made, name: &str) -> &'a [u8] {
    made.files.iter().find(|(n, _)| n == name).map(|(_, bytes)| &bytes[..]).unwrap_or_else(|| panic!("{name}"))
}

const FLOOR: &str = "[[object]]\nname = \"floor\"\nkind = \"plane\"\nsize = [\"60mm\", \"60mm\"]\n";

fn object(name: &str, rest: &str) -> String {
    format!("[[object]]\nname = \"{name}\"\n{rest}\n")
}

#[test]
fn areas_are_those_of_the_shapes() {
    let study = "[study.labels]\ncoverage = 16\n[[study.label]]\ncategory = \"part\"\nobjects = [\"disc\", \"block\"]";
    let disc = object(
        "disc",
        "kind = \"cylinder\"\ndiameter = \"14mm\"\nheight = \"2mm\"\ntranslate = [\"-9mm\", \"1mm\", \"-7mm\"]",
    );
    let block = object(
        "block",
        "kind = \"box\"\nsize = [\"9mm\", \"3mm\", \"11mm\"]\ntranslate = [\"10mm\", \"2mm\", \"8mm\"]\nrotate = [0, \"30deg\", 0]",
    );
    let made = make(study, &format!("{FLOOR}{disc}{block}"));
    let pixel = 40.0 / f64::from(SIDE);
    for (name, area, edge) in [
        // The cylinder is a polygon of many sides.
        ("disc", std::f64::consts::PI * 49.0, std::f64::consts::PI * 14.0),
        ("block", 99.0, 40.0),
    ] {
        let found = instance(&made, name);
        let expected = area / pixel.powi(2);
        // 256 samples a pixel: an edge pixel has an error of some hundredths, of either sign.
        let tolerance = 0.02 * edge / pixel + 0.003 * expected;
        assert!((found.visible - expected).abs() < tolerance, "{name}: {} and {expected}", found.visible);
        assert_eq!(found.visible, found.amodal, "nothing hides it");
        assert!((found.area as f64 - expected).abs() < 0.5 * edge / pixel, "{name}: {}", found.area);
    }
}

#[test]
fn a_hidden_part_counts_as_amodal() {
    let study = "[[study.label]]\ncategory = \"part\"\nobjects = \"*er\"";
    let under = object("under", "kind = \"box\"\nsize = [\"20mm\", \"2mm\", \"10mm\"]\ntranslate = [0, \"1mm\", 0]");
    let over =
        object("cover", "kind = \"box\"\nsize = [\"10mm\", \"2mm\", \"20mm\"]\ntranslate = [\"5mm\", \"9mm\", 0]");
    let made = make(study, &format!("{FLOOR}{under}{over}"));
    let (under, over) = (instance(&made, "under"), instance(&made, "cover"));
    // 20 x 10 mm are 32 x 16 pixels, of which the right half is hidden.
    assert_eq!((under.amodal, under.visible, under.area), (512.0, 256.0, 256));
    assert_eq!(under.bbox, [16, 24, 16, 16]);
    assert_eq!((over.amodal, over.visible), (512.0, 512.0));
}

#[test]
fn a_flat_clear_cover_changes_no_label_of_a_telecentric_view() {
    let study =
        "[study.labels]\nsemantic = true\ncoverage = 4\n[[study.label]]\ncategory = \"part\"\nobjects = \"ball\"";
    let ball = object("ball", "kind = \"sphere\"\ndiameter = \"15mm\"\ntranslate = [\"3mm\", \"8mm\", \"-4mm\"]");
    let cover = "[[object]]\nname = \"sheet\"\nkind = \"box\"\nsize = [\"80mm\", \"3mm\", \"80mm\"]\ntranslate = [0, \"30mm\", 0]\n\
        material = \"pmma\"\n[[material]]\nname = \"pmma\"\nnew = true\nbase_color = 1\ntransmission = 1\nroughness = 0\nior = 1.49\nsolid = true\n";
    let open = make(study, &format!("{FLOOR}{ball}"));
    let covered = make(study, &format!("{FLOOR}{ball}{cover}"));
    for name in ["masks/000000.png", "semantic/000000.png", "coverage/000000.png"] {
        assert!(file(&open, name) == file(&covered, name), "{name}");
    }
    assert!(instance(&covered, "ball").area > 300);
}

#[test]
fn depth_and_normals_are_in_the_frame_of_the_camera() {
    let study = "[study.labels]\ndepth = true\nnormals = true";
    let ramp = object("ramp", "kind = \"box\"\nsize = [\"80mm\", \"2mm\", \"80mm\"]\nrotate = [0, 0, \"30deg\"]");
    let made = make(study, &ramp);
    let folder = tempfile::tempdir().expect("a folder");
    let read = |name: &str| {
        let path = folder.path().join("a.png");
        std::fs::write(&path, file(&made, name)).expect("writable");
        image::open(&path).expect("a PNG")
    };
    let (depth, normals) = (read("depth/000000.png").into_luma16(), read("normals/000000.png").into_rgb16());
    for (x, y) in [(10, 10), (32, 50), (60, 3)] {
        // Right in the image is +x, where the ramp rises: its upper face is y = x tan 30° + 1 mm / cos 30°.
        let across = (f64::from(x) + 0.5) / f64::from(SIDE) * 40.0 - 20.0;
        let expected = 200.0 - across * (30f64).to_radians().tan() - 1.0 / (30f64).to_radians().cos();
        let found = f64::from(depth.get_pixel(x, y).0[0]) * 0.1;
        assert!((found - expected).abs() < 0.06, "{x}, {y}: {found} and {expected}");
        let normal = normals.get_pixel(x, y).0.map(|v| (f64::from(v) - 32768.0) / 32767.0);
        // The face looks to the left and up, toward the camera.
        let expected = [-0.5, 0.0, -(0.75f64).sqrt()];
        assert!(normal.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{normal:?}");
    }
}

#[test]
fn defects_have_their_own_labels_also_where_they_show_nothing() {
    let block =
        object("print", "kind = \"box\"\nsize = [\"10mm\", \"0.1mm\", \"10mm\"]\ntranslate = [0, \"0.1mm\", 0]");
    let scene = format!("{FLOOR}{block}");
    let label = "[[study.label]]\ncategory = \"print\"\nobjects = \"print\"\n";
    let whole = make(label, &scene);
    let made = make(&format!("{label}[[study.defect]]\nkind = \"missing\"\non = \"print\"\n"), &scene);
    let (print, missing) = (instance(&whole, "print"), instance(&made, "missing 1"));
    assert_eq!((missing.area, missing.bbox), (print.area, print.bbox), "the label is where the print was");
    assert_eq!(missing.defect.as_deref(), Some("missing"));
    assert!(!made.record.instances.iter().any(|i| i.name == "print"));

    // A scratch of a tenth of a pixel in width has a mask without gaps if the pixels have several samples.
    let scratch = "[study.labels]\ncoverage = 8\n[[study.defect]]\nkind = \"scratch\"\non = \"floor\"\nfacing = [0, 1, 0]\n\
        length = \"20mm\"\nwidth = \"150um\"\ndepth = \"20um\"\n";
    let made = make(scratch, FLOOR);
    let found = instance(&made, "scratch 1");
    let longest = u64::from(found.bbox[2].max(found.bbox[3]));
    assert!(found.area >= longest, "{found:?}");
    let area = found.visible * (40.0f64 / f64::from(SIDE)).powi(2);
    assert!((0.5..=4.0).contains(&area), "20 mm x 150 um with thinner ends are about 2.5 mm²: {area}");
    assert!(found.size_mm.is_some_and(|s| (10.0..=20.5).contains(&s)), "{found:?}");
}

/// A stain at the end of a floor, beyond the film, and a missing block.
#[test]
fn records_have_the_place_of_defects_also_outside_of_the_film() {
    let study = "[study.labels]\nyolo = true\n[[study.defect]]\nkind = \"scratch\"\non = \"far\"\nfacing = [0, 1, 0]\n\
        length = \"2mm\"\nwidth = \"0.2mm\"\ndepth = \"20um\"\n\
        [[study.defect]]\nkind = \"missing\"\non = \"block\"\n";
    let far = object("far", "kind = \"box\"\nsize = [\"9mm\", \"2mm\", \"9mm\"]\ntranslate = [\"70mm\", \"1mm\", 0]");
    let block = object(
        "block",
        "kind = \"box\"\nsize = [\"4mm\", \"2mm\", \"4mm\"]\ntranslate = [\"3mm\", \"1mm\", \"5mm\"]\nrotate = [0, \"90deg\", 0]",
    );
    let made = make(study, &format!("{FLOOR}{far}{block}"));
    let scratch = instance(&made, "scratch 1");
    assert_eq!((scratch.area, scratch.visible, scratch.amodal, scratch.bbox), (0, 0.0, 0.0, [0; 4]));
    let place = scratch.place.as_ref().expect("a place");
    let inner = place.object.expect("a position");
    assert_eq!(place.on, "far");
    // The box is not turned: its frame is 70 mm to the right and 1 mm up.
    for (world, (inner, shift)) in place.world.iter().zip(inner.iter().zip([0.07, 0.001, 0.0])) {
        assert!((world - inner - shift).abs() < 1e-9, "{place:?}");
    }
    assert!((place.world[1] - 0.002).abs() < 1e-9 && (place.normal[1] - 1.0).abs() < 1e-9, "{place:?}");
    assert!(place.angle_deg.is_some_and(|angle| (0.0..360.0).contains(&angle)), "{place:?}");
    let missing = instance(&made, "missing 1").place.as_ref().expect("a place");
    assert_eq!((missing.on.as_str(), missing.angle_deg), ("block", None));
    assert!(missing.object.expect("a position").iter().all(|v| v.abs() < 1e-6), "{missing:?}");
    assert!((missing.world[0] - 0.003).abs() < 1e-6 && (missing.world[2] - 0.005).abs() < 1e-6, "{missing:?}");
    let lines = String::from_utf8_lossy(file(&made, "labels/000000.txt")).into_owned();
    assert_eq!(lines.lines().count(), 1, "only the missing block is in the film: {lines}");
}

/// A clear sheet over a print on an unlabelled floor, changed in each way. The telecentric view from above has the sheet in
/// its middle, 40 x 40 pixels, and the print of 16 x 16 pixels below it.
#[test]
fn labels_are_seen_through_a_changed_clear_cover() {
    let print =
        object("print", "kind = \"box\"\nsize = [\"10mm\", \"0.1mm\", \"10mm\"]\ntranslate = [0, \"0.1mm\", 0]");
    let clear = |solid: bool| {
        format!(
            "[[object]]\nname = \"sheet\"\nkind = \"box\"\nsize = [\"25mm\", \"2mm\", \"25mm\"]\ntranslate = [0, \"9mm\", 0]\n\
             [[material]]\nname = \"sheet\"\nbase_color = 1\ntransmission = 1\nroughness = 0\nior = 1.49\nsolid = {solid}\n"
        )
    };
    for samples in [1, 4] {
        let label = format!(
            "[study.labels]\ncoverage = {samples}\n[[study.label]]\ncategory = \"print\"\nobjects = \"print\"\n"
        );
        let usual = make(&label, &format!("{FLOOR}{print}{}", clear(true)));
        let usual = instance(&usual, "print");
        assert_eq!((usual.area, usual.bbox), (256, [24, 24, 16, 16]));
        for (kind, keys, solid) in [
            ("missing", "", true),
            ("missing", "", false),
            ("faded", "strength = 1\n", false),
            ("faded", "strength = 0.7\n", false),
            ("faded", "strength = 0.1\n", false),
            ("shifted", "length = \"1mm\"\nangle = \"0deg\"\n", true),
        ] {
            let change = format!("[[study.defect]]\nkind = \"{kind}\"\non = \"sheet\"\n{keys}");
            let made = make(&format!("{label}{change}"), &format!("{FLOOR}{print}{}", clear(solid)));
            let found = instance(&made, "print");
            assert_eq!((found.area, found.bbox), (usual.area, usual.bbox), "{kind} {keys}");
            assert_eq!((found.visible, found.amodal), (usual.visible, usual.amodal), "{kind} {keys}");
            // The changed sheet has the pixels around the print.
            let sheet = instance(&made, &format!("{kind} 1"));
            let expected = 1600.0 - 256.0;
            assert!((sheet.area as f64 - expected).abs() < 90.0, "{kind} {keys}: {sheet:?}");
            assert!((sheet.amodal - 1600.0).abs() < 90.0, "{kind} {keys}: {sheet:?}");
        }
    }
}

/// An opaque object that is changed has its label where it is or was, also in front of a labelled one.
#[test]
fn a_changed_opaque_object_hides_the_labels_behind_it() {
    let print =
        object("print", "kind = \"box\"\nsize = [\"10mm\", \"0.1mm\", \"10mm\"]\ntranslate = [0, \"0.1mm\", 0]");
    let label = "[[study.label]]\ncategory = \"floor\"\nobjects = \"floor\"\n";
    for change in ["missing\"", "faded\"", "faded\"\nstrength = 0.3", "shifted\"\nlength = \"1um\""] {
        let study = format!("{label}[[study.defect]]\nname = \"change\"\non = \"print\"\nkind = \"{change}\n");
        let made = make(&study, &format!("{FLOOR}{print}"));
        assert_eq!(instance(&made, "change 1").area, 256, "{change}");
        assert_eq!(instance(&made, "floor").area, u64::from(SIDE * SIDE) - 256, "{change}");
    }
}

/// A part and a defect in one category: only the defect is one.
#[test]
fn a_part_with_the_category_of_a_defect_is_no_defect() {
    let block = object("block", "kind = \"box\"\nsize = [\"10mm\", \"2mm\", \"10mm\"]\ntranslate = [0, \"1mm\", 0]");
    let cover = object(
        "cover",
        "kind = \"box\"\nsize = [\"20mm\", \"1mm\", \"20mm\"]\ntranslate = [0, \"9mm\", 0]\nmaterial = \"pmma\"",
    );
    let pmma = "[[material]]\nname = \"pmma\"\nnew = true\nbase_color = 1\ntransmission = 1\nroughness = 0\nior = 1.49\nsolid = true\n";
    let study = |category: &str| {
        format!(
            "[study.labels]\ncoverage = 4\n[[study.label]]\ncategory = \"spot\"\nobjects = [\"block\", \"cover\"]\n\
             [[study.defect]]\nkind = \"dust\"\nname = \"dust\"\ncategory = \"{category}\"\non = \"floor\"\n\
             facing = [0, 1, 0]\nlength = \"2mm\"\n"
        )
    };
    let scene = format!("{FLOOR}{block}{cover}{pmma}");
    let [own, shared] = ["dust", "spot"].map(|category| make(&study(category), &scene));
    assert_eq!(file(&own, "masks/000000.png"), file(&shared, "masks/000000.png"));
    for name in ["block", "cover"] {
        let [own, shared] = [&own, &shared].map(|made| instance(made, name));
        assert_eq!((own.area, own.visible, own.amodal), (shared.area, shared.visible, shared.amodal), "{name}");
    }
    assert!(instance(&own, "block").area > 200);
    assert_eq!(instance(&own, "dust 1").category, 2);
    assert_eq!(instance(&shared, "dust 1").category, 1);
}

/// A picture of 80 x 40 pixels whose left half is white, as a mask on the floor: the label is that half.
#[test]
fn the_label_of_a_decal_is_what_its_picture_covers() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("half.png");
    let texels = Plane::from_fn(80, 40, |x, _| if x < 40 { 255 } else { 0 });
    std::fs::write(&path, png_bytes(Picture::Gray8(&texels)).expect("a PNG")).expect("a file");
    let decal = |image: &str| {
        let keys =
            "kind = \"decal\"\nname = \"mark\"\non = \"floor\"\nmode = \"mask\"\nlength = \"16mm\"\nangle = \"0deg\"";
        format!("[study.labels]\ncoverage = 4\n[[study.defect]]\n{keys}\nimage = {image:?}\n[study.images]\n")
    };
    let path = path.to_str().expect("a path");
    let plate = object("floor", "kind = \"plane\"\nsize = [\"24mm\", \"12mm\"]");
    let made = make(&decal(path), &plate);
    let mark = instance(&made, "mark 1");
    let pixel = 40.0 / f64::from(SIDE);
    let x = mark.place.as_ref().expect("a place").world[0] * 1e3;
    let expected = 8.0 * 8.0 / pixel.powi(2);
    assert!((mark.visible / expected - 1.0).abs() < 0.03, "{} of {expected}", mark.visible);
    // The left half of the picture is that before the middle along its rows, which run along +x.
    let middle = (f64::from(mark.bbox[0]) + 0.5 * f64::from(mark.bbox[2])) * pixel - 20.0;
    assert!((middle - (x - 4.0)).abs() < pixel, "{middle} {x}");
    let missing = Study::from_text("test.toml", &format!("scene = \"none\"\n[study]\n{}", decal("no.png")));
    let fault = missing.expect_err("no file").to_string();
    assert!(fault.contains("no.png") && fault.contains("test.toml"), "{fault}");
}
