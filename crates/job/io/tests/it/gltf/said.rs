//! Messages of the glTF import about faults that had no message, or a wrong one, in the past.

use super::support::{Asset, SQUARE, load_bytes, warns};
use dunkelfeld_io::import::{EmissiveUnit, ImportOptions, load_scene};
use serde_json::json;

fn square() -> Asset {
    Asset::with_primitive(|a| {
        let indices = a.indices(&[0, 1, 2, 1, 3, 2]);
        json!({"attributes": {"POSITION": a.floats(&SQUARE)}, "indices": indices})
    })
}

fn problem(bytes: &[u8]) -> String {
    load_bytes(bytes, "a.glb", &ImportOptions::default()).expect_err("damaged").to_string()
}

#[test]
fn each_fault_of_a_glb_header_has_its_name() {
    let sound = square().glb();
    let with = |at: usize, bytes: &[u8]| {
        let mut glb = sound.clone();
        glb[at..at + bytes.len()].copy_from_slice(bytes);
        glb
    };
    let cases = [
        (with(4, &[1, 0, 0, 0]), "glTF version \"1\""),
        (with(8, &[12, 0, 0, 0]), "by its header the file has 12 bytes"),
        (with(8, &[0, 0, 0, 1]), "by its header the file has 16777216 bytes, but it has"),
        (with(16, b"BIN\0"), "the file does not consist of JSON and one binary chunk"),
        (with(12, &[255, 255, 0, 0]), "the file does not consist of JSON and one binary chunk"),
        (sound[..10].to_vec(), "by its header the file has 0 bytes, but it has 10"),
        (sound[..40].to_vec(), "but it has 40"),
    ];
    for (glb, words) in cases {
        let text = problem(&glb);
        assert!(text.contains(words) && text.contains("help:"), "{words}: {text}");
    }
}

#[test]
fn a_missing_buffer_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("a.gltf");
    let mut a = square();
    let data = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, &a.data);
    let own = json!({"byteLength": a.data.len(), "uri": format!("data:;base64,{data}")});
    a.json["buffers"] = json!([own, {"byteLength": 64, "uri": "gone.bin"}]);
    std::fs::write(&path, a.gltf()).expect("write");
    let e = load_scene(&path, &ImportOptions::default()).expect_err("the file is missing");
    assert!(e.place.contains("buffer 1") && e.problem.contains("gone.bin"), "{e}");
}

#[test]
fn vertex_colours_outside_their_range_are_counted() {
    let of = |colors: &[[f32; 4]; 4]| {
        let a = Asset::with_primitive(
            |a| json!({"attributes": {"POSITION": a.floats(&SQUARE), "COLOR_0": a.floats(colors)}, "mode": 5}),
        );
        a.load().expect("loads")
    };
    let fine = of(&[[0.0, 0.5, 1.0, 1.0]; 4]);
    assert!(fine.warnings.is_empty(), "{:?}", fine.warnings);
    let bright = of(&[[0.0; 4], [1.5, 0.0, 0.0, 1.0], [0.0, -0.1, 0.0, 1.0], [0.0, f32::NAN, 0.0, 1.0]]);
    let words = ["mesh 0", "primitive 0", "COLOR_0 is outside [0, 1] at 3 of 4 vertices", "clamped"];
    assert!(warns(&bright, &words), "{:?}", bright.warnings);
}

#[test]
fn anisotropy_without_tangents_states_what_it_follows() {
    let of = |with_tangents: bool| {
        let mut a = Asset::with_primitive(|a| {
            let mut attributes = json!({"POSITION": a.floats(&SQUARE), "NORMAL": a.floats(&[[0.0, 0.0, 1.0]; 4])});
            attributes["TEXCOORD_0"] = a.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]).into();
            if with_tangents {
                attributes["TANGENT"] = a.floats(&[[1.0, 0.0, 0.0, 1.0]; 4]).into();
            }
            json!({"attributes": attributes, "mode": 5, "material": 0})
        });
        a.json["materials"] = json!([{"extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}}]);
        a.load().expect("loads")
    };
    assert!(of(true).warnings.is_empty(), "{:?}", of(true).warnings);
    let words = ["mesh 0", "no TANGENT", "its anisotropy takes its direction from TEXCOORD_0"];
    assert!(warns(&of(false), &words), "{:?}", of(false).warnings);
}

#[test]
fn weights_of_morphs_and_joints_that_do_not_fit_are_reported() {
    let morphed = |weights: serde_json::Value| {
        let mut a = Asset::with_primitive(|a| {
            let delta = a.floats(&[[0.0, 0.0, 0.5]; 4]);
            json!({"attributes": {"POSITION": a.floats(&SQUARE)}, "mode": 5, "targets": [{"POSITION": delta}]})
        });
        a.json["meshes"][0]["weights"] = weights;
        a.load().expect("loads")
    };
    assert!(morphed(json!([0.5])).warnings.is_empty() && morphed(json!([])).warnings.is_empty());
    let many = morphed(json!([0.5, 1, 1]));
    assert!(warns(&many, &["mesh 0", "3 weights for 1 morph targets", "ignored"]), "{:?}", many.warnings);
    let mut none = square();
    none.json["meshes"][0]["weights"] = json!([1]);
    let none = none.load().expect("loads");
    assert!(warns(&none, &["1 weights for 0 morph targets"]), "{:?}", none.warnings);

    for (name, other) in [("JOINTS_0", "WEIGHTS_0"), ("WEIGHTS_0", "JOINTS_0"), ("JOINTS_1", "WEIGHTS_1")] {
        let mut a = square();
        let data = a.raw(&[0; 16], 5121, "VEC4", 4, name.starts_with('W'));
        a.json["meshes"][0]["primitives"][0]["attributes"][name] = data.into();
        let imported = a.load().expect("loads");
        let words = ["mesh 0", &format!("{name} without {other}"), "moves no vertex"];
        assert!(warns(&imported, &words), "{name}: {:?}", imported.warnings);
    }
}

#[test]
fn a_scene_of_flattened_nodes_alone_is_refused() {
    let mut a = square();
    a.json["nodes"][0]["scale"] = json!([0, 0, 0]);
    let e = a.load().expect_err("nothing is left");
    assert!(e.place.contains("part") && e.problem.contains("flattens") && e.problem.contains("no mesh is left"), "{e}");
}

#[test]
fn names_that_a_terminal_would_obey_are_spelled_out_in_warnings() {
    let mut a = square();
    a.json["materials"] = json!([{"name": "\u{1b}[2J\u{202e}", "alphaCutoff": 0.5, "pbrMetallicRoughness":
        {"baseColorTexture": {"index": 7}}}]);
    a.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    let imported = a.load().expect("loads");
    let shown: String = imported.warnings.iter().map(ToString::to_string).collect();
    assert!(shown.contains("\\u{1b}[2J\\u{202e}"), "{shown:?}");
    assert!(!shown.contains(|c: char| c.is_control() || c == '\u{202e}'), "{shown:?}");
}

#[test]
fn emission_of_blender_is_reported_with_and_without_lamps() {
    let of = |generator: &str, emission: f32, with_lamp: bool, unit: EmissiveUnit| {
        let mut a = square();
        a.json["asset"]["generator"] = generator.into();
        a.json["materials"] = json!([{"name": "glow", "emissiveFactor": [1, 1, 1],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": emission}}}]);
        a.json["meshes"][0]["primitives"][0]["material"] = 0.into();
        if with_lamp {
            a.json["extensions"] =
                json!({"KHR_lights_punctual": {"lights": [{"name": "key", "type": "point", "intensity": 683}]}});
            a.json["nodes"] =
                json!([{"name": "part", "mesh": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}]);
        }
        load_bytes(&a.glb(), "a.glb", &ImportOptions::default().with_emissive_unit(unit)).expect("loads")
    };
    let blender = "Khronos glTF Blender I/O v4.5.51";
    for (with_lamp, words) in [(true, "beside lamps such as"), (false, "for the radiance of Blender")] {
        let imported = of(blender, 10.0, with_lamp, EmissiveUnit::Nit);
        let all = ["glow", "10.0 nit", "683 lm/W", "`emissive_unit = \"W/(m2 sr)\"`", words];
        assert!(warns(&imported, &all), "{:?}", imported.warnings);
    }
    for (generator, emission, unit) in [
        ("CAD 3", 10.0, EmissiveUnit::Nit),
        (blender, 5000.0, EmissiveUnit::Nit),
        (blender, 10.0, EmissiveUnit::WattPerSteradianSquareMetre),
    ] {
        let imported = of(generator, emission, false, unit);
        assert!(!warns(&imported, &["683 lm/W"]), "{:?}", imported.warnings);
    }
}
