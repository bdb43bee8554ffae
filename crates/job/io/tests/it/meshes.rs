//! STL and PLY files, units and axes, formats that are not read, and jobs with several scene files.

use dunkelfeld_geometry::{DVec3, Mesh, Vec3};
use dunkelfeld_io::InputError;
use dunkelfeld_io::import::{ImportOptions, Imported, UpAxis, load_scene};
use dunkelfeld_io::job::Job;
use dunkelfeld_io::loader::Limits;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::cuboid;
use std::path::Path;

const ASCII: &str = "solid part\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 10 0 0\n   vertex 0 1E1 0\n  \
                     endloop\n endfacet\nendsolid part\n";

fn load_with(name: &str, bytes: &[u8], options: ImportOptions) -> Result<Imported, InputError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("writable");
    load_scene(&path, &options)
}

fn load(name: &str, bytes: &[u8]) -> Imported {
    load_with(name, bytes, ImportOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn refused(name: &str, bytes: &[u8]) -> InputError {
    load_with(name, bytes, ImportOptions::default()).map(|i| i.scene.meshes.len()).expect_err(name)
}

fn binary_stl(header: &[u8], mesh: &Mesh) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for t in 0..mesh.triangles.len() {
        let values = mesh.corners(t).into_iter().flat_map(|p| p.to_array());
        [0.0; 3].into_iter().chain(values).for_each(|v: f32| bytes.extend(v.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

/// World positions of all corners.
fn corners(imported: &Imported) -> Vec<DVec3> {
    let scene = &imported.scene;
    let of = |i: &dunkelfeld_scene::Instance| {
        let meshes = i.meshes.iter().flat_map(|m| {
            let mesh = &scene.meshes[*m].mesh;
            mesh.triangles.iter().flatten().map(|v| mesh.positions[*v as usize])
        });
        meshes.map(|p| (i.to_world.transform_point3(p.as_dvec3()) * 1e9).round() / 1e9).collect::<Vec<_>>()
    };
    scene.instances.iter().flat_map(of).collect()
}

#[test]
fn stl_is_read_in_both_forms_in_millimetres_with_z_up() {
    let text = load("part.stl", ASCII.as_bytes());
    assert_eq!(corners(&text), [DVec3::ZERO, DVec3::X * 0.01, DVec3::NEG_Z * 0.01], "+y of the file is -z");
    let scene = &text.scene;
    assert_eq!((scene.instances[0].name.as_str(), scene.materials[0].name.as_str()), ("part", "part"));
    let metres = ImportOptions::default().with_unit(1.0).with_up(UpAxis::Y).with_scale(2.0);
    let scaled = load_with("part.stl", ASCII.as_bytes(), metres).expect("a part");
    assert_eq!(corners(&scaled)[2], DVec3::Y * 20.0);

    let cube = cuboid(Vec3::ZERO, Vec3::splat(10.0));
    // The header of some programs looks like a text.
    for header in [&b"made by hand"[..], b"solid of SolidWorks"] {
        let imported = load("CUBE.STL", &binary_stl(header, &cube));
        let mesh = &imported.scene.meshes[0].mesh;
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12), "corners are shared");
        assert!(imported.warnings.is_empty());
        assert!(imported.scene.build().expect("a scene").1.findings.iter().all(|f| f.place == "scene"));
    }
}

#[test]
fn texts_of_careless_programs_are_read() {
    let odd = "SOLID\r\nFACET NORMAL nan nan nan\r\nOUTER LOOP\r\nVERTEX 0 0 0\r\nVERTEX 1 0 0\r\nVERTEX 0 1 0\r\nENDLOOP\r\n\
               ENDFACET\r\n";
    assert_eq!(corners(&load("a.stl", odd.as_bytes())).len(), 3, "without a name, in capitals, without an end");
    let two = ASCII.to_owned() + &ASCII.replace("part", "Lid 2").replace("1E1", "5");
    let imported = load("a.stl", two.as_bytes());
    let names: Vec<&str> = imported.scene.instances.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names, ["part", "Lid 2"]);
}

#[test]
fn encodings_of_texts_are_read_or_refused_with_help() {
    for (name, text) in [("a.stl", ASCII), ("a.ply", PLY)] {
        let plain = corners(&load(name, text.as_bytes()));
        assert_eq!(corners(&load(name, format!("\u{feff}{text}").as_bytes())), plain, "a byte order mark");
        let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        for bytes in [&wide[..], &[&[0xff, 0xfe], &wide[..]].concat()] {
            let error = refused(name, bytes);
            assert!(error.problem.contains("UTF-16") && error.help.contains("UTF-8"), "{error}");
        }
    }
}

#[test]
fn a_look_that_is_not_read_is_reported() {
    let with = |vertex: &str, face: &str, comment: &str| {
        let properties =
            |names: &str| names.split_whitespace().map(|n| format!("property float {n}\n")).collect::<String>();
        let values = |names: &str| " 0.5".repeat(names.split_whitespace().count());
        let (vertex, vertex_values, face, face_values) =
            (properties(vertex), values(vertex), properties(face), values(face));
        let points: String = ["0 0 0", "1 0 0", "0 1 0"].map(|p| format!("{p}{vertex_values}\n")).concat();
        let text = format!(
            "ply\nformat ascii 1.0\n{comment}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n{vertex}\
             element face 1\nproperty list uchar int vertex_index\n{face}end_header\n{points}3 0 1 2{face_values}\n"
        );
        let imported = load("a.ply", text.as_bytes());
        let texts = imported.warnings.iter().map(|w| w.message.clone()).collect::<Vec<_>>().join("|");
        (texts, imported.scene.meshes[0].mesh.colors.len())
    };
    for (vertex, face, comment, said) in [
        ("s t", "", "comment TextureFile a b.png\n", "its texture (`TextureFile a b.png`) is not read"),
        ("texture_u texture_v", "", "", "its texture is not read"),
        ("", "texnumber", "", "its texture is not read"),
        ("", "red green blue", "", "the colours of its faces are not read"),
        ("u v", "r g b", "", "its texture is not read"),
    ] {
        assert!(with(vertex, face, comment).0.contains(said), "{vertex}, {face}: {}", with(vertex, face, comment).0);
    }
    for colors in ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"] {
        assert_eq!(with(colors, "", "comment made by hand\n"), (String::new(), 3), "{colors}");
    }
}

#[test]
fn damaged_stl_is_refused() {
    let cube = binary_stl(b"x", &cuboid(Vec3::ZERO, Vec3::ONE));
    for (bytes, part) in [
        (&b""[..], "too short"),
        (b"PK\x03\x04 this is a zip", "too short"),
        (&cube[..300], "announces 12 triangles, but it ends after 4"),
        (b"solid a\nendsolid a\n", "no triangles"),
        (b"solid a\nfacet normal 0 0 0\nouter loop\nvertex 1 2\n", "cannot be read"),
        (b"solid a\nfacet normal 0 0 0\nouter loop\nvertex 1 2 inf\n", "cannot be read"),
    ] {
        let error = refused("a.stl", bytes);
        assert!(error.problem.contains(part) && !error.help.is_empty(), "{error}");
    }
    let longer = [&cube[..], &[0; 7]].concat();
    assert!(load("a.stl", &longer).warnings[0].message.contains("7 B after"));
    let limits = Limits { geometry_bytes: 500, ..Limits::default() };
    for bytes in [&cube[..], ASCII.repeat(12).as_bytes()] {
        let error = load_with("a.stl", bytes, ImportOptions::default().with_limits(limits)).expect_err("12 triangles");
        assert!(error.problem.contains("12 triangles"), "{error}");
    }
}

const PLY: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 5\nproperty float x\nproperty float y\n\
                   property double z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n\
                   property uchar green\nproperty uchar blue\nelement edge 1\nproperty int v1\nelement face 2\n\
                   property list uchar int vertex_indices\nend_header\n\
                   0 0 0 0 0 2 255 0 0\n10 0 0 0 0 1 0 255 0\n10 10 0 0 0 1 0 0 255\n0 10 0 0 0 1 255 255 255\n\
                   5 5 9 0 0 1 0 0 0\n7\n4 0 1 2 3\n3 0 1 4\n";

/// The same file in binary form.
fn binary_ply(little: bool) -> Vec<u8> {
    let (head, body) = PLY.split_once("end_header\n").expect("a header");
    let kind = if little { "binary_little_endian" } else { "binary_big_endian" };
    let mut bytes = format!("{}end_header\n", head.replace("ascii", kind)).into_bytes();
    for (row, line) in body.lines().enumerate() {
        for (column, word) in line.split(' ').enumerate() {
            let number: f64 = word.parse().expect("a number");
            let mut push = |be: &[u8]| {
                let mut be = be.to_vec();
                if little {
                    be.reverse();
                }
                bytes.extend(be);
            };
            match (row, column) {
                (0..=4, 2) => push(&number.to_be_bytes()),
                (0..=4, 0..=5) => push(&(number as f32).to_be_bytes()),
                (0..=4, _) | (6.., 0) => push(&[number as u8]),
                _ => push(&(number as i32).to_be_bytes()),
            }
        }
    }
    bytes
}

#[test]
fn ply_is_read_in_all_forms_with_normals_and_colours() {
    for bytes in [PLY.as_bytes().to_vec(), binary_ply(true), binary_ply(false)] {
        let imported = load("scan.ply", &bytes);
        let mesh = &imported.scene.meshes[0].mesh;
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (5, 3), "a quadrilateral and a triangle");
        assert_eq!(mesh.normals, [Vec3::Z; 5]);
        assert_eq!(mesh.colors[1].to_array(), [0.0, 1.0, 0.0, 1.0]);
        assert_eq!(imported.scene.materials[0].base_color.factor, Rgb::WHITE);
        assert!(corners(&imported).contains(&DVec3::new(0.005, 0.009, -0.005)), "millimetres, z up");
    }
}

#[test]
fn ply_far_from_its_origin_keeps_its_shape() {
    let (head, body) = PLY.split_once("end_header\n").expect("a header");
    let moved = body.lines().enumerate().map(|(row, line)| match line.splitn(4, ' ').collect::<Vec<_>>()[..] {
        [x, y, _, rest] if row < 5 => format!("{x} {y} {} {rest}\n", if row == 4 { "4000000.25" } else { "4000000" }),
        _ => format!("{line}\n"),
    });
    let far = format!("{head}end_header\n{}", moved.collect::<String>());
    let imported = load_with("a.ply", far.as_bytes(), ImportOptions::default().with_unit(1.0)).expect("a mesh");
    let highest = corners(&imported).into_iter().map(|p| p.y).fold(0.0, f64::max);
    assert_eq!(highest, 4_000_000.25, "f32 has steps of 0.25 m there, and the mesh lies around its own origin");
    assert!(imported.scene.meshes[0].mesh.positions.iter().all(|p| p.abs().max_element() < 100.0));
}

#[test]
fn strips_of_triangles_wind_alike() {
    let strips = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n\
                  9 0 1 2 3 -1 1 3 2 99\n";
    let imported = load("a.ply", strips.as_bytes());
    let mesh = &imported.scene.meshes[0].mesh;
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [1, 3, 2]]);
    assert!(imported.warnings[0].message.contains("1 of them cannot be used"), "{:?}", imported.warnings);
}

#[test]
fn damaged_ply_is_refused() {
    let no_faces = PLY.replace("element face 2", "element face 0");
    let wrong = PLY.replace("4 0 1 2 3", "4 0 1 2 77").replace("3 0 1 4", "3 0 1 -9");
    for (text, part) in [
        ("", "cannot be read as PLY"),
        ("ply\n", "cannot be read as PLY"),
        (&PLY.replace("element vertex 5", "element vertex 99999999999"), "more than the file can hold"),
        (&PLY.replace("property int v1\n", ""), "more than the file can hold"),
        (&PLY.replace("float x", "float a"), "no coordinates"),
        (&PLY.replace("10 10 0", "10 ten 0"), "cannot be read as PLY"),
        (PLY.split("7\n").next().expect("the start"), "cannot be read as PLY"),
        (&no_faces, "5 points but no face"),
        (&wrong, "2 faces, of which none can be used"),
    ] {
        let error = refused("a.ply", text.as_bytes());
        assert!(error.problem.contains(part) && !error.help.is_empty(), "{error}");
    }
    let limits = Limits { geometry_bytes: 300, ..Limits::default() };
    let error =
        load_with("a.ply", PLY.as_bytes(), ImportOptions::default().with_limits(limits)).expect_err("too large");
    assert!(error.problem.contains("may need more"), "{error}");
    let mut binary = binary_ply(true);
    binary.truncate(binary.len() - 3);
    assert!(refused("a.ply", &binary).problem.contains("cannot be read as PLY"));
}

#[test]
fn other_formats_are_refused_with_the_way_to_gltf() {
    for (name, part) in [
        ("a.STEP", "FreeCAD"),
        ("a.stp", "FreeCAD"),
        ("a.sldprt", "CAD program"),
        ("a.blend", "open it in Blender"),
        ("a.fbx", "import it in Blender"),
        ("a.usdz", "import it in Blender"),
        ("a.xyz", "make a mesh of the points"),
        ("a.dae", "open it in MeshLab or FreeCAD"),
        ("a.3mf", "open it in MeshLab or FreeCAD"),
        ("a.txt", ".ply"),
        ("a", ".glb"),
    ] {
        let error = load_scene(Path::new(name), &ImportOptions::default()).expect_err(name);
        let way = ["glTF", "PLY"].iter().any(|format| error.help.contains(format));
        assert!(error.is_of_file() && error.help.contains(part) && way, "{error}");
    }
}

fn job_in(files: &[(&str, &[u8])], text: &str) -> Result<(Job, Imported), InputError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("writable");
    }
    let job = Job::from_text(folder.path().join("a.toml"), text)?;
    let mut imported = job.load_scene()?;
    job.apply_overrides(&mut imported.scene)?;
    Ok((job, imported))
}

#[test]
fn several_files_make_one_scene() {
    let obj = "o lid\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let files: &[(&str, &[u8])] = &[("a.obj", obj.as_bytes()), ("part.stl", ASCII.as_bytes())];
    let text = "scene = [\"a.obj\", { file = \"part.stl\", unit = \"cm\", up = \"y\", scale = 2, prefix = \"new/\" }]\n\
                [import]\nunit = \"m\"\nscale = 3\n[[object]]\nname = \"new/part\"\ntranslate = [1, 0, 0]";
    let (job, imported) = job_in(files, text).expect("a scene");
    let names: Vec<&str> = imported.scene.instances.iter().map(|i| i.name.as_str()).collect();
    assert_eq!((names, job.inputs().iter().count()), (vec!["lid", "new/part"], 2));
    let all = corners(&imported);
    assert_eq!((all[1], all[4]), (DVec3::X * 3.0, DVec3::new(1.2, 0.0, 0.0)), "own values replace those of [import]");
    assert_eq!(imported.scene.materials[imported.scene.meshes[1].material].name, "new/part");

    let (_, empty) =
        job_in(&[], "scene = \"none\"\n[[object]]\nname = \"ball\"\nkind = \"sphere\"\ndiameter = \"10mm\"")
            .expect("a scene without files");
    assert_eq!(empty.scene.instances.len(), 1);
    assert!(empty.scene.build().is_ok());
}

#[test]
fn faults_of_scene_files_point_at_their_line() {
    let files: &[(&str, &[u8])] = &[("part.stl", ASCII.as_bytes())];
    for (text, part) in
        [("scene = [\"part.stl\", { file = \"lid.stl\" }]", "lid.stl"), ("scene = \"part.step\"", "CAD format")]
    {
        let error = job_in(files, text).map(|_| ()).expect_err(text);
        assert!(error.place.contains("scene") && error.problem.contains(part), "{text}: {error}");
        assert!(error.caret().contains('^'), "{error}");
    }
    let error = job_in(files, "scene = [\"part.stl\",\n \"lid.stl\"]").map(|_| ()).expect_err("no file");
    assert!(error.caret().contains("2 |  \"lid.stl\""), "{}", error.caret());
}
