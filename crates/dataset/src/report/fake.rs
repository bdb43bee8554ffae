//! Small sets for tests.

use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// The head of a set with one defect and one object.
pub(crate) fn head() -> Value {
    json!({
        "format": 4, "program": "dunkelfeld 0.1.0", "study": "fake", "study_hash": "abc", "count": 20,
        "categories": [{"id": 1, "name": "scratch", "is_defect": true}, {"id": 2, "name": "part", "is_defect": false}],
    })
}

/// A record with one label of each category.
pub(crate) fn record(index: u64) -> Value {
    let label = |id, category, bbox: [u32; 4]| {
        json!({"id": id, "name": "x", "category": category, "bbox": bbox, "visible": 20, "amodal": 40,
               "contrast": -12.5, "cnr": -3.1, "size_mm": 4.2, "defect": null})
    };
    json!({
        "index": index, "seed": 1, "frame": 0, "width": 64, "height": 32, "samples": 64,
        "drawn": {"sensor.exposure": format!("{}ms", index + 1), "roughness": 0.31, "scene": "b.glb"},
        "certificate": {"k": 1.0, "hidden": 0.991, "median": 0.2, "p99": 0.9}, "matched": 0.97,
        "instances": [label(3, 1, [8, 8, 16, 8]), label(4, 2, [40, 4, 20, 24])],
        "files": {format!("images/{index:06}.png"): {"bytes": 123, "hash": "x"}},
    })
}

/// Writes `set.json` and records.
pub(crate) fn write(folder: &Path, records: &[Value]) {
    fs::create_dir_all(folder.join("records")).expect("a folder");
    fs::write(folder.join("set.json"), head().to_string()).expect("written");
    for record in records {
        let name = format!("{:06}.json", record["index"].as_u64().expect("an index"));
        fs::write(folder.join("records").join(name), record.to_string()).expect("written");
    }
}
