//! OBJ and MTL files written by hand, each odd in one way, and what must come out of them.

use dunkelfeld_geometry::{DVec3, Mesh, Vec2, Vec3};
use dunkelfeld_io::import::{ImportOptions, Imported};
use dunkelfeld_io::loader::Limits;
use dunkelfeld_io::obj::load_obj;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{AlphaMode, ColorEncoding, Material, Surface, Wrap};
use std::path::Path;

/// Loads `a.obj` from a folder with the given files.
fn load_with(files: &[(&str, &[u8])]) -> Result<Imported, dunkelfeld_io::InputError> {
    load_within(files, Limits::default())
}

fn load_within(files: &[(&str, &[u8])], limits: Limits) -> Result<Imported, dunkelfeld_io::InputError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("in the folder")).expect("writable");
        std::fs::write(path, bytes).expect("writable");
    }
    load_obj(&folder.path().join("a.obj"), &ImportOptions::default().with_limits(limits))
}

fn load(obj: &str) -> Imported {
    load_with(&[("a.obj", obj.as_bytes())]).unwrap_or_else(|e| panic!("{e}\n{obj}"))
}

fn load_material(mtl: &str) -> (Material, Imported) {
    let obj = format!("mtllib m.mtl\n{CUBE}\nusemtl m\n{CUBE_FACES}");
    let mtl = format!("newmtl m\n{mtl}");
    let red = png(&[[255, 0, 0, 255]], 1);
    let files: &[(&str, &[u8])] = &[("a.obj", obj.as_bytes()), ("m.mtl", mtl.as_bytes()), ("red.png", &red)];
    let imported = load_with(files).unwrap_or_else(|e| panic!("{e}\n{mtl}"));
    (imported.scene.materials[0].clone(), imported)
}

fn png(texels: &[[u8; 4]], width: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, texels.len() as u32 / width);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().expect("in memory");
    writer.write_image_data(texels.as_flattened()).expect("in memory");
    writer.finish().expect("in memory");
    bytes
}

fn warned(imported: &Imported, part: &str) -> bool {
    imported.warnings.iter().any(|w| w.to_string().contains(part))
}

fn the_mesh(imported: &Imported) -> &Mesh {
    assert_eq!(imported.scene.meshes.len(), 1);
    &imported.scene.meshes[0].mesh
}

fn area(mesh: &Mesh) -> f32 {
    (0..mesh.triangles.len()).map(|t| mesh.corners(t)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

const CUBE: &str =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1";
const CUBE_FACES: &str =
    "f 4/1 3/2 2/3 1/4\nf 5/1 6/2 7/3 8/4\nf 1/1 2/2 6/3 5/4\nf 2/1 3/2 7/3 6/4\nf 3/1 4/2 8/3 7/4\nf 4/1 1/2 5/3 8/4";

#[test]
fn every_spelling_of_a_triangle_gives_the_same_mesh() {
    let plain = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for bytes in [
        b"v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3".to_vec(),
        b"v\t0 0  0 # origin\n v 1. 0 0 1.0\nv 0 +1e0 .0\nf 1 2 3 # the only face".to_vec(),
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n".to_vec(),
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/ 2// 3\n".to_vec(),
        b"# \xe4\xf6\xfc in Latin-1\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3".to_vec(),
    ] {
        let imported = load_with(&[("a.obj", &bytes)]).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(the_mesh(&imported), the_mesh(&plain), "{}", String::from_utf8_lossy(&bytes));
    }
}

#[test]
fn faces_without_area_or_with_numbers_that_are_none_are_dropped_with_their_lines() {
    let imported = load(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 inf\nv 1e300 0 0\nf 1 2 3\nf 1 1 2\nf 1 2 4\nf 1 2 5\nl 1 2\np 1\nwhat 1\ncurv 0 1",
    );
    assert_eq!(the_mesh(&imported).triangles, [[0, 1, 2]]);
    for part in [
        "line 7: the face has no area",
        "lines 8, 9: the face uses an unusable vertex",
        "lines 10, 11: points and lines",
        "lines 12, 13: an unknown statement",
    ] {
        assert!(warned(&imported, part), "{part} missing in {:#?}", imported.warnings);
    }
}

#[test]
fn files_that_cannot_be_read_are_refused_with_the_reason() {
    for (obj, part) in [
        ("", "no face"),
        ("v 0 0 0\np 1", "no face; a.obj: line 2: points and lines"),
        ("f 1 2 3", "line 1: cannot be read as an OBJ statement: the face has an index"),
        ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3", "none of its faces can be used"),
        ("v 0 0 0\nv 1,5 0 0", "line 2: cannot be read as an OBJ statement: position"),
        ("\u{0}\u{0}\u{0}\u{1}binary", "binary"),
        ("v\u{0}t\u{0}", "UTF-16"),
    ] {
        let error = load_with(&[("a.obj", obj.as_bytes())]).expect_err(obj);
        assert!(error.to_string().contains(part), "{error}");
        assert!(!error.help.is_empty());
    }
    assert!(load_obj(Path::new("no/such.obj"), &ImportOptions::default()).is_err());
    let obj = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3";
    let error = load_with(&[("a.obj", obj), ("m.mtl", b"newmtl m\nKd 1")]).expect_err("one number");
    assert!(error.file.ends_with("m.mtl") && error.place == "line 2", "{error}");
}

/// A concave polygon of known area, in a plane that is parallel to no axis and far from the origin.
#[test]
fn concave_polygons_far_away_keep_their_area() {
    let outline = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 1.0], [0.0, 3.0]];
    let (u, v) = (Vec3::new(2.0, 1.0, 2.0) / 3.0, Vec3::new(-2.0, 2.0, 1.0) / 3.0);
    for shift in [0.0, 1e6] {
        let mut obj = String::new();
        for [x, y] in outline {
            let p = (x * u + y * v).as_dvec3() + shift;
            obj.push_str(&format!("v {} {} {}\n", p.x, p.y, p.z));
        }
        obj.push_str("f 1 2 3 4 5\n");
        let imported = load(&obj);
        let mesh = the_mesh(&imported);
        assert_eq!(mesh.triangles.len(), 3);
        assert!((area(mesh) - 8.0).abs() < 1e-5, "area {} at {shift}", area(mesh));
        let to_world = imported.scene.instances[0].to_world;
        let nearest =
            mesh.positions.iter().map(|p| to_world.transform_point3(p.as_dvec3()).distance(DVec3::splat(shift)));
        assert!(nearest.fold(f64::MAX, f64::min) < 1e-5, "no vertex at the outline's start, {shift}");
    }
}

#[test]
fn objects_groups_and_materials_become_instances_and_parts() {
    let imported = load(&format!(
        "{CUBE}\nf 1 2 3\no box\nusemtl red paint\nf 4 3 2 1\nusemtl blue\nf 5 6 7 8\ng lid  top\nf 1 2 6 5\no box\nusemtl red paint\nf 2 3 7 6\ng default\nf 3 4 8 7"
    ));
    let scene = &imported.scene;
    let names: Vec<(&str, usize)> = scene.instances.iter().map(|i| (i.name.as_str(), i.meshes.len())).collect();
    assert_eq!(names, [("object 0", 1), ("box", 2), ("box/lid top", 1)]);
    let triangles: Vec<usize> = scene.meshes.iter().map(|m| m.mesh.triangles.len()).collect();
    assert_eq!(triangles, [1, 6, 2, 2]);
    let materials: Vec<&str> = scene.meshes.iter().map(|m| scene.materials[m.material].name.as_str()).collect();
    assert_eq!(materials, ["default", "red paint", "blue", "blue"]);
    assert_eq!(scene.materials.len(), 3);
    assert!(warned(&imported, "\"red paint\": is not defined"));
}

#[test]
fn vertices_are_shared_where_all_attributes_agree() {
    let imported = load(&format!("{CUBE}\n{CUBE_FACES}"));
    let mesh = the_mesh(&imported);
    // Each of 8 corners is met by three faces; of the 24 pairs of vertex and coordinate some coincide.
    assert_eq!(mesh.triangles.len(), 12);
    assert!(mesh.positions.len() < 24 && mesh.positions.len() >= 8, "{}", mesh.positions.len());
    assert_eq!(mesh.uvs[0].len(), mesh.positions.len());
    assert!(mesh.normals.is_empty(), "no normals and no smoothing means flat");
    // v points down in our images.
    let corner = mesh
        .positions
        .iter()
        .zip(&mesh.uvs[0])
        .any(|(p, uv)| *p == Vec3::new(0.0, 1.0, 0.0) && *uv == Vec2::new(0.0, 1.0));
    assert!(corner, "{mesh:?}");
}

/// At a cube's corner three equal angles meet, for any cut of the quads: the mean is the diagonal.
#[test]
fn smoothing_groups_make_angle_weighted_normals() {
    let imported = load(&format!("{CUBE}\ns 1\n{CUBE_FACES}"));
    let mesh = the_mesh(&imported);
    for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
        let expected = (*p - Vec3::splat(0.5)).normalize();
        assert!((*n - expected).length() < 1e-6, "{n} at {p}, not {expected}");
    }
    // Two groups do not smooth into each other, and "off" is flat.
    let imported = load("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 0 1 1\ns 1\nf 1 2 3 4\ns off\nf 1 4 6 5\n");
    let mesh = the_mesh(&imported);
    assert_eq!(mesh.positions.len(), 8);
    for (t, expected) in [(0, Vec3::Z), (1, Vec3::Z), (2, Vec3::X), (3, Vec3::X)] {
        for i in mesh.triangles[t] {
            assert!((mesh.normals[i as usize] - expected).length() < 1e-6, "{:?}", mesh.normals);
        }
    }
}

#[test]
fn given_normals_are_unit_and_missing_or_null_ones_are_computed() {
    let imported = load(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 5\nvn 0 0 0\nvn nan 0 0\nf 1//1 2//2 3//1\nf 1//1 2//3 3//1\nf 1 2 3\n",
    );
    let mesh = the_mesh(&imported);
    assert!(mesh.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-6), "{:?}", mesh.normals);
}

#[test]
fn vertex_colours_may_be_partial_and_may_be_bytes() {
    let imported = load("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3");
    let colors = &the_mesh(&imported).colors;
    assert!((colors[0].y - 0.214_041).abs() < 1e-5, "sRGB 0.5 is linear 0.214: {colors:?}");
    assert_eq!((colors[1].to_array(), colors[2].to_array()), ([1.0; 4], [0.0, 0.0, 1.0, 1.0]));
    let imported = load("v 0 0 0 255 0 0\nv 1 0 0 0 255 0\nv 0 1 0 0 0 255\nf 1 2 3");
    assert_eq!(the_mesh(&imported).colors[0].to_array(), [1.0, 0.0, 0.0, 1.0]);
}

#[test]
fn libraries_are_found_by_all_their_spellings() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let library: &[u8] = b"newmtl m\nKd 1 0 0\n";
    for (statement, file) in [
        ("mtllib m.mtl", "m.mtl"),
        ("mtllib my materials.mtl", "my materials.mtl"),
        ("mtllib none.mtl m.mtl", "m.mtl"),
        ("mtllib .\\sub folder\\m.mtl", "sub folder/m.mtl"),
        ("mtllib m", "m"),
    ] {
        let obj = format!("{statement}\n{triangle}");
        let imported = load_with(&[("a.obj", obj.as_bytes()), (file, library)]).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(
            imported.scene.materials[0].base_color.factor,
            Rgb::new(1.0, 0.0, 0.0),
            "{statement}: {:?}",
            imported.warnings
        );
    }
    let imported = load(&format!("mtllib gone.mtl\n{triangle}"));
    assert!(warned(&imported, "line 1: the material library \"gone.mtl\" cannot be read"), "{:?}", imported.warnings);
    assert_eq!(imported.scene.materials[0].name, "m");
}

#[test]
fn classic_keys_map_as_documented() {
    let (m, _) = load_material("Kd 0.2 0.4 0.6\nKs 0.5 0.25 0.5\nNs 6\nillum 2\nNi 1.6");
    assert_eq!((m.base_color.factor, m.specular.strength.factor, m.ior), (Rgb::new(0.2, 0.4, 0.6), 0.5, 1.6));
    assert_eq!(m.specular.color.factor, Rgb::new(1.0, 0.5, 1.0));
    assert!((m.roughness.factor.powi(4) - 2.0 / 8.0).abs() < 1e-6);
    assert_eq!(load_material("Kd 1 1 1").0.specular.strength.factor, 0.0);
    assert_eq!(load_material("Ks 1 1 1\nillum 1").0.specular.strength.factor, 0.0);
    let (m, _) = load_material("Kd 0.1 0.1 0.1\nKs 0.9 0.8 0.3\nillum 3");
    assert_eq!((m.metallic.factor, m.base_color.factor), (1.0, Rgb::new(0.9, 0.8, 0.3)));
    let (m, _) = load_material("Ke 5 6 7");
    assert_eq!((m.emission.factor, m.double_sided), (Rgb::new(5.0, 6.0, 7.0), false));
    for (dissolve, alpha) in [("d 0.25", 0.25), ("Tr 0.25", 0.75), ("Tr 0.9\nd 0.5", 0.5)] {
        let (m, _) = load_material(dissolve);
        assert_eq!((m.alpha.factor, m.alpha_mode, m.transmission.factor), (alpha, AlphaMode::Blend, 0.0), "{dissolve}");
    }
    let (m, imported) = load_material("d 0");
    assert!(m.alpha.factor == 0.0 && warned(&imported, "covers nothing"));
    assert_eq!(load_material("Tf 1 1 1\nNi 1\nillum 4").0.transmission.factor, 0.0);
    assert_eq!(load_material("Ni 0").0.ior, 1.5);
}

#[test]
fn refracting_closed_meshes_are_solids_and_open_ones_sheets() {
    let (m, _) = load_material("Kd 0 0 0\nTf 0.5 1 1\nNi 1.49\nillum 7");
    assert!(matches!(m.surface, Surface::Solid(v) if v.attenuation_distance.is_infinite()));
    assert_eq!((m.transmission.factor, m.ior, m.roughness.factor, m.alpha.factor), (1.0, 1.49, 0.0, 1.0));
    // Two interfaces give the filter's colour.
    assert!(
        (m.base_color.factor.r.powi(2) - 0.5).abs() < 1e-6 && m.base_color.factor.g == 1.0,
        "{:?}",
        m.base_color.factor
    );

    let open = CUBE_FACES.lines().skip(1).collect::<Vec<_>>().join("\n");
    let mtl = b"newmtl g\nillum 6\nd 0.1\nNi 1.5\n";
    let obj = format!("mtllib m.mtl\n{CUBE}\nusemtl g\no closed\n{CUBE_FACES}\no open\n{open}");
    let imported = load_with(&[("a.obj", obj.as_bytes()), ("m.mtl", mtl)]).unwrap_or_else(|e| panic!("{e}"));
    let surface = |i: usize| imported.scene.materials[imported.scene.meshes[i].material].surface;
    assert!(matches!(surface(0), Surface::Solid(_)));
    assert_eq!(surface(1), Surface::Thin);
    assert!(imported.scene.materials.iter().all(|m| m.name == "g" && (m.transmission.factor - 0.9).abs() < 1e-6));
    assert!(warned(&imported, "not closed"));
}

#[test]
fn pbr_keys_map_as_documented() {
    let (m, _) = load_material(
        "Kd 0.5 0.5 0.5\nKs 0 0 0\nPr 0.2\nPm 0.3\nPs 0.4\nPc 0.5\nPcr 0.6\naniso 0.7\nanisor 0.25\nmap_Pr red.png",
    );
    assert_eq!(
        (m.roughness.factor, m.metallic.factor, m.clearcoat.strength.factor, m.clearcoat.roughness.factor),
        (0.2, 0.3, 0.5, 0.6)
    );
    assert_eq!(
        (m.sheen.color.factor, m.anisotropy.strength.factor, m.specular.strength.factor),
        (Rgb::splat(0.4), 0.7, 1.0)
    );
    assert!((m.anisotropy.rotation - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
    assert_eq!(m.roughness.texture.expect("map_Pr").channel, 0);
}

/// OBJ reads the texture at s * uv + o with v upwards; here v runs down. Both must reach the same texel.
#[test]
fn texture_options_survive_the_turn_of_the_v_axis() {
    let (m, imported) = load_material("Kd 0 0 0\nmap_Kd -s 2 3 -o 0.25 0.5 -clamp on red.png");
    let texture = m.base_color.texture.expect("map_Kd");
    assert_eq!((texture.encoding, texture.wrap), (ColorEncoding::Srgb, [Wrap::Clamp; 2]));
    assert_eq!(m.base_color.factor, Rgb::WHITE);
    assert!(warned(&imported, "Kd is black beside a map"));
    let (u, v) = (0.1, 0.2);
    let (want_u, want_v_up) = (2.0 * u + 0.25, 3.0 * v + 0.5);
    let got = texture.transform.offset + texture.transform.scale * Vec2::new(u, 1.0 - v);
    assert!((got - Vec2::new(want_u, 1.0 - want_v_up)).length() < 1e-6, "{got}");
    assert_eq!(imported.scene.images.len(), 1);
}

#[test]
fn maps_are_found_converted_and_shared() {
    let obj = format!("mtllib sub/m.mtl\n{CUBE}\nusemtl m\n{CUBE_FACES}");
    let mtl = b"newmtl m\nmap_Kd leaf.png\nmap_d leaf.png\nmap_Bump -bm 2 heights.png\nmap_Ns grey.png\nmap_Ke gone.png\nmap_Ks broken.png\n";
    let leaf = png(&[[10, 200, 30, 255], [10, 200, 30, 0]], 2);
    let heights = png(&[[0, 0, 0, 255], [128, 128, 128, 255], [255, 255, 255, 255], [128, 128, 128, 255]], 4);
    let grey = png(&[[128, 128, 128, 255]], 1);
    let imported = load_with(&[
        ("a.obj", obj.as_bytes()),
        ("sub/m.mtl", mtl),
        ("sub/leaf.png", &leaf),
        ("heights.png", &heights),
        ("sub/grey.png", &grey),
        ("sub/broken.png", b"\x89PNG\r\n\x1a\nnothing"),
    ])
    .unwrap_or_else(|e| panic!("{e}"));
    let m = &imported.scene.materials[0];
    let alpha = m.alpha.texture.expect("map_d");
    assert_eq!((alpha.image, alpha.channel), (m.base_color.texture.expect("map_Kd").image, 3));
    assert_eq!(m.alpha_mode, AlphaMode::Blend);
    assert_eq!(imported.scene.images.len(), 3);
    let normals = &imported.scene.images[m.normal_map.texture.expect("map_Bump").image.0 as usize];
    assert!(normals.name.contains("normals"));
    assert!(m.roughness.texture.is_some() && m.roughness.factor == 1.0);
    assert!(m.emission.texture.is_none() && m.specular.color.texture.is_none());
    assert!(warned(&imported, "\"gone.png\"") && warned(&imported, "\"broken.png\""), "{:?}", imported.warnings);
    let mesh = the_mesh(&imported);
    assert_eq!(mesh.tangents.len(), mesh.positions.len());
}

/// One file by two names, as colour and as numbers; a second file of the same bytes. Converted images count separately: of a
/// grey image of 8 bits normals of 3 x 16 bits, and roughness of 16 bits.
#[test]
fn files_that_hold_the_same_are_kept_once_and_count_against_the_budget() {
    let obj = format!("mtllib m.mtl\n{CUBE}\nusemtl m\n{CUBE_FACES}");
    let mtl = b"newmtl m\nmap_Kd a.png\nmap_Pm ./a.png\nmap_Ks b.png\nmap_Bump a.png\nmap_Ns a.png\n";
    let mut grey = Vec::new();
    let mut encoder = png::Encoder::new(&mut grey, 4, 4);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().and_then(|mut w| w.write_image_data(&[9; 16])).expect("in memory");
    let files: &[(&str, &[u8])] = &[("a.obj", obj.as_bytes()), ("m.mtl", mtl), ("a.png", &grey), ("b.png", &grey)];
    let within = |total_image_bytes| load_within(files, Limits { total_image_bytes, ..Limits::default() });
    let sum = 16 * (1 + 6 + 2);
    let imported = within(sum).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(imported.scene.images.iter().map(|i| i.texels.bytes() as u64).sum::<u64>(), sum);
    let m = &imported.scene.materials[0];
    assert_eq!(m.base_color.texture.expect("map_Kd").image, m.metallic.texture.expect("map_Pm").image);
    assert_eq!(imported.scene.images.len(), 3);
    let e = within(sum - 1).expect_err("beyond the budget");
    assert!(e.problem.contains("3 images of the scene need") && e.place.contains(".png"), "{e}");
}

#[test]
fn a_normal_map_under_the_name_of_a_bump_map_is_recognised() {
    let obj = format!("mtllib m.mtl\n{CUBE}\nusemtl m\n{CUBE_FACES}");
    let normals = png(&[[128, 128, 255, 255], [160, 128, 250, 255]], 2);
    let files: &[(&str, &[u8])] =
        &[("a.obj", obj.as_bytes()), ("m.mtl", b"newmtl m\nmap_Bump -bm 0.5 n.png"), ("n.png", &normals)];
    let imported = load_with(files).unwrap_or_else(|e| panic!("{e}"));
    let m = &imported.scene.materials[0];
    assert_eq!((imported.scene.images[0].name.as_str(), m.normal_map.scale), ("n.png", 0.5));
    assert!(warned(&imported, "holds normals"));
}

#[test]
fn files_outside_the_folder_are_not_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("secret.mtl"), "newmtl m\nKd 1 0 0\n").expect("writable");
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).expect("writable");
    let path = inner.join("a.obj");
    std::fs::write(&path, "mtllib ../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n").expect("writable");
    let imported = load_obj(&path, &ImportOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_ne!(imported.scene.materials[0].base_color.factor, Rgb::new(1.0, 0.0, 0.0));
    assert!(warned(&imported, "secret.mtl"));
}

/// Three vertices and a triangle are 48 bytes.
#[test]
fn meshes_beyond_the_limit_are_refused() {
    let obj: &[(&str, &[u8])] = &[("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")];
    let within = |geometry_bytes| load_within(obj, Limits { geometry_bytes, ..Limits::default() });
    assert_eq!(within(48).map(|i| i.scene.meshes.len()), Ok(1));
    let e = within(47).expect_err("beyond the limit");
    assert!(e.problem.contains("meshes need more than") && e.help.contains("import limits"), "{e}");
}

/// A line of a megabyte, and a polygon whose triangulation by ear clipping takes hours: the limit on corners refuses it.
#[test]
fn huge_lines_neither_hang_nor_hide_the_rest() {
    let mut obj = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf");
    for i in 0..200_000 {
        obj.push_str([" 1", " 2", " 3"][i % 3]);
    }
    obj.push_str("\n# ");
    obj.push_str(&"x".repeat(1 << 20));
    obj.push_str("\nusemtl ");
    obj.push_str(&"y ".repeat(1 << 19));
    obj.push_str("\nf 1 2 3\n");
    let imported = load(&obj);
    assert_eq!(imported.scene.meshes.len(), 2);
    assert!(warned(&imported, "line 5: the face has more than 20000 corners"));
}
