//! Tests of the whole page: hostile names, and sets with few or unusual records.

use super::{SetView, page};
use crate::record::Record;
use crate::set::Set;
use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::png_bytes;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// A record with one label of each category.
pub(crate) fn record(index: u64) -> Value {
    let label = |id, category, bbox: [u32; 4]| {
        json!({"id": id, "name": "x", "category": category, "bbox": bbox, "area": 20, "visible": 20.0, "amodal": 40.0,
               "contrast": -12.5, "cnr": -3.1, "size_mm": 4.2, "defect": null})
    };
    json!({
        "index": index, "study": "abc", "seed": 1, "frame": 0, "width": 64, "height": 32, "samples": 64, "exposure": 0.01,
        "drawn": {"sensor.exposure": format!("{}ms", index + 1), "roughness": 0.31, "scene": "b.glb"},
        "certificate": {"k": 1.0, "hidden": 0.991, "median": 0.2, "p99": 0.9, "saturated": 0.0}, "matched": 0.97,
        "instances": [label(3, 1, [8, 8, 16, 8]), label(4, 2, [40, 4, 20, 24])],
        "files": {format!("images/{index:06}.png"): {"bytes": 123, "hash": "x"}},
    })
}

/// Writes the description of a set of 20 images with one category of defects and one of objects, and records.
pub(crate) fn write(folder: &Path, records: &[Value]) -> Set {
    write_named(folder, records, "fake")
}

/// As [`write`], with a name for the study and the categories.
fn write_named(folder: &Path, records: &[Value], name: &str) -> Set {
    fs::create_dir_all(folder.join("records")).expect("a folder");
    let category = |id: u16, name: &str, is_defect: bool| json!({"id": id, "name": name, "is_defect": is_defect});
    let head = json!({
        "format": crate::record::FORMAT, "program": name, "study": name, "study_hash": name, "study_text": "",
        "inputs": [], "files": [], "count": 20, "categories": [category(1, name, true), category(2, "part", false)],
    });
    fs::write(folder.join("set.json"), head.to_string()).expect("written");
    for record in records {
        let record: Record = serde_json::from_value(record.clone()).expect("a record");
        let name = format!("records/{:06}.json", record.index);
        fs::write(folder.join(name), serde_json::to_vec(&record).expect("JSON")).expect("written");
    }
    Set::read(folder).expect("a set")
}

const EVIL: &str = "</title></style><script>alert('1')</script><img src=x onerror=\"alert(2)\">&amp;\u{1}\u{202e}";

/// The page of a set, with images for its records.
fn page_of(set: &Set) -> String {
    fs::create_dir_all(set.path().join("images")).expect("a folder");
    let bytes = png_bytes(Picture::Rgb8(&Plane::new(300, 150, [90; 3]))).expect("a picture");
    for index in set.finished() {
        fs::write(set.path().join(format!("images/{index:06}.png")), &bytes).expect("written");
    }
    let page = page(&SetView::new(set).expect("a set")).expect("a page");
    assert!(!page.contains("NaN") && !page.contains(">inf"), "{page}");
    assert_eq!(page.matches("<script").count(), 1, "only the script of the page");
    assert!(!page.contains("<img src=x") && !page.contains("alert(\""), "{page}");
    assert!(page.ends_with("</html>"));
    page
}

fn drawn(folder: &Path, records: &[Value]) -> String {
    page_of(&write(folder, records))
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
    for part in ["Data set: fake", "40", "sensor.exposure", "b.glb", "hidden at k = 1", "images/000019.png", "part"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("Not finished") && !page.contains("per hour"));
    // Each image with its labels.
    assert_eq!([page.matches("<img").count(), page.matches("<svg class=\"labels\"").count()], [20; 2]);
}

#[test]
fn sets_without_images_and_with_one_have_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let page = drawn(folder.path(), &[]);
    assert!(page.contains("0 of 20 images") && page.contains("No image is finished"));
    let page = drawn(folder.path(), &[record(0)]);
    assert!(page.contains("Equal in all images") && page.contains("0.31"));
}

#[test]
fn unknown_numbers_have_a_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let label = json!({"id": 3, "name": "x", "category": 1, "bbox": [0, 0, 0, 0], "area": 0, "visible": 0.0, "amodal": 0.0,
        "contrast": null, "cnr": null, "size_mm": null, "defect": "dust"});
    let mut record = with(0, "instances", json!([label]));
    record["certificate"] = Value::Null;
    record["matched"] = Value::Null;
    record["drawn"] = json!({"scene": "a.glb", "is_on": true});
    drawn(folder.path(), &[record]);
}

#[test]
fn hostile_names_stay_text() {
    let folder = tempfile::tempdir().expect("a folder");
    let records: Vec<Value> = (0..3)
        .map(|i| with(i, "drawn", json!({EVIL: i, "texts": format!("{EVIL}{i}"), "unit": format!("{i}{}", "m<b>")})))
        .collect();
    let page = page_of(&write_named(folder.path(), &records, EVIL));
    assert!(!page.contains("m<b>") && !page.contains('\u{1}') && page.contains("&lt;script&gt;"));
}

#[test]
fn times_are_those_of_the_files() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir_all(folder.path().join("costs")).expect("a folder");
    for (i, total) in [1.0, 2.0, 6.0].into_iter().enumerate() {
        let cost = crate::record::Cost { render: total - 0.5, write: 0.5, total, ..Default::default() };
        let text = serde_json::to_string(&cost).expect("JSON");
        fs::write(folder.path().join(format!("costs/{i:06}.json")), text).expect("written");
    }
    let page = drawn(folder.path(), &(0..3).map(record).collect::<Vec<_>>());
    // The mean is 3 s, so that 1200 images need an hour. The 17 missing ones need 51 s.
    assert!(page.contains("1200 images per hour") && page.contains("51.0 s more for 17 images"), "{page}");
}

#[test]
fn chosen_images_include_both_ends() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = write(folder.path(), &(0..11).map(record).collect::<Vec<_>>());
    let view = SetView::new(&set).expect("a set");
    assert_eq!(view.evenly(3), [0, 5, 10]);
    assert_eq!(view.evenly(1), [0]);
    assert_eq!(view.evenly(99).len(), 11);
}
