//! glTF import of broken and malicious files: a clear error or a warning, never a panic, a hang or a huge allocation.

use super::support::{Asset, SQUARE, load_bytes, warns};
use dunkelfeld_geometry::Vec3;
use dunkelfeld_io::import::{ImportOptions, load_scene};
use dunkelfeld_io::loader::Limits;
use serde_json::{Value, json};

fn square() -> Asset {
    Asset::with_primitive(|a| {
        let indices = a.indices(&[0, 1, 2, 1, 3, 2]);
        json!({"attributes": {"POSITION": a.floats(&SQUARE)}, "indices": indices})
    })
}

/// An asset that uses nearly everything.
fn rich() -> Asset {
    let mut a = Asset::with_primitive(|a| {
        let uv = a.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        let normals = a.floats(&[[0.0, 0.0, 1.0]; 4]);
        let colors = a.raw(&[200; 16], 5121, "VEC4", 4, true);
        let joints = a.raw(&[0; 16], 5121, "VEC4", 4, false);
        let weights = a.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]);
        let delta = a.floats(&[[0.0, 0.0, 0.5]; 4]);
        let position = a.floats(&SQUARE);
        let sparse = a.view(&[0, 2]);
        let values = a.view(&[0; 24]);
        a.json["accessors"][position]["sparse"] = json!({"count": 2,
            "indices": {"bufferView": sparse, "componentType": 5121}, "values": {"bufferView": values}});
        json!({"attributes": {"POSITION": position, "NORMAL": normals, "TEXCOORD_0": uv, "TEXCOORD_1": uv,
            "COLOR_0": colors, "JOINTS_0": joints, "WEIGHTS_0": weights},
            "indices": a.indices(&[0, 1, 3, 0, 3, 2]), "targets": [{"POSITION": delta}], "material": 0})
    });
    let texture = a.texture(2, &[[1, 2, 3, 4], [5, 6, 7, 8]]);
    let translations = a.floats(&[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let info = json!({"index": texture, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0.5]}}});
    a.json["materials"] = json!([{"normalTexture": info, "alphaMode": "BLEND",
        "pbrMetallicRoughness": {"baseColorTexture": info, "metallicRoughnessTexture": info}, "extensions": {
        "KHR_materials_volume": {"thicknessFactor": 1}, "KHR_materials_transmission": {"transmissionFactor": 1}}}]);
    a.json["meshes"][0]["weights"] = json!([0.5]);
    a.json["skins"] = json!([{"joints": [1]}]);
    a.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]);
    a.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}});
    a.json["nodes"] = json!([
        {"mesh": 0, "skin": 0},
        {"children": [2, 3], "rotation": [0, 0, 0, 1]},
        {"camera": 0, "mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 1, 1, 1],
            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": translations}}}}
    ]);
    a
}

fn strict_options() -> ImportOptions {
    let mib = 1 << 20;
    let limits = Limits {
        file_bytes: mib,
        total_bytes: 4 * mib,
        json_objects: 10_000,
        image_side: 4096,
        image_bytes: 16 * mib,
        total_image_bytes: 32 * mib,
        geometry_bytes: 16 * mib,
    };
    ImportOptions::default().with_limits(limits)
}

#[test]
fn the_rich_asset_is_valid() {
    let imported = rich().load().expect("loads");
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    assert_eq!(imported.scene.instances.len(), 4);
}

#[test]
fn cycles_and_second_parents_are_cut() {
    let mut a = square();
    a.json["nodes"] = json!([
        {"mesh": 0, "children": [1]}, {"mesh": 0, "children": [2, 77]}, {"mesh": 0, "children": [0, 2]},
        {"mesh": 0, "children": [4]}, {"mesh": 0}, {"children": [4]}
    ]);
    a.json["scenes"] = json!([{"nodes": [0, 3, 5, 99]}]);
    let imported = a.load().expect("loads");
    assert_eq!(imported.scene.instances.len(), 5, "every node once");
    for word in ["its child 77", "own ancestor", "already a child", "its node 99"] {
        assert!(warns(&imported, &[word]), "{word}: {:?}", imported.warnings);
    }
}

#[test]
fn a_hierarchy_of_any_depth_is_walked() {
    let mut a = square();
    let n = 100_000;
    let chain = (0..n).map(|i| if i + 1 < n { json!({"children": [i + 1]}) } else { json!({"mesh": 0}) });
    a.json["nodes"] = chain.collect();
    assert_eq!(a.load().expect("loads").scene.instances.len(), 1);
}

#[test]
fn buffers_outside_the_folder_are_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    std::fs::create_dir(folder.path().join("scene")).expect("mkdir");
    std::fs::write(folder.path().join("secret.bin"), [0; 64]).expect("write");
    let path = folder.path().join("scene/a.gltf");
    let absolute = folder.path().join("secret.bin").display().to_string();
    for uri in ["../secret.bin", "%2e%2e/secret.bin", &absolute, "http://x/y.bin", "file:///etc/passwd"] {
        let mut a = square();
        a.json["buffers"] = json!([{"byteLength": 64, "uri": uri}]);
        std::fs::write(&path, a.gltf()).expect("write");
        let e = load_scene(&path, &ImportOptions::default()).expect_err("outside");
        assert!(e.place.contains("buffer 0") && e.problem.contains("only files inside"), "{uri}: {e}");
    }
}

#[test]
fn counts_are_checked_before_anything_is_allocated() {
    for count in [5, 1_000_000_000, u64::from(u32::MAX), u64::MAX / 2, u64::MAX] {
        let mut a = square();
        a.json["accessors"][0]["count"] = count.into();
        a.json["accessors"][1]["count"] = count.into();
        let e = a.load().expect_err("beyond the data");
        assert!(e.problem.contains("accessor"), "{count}: {e}");
        for i in 0..2 {
            a.json["accessors"][i].as_object_mut().expect("object").remove("bufferView");
        }
        if count > 1_000_000 {
            let e = a.load().expect_err("elements without data");
            assert!(e.problem.contains("no data") || e.problem.contains("more data"), "{count}: {e}");
        }
    }
}

#[test]
fn one_large_buffer_cannot_be_multiplied_without_end() {
    let mut a = Asset::new(json!({"nodes": [{"mesh": 0}]}));
    let position = a.floats(&[[0.0_f32, 1.0, 2.0]; 30_000]);
    let primitives = vec![json!({"attributes": {"POSITION": position}}); 2_000];
    a.json["meshes"] = json!([{"primitives": primitives}]);
    let e = load_bytes(&a.gltf(), "a.gltf", &strict_options()).expect_err("too much geometry");
    assert!(e.problem.contains("MiB allowed"), "{e}");
}

#[test]
fn extents_outside_their_container_are_refused() {
    let changes: [(&str, usize, Value); 9] = [
        ("bufferViews", 0, json!({"byteLength": 1_u64 << 40})),
        ("bufferViews", 0, json!({"byteOffset": u64::MAX})),
        ("bufferViews", 0, json!({"buffer": 3})),
        ("accessors", 0, json!({"bufferView": 17})),
        ("accessors", 1, json!({"byteOffset": u64::MAX})),
        ("accessors", 1, json!({"componentType": 5130})),
        ("accessors", 1, json!({"type": "VEC2"})),
        ("accessors", 0, json!({"componentType": 5126})),
        ("accessors", 1, json!({"count": 0})),
    ];
    for (list, index, change) in changes {
        let mut a = square();
        for (key, value) in change.as_object().expect("object") {
            a.json[list][index][key] = value.clone();
        }
        let e = a.load().expect_err("nothing is left");
        assert!(e.place.contains("primitive 0") && e.problem.contains("no mesh is left"), "{change}: {e}");
    }
}

#[test]
fn vertices_out_of_range_cost_their_triangles_only() {
    let mut a = square();
    a.data[2] = 200;
    let imported = a.load().expect("one triangle remains");
    assert_eq!(imported.scene.meshes[0].mesh.triangles.len(), 1);
    assert!(warns(&imported, &["1 of 2 triangles", "out of range"]));
}

#[test]
fn a_broken_primitive_does_not_cost_the_others() {
    let mut a = square();
    let bad = json!({"attributes": {"POSITION": 55}});
    a.json["meshes"][0]["primitives"].as_array_mut().expect("array").insert(0, bad);
    let imported = a.load().expect("the good one remains");
    assert_eq!(imported.scene.instances[0].meshes.len(), 1);
    assert!(warns(&imported, &["primitive 0", "left out"]));
}

#[test]
fn sparse_indices_out_of_range_are_refused() {
    let mut a = square();
    let indices = a.view(&[1, 200]);
    let values = a.view(&[0; 24]);
    let sparse = |count: u64| {
        json!({"count": count, "indices": {"bufferView": indices, "componentType": 5121},
            "values": {"bufferView": values}})
    };
    for (count, word) in [(2, "index 200"), (1 << 60, "are replaced"), (4, "exceed")] {
        a.json["accessors"][1]["sparse"] = sparse(count);
        let e = a.load().expect_err("sparse");
        assert!(e.problem.contains("sparse") && e.problem.contains(word), "{e}");
    }
}

#[test]
fn vertices_that_are_not_finite_cost_their_triangles() {
    let a = Asset::with_primitive(|a| {
        let mut positions = SQUARE;
        positions[0] = [f32::NAN, 0.0, f32::INFINITY];
        json!({"mode": 5, "attributes": {"POSITION": a.floats(&positions)}})
    });
    let imported = a.load().expect("one triangle remains");
    let mesh = &imported.scene.meshes[0].mesh;
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (1, 3));
    assert!(mesh.positions.iter().all(|p: &Vec3| p.is_finite()));
}

#[test]
fn versions_and_empty_files_are_reported() {
    let fail = |bytes: &[u8]| load_bytes(bytes, "a.gltf", &ImportOptions::default()).expect_err("refused").to_string();
    assert!(fail(b"").contains("empty"));
    assert!(fail(b"hello").contains("JSON, line 1"));
    assert!(fail(br#"{"asset": {"version": "1.0"}, "meshes": {}}"#).contains("version \"1.0\""));
    assert!(fail(br#"{"asset": {"version": "2.1", "minVersion": "2.1"}}"#).contains("2.1"));
    assert!(fail(&"[".repeat(1_000_000).into_bytes()).contains("JSON"));
    assert!(fail(br#"{"asset": {"version": "2.0"}, "nodes": [["not", "an", "object"]]}"#).contains("JSON, nodes[0]"));
    let nothing = load_bytes(br#"{"asset": {"version": "2.0"}}"#, "a.gltf", &ImportOptions::default());
    assert!(warns(&nothing.expect("an empty scene is a scene"), &["no mesh"]));
}

#[test]
fn a_truncated_glb_is_refused_at_every_length() {
    let glb = rich().glb();
    for length in (0..glb.len()).step_by(7) {
        let e = load_bytes(&glb[..length], "a.glb", &strict_options()).expect_err("cut short");
        assert!(!e.problem.is_empty() && !e.help.is_empty(), "{length} bytes: {e}");
    }
}

#[test]
fn objects_without_number_are_refused() {
    let bytes = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{}{{}}]}}"#, "{},".repeat(20_000));
    let e = load_bytes(bytes.as_bytes(), "a.gltf", &strict_options()).expect_err("too many");
    assert!(e.problem.contains("objects"), "{e}");
}

/// A material with a normal map on a mesh of triangles that meet in one point; `uv` gives the coordinates at the point.
fn fan(triangles: usize, degenerate: bool, uv: impl Fn(f32) -> [f32; 2]) -> Asset {
    let mut a = Asset::with_primitive(|a| {
        let angle = |i: usize| i as f32 / triangles as f32;
        let rim = |t: f32| if degenerate { [0.0, 0.0, 1.0] } else { [t.cos(), t.sin(), 0.0] };
        let corners = |i: usize| [[0.0, 0.0, 1.0], rim(angle(i)), rim(angle(i + 1))];
        let coordinates = |i: usize| [uv(angle(i)), [angle(i), 1.0], [angle(i + 1), 1.0]];
        let positions: Vec<_> = (0..triangles).flat_map(corners).collect();
        let coordinates: Vec<_> = (0..triangles).flat_map(coordinates).collect();
        let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
        json!({"material": 0, "attributes": {"POSITION": a.floats(&positions), "NORMAL": a.floats(&normals),
            "TEXCOORD_0": a.floats(&coordinates)}})
    });
    let texture = a.texture(1, &[[128, 128, 255, 255]]);
    a.json["materials"] = json!([{"normalTexture": {"index": texture}}]);
    a
}

#[test]
fn tangents_of_large_fans_neither_hang_nor_overflow_the_stack() {
    // A pole with a seam at every triangle, degenerate triangles, and one vertex of 200 000 triangles: a plain
    // implementation takes minutes for each, because it is quadratic, or recurses once per triangle. The limit on all tests
    // in `.ci/run` ends it.
    for (a, has_tangents) in [
        (fan(200_000, false, |t| [t, 0.0]), true),
        (fan(200_000, true, |t| [t, 0.0]), true),
        (fan(200_000, false, |_| [0.5, 0.0]), false),
        (fan(2_000, false, |_| [0.5, 0.0]), true),
    ] {
        let imported = a.load().expect("loads");
        assert_eq!(!imported.scene.meshes[0].mesh.tangents.is_empty(), has_tangents);
        assert_eq!(warns(&imported, &["too many triangles share"]), !has_tangents);
    }
}

fn png(image: image::DynamicImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("encode");
    bytes.into_inner()
}

/// A square with a material for each image.
fn with_images(images: &[Vec<u8>]) -> Asset {
    let mut a = square();
    let primitive = a.json["meshes"][0]["primitives"][0].clone();
    let parts: Vec<Value> = (0..images.len())
        .map(|i| {
            let mut primitive = primitive.clone();
            primitive["material"] = i.into();
            primitive
        })
        .collect();
    a.json["meshes"][0]["primitives"] = parts.into();
    let views: Vec<usize> = images.iter().map(|bytes| a.view(bytes)).collect();
    let list = |f: &dyn Fn(usize) -> Value| -> Value { (0..images.len()).map(f).collect() };
    a.json["images"] = list(&|i| json!({"bufferView": views[i], "name": format!("map {i}")}));
    a.json["textures"] = list(&|i| json!({"source": i}));
    a.json["materials"] = list(&|i| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}}));
    a
}

fn budget(total_image_bytes: u64) -> ImportOptions {
    ImportOptions::default().with_limits(Limits { total_image_bytes, ..Limits::default() })
}

/// Small files that decode to much: 3 x 512 x 512 x 3 B are 2.25 MiB.
#[test]
fn images_together_have_a_budget() {
    let grey = |v: u8| png(image::RgbImage::from_pixel(512, 512, image::Rgb([v; 3])).into());
    let a = with_images(&[grey(1), grey(2), grey(3)]);
    let e = load_bytes(&a.gltf(), "a.gltf", &budget(2 << 20)).expect_err("beyond the budget");
    for words in ["3 images", "2.2 MiB", "2.0 MiB are allowed", "512 x 512, 3 channels of 8 bits"] {
        assert!(e.problem.contains(words), "{words}: {e}");
    }
    assert!(e.place.contains("image 2 \"map 2\"") && e.help.contains("texture_memory"), "{e}");
    let imported = load_bytes(&a.gltf(), "a.gltf", &budget(9 << 18)).expect("exactly the sum");
    assert_eq!(imported.scene.images.len(), 3);
}

/// By buffer view, by equal bytes in another one, by file, by another spelling of it, in another encoding.
#[test]
fn images_of_the_same_content_are_decoded_once() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let bytes = png(image::GrayImage::from_pixel(8, 8, image::Luma([7])).into());
    std::fs::write(folder.path().join("a b.png"), &bytes).expect("write");
    let mut a = with_images(&vec![bytes; 4]);
    a.json["images"][1] = a.json["images"][0].clone();
    a.json["images"][2] = json!({"uri": "a b.png"});
    a.json["images"][3] = json!({"uri": "./a%20b.png"});
    a.json["materials"][3] = json!({"normalTexture": {"index": 3}});
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, a.gltf()).expect("write");
    let imported = load_scene(&path, &budget(64)).expect("one image of 64 B");
    assert_eq!(imported.scene.images.len(), 1);
    assert_eq!(imported.scene.images[0].texels.as_ref(), &dunkelfeld_scene::Texels::Gray8(vec![[7]; 64]));
}
