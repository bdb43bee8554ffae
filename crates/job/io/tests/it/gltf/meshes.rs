//! glTF import: nodes, instances, topology, accessors, poses, normals and tangents.

use super::support::{Asset, SQUARE, load_bytes, warns};
use dunkelfeld_geometry::{DVec3, Mesh, Vec2, Vec3, Vec4};
use dunkelfeld_io::import::{ImportOptions, Imported};
use serde_json::json;

fn only_mesh(imported: &Imported) -> &Mesh {
    assert_eq!(imported.scene.meshes.len(), 1, "warnings: {:?}", imported.warnings);
    &imported.scene.meshes[0].mesh
}

fn square() -> Asset {
    Asset::with_primitive(|a| json!({"mode": 5, "attributes": {"POSITION": a.floats(&SQUARE)}}))
}

#[test]
fn transforms_multiply_down_the_hierarchy_in_f64() {
    let mut a = square();
    a.json["nodes"] = json!([
        {"translation": [1e9, 0, 0], "children": [1]},
        {"name": "leaf", "mesh": 0, "scale": [-2, 3, 4], "rotation": [0, 0, 1, 1], "translation": [0.125, 0, 0]},
        {"name": "matrix", "mesh": 0, "matrix": [0, 2, 0, 0,  -3, 0, 0, 0,  0, 0, 4, 0,  5, 6, 7, 1]}
    ]);
    let imported = a.load().expect("loads");
    let instances = &imported.scene.instances;
    let at = |name: &str, p: DVec3| {
        let i = instances.iter().find(|i| i.name == name).expect("the instance");
        i.to_world.transform_point3(p)
    };
    // f32 would lose the eighth at 1e9; the rotation (not normalised in the file) turns x to y.
    let p = at("leaf", DVec3::new(1.0, 1.0, 1.0));
    assert!((p - DVec3::new(1e9 + 0.125 - 3.0, -2.0, 4.0)).length() < 1e-6, "{p}");
    assert_eq!(at("matrix", DVec3::new(1.0, 1.0, 1.0)), DVec3::new(2.0, 8.0, 11.0));
    assert_eq!(imported.scene.meshes.len(), 1, "the mesh is stored once");
    assert_eq!(instances[0].meshes, instances[1].meshes);
    assert!(instances[0].to_world.matrix3.determinant() < 0.0, "the mirror image stays one");
}

#[test]
fn the_scene_is_the_requested_one_else_the_default_else_the_first_else_every_root() {
    let names = |a: &Asset, scene: Option<usize>| -> Vec<String> {
        let options = ImportOptions::default().with_scene(scene);
        let imported = load_bytes(&a.gltf(), "a.gltf", &options).expect("loads");
        imported.scene.instances.into_iter().map(|i| i.name).collect()
    };
    let mut a = square();
    a.json["nodes"] = json!([{"name": "a", "mesh": 0}, {"name": "b", "mesh": 0, "children": [2]}, {"mesh": 0}]);
    assert_eq!(names(&a, None), ["a", "b", "mesh 0"]);
    a.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [1]}]);
    assert_eq!(names(&a, None), ["a"]);
    a.json["scene"] = json!(1);
    assert_eq!(names(&a, None), ["b", "mesh 0"]);
    assert_eq!(names(&a, Some(0)), ["a"]);
    let options = ImportOptions::default().with_scene(2);
    let e = load_bytes(&a.gltf(), "a.gltf", &options).expect_err("there is no scene 2");
    assert!(e.problem.contains("scene 2"), "{e}");
}

#[test]
fn nodes_flattened_to_nothing_are_left_out_and_hidden_ones_too() {
    let mut a = square();
    a.json["nodes"] = json!([
        {"name": "flat", "mesh": 0, "scale": [1, 0, 1]},
        {"name": "hidden", "extensions": {"KHR_node_visibility": {"visible": false}}, "children": [2]},
        {"name": "below", "mesh": 0},
        {"name": "seen", "mesh": 0}
    ]);
    let imported = a.load().expect("loads");
    let names: Vec<_> = imported.scene.instances.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names, ["seen"]);
    assert!(warns(&imported, &["flat", "scale 0"]));
}

#[test]
fn strips_and_fans_keep_their_winding() {
    for (mode, expected) in [(4, vec![[0, 1, 2]]), (5, vec![[0, 1, 2], [1, 3, 2]]), (6, vec![[1, 2, 0], [2, 3, 0]])] {
        for indexed in [false, true] {
            let a = Asset::with_primitive(|a| {
                let mut p = json!({"mode": mode, "attributes": {"POSITION": a.floats(&SQUARE)}});
                if indexed {
                    p["indices"] = a.indices(&[0, 1, 2, 3]).into();
                }
                p
            });
            let imported = a.load().expect("loads");
            assert_eq!(only_mesh(&imported).triangles, expected, "mode {mode}, indexed: {indexed}");
        }
    }
}

#[test]
fn points_and_lines_are_left_out_with_a_warning() {
    for mode in 0..4 {
        let a = Asset::with_primitive(|a| json!({"mode": mode, "attributes": {"POSITION": a.floats(&SQUARE)}}));
        let imported = a.load().expect("loads");
        assert!(imported.scene.meshes.is_empty() && warns(&imported, &["no surface"]), "mode {mode}");
    }
}

#[test]
fn integers_are_read_as_they_are_or_normalised() {
    let a = Asset::with_primitive(|a| {
        let position: Vec<u8> = [[0_i16, 0, 0, 9], [32767, 0, 0, 9], [0, -32768, 0, 9]]
            .iter()
            .flatten()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let position = a.raw(&position, 5122, "VEC3", 3, true);
        // Every vector is padded to 8 bytes: a stride.
        a.json["bufferViews"][0]["byteStride"] = json!(8);
        let uv = a.raw(&[0, 1, 0, 0, 2, 3, 0, 0, 255, 4, 0, 0], 5121, "VEC2", 3, false);
        a.json["bufferViews"][1]["byteStride"] = json!(4);
        let colors = a.raw(&[255, 0, 51, 0, 0, 0, 0, 0, 255, 255, 255, 0], 5121, "VEC3", 3, true);
        a.json["bufferViews"][2]["byteStride"] = json!(4);
        json!({"attributes": {"POSITION": position, "TEXCOORD_1": uv, "COLOR_0": colors}})
    });
    let imported = a.load().expect("loads");
    let mesh = only_mesh(&imported);
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, -Vec3::Y]);
    assert_eq!(mesh.uvs[1], [Vec2::new(0.0, 1.0), Vec2::new(2.0, 3.0), Vec2::new(255.0, 4.0)]);
    assert!(mesh.uvs[0].is_empty());
    assert_eq!(mesh.colors[0], Vec4::new(1.0, 0.0, 0.2, 1.0), "three channels are opaque");
}

#[test]
fn sparse_accessors_replace_elements_with_and_without_a_base() {
    for with_base in [true, false] {
        let a = Asset::with_primitive(|a| {
            let position = a.floats(&SQUARE);
            let indices = a.view(&[1, 3]);
            let values: Vec<u8> = [5.0_f32, 6.0, 7.0, 8.0, 9.0, 10.0].iter().flat_map(|v| v.to_le_bytes()).collect();
            let values = a.view(&values);
            let accessor = &mut a.json["accessors"][position];
            accessor["sparse"] = json!({"count": 2, "indices": {"bufferView": indices, "componentType": 5121},
                "values": {"bufferView": values}});
            if !with_base {
                accessor.as_object_mut().expect("object").remove("bufferView");
            }
            json!({"mode": 5, "attributes": {"POSITION": position}})
        });
        let imported = a.load().expect("loads");
        let base = if with_base { Vec3::Y } else { Vec3::ZERO };
        let expected = [Vec3::ZERO, Vec3::new(5.0, 6.0, 7.0), base, Vec3::new(8.0, 9.0, 10.0)];
        assert_eq!(only_mesh(&imported).positions, expected);
    }
}

#[test]
fn vertices_that_no_triangle_uses_are_dropped() {
    let a = Asset::with_primitive(|a| {
        let position = a.floats(&SQUARE);
        let uv = a.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        json!({"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "indices": a.indices(&[3, 1, 2])})
    });
    let imported = a.load().expect("loads");
    let mesh = only_mesh(&imported);
    assert_eq!(mesh.positions, [Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)]);
    assert_eq!(mesh.uvs[0], [Vec2::X, Vec2::Y, Vec2::ONE]);
    assert_eq!(mesh.triangles, [[2, 0, 1]]);
}

#[test]
fn morph_targets_have_the_mesh_weights_unless_the_node_has_its_own() {
    let mut a = Asset::with_primitive(|a| {
        let normals = a.floats(&[[0.0, 0.0, 1.0]; 4]);
        let up = a.floats(&[[0.0, 0.0, 2.0]; 4]);
        let tilt = a.floats(&[[1.0, 0.0, 0.0]; 4]);
        json!({"mode": 5, "attributes": {"POSITION": a.floats(&SQUARE), "NORMAL": normals},
            "targets": [{"POSITION": up}, {"NORMAL": tilt}]})
    });
    a.json["meshes"][0]["weights"] = json!([0.5, 0.0]);
    a.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "weights": [0.25, 1.0]}, {"mesh": 0}]);
    let imported = a.load().expect("loads");
    let scene = &imported.scene;
    assert_eq!(scene.meshes.len(), 2, "one for each set of weights");
    let mesh = |instance: usize| &scene.meshes[scene.instances[instance].meshes[0]].mesh;
    assert_eq!(mesh(0).positions[3], Vec3::new(1.0, 1.0, 1.0));
    assert_eq!(mesh(0).normals[3], Vec3::Z);
    assert_eq!(mesh(1).positions[3], Vec3::new(1.0, 1.0, 0.5));
    assert!((mesh(1).normals[3] - Vec3::new(0.5, 0.0, 0.5).normalize()).length() < 1e-6);
    assert_eq!(scene.instances[0].meshes, scene.instances[2].meshes);
}

#[test]
fn skins_are_baked_where_their_joints_are() {
    let mut a = Asset::with_primitive(|a| {
        let joints = a.raw(&[0, 1, 0, 0].repeat(4), 5121, "VEC4", 4, false);
        // The first two vertices hang on joint 0, the third on joint 1, the last on both; sums are not 1.
        let weights =
            a.floats(&[[2.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0]]);
        let normals = a.floats(&[[0.0, 0.0, 1.0]; 4]);
        json!({"mode": 5, "attributes":
            {"POSITION": a.floats(&SQUARE), "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights}})
    });
    let mut bind = [0.0_f32; 16];
    [0, 5, 10, 15].iter().for_each(|i| bind[*i] = 1.0);
    let mut second = bind;
    second[13] = -1.0;
    a.floats(&[bind, second]);
    let binds = a.json["accessors"].as_array().expect("array").len() - 1;
    a.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": binds}]);
    // Joint 1 turns by 90 degrees about y: z to x. The node's own transform must not count.
    let half = 0.5_f64.sqrt();
    a.json["nodes"] = json!([
        {"name": "skinned", "mesh": 0, "skin": 0, "translation": [9, 9, 9]},
        {"translation": [1e8, 0, 0], "children": [2]},
        {"translation": [0, 1, 0], "rotation": [0, half, 0, half]}
    ]);
    let imported = a.load().expect("loads");
    let mesh = only_mesh(&imported);
    assert_eq!(imported.scene.instances[0].to_world.translation, DVec3::new(1e8, 0.0, 0.0));
    assert_eq!(mesh.positions[1], Vec3::X, "no digit is lost at 1e8");
    assert!((mesh.positions[2] - Vec3::Y).length() < 1e-6);
    // Half of (1, 1, 0) and half of its turned image (0, 1, -1).
    assert!((mesh.positions[3] - Vec3::new(0.5, 1.0, -0.5)).length() < 1e-6, "{}", mesh.positions[3]);
    assert!((mesh.normals[2] - Vec3::X).length() < 1e-6, "{}", mesh.normals[2]);
}

#[test]
fn gpu_instancing_places_the_mesh_once_per_element() {
    let mut a = square();
    let t = a.floats(&[[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]);
    let s = a.floats(&[[2.0, 2.0, 2.0], [1.0, 1.0, 1.0]]);
    a.json["nodes"][0]["translation"] = json!([0, 0, 5]);
    let attributes = json!({"TRANSLATION": t, "SCALE": s});
    a.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    let imported = a.load().expect("loads");
    let corner = DVec3::new(1.0, 1.0, 0.0);
    let corners: Vec<_> = imported.scene.instances.iter().map(|i| i.to_world.transform_point3(corner)).collect();
    assert_eq!(corners, [DVec3::new(3.0, 2.0, 5.0), DVec3::new(1.0, 3.0, 5.0)]);
    assert_eq!(imported.scene.meshes.len(), 1);
}

#[test]
fn unusable_normals_are_repaired_from_the_faces() {
    let a = Asset::with_primitive(|a| {
        let normals = a.floats(&[[0.0, 3.0, 0.0], [f32::NAN, 0.0, 0.0], [0.0; 3], [0.0, 0.0, 0.5]]);
        json!({"mode": 5, "attributes": {"POSITION": a.floats(&SQUARE), "NORMAL": normals}})
    });
    let imported = a.load().expect("loads");
    assert_eq!(only_mesh(&imported).normals, [Vec3::Y, Vec3::Z, Vec3::Z, Vec3::Z]);
    assert!(warns(&imported, &["2 normals"]));
}

#[test]
fn without_normals_the_mesh_is_flat() {
    assert!(only_mesh(&square().load().expect("loads")).normals.is_empty());
}

/// A square whose image stands upright (v down the image), under a material with a normal map.
fn mapped_square(normals: bool, mirrored: bool) -> Asset {
    let mut a = Asset::with_primitive(|a| {
        let u = |u: f32| if mirrored { 1.0 - u } else { u };
        let uv = a.floats(&[[u(0.0), 1.0], [u(1.0), 1.0], [u(0.0), 0.0], [u(1.0), 0.0]]);
        let mut p = json!({"mode": 5, "material": 0, "attributes": {"POSITION": a.floats(&SQUARE), "TEXCOORD_0": uv}});
        if normals {
            p["attributes"]["NORMAL"] = a.floats(&[[0.0, 0.0, 1.0]; 4]).into();
        }
        p
    });
    let texture = a.texture(1, &[[128, 128, 255, 255]]);
    a.json["materials"] = json!([{"normalTexture": {"index": texture, "scale": 0.5}}]);
    a
}

#[test]
fn tangents_follow_u_and_the_bitangent_points_up_the_image() {
    for (mirrored, expected) in [(false, Vec4::new(1.0, 0.0, 0.0, 1.0)), (true, Vec4::new(-1.0, 0.0, 0.0, -1.0))] {
        let imported = mapped_square(true, mirrored).load().expect("loads");
        let mesh = only_mesh(&imported);
        assert_eq!(mesh.tangents, [expected; 4], "mirrored: {mirrored}");
        assert_eq!(mesh.positions.len(), 4, "corners that agree share their vertex");
        assert_eq!(imported.scene.materials[0].normal_map.scale, 0.5);
    }
}

#[test]
fn flat_meshes_get_tangents_at_every_corner() {
    let imported = mapped_square(false, false).load().expect("loads");
    let mesh = only_mesh(&imported);
    assert!(mesh.normals.is_empty());
    assert_eq!((mesh.positions.len(), mesh.uvs[0].len(), mesh.tangents.len()), (6, 6, 6));
    let corners: Vec<_> = (0..2).map(|t| mesh.corners(t)).collect();
    assert_eq!(corners, [[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y]]);
}

#[test]
fn tangents_turn_with_the_texture_transform() {
    let mut a = mapped_square(true, false);
    // u' = v, v' = -u: u' grows down the image, which is -y.
    let transform = json!({"KHR_texture_transform": {"rotation": std::f64::consts::FRAC_PI_2}});
    a.json["materials"][0]["normalTexture"]["extensions"] = transform;
    let imported = a.load().expect("loads");
    let tangent = only_mesh(&imported).tangents[0];
    assert!((tangent - Vec4::new(0.0, -1.0, 0.0, 1.0)).length() < 1e-6, "{tangent}");
}

#[test]
fn given_tangents_are_kept_and_broken_ones_replaced() {
    for (given, expected) in
        [([0.0, 2.0, 0.0, -1.0], Vec4::new(0.0, 1.0, 0.0, -1.0)), ([0.0; 4], Vec4::new(1.0, 0.0, 0.0, 1.0))]
    {
        let mut a = mapped_square(true, false);
        let tangents = a.floats(&[given; 4]);
        a.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = tangents.into();
        let imported = a.load().expect("loads");
        assert_eq!(only_mesh(&imported).tangents[0], expected);
        assert_eq!(imported.warnings.is_empty(), given != [0.0; 4]);
    }
}

#[test]
fn attributes_of_the_wrong_length_are_left_out() {
    let a = Asset::with_primitive(|a| {
        let normals = a.floats(&[[0.0, 0.0, 1.0]; 3]);
        json!({"mode": 5, "attributes": {"POSITION": a.floats(&SQUARE), "NORMAL": normals}})
    });
    let imported = a.load().expect("loads");
    assert!(only_mesh(&imported).normals.is_empty());
    assert!(warns(&imported, &["NORMAL", "3 elements for 4"]));
}

/// Some programs on Windows write a byte order mark before JSON.
#[test]
fn a_byte_order_mark_before_the_json_is_left_out_in_gltf_and_glb() {
    const MARK: &[u8] = b"\xef\xbb\xbf ";
    let asset = square();
    let plain = asset.load().expect("readable").scene;
    let gltf = [MARK, &asset.gltf()].concat();
    let mut glb = asset.glb();
    glb.splice(20..20, MARK.iter().copied());
    for at in [8, 12] {
        let length = u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes")) + MARK.len() as u32;
        glb[at..at + 4].copy_from_slice(&length.to_le_bytes());
    }
    assert!(plain.instances.len() == 1 && glb[20..].starts_with(MARK));
    for (bytes, name) in [(gltf, "asset.gltf"), (glb, "asset.glb")] {
        let imported = load_bytes(&bytes, name, &ImportOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(imported.scene.instances.len(), plain.instances.len(), "{name}");
        assert!(imported.warnings.is_empty(), "{name}: {:?}", imported.warnings);
    }
}

#[test]
fn glb_and_gltf_are_distinguished_by_their_bytes() {
    let a = square();
    for name in ["a.glb", "a.gltf"] {
        let from_glb = load_bytes(&a.glb(), name, &ImportOptions::default()).expect("a GLB");
        let from_json = load_bytes(&a.gltf(), name, &ImportOptions::default()).expect("JSON");
        assert_eq!(only_mesh(&from_glb), only_mesh(&from_json));
    }
}
