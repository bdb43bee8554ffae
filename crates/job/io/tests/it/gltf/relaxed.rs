//! glTF import: what the crate `gltf` refuses, and what it alone would refuse or round.

use super::support::{Asset, SQUARE, load_bytes};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::import::{ImportOptions, Imported};
use dunkelfeld_io::loader::Limits;
use serde_json::{Value, json};

fn square() -> Asset {
    Asset::with_primitive(|a| {
        let indices = a.indices(&[0, 1, 2, 1, 3, 2]);
        json!({"attributes": {"POSITION": a.floats(&SQUARE)}, "indices": indices, "material": 0})
    })
}

fn with_material(material: Value) -> Asset {
    let mut a = square();
    a.texture(1, &[[9, 8, 7, 6]]);
    a.json["materials"] = json!([material]);
    a
}

/// The data that two imports must share.
fn content(imported: &Imported) -> String {
    format!(
        "{:?}",
        (&imported.scene.meshes, &imported.scene.materials, &imported.scene.instances, &imported.scene.lights)
    )
}

fn same(change: impl Fn(&mut Value)) {
    let mut a = with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "name": "m"}));
    a.json["scenes"] = json!([{"nodes": [0]}]);
    let plain = a.load().expect("loads");
    change(&mut a.json);
    let changed = a.load().unwrap_or_else(|e| panic!("{e}: {}", a.json));
    assert_eq!(content(&plain), content(&changed), "{}", a.json);
    assert_eq!(plain.warnings, changed.warnings, "{}", a.json);
}

#[test]
fn animations_extras_and_unread_extensions_may_be_anything() {
    same(|json| json["animations"] = json!([{"channels": 7}]));
    same(|json| json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}]}]));
    same(|json| json["extras"] = json!([[1, "x"], {"a": [[2]]}]));
    same(|json| json["nodes"][0]["extras"] = json!("x"));
    same(|json| json["accessors"][0]["max"] = json!("x"));
    same(|json| {
        json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_materials_variants": {"mappings": [3]}})
    });
    same(|json| json["materials"][0]["extensions"] = json!({"ACME_thing": [[1], "x"]}));
}

#[test]
fn an_empty_scene_may_lack_its_list_of_nodes() {
    let mut a = square();
    a.json["scenes"] = json!([{"name": "empty"}]);
    assert!(a.load().expect("loads").scene.instances.is_empty());
}

#[test]
fn transforms_keep_the_digits_of_f64() {
    let mut a = square();
    a.json["nodes"] = json!([{"name": "far", "mesh": 0, "translation": [1e9 + 0.25, 0.1, 0]}]);
    let imported = a.load().expect("loads");
    assert_eq!(imported.scene.instances[0].to_world.translation, DVec3::new(1e9 + 0.25, 0.1, 0.0));
}

#[test]
fn json_that_the_crate_refuses_is_refused_with_its_place() {
    for (list, value) in [
        ("nodes", json!([{"mesh": 0, "camera": "x"}])),
        ("nodes", json!([{"mesh": 0.0}])),
        ("skins", json!([{}])),
        ("cameras", json!([{"type": "perspective", "perspective": {"yfov": 1}}])),
        ("materials", json!([{"emissiveTexture": {}}])),
        ("meshes", json!([{"primitives": [{}]}])),
        ("extensions", json!({"KHR_lights_punctual": {"lights": [{}]}})),
        ("asset", json!({})),
    ] {
        let mut a = square();
        a.json[list] = value;
        let e = a.load().expect_err(list);
        assert!(e.place.starts_with("JSON, ") && e.help.contains("export"), "{e}");
    }
}

#[test]
fn faults_of_type_have_their_place_also_in_untyped_extensions() {
    let text =
        |material: &str| format!("{{\"asset\": {{\"version\": \"2.0\"}},\n \"materials\": [{{}},\n  {{{material}}}]}}");
    for (material, word) in [
        ("\"doubleSided\": 3", "boolean"),
        ("\"extensions\": {\"KHR_materials_clearcoat\": {\"clearcoatFactor\": \"much\"}}", "much"),
        ("\"normalTexture\": {\"index\": -1}", "whole number"),
        ("\"extensions\": {\"KHR_materials_ior\": 7}", "expected an object"),
    ] {
        let e = load_bytes(text(material).as_bytes(), "a.gltf", &ImportOptions::default()).expect_err("a fault");
        assert!(e.place.starts_with("JSON, materials[1].") && e.problem.contains(word), "{e}");
        assert!(e.help.contains("export"), "{e}");
    }
}

#[test]
fn a_glb_with_other_chunks_is_refused() {
    let mut glb = square().glb();
    let json_end = 20 + u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    glb.splice(json_end..json_end, [&8_u32.to_le_bytes()[..], b"ODD\0", &[7; 8]].concat());
    let length = (glb.len() as u32).to_le_bytes();
    glb[8..12].copy_from_slice(&length);
    let e = load_bytes(&glb, "a.glb", &ImportOptions::default()).expect_err("another chunk");
    assert!(e.problem.contains("one binary chunk") && e.help.contains("damaged"), "{e}");
}

#[test]
fn values_without_number_are_refused() {
    let bytes = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"children": [{}1]}}]}}"#, "1,".repeat(40_000));
    let limits = Limits { json_objects: 1_000, ..Limits::default() };
    let options = ImportOptions::default().with_limits(limits);
    let e = load_bytes(bytes.as_bytes(), "a.gltf", &options).expect_err("too many");
    assert!(e.place == "JSON" && e.problem.contains("values") && e.help.contains("limits"), "{e}");
}
