//! `[[object]]` of a job: its effects on a scene, and its refusals.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Vec3};
use dunkelfeld_io::InputError;
use dunkelfeld_io::job::Job;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Instance, Material, MeshPart, PunctualKind, PunctualLight, SceneBuilder};
use std::sync::Arc;

/// Two triangles from one mesh of material "steel": "lid 1" at the origin and "lid 2" at x = 10 m, and a lamp.
fn scene() -> SceneBuilder {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, 2.0 * Vec3::X, 4.0 * Vec3::Y],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let material = |name: &str, emission: f32| Material {
        name: name.into(),
        emission: Rgb::splat(emission).into(),
        ..Material::default()
    };
    let instance = |name: &str, mesh: usize, x: f64| Instance {
        name: name.into(),
        meshes: vec![mesh],
        to_world: DAffine3::from_translation(DVec3::new(x, 0.0, 20.0 * mesh as f64)),
        motion: Default::default(),
    };
    SceneBuilder {
        materials: vec![material("steel", 0.0), material("glow", 1.0)],
        meshes: vec![
            MeshPart { name: "lid".into(), mesh: mesh.clone().into(), material: 0, ..MeshPart::default() },
            MeshPart { name: "lamp".into(), mesh: mesh.into(), material: 1, ..MeshPart::default() },
        ],
        instances: vec![instance("lid 1", 0, 0.0), instance("lid 2", 0, 10.0), instance("lamp", 1, 0.0)],
        lights: vec![PunctualLight {
            name: "bulb".into(),
            to_world: DAffine3::IDENTITY,
            kind: PunctualKind::Point { intensity: Rgb::WHITE },
        }],
        ..SceneBuilder::default()
    }
}

fn apply(text: &str) -> Result<SceneBuilder, InputError> {
    let mut scene = scene();
    let job = Job::from_text("jobs/a.toml", format!("scene = \"a.glb\"\n{text}"))?;
    job.apply_overrides(&mut scene)?;
    Ok(scene)
}

fn changed(text: &str) -> SceneBuilder {
    apply(text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

/// The place of the corner at the object's origin, and of the one at x = 2 m.
fn corners(scene: &SceneBuilder, object: usize) -> [DVec3; 2] {
    let place = scene.instances[object].to_world;
    [DVec3::ZERO, 2.0 * DVec3::X].map(|p| (place.transform_point3(p) * 1e9).round() / 1e9)
}

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn names(scene: &SceneBuilder) -> Vec<&str> {
    scene.instances.iter().map(|n| n.name.as_str()).collect()
}

fn material_of(scene: &SceneBuilder, object: usize) -> &str {
    &scene.materials[scene.meshes[scene.instances[object].meshes[0]].material].name
}

#[test]
fn objects_are_moved_about_their_pivot_in_the_order_of_the_file() {
    let s =
        changed("[[object]]\nname = \"lid *\"\ntranslate = [0, \"500mm\", 1]\nscale = 3\nrotate = [0, 0, \"90deg\"]");
    assert_eq!(corners(&s, 0), [at(0.0, 0.5, 1.0), at(0.0, 6.5, 1.0)]);
    assert_eq!(corners(&s, 1), [at(0.0, 30.5, 1.0), at(0.0, 36.5, 1.0)], "about the origin of the world");
    let s =
        changed("[[object]]\nname = \"lid 2\"\npivot = \"center\"\nrotate = { axis = [0, 0, 1], angle = \"180deg\" }");
    assert_eq!(corners(&s, 1), [at(12.0, 4.0, 0.0), at(10.0, 4.0, 0.0)], "the centre is (11, 2, 0)");
    let s = changed("[[object]]\nname = \"lid 1\"\npivot = \"lid 2\"\nscale = 2");
    assert_eq!(corners(&s, 0)[0], at(-11.0, -2.0, 0.0), "about the centre of another object");
    let s = changed(
        "[[object]]\nname = \"lid 1\"\nmatrix = [-1,0,0,1, 0,1,0,2, 0,0,1,3, 0,0,0,1]\n[[object]]\nname = \"lid 1\"\ntranslate = [0, 0, 4]",
    );
    assert_eq!(corners(&s, 0), [at(1.0, 2.0, 7.0), at(-1.0, 2.0, 7.0)]);
}

#[test]
fn objects_are_removed_and_get_other_materials() {
    assert_eq!(names(&changed("[[object]]\nname = \"lid*\"\nvisible = false")), ["lamp"]);
    let s = changed(
        "[[object]]\nname = \"lid 2\"\nmaterial = \"blue\"\n[[material]]\nname = \"blue\"\nnew = true\nbase_color = [0, 0, 1]",
    );
    assert_eq!([0, 1].map(|object| material_of(&s, object)), ["steel", "blue"], "the shared mesh was copied");
    assert_eq!(s.materials[2].base_color.factor, Rgb::new(0.0, 0.0, 1.0));
    let both = changed("[[object]]\nname = \"lid*\"\nmaterial = \"glow\"");
    assert_eq!(both.meshes.len(), 2, "no copy is needed if all objects of the mesh change");
    assert_eq!([0, 1].map(|object| material_of(&both, object)), ["glow", "glow"]);
}

#[test]
fn an_entry_changes_no_material_of_a_later_entry() {
    let s = changed(
        "[[material]]\nname = \"alu\"\nnew = true\n[[material]]\nname = \"*\"\nmetallic = 0.75\n\
         [[material]]\nname = \"felt\"\nnew = true\nroughness = 1\n[[material]]\nname = \"f?lt\"\nroughness = 0.25",
    );
    let values =
        |name: &str| s.materials.iter().find(|m| m.name == name).map(|m| (m.metallic.factor, m.roughness.factor));
    assert_eq!(["steel", "alu", "felt"].map(|name| values(name).map(|v| v.0)), [Some(0.75), Some(0.75), Some(0.0)]);
    assert_eq!(values("felt"), Some((0.0, 0.25)));
    let early = apply("[[material]]\nname = \"felt\"\nmetallic = 1\n[[material]]\nname = \"felt\"\nnew = true");
    let error = early.expect_err("defined later");
    assert!(error.place == "[[material]] 1, name" && error.problem.contains("later entry"), "{error}");
}

#[test]
fn copies_share_the_mesh_and_replace_the_object() {
    let s = changed(
        "[[object]]\nname = \"lid 1\"\ntranslate = [1, 0, 0]\ngrid = { count = [2, 1, 2], step = [5, 1, \"7m\"] }",
    );
    assert_eq!(names(&s), ["lid 1 1", "lid 2", "lamp", "lid 1 2", "lid 1 3", "lid 1 4"]);
    let places = [0, 3, 4, 5].map(|object| corners(&s, object)[0]);
    assert_eq!(places, [at(1.0, 0.0, 0.0), at(6.0, 0.0, 0.0), at(1.0, 0.0, 7.0), at(6.0, 0.0, 7.0)]);
    assert!(s.meshes.len() == 2 && s.instances[5].meshes == [0]);
    let s = changed(
        "[[object]]\nname = \"lid 2\"\npivot = \"center\"\ntranslate = [0, 1, 0]\ninstances = [{ translate = [0, 0, 1] }, { rotate = [0, 0, \"180deg\"] }]",
    );
    assert_eq!([1, 3].map(|object| corners(&s, object)[0]), [at(10.0, 1.0, 1.0), at(12.0, 5.0, 0.0)]);
}

#[test]
fn new_objects_have_their_size_place_and_material() {
    let text = "[[object]]\nname = \"belt\"\nkind = \"box\"\nsize = [1, \"20mm\", 2]\ntranslate = [0, \"-10mm\", 0]\n\
                [[material]]\nname = \"belt\"\nbase_color = 0.05\n\
                [[object]]\nname = \"pin\"\nkind = \"cylinder\"\ndiameter = \"4mm\"\nheight = \"1cm\"\nmaterial = \"steel\"\n\
                translate = [0, 0, -5]";
    let s = changed(text);
    assert_eq!(names(&s)[3..], ["belt", "pin"]);
    assert_eq!([3, 4].map(|object| material_of(&s, object)), ["belt", "steel"]);
    assert_eq!(s.materials.last().expect("a new one").base_color.factor, Rgb::splat(0.05));
    let highest = |object: usize| {
        let instance = &s.instances[object];
        let corners = s.meshes[instance.meshes[0]].mesh.positions.iter();
        corners.map(|p| instance.to_world.transform_point3(p.as_dvec3())).reduce(DVec3::max).expect("corners")
    };
    assert!(highest(3).distance(at(0.5, 0.0, 1.0)) < 1e-7 && highest(4).distance(at(2e-3, 5e-3, -4.998)) < 1e-7);
    let (_, report) = s.build().expect("a scene");
    assert!(report.findings.is_empty(), "{:?}", report.findings);
}

#[test]
fn copies_of_emitters_have_a_limit() {
    let mut scene = scene();
    Arc::make_mut(&mut scene.meshes[1].mesh).triangles = vec![[0, 1, 2]; 100];
    let text = "scene = \"a.glb\"\n[[object]]\nname = \"lamp\"\ngrid = { count = [300, 300, 1], step = [1, 1, 1] }";
    let job = Job::from_text("a.toml", text).expect("a job");
    let error = job.apply_overrides(&mut scene).expect_err("nine million lights");
    assert!(error.problem.contains("9000000 emitting triangles"), "{error}");
}
