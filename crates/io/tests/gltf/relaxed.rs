//! glTF import of files that the crate `gltf` alone refuses, misreads or cannot hold.

use crate::support::{Asset, SQUARE, load_bytes, warns};
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
fn null_counts_as_absent_and_whole_numbers_may_have_a_point() {
    same(|json| json["nodes"][0]["translation"] = Value::Null);
    same(|json| json["accessors"][0]["sparse"] = Value::Null);
    same(|json| json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = Value::Null);
    same(|json| json["materials"][0]["extensions"] = json!({"KHR_materials_sheen": null}));
    same(|json| {
        let mode = json["accessors"][0]["componentType"].as_f64().expect("a number");
        json["accessors"][0]["componentType"] = json!(mode);
        json["scenes"][0]["nodes"] = json!([0.0]);
        json["meshes"][0]["primitives"][0]["mode"] = json!(4.0);
        json["bufferViews"][1]["byteOffset"] = json!(json["bufferViews"][1]["byteOffset"].as_f64());
    });
}

#[test]
fn parts_that_do_not_matter_may_be_anything() {
    same(|json| json["animations"] = json!([{"channels": 7}]));
    same(|json| json["extras"] = json!([[1, "x"], {"a": [[2]]}]));
    same(|json| json["accessors"][0]["name"] = json!(5));
    same(|json| json["accessors"][0]["max"] = json!("x"));
    same(|json| json["images"][0]["mimeType"] = json!(false));
    same(|json| json["bufferViews"][0]["target"] = json!("x"));
    same(|json| json["materials"][0]["occlusionTexture"] = json!(1));
    same(|json| {
        json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_materials_variants": {"mappings": [3]}})
    });
    same(|json| json["materials"][0]["extensions"] = json!({"ACME_thing": [[1], "x"]}));
    same(|json| json["skins"] = json!([{"skeleton": "x"}]));
}

#[test]
fn members_that_the_crate_requires_may_be_missing() {
    let of = |list: &str, value: Value| {
        let mut a = square();
        a.json["materials"] = json!([{}]);
        a.json[list] = value;
        a.load().unwrap_or_else(|e| panic!("{list}: {e}"))
    };
    assert!(of("scenes", json!([{"name": "empty"}])).scene.instances.is_empty());
    assert_eq!(of("skins", json!([{}])).scene.instances.len(), 1);
    assert!(warns(&of("nodes", json!([{"mesh": 0}, {"camera": 0}])), &["camera 0 does not exist"]));
    for camera in [json!({}), json!({"perspective": {}}), json!({"type": "orthographic", "orthographic": {}})] {
        let mut a = Asset::new(json!({"nodes": [{"camera": 0}]}));
        a.json["cameras"] = json!([camera]);
        assert!(warns(&a.load().expect("loads"), &["camera 0", "field of view or magnification"]));
    }
    let lights = json!({"KHR_lights_punctual": {"lights": [{}, {"type": "spot"}]}});
    let node = |light: Value| json!({"extensions": {"KHR_lights_punctual": light}});
    let nodes = json!([node(json!({})), node(json!({"light": 0})), node(json!({"light": 1}))]);
    let imported = Asset::new(json!({"nodes": nodes, "extensions": lights})).load().expect("loads");
    assert_eq!(imported.scene.lights.len(), 1);
    assert!(warns(&imported, &["light 0", "the light type (none) does not exist"]), "{:?}", imported.warnings);
    let imported = with_material(json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {}})).load().expect("loads");
    assert!(warns(&imported, &["material 0", "it has no index"]), "{:?}", imported.warnings);
}

/// The crate keeps 32 bits of an index, so that 2^32 would become 0.
#[test]
fn indices_beyond_32_bits_are_out_of_range() {
    for index in [json!(4_294_967_296_u64), json!(4_294_967_296.0), json!(u64::MAX)] {
        let mut a = square();
        a.json["meshes"][0]["primitives"][0]["material"] = index.clone();
        let imported = a.load().expect("loads");
        assert!(warns(&imported, &["primitive 0", "material", "does not exist"]), "{index}: {:?}", imported.warnings);
        a.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = index.clone();
        let e = a.load().expect_err("no positions");
        assert!(e.problem.contains("accessor") && e.problem.contains("does not exist"), "{index}: {e}");
    }
}

#[test]
fn transforms_keep_the_digits_of_f64() {
    let mut a = square();
    a.json["nodes"] = json!([{"name": "far", "mesh": 0, "translation": [1e9 + 0.25, 0.1, 0]}]);
    let imported = a.load().expect("loads");
    assert_eq!(imported.scene.instances[0].to_world.translation, DVec3::new(1e9 + 0.25, 0.1, 0.0));
}

#[test]
fn arrays_in_the_place_of_objects_are_refused() {
    let refuse = |change: &dyn Fn(&mut Value)| {
        let mut a = with_material(json!({}));
        change(&mut a.json);
        let e = a.load().expect_err("an array");
        assert!(e.place.starts_with("JSON, line ") && e.problem.contains("expected"), "{e}");
        assert!(e.caret().contains('^'));
    };
    refuse(&|json| json["asset"] = json!(["2.0"]));
    refuse(&|json| json["materials"][0]["pbrMetallicRoughness"] = json!([[1, 1, 1, 1]]));
    refuse(&|json| json["materials"][0]["emissiveTexture"] = json!([0]));
    refuse(&|json| json["materials"][0]["extensions"] = json!({"KHR_materials_clearcoat": [1]}));
    refuse(&|json| json["nodes"] = json!([[0]]));
}

#[test]
fn faults_of_type_have_their_line_also_in_untyped_extensions() {
    let text =
        |material: &str| format!("{{\"asset\": {{\"version\": \"2.0\"}},\n \"materials\": [{{}},\n  {{{material}}}]}}");
    for (material, word) in [
        ("\"doubleSided\": 3", "boolean"),
        ("\"extensions\": {\"KHR_materials_clearcoat\": {\"clearcoatFactor\": \"much\"}}", "much"),
        ("\"normalTexture\": {\"index\": -1}", "whole number"),
        ("\"extensions\": {\"KHR_materials_ior\": 7}", "expected an object"),
    ] {
        let e = load_bytes(text(material).as_bytes(), "a.gltf", &ImportOptions::default()).expect_err("a fault");
        assert!(e.place.starts_with("JSON, line 3, column ") && e.problem.contains(word), "{e}");
        assert!(e.help.contains("export") && e.caret().starts_with("  |\n3 | "), "{}", e.caret());
    }
}

#[test]
fn other_chunks_of_a_glb_are_skipped() {
    let a = square();
    let glb = a.glb();
    let plain = load_bytes(&glb, "a.glb", &ImportOptions::default()).expect("loads");
    let json_end = 20 + u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let odd = [&8_u32.to_le_bytes()[..], b"ODD\0", &[7; 8]].concat();
    // Before the binary chunk, twice, after it, and a rest that is no chunk.
    for (at, piece) in
        [(json_end, odd.clone()), (json_end, odd.repeat(2)), (glb.len(), odd.clone()), (glb.len(), vec![1, 2, 3])]
    {
        let mut changed = glb.clone();
        changed.splice(at..at, piece.iter().copied());
        let length = (changed.len() as u32).to_le_bytes();
        changed[8..12].copy_from_slice(&length);
        let imported = load_bytes(&changed, "a.glb", &ImportOptions::default()).unwrap_or_else(|e| panic!("{at}: {e}"));
        assert_eq!(content(&imported), content(&plain), "{at}");
    }
    let mut cut = glb.clone();
    cut.splice(json_end..json_end, odd.iter().copied());
    cut[json_end] = 255;
    let length = (cut.len() as u32).to_le_bytes();
    cut[8..12].copy_from_slice(&length);
    cut[json_end + 1] = 255;
    let e = load_bytes(&cut, "a.glb", &ImportOptions::default()).expect_err("a chunk that is cut short");
    assert!(e.place == "GLB chunk 1" && e.help.contains("damaged"), "{e}");
}

#[test]
fn a_refusal_names_what_the_crate_finds() {
    let mut a = square();
    a.json["accessors"][0]["bufferView"] = 17.into();
    a.json["accessors"][1]["bufferView"] = 18.into();
    let e = a.load().expect_err("nothing is left");
    assert!(e.help.contains("accessors[0].bufferView: index out of bounds"), "{e}");
    // The crate's validation of this primitive would panic.
    a.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 55.into();
    a.json["accessors"] = json!([]);
    let e = a.load().expect_err("nothing is left");
    assert!(e.help.contains("meshes[0].primitives[0].attributes[\"POSITION\"]: index out of bounds"), "{e}");
}

#[test]
fn values_without_number_are_refused() {
    let bytes = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"children": [{}1]}}]}}"#, "1,".repeat(40_000));
    let limits = Limits { json_objects: 1_000, ..Limits::default() };
    let options = ImportOptions::default().with_limits(limits);
    let e = load_bytes(bytes.as_bytes(), "a.gltf", &options).expect_err("too many");
    assert!(e.place == "JSON" && e.problem.contains("values") && e.help.contains("limits"), "{e}");
}
