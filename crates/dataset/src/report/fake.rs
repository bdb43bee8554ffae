//! Small sets for tests.

use crate::record::Record;
use crate::set::Set;
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
pub(crate) fn write_named(folder: &Path, records: &[Value], name: &str) -> Set {
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
