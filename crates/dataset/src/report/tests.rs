//! Tests of the whole page: hostile names, and sets with few or unusual records.

use super::fake::{self, record};
use super::{SetView, page};
use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::png_bytes;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const EVIL: &str = "</title></style><script>alert('1')</script><img src=x onerror=\"alert(2)\">&amp;\u{1}\u{202e}";

/// Writes images for the records, and draws the page.
fn drawn(folder: &Path, records: &[Value]) -> String {
    fake::write(folder, records);
    written(folder, records);
    page(&SetView::read(folder).expect("a set")).expect("a page")
}

fn written(folder: &Path, records: &[Value]) {
    fs::create_dir_all(folder.join("images")).expect("a folder");
    let bytes = png_bytes(Picture::Rgb8(&Plane::new(300, 150, [90; 3]))).expect("a picture");
    for record in records {
        fs::write(folder.join(format!("images/{:06}.png", record["index"].as_u64().expect("an index"))), &bytes)
            .expect("written");
    }
}

fn check(page: &str) {
    assert!(!page.contains("NaN") && !page.contains(">inf"), "{page}");
    assert_eq!(page.matches("<script").count(), 1, "only the script of the page");
    assert!(!page.contains("<img src=x") && !page.contains("alert("), "{page}");
    assert!(page.ends_with("</html>"));
}

fn with(index: u64, key: &str, value: Value) -> Value {
    let mut record = record(index);
    record[key] = value;
    record
}

#[test]
fn a_page_shows_a_set() {
    let folder = tempfile::tempdir().expect("a folder");
    let records: Vec<Value> = (0..20).map(record).collect();
    let page = drawn(folder.path(), &records);
    check(&page);
    for part in ["Data set: fake", "40", "sensor.exposure", "b.glb", "hidden at k = 1", "images/000019.png", "scratch"]
    {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("Not finished") && !page.contains("per hour"));
    // Each image with its labels.
    assert_eq!([page.matches("<img").count(), page.matches("<svg class=\"labels\"").count()], [20; 2]);
}

#[test]
fn a_set_without_finished_images_has_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = drawn(folder.path(), &[]);
    check(&page);
    assert!(page.contains("0 of 20 images") && page.contains("No image is finished"));
}

#[test]
fn one_image_has_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = drawn(folder.path(), &[record(0)]);
    check(&page);
    assert!(page.contains("Equal in all images") && page.contains("0.31"));
}

#[test]
fn sets_with_texts_only_or_without_anything_have_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let scenes = |i: u64| {
        let scene = if i == 1 { "a.glb" } else { "b.glb" };
        with(i, "drawn", json!({"scene": scene, "is_on": i == 1}))
    };
    check(&drawn(folder.path(), &(0..3).map(scenes).collect::<Vec<_>>()));
    let bare = tempfile::tempdir().expect("a folder");
    fake::write(bare.path(), &[json!({"index": 0})]);
    fs::write(bare.path().join("set.json"), "{\"format\": 4, \"count\": 1}").expect("written");
    written(bare.path(), &[record(0)]);
    let page = page(&SetView::read(bare.path()).expect("a set")).expect("a page");
    check(&page);
    assert!(page.contains("The set has no categories"));
}

#[test]
fn unknown_numbers_have_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let label = json!({"id": 3, "name": "x", "category": 77, "bbox": [0, 0, 0, 0], "visible": 0, "amodal": 0,
        "contrast": null, "cnr": null, "size_mm": null, "defect": null});
    let mut record = with(0, "instances", json!([label, {"id": 1, "category": 1}]));
    record["certificate"] = Value::Null;
    record["matched"] = Value::Null;
    let page = drawn(folder.path(), &[record]);
    check(&page);
    assert!(page.contains("77 (not in set.json)"));
}

#[test]
fn hostile_names_stay_text() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut records = Vec::new();
    for i in 0..3 {
        let drawn = json!({EVIL: i, "texts": format!("{EVIL}{i}"), "same": EVIL, "unit": format!("{i}{}", "m<b>")});
        let mut record = with(i, "drawn", drawn);
        record["files"] = json!({format!("{EVIL}/x"): {"bytes": u64::MAX}});
        records.push(record);
    }
    fake::write(folder.path(), &records);
    written(folder.path(), &records);
    let mut head = fake::head();
    for key in ["study", "program", "study_hash"] {
        head[key] = json!(EVIL);
    }
    head["categories"][0]["name"] = json!(EVIL);
    fs::write(folder.path().join("set.json"), head.to_string()).expect("written");
    fs::create_dir_all(folder.path().join("costs")).expect("a folder");
    fs::write(folder.path().join("costs/000000.json"), json!({EVIL: 1.0, "render": 2.0}).to_string()).expect("written");
    let view = SetView::read(folder.path()).expect("a set");
    let page = page(&view).expect("a page");
    assert_eq!(page.matches("<script").count(), 1);
    assert!(!page.contains("<img src=x") && !page.contains("m<b>") && !page.contains('\u{1}'));
    assert!(page.contains("&lt;script&gt;"));
}

#[test]
fn times_are_those_of_the_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let records: Vec<Value> = (0..3).map(record).collect();
    fs::create_dir_all(folder.path().join("costs")).expect("a folder");
    for (i, total) in [1.0, 2.0, 6.0].into_iter().enumerate() {
        let cost = json!({"render": total - 0.5, "write": 0.5, "total": total});
        fs::write(folder.path().join(format!("costs/{i:06}.json")), cost.to_string()).expect("written");
    }
    let page = drawn(folder.path(), &records);
    check(&page);
    // The mean is 3 s, so that 1200 images need an hour. The 17 missing ones need 51 s.
    assert!(page.contains("1200 images per hour") && page.contains("51.0 s more for 17 images"), "{page}");
}
