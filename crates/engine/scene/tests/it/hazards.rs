//! Hazards of a scene before it is rendered: every hazard is reported with its object and with help. A valid scene has
//! no report.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion, Vec2, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld_scene::{
    AlphaMode, BuildReport, Camera, ColorEncoding, Image, ImageId, LineScan, Material, NormalMap, Projection,
    PunctualKind, PunctualLight, SceneBuilder, Shutter, Specular, Surface, Texels, Texture, Volume, look_at,
};

fn opaque(name: &str) -> Material {
    Material { name: name.into(), ..Material::default() }
}

fn glass(name: &str) -> Material {
    let surface = Surface::Solid(Volume::default());
    Material { name: name.into(), roughness: 0.0.into(), transmission: 1.0.into(), surface, ..Material::default() }
}

fn lamp() -> Material {
    Material {
        name: "lamp".into(),
        emission: Rgb::WHITE.into(),
        base_color: Rgb::BLACK.into(),
        specular: Specular::NONE,
        ..Material::default()
    }
}

/// A table of a metre with a lamp above it.
fn table() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let m = b.add_material(opaque("wood"));
    b.add_object("table", rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y), m);
    let m = b.add_material(lamp());
    b.add_object("bulb", rectangle(Vec3::new(-0.1, -0.1, 0.8), Vec3::Y * 0.2, Vec3::X * 0.2), m);
    b
}

/// The table with one more object.
fn with(material: Material, mesh: Mesh) -> SceneBuilder {
    let mut b = table();
    let m = b.add_material(material);
    b.add_object("thing", mesh, m);
    b
}

fn hazards(b: SceneBuilder) -> Vec<String> {
    let (_, report) = b.build().expect("valid");
    report.hazards().map(|f| format!("{}: {}", f.place, f.message)).collect()
}

/// One hazard, about the object, with the words and with help.
#[track_caller]
fn contains_message(b: SceneBuilder, about: &str, words: &[&str]) {
    let found = hazards(b);
    let of_it = found.iter().find(|h| h.starts_with(about) && words.iter().all(|w| h.contains(w)));
    assert!(of_it.is_some(), "nothing about {about} with {words:?} in {found:#?}");
}

#[track_caller]
fn assert_no_hazards(b: SceneBuilder, what: &str) {
    let found = hazards(b);
    assert!(found.is_empty(), "{what}: {found:#?}");
}

#[test]
fn valid_scenes_have_no_hazards() {
    assert_no_hazards(table(), "a table and a lamp");
    assert_no_hazards(with(opaque("ball"), sphere(Vec3::new(0.1, 0.1, 0.3), 0.2, 24, true)), "a smooth ball");
    assert_no_hazards(
        with(glass("pane"), cuboid(Vec3::new(-0.1, -0.1, 0.1), Vec3::new(0.1, 0.1, 0.104))),
        "a pane in the air",
    );
    assert_no_hazards(
        with(opaque("box"), cuboid(Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.1, 0.1, 0.1))),
        "a box on the table",
    );
    // Two solids that share a face form one interface, and a needle is a valid triangle.
    let mut b = with(glass("left"), cuboid(Vec3::new(-0.1, -0.1, 0.1), Vec3::new(0.0, 0.1, 0.2)));
    let m = b.add_material(glass("right"));
    b.add_object("right", cuboid(Vec3::new(0.0, -0.1, 0.1), Vec3::new(0.1, 0.1, 0.2)), m);
    assert_no_hazards(b, "two blocks that touch");
    assert_no_hazards(
        with(opaque("needle"), rectangle(Vec3::new(0.0, 0.0, 0.2), Vec3::X * 0.3, Vec3::Y * 1e-5)),
        "a needle",
    );
    // At a kilometre from the world's origin nothing is reported, because scenes are recentred.
    let mut b = table();
    b.instances.iter_mut().for_each(|i| i.to_world = DAffine3::from_translation(DVec3::splat(1e3)));
    assert_no_hazards(b, "a table a kilometre away");
}

#[test]
fn sizes_below_the_precision_of_f32_are_hazards() {
    // Half a kilometre from the middle a part of a millimetre is fifteen to thirty steps large.
    let mut b = with(opaque("steel"), cuboid(Vec3::splat(-5e-4), Vec3::splat(5e-4)));
    b.instances[2].to_world = DAffine3::from_translation(DVec3::new(500.0, 0.0, 0.0));
    let m = b.add_material(opaque("far"));
    b.add_object("far", rectangle(Vec3::new(-501.0, 0.0, 0.0), Vec3::X, Vec3::Y), m);
    contains_message(b, "object \"thing\"", &["lies 500", "steps of 3.1e-5 m", "near the middle of the scene"]);
    // A film of half a micrometre half a metre away from the middle, with any tilt.
    let film = cuboid(Vec3::new(-0.05, -0.05, 0.0), Vec3::new(0.05, 0.05, 5e-7));
    let mut b = with(glass("film"), film);
    b.instances[2].to_world = DAffine3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7)
        * DAffine3::from_translation(DVec3::new(0.3, 0.3, 0.4));
    contains_message(b, "object \"thing\"", &["is a solid", "thick where coordinates go in steps of", "thickness 0"]);
    // Triangles a tenth of a micrometre high.
    let needle = rectangle(Vec3::new(0.4, 0.4, 0.2), Vec3::new(0.05, 0.05, 0.0), Vec3::new(0.0, 1e-7, 0.0));
    contains_message(with(opaque("needle"), needle), "object \"thing\"", &["2 triangles", "rounding noise", "remesh"]);
    // A mesh of a centimetre at a kilometre from its own origin, moved back by its transform.
    let mut b = with(opaque("cad"), cuboid(Vec3::new(1000.0, 0.0, 0.0), Vec3::new(1000.01, 0.01, 0.01)));
    b.instances[2].to_world = DAffine3::from_translation(DVec3::new(-1000.0, 0.0, 0.1));
    contains_message(b, "mesh \"thing\"", &["from their own origin", "when it was written", "export it around"]);
}

#[test]
fn coplanar_overlapping_faces_are_hazards() {
    let upper = rectangle(Vec3::new(-0.2, -0.2, 0.0), Vec3::X * 0.3, Vec3::Y * 0.3);
    contains_message(
        with(opaque("paper"), upper.clone()),
        "object \"table\"",
        &["object \"thing\"", "rounding decides"],
    );
    contains_message(with(lamp(), upper), "object \"table\"", &["one of them emits", "move the emitter"]);
    let block = cuboid(Vec3::new(-0.2, -0.2, 0.0), Vec3::new(0.2, 0.2, 0.1));
    contains_message(with(glass("block"), block), "object \"table\"", &["clear solid", "air gap", "leave a gap"]);
    let near = cuboid(Vec3::new(-0.2, -0.2, 1e-6), Vec3::new(0.2, 0.2, 0.1));
    contains_message(with(glass("block"), near), "object \"table\"", &["the gap has an error of", "make it wider"]);
    let twin = rectangle(Vec3::new(-0.1, -0.1, 0.8), Vec3::Y * 0.2, Vec3::X * 0.2);
    contains_message(with(lamp(), twin), "object \"bulb\"", &["both emit", "delete one"]);
    // In one plane, but beside each other; and above each other, but tilted.
    let beside = rectangle(Vec3::new(0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    assert_no_hazards(with(opaque("second"), beside), "two tables side by side");
    let tilted = rectangle(Vec3::new(-0.2, -0.2, 0.001), Vec3::new(0.3, 0.0, 0.01), Vec3::Y * 0.3);
    assert_no_hazards(with(opaque("card"), tilted), "a card at an angle");
    // A tilted pair is found like one along the axes.
    let turn = DAffine3::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 1.1);
    let mut b = with(opaque("paper"), rectangle(Vec3::new(-0.2, -0.2, 0.0), Vec3::X * 0.3, Vec3::Y * 0.3));
    b.instances.iter_mut().for_each(|i| i.to_world = turn * i.to_world);
    contains_message(b, "object \"table\"", &["object \"thing\"", "rounding decides"]);
}

#[test]
fn unusable_attributes_are_hazards() {
    let mut mesh = rectangle(Vec3::new(-0.2, -0.2, 0.3), Vec3::X * 0.3, Vec3::Y * 0.3);
    mesh.normals = vec![Vec3::new(0.9, 0.0, 0.3); 4];
    contains_message(
        with(opaque("felt"), mesh.clone()),
        "object \"thing\"",
        &["2 triangles", "differ by more than 60 degrees", "72"],
    );
    mesh.normals = vec![Vec3::Z, Vec3::ZERO, Vec3::Z, Vec3::splat(f32::NAN)];
    contains_message(with(opaque("felt"), mesh.clone()), "object \"thing\"", &["2 normals", "recompute"]);
    mesh.normals = vec![Vec3::NEG_Z; 4];
    assert_no_hazards(with(opaque("felt"), mesh.clone()), "normals that point to the other side are turned");
    mesh.normals.clear();

    let mapped = |mesh: Mesh| {
        let texture = Texture::new(ImageId(0), ColorEncoding::Linear);
        let mut b = with(
            Material { normal_map: NormalMap { texture: Some(texture), scale: 1.0 }, ..opaque("wood grain") },
            mesh,
        );
        b.images.push(Image {
            name: "map".into(),
            width: 1,
            height: 1,
            texels: Texels::Rgba8(vec![[128, 128, 255, 255]]).into(),
        });
        b
    };
    assert_no_hazards(mapped(mesh.clone()), "a map on sound coordinates");
    mesh.uvs[0] = vec![Vec2::ZERO, Vec2::X, Vec2::X * 2.0, Vec2::X * 3.0];
    contains_message(mapped(mesh.clone()), "object \"thing\"", &["normal map", "2 of its triangles", "unwrap"]);
    mesh.uvs[0].clear();
    contains_message(
        mapped(mesh.clone()),
        "object \"thing\"",
        &["normal map", "neither tangents nor texture coordinates"],
    );
    mesh.tangents = vec![dunkelfeld_geometry::Vec4::ZERO; 4];
    contains_message(mapped(mesh), "object \"thing\"", &["normal map", "4 of its tangents"]);
}

#[test]
fn implausible_indices_of_refraction_are_hazards() {
    let block = || cuboid(Vec3::new(-0.2, -0.2, 0.1), Vec3::new(0.2, 0.2, 0.2));
    for (ior, words) in
        [(0.67, "give the inverse, 1.49"), (7.5, "germanium"), (1.0004, "neither reflects nor refracts")]
    {
        contains_message(with(Material { ior, ..glass("odd") }, block()), "material \"odd\"", &[words]);
    }
    for ior in [1.0, 1.33, 2.42, 4.0] {
        assert_no_hazards(with(Material { ior, ..glass("fine") }, block()), "an index as materials have it");
    }
}

#[test]
fn overlapping_solids_and_cameras_inside_solids_are_hazards() {
    let mut b = with(glass("one"), cuboid(Vec3::new(-0.2, -0.2, 0.1), Vec3::new(0.1, 0.2, 0.2)));
    let m = b.add_material(glass("two"));
    b.add_object("second", cuboid(Vec3::new(0.0, -0.1, 0.05), Vec3::new(0.3, 0.1, 0.15)), m);
    contains_message(b.clone(), "object \"thing\"", &["overlaps object \"second\"", "`priority`"]);
    // Different priorities say which of both fills the place.
    let mut decided = b.clone();
    decided.materials[m].surface = Surface::Solid(Volume { priority: 1, ..Volume::default() });
    assert_no_hazards(decided, "solids of different priorities");
    // One inside the other is nesting, which is intended.
    let mut nested = with(glass("one"), cuboid(Vec3::new(-0.2, -0.2, 0.1), Vec3::new(0.2, 0.2, 0.3)));
    let m = nested.add_material(glass("two"));
    nested.add_object("second", cuboid(Vec3::new(-0.1, -0.1, 0.15), Vec3::new(0.1, 0.1, 0.25)), m);
    assert_no_hazards(nested.clone(), "a bubble");
    nested.add_camera("eye", DVec3::new(0.15, 0.0, 0.2), DVec3::ZERO, 0.5);
    contains_message(nested.clone(), "camera \"eye\"", &["inside a solid of material \"one\"", "move it out"]);
    nested.cameras[0].to_world = look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y);
    assert_no_hazards(nested, "an eye outside");
}

#[test]
fn emitters_too_small_to_be_hit_are_hazards() {
    let spark = || rectangle(Vec3::new(0.0, 0.0, 0.5), Vec3::Y * 1e-5, Vec3::X * 1e-5);
    let mut b = with(lamp(), spark());
    let specks = |b: &SceneBuilder| hazards(b.clone()).iter().any(|h| h.contains("bright specks"));
    assert!(!specks(&b), "light sampling finds it, and nothing reflects it sharply");
    let m = b.add_material(Material { metallic: 1.0.into(), roughness: 0.0.into(), ..opaque("chrome") });
    b.add_object("mirror", rectangle(Vec3::new(-0.3, -0.3, 0.1), Vec3::X * 0.1, Vec3::Y * 0.1), m);
    contains_message(b, "object \"thing\"", &["\"chrome\"", "bright specks", "larger and dimmer"]);
}

#[test]
fn slips_of_modelling_name_their_cure() {
    // A table of 400 mm that was exported as 400 m.
    let large = with(opaque("wood"), cuboid(Vec3::new(0.0, 0.0, 1.0), Vec3::new(400.0, 100.0, 30.0)));
    contains_message(large, "object \"thing\"", &["400.000 m large", "unit = \"mm\""]);
    let sheet = Material { surface: Surface::Thin, ..glass("pane") };
    let block = cuboid(Vec3::new(-0.1, -0.1, 0.1), Vec3::new(0.1, 0.1, 0.104));
    contains_message(with(sheet.clone(), block), "mesh \"thing\"", &["closed", "thin sheet", "`solid = true`"]);
    let open = rectangle(Vec3::new(-0.1, -0.1, 0.1), Vec3::X * 0.2, Vec3::Y * 0.2);
    assert_no_hazards(with(sheet, open.clone()), "an open sheet");
    let empty = Material { metallic: 1.0.into(), roughness: 1.0.into(), ..opaque("Material.001") };
    contains_message(
        with(empty.clone(), open.clone()),
        "object \"thing\"",
        &["Material.001", "white rough metal", "metallic = 0"],
    );
    assert_no_hazards(with(Material { base_color: Rgb::splat(0.9).into(), ..empty }, open.clone()), "a grey metal");
    let mut twin = with(opaque("lid"), open.clone());
    twin.instances.push(twin.instances[2].clone());
    contains_message(twin, "object \"thing\"", &["copy of object \"thing\"", "same place", "visible = false"]);
    // A part of 60 mm that was read as 60 m.
    let part = with(opaque("steel"), cuboid(Vec3::new(0.0, 0.0, 1.0), Vec3::new(60.0, 40.0, 5.0)));
    contains_message(part, "object \"thing\"", &["60.000 m large", "unit = \"mm\""]);
    assert_no_hazards(
        with(opaque("wall"), cuboid(Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.1, 6.0, 3.0))),
        "a wall of 6 m",
    );
    // A lamp that faces a plate at its surface, and the same lamp turned around.
    let down = rectangle(Vec3::new(-0.1, -0.1, 0.1005), Vec3::Y * 0.2, Vec3::X * 0.2);
    let up = rectangle(Vec3::new(-0.1, -0.1, 0.1005), Vec3::X * 0.2, Vec3::Y * 0.2);
    let lit = |mesh: Mesh| {
        let mut b = with(opaque("plate"), open.clone());
        b.add_object("panel", mesh, 1);
        b
    };
    contains_message(lit(down), "object \"panel\"", &["object \"thing\"", "5.0e-4 m in front", "turn its normals"]);
    assert_no_hazards(lit(up), "a lamp that shines into the room");
}

#[test]
fn lights_inside_bodies_are_hazards() {
    let block = || cuboid(Vec3::new(-0.2, -0.2, 0.1), Vec3::new(0.2, 0.2, 0.3));
    let inside = |material: Material, mesh: Mesh, z: f64| {
        let mut b = with(material, mesh);
        let place = DAffine3::from_translation(DVec3::new(0.05, 0.0, z));
        let kind = PunctualKind::Point { intensity: Rgb::WHITE };
        b.lights.push(PunctualLight { name: "bulb 2".into(), to_world: place, kind });
        let panel = rectangle(Vec3::new(-0.01, -0.01, 0.0), Vec3::Y * 0.02, Vec3::X * 0.02);
        let panel = b.add_object("panel", panel, 1);
        b.instances[panel].to_world = place;
        b
    };
    let within = inside(opaque("steel"), block(), 0.2);
    contains_message(within.clone(), "light \"bulb 2\"", &["inside the opaque object \"thing\"", "move it out"]);
    contains_message(within.clone(), "object \"panel\"", &["inside the opaque object \"thing\""]);
    assert_no_hazards(inside(opaque("steel"), block(), 0.4), "lights above a block");
    // A camera inside: a room.
    let mut room = within;
    room.add_camera("eye", DVec3::new(0.1, 0.1, 0.2), DVec3::new(0.0, 0.0, 0.2), 0.5);
    assert_no_hazards(room, "a room");
    // An open box, and a shell with thick walls and an opening.
    let mut open = block();
    open.triangles.truncate(10);
    assert_no_hazards(inside(opaque("steel"), open, 0.2), "an open box");
    let rough = Material { roughness: 0.3.into(), ..glass("epoxy") };
    contains_message(inside(rough, block(), 0.2), "light \"bulb 2\"", &["clear solid of material \"epoxy\""]);
}

#[test]
fn cameras_inside_bodies_are_hazards() {
    let body = |material: Material| with(material, cuboid(Vec3::new(-0.2, -0.2, 0.1), Vec3::new(0.2, 0.2, 0.3)));
    let around = |b: SceneBuilder, z: f64, closed: bool| {
        let (scene, _) = b.build().expect("valid");
        let eye = DVec3::new(0.05, 0.0, z);
        let camera = Camera { to_world: look_at(eye, DVec3::ZERO, DVec3::Y), ..Camera::default() };
        let camera = scene.ray_generator(&camera, 8, 8).expect("valid");
        let mut report = BuildReport::default();
        scene.report_enclosed_camera(&camera, &mut report);
        let hazard =
            report.hazards().any(|f| f.place == "object \"thing\"" && f.message.contains("move the camera out"));
        assert_eq!(hazard, scene.body_around(&camera, true).is_some());
        scene.body_around(&camera, closed).map(str::to_owned)
    };
    assert_eq!(around(body(opaque("steel")), 0.2, true).as_deref(), Some("thing"));
    assert_eq!(around(body(opaque("steel")), 0.4, true), None, "above the body");
    assert_eq!(around(body(glass("glass")), 0.2, true), None, "in a clear body");
    assert_eq!(around(body(lamp()), 0.2, true).as_deref(), Some("thing"), "in a lamp that emits outward");
    let inward = Material { double_sided: true, ..lamp() };
    assert_eq!(around(body(inward), 0.2, true), None, "in a lamp that emits inward");
    let mut lit = body(opaque("steel"));
    let to_world = DAffine3::from_translation(DVec3::new(0.0, 0.1, 0.2));
    let kind = PunctualKind::Point { intensity: Rgb::WHITE };
    lit.lights.push(PunctualLight { name: "bulb".into(), to_world, kind });
    assert_eq!(around(lit, 0.2, true), None, "a room with a lamp");
    let mut open = body(opaque("steel"));
    let part = open.meshes.last_mut().expect("a body");
    std::sync::Arc::make_mut(&mut part.mesh).triangles.pop();
    assert_eq!(around(open.clone(), 0.2, true), None, "light can enter");
    assert_eq!(around(open, 0.2, false).as_deref(), Some("thing"));
}

/// A part of a file without a unit is small by its size in the world.
#[test]
fn small_parts_of_files_without_a_unit_are_hazards() {
    let part = |size: f32, is_unit_assumed: bool, scale: f64| {
        let mut b = with(opaque("part"), cuboid(Vec3::splat(-0.5 * size), Vec3::splat(0.5 * size)));
        b.meshes.last_mut().expect("a part").is_unit_assumed = is_unit_assumed;
        let lifted = DAffine3::from_translation(DVec3::new(0.0, 0.0, 0.1)) * DAffine3::from_scale(DVec3::splat(scale));
        b.instances.last_mut().expect("a part").to_world = lifted;
        hazards(b).iter().any(|h| h.starts_with("object \"thing\"") && h.contains("unit = \"m\""))
    };
    assert!(part(1.9e-3, true, 1.0) && part(2.1, true, 9e-4));
    assert!(!part(2.1e-3, true, 1.0) && !part(1.9e-3, false, 1.0) && !part(1.9e-3, true, 1000.0));
}

/// The hazards of lights that face away, seen from a camera above the table.
fn averted(b: SceneBuilder) -> Vec<String> {
    let (scene, _) = b.build().expect("valid");
    let camera = Camera { to_world: look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y), ..Camera::default() };
    let camera = scene.ray_generator(&camera, 40, 40).expect("valid");
    let mut report = BuildReport::default();
    scene.report_averted_lights(&[(camera, [40, 40])], &mut report);
    report.hazards().map(|f| format!("{}: {}", f.place, f.message)).collect()
}

#[test]
fn lights_that_face_away_from_everything_are_hazards() {
    // Above the table, beside the image: a panel that shines down, and one that shines up.
    let with_panel = |x: f32, up: bool, z: f32| {
        let mut b = table();
        let (u, v) = if up { (Vec3::X, Vec3::Y) } else { (Vec3::Y, Vec3::X) };
        b.add_object("panel", rectangle(Vec3::new(x, -0.1, z), u * 0.2, v * 0.2), 1);
        b
    };
    assert_eq!(averted(table()), Vec::<String>::new());
    assert_eq!(averted(with_panel(1.5, false, 0.9)), Vec::<String>::new());
    let found = averted(with_panel(1.5, true, 0.9));
    assert!(
        found.len() == 1 && found[0].starts_with("object \"panel\": faces away") && found[0].contains("`aim`"),
        "{found:?}"
    );
    // An indicator in the image is a source of light for the camera, and a lamp below the table lights its lower side.
    assert_eq!(averted(with_panel(-0.1, true, 0.01)), Vec::<String>::new());
    assert_eq!(averted(with_panel(1.5, true, -0.5)), Vec::<String>::new());
    // An object above it is lit, another lamp there is not.
    for (material, count) in [(opaque("ceiling"), 0), (lamp(), 1)] {
        let mut b = with_panel(1.5, true, 0.9);
        let m = b.add_material(material);
        b.add_object("above", rectangle(Vec3::new(-0.5, -0.5, 3.0), Vec3::Y, Vec3::X), m);
        assert_eq!(averted(b).len(), count);
    }
    // Lamps alone light nothing, and the camera looks at them.
    let mut b = with_panel(1.5, true, 0.9);
    b.instances.remove(0);
    assert_eq!(averted(b), Vec::<String>::new());
    let spot = |target: DVec3| {
        let mut b = table();
        let kind = PunctualKind::Spot { intensity: Rgb::WHITE, inner: 0.2, outer: 0.3 };
        let to_world = look_at(DVec3::new(3.0, 0.0, 1.0), target, DVec3::Y);
        b.lights.push(PunctualLight { name: "spot".into(), to_world, kind });
        averted(b)
    };
    assert_eq!(spot(DVec3::ZERO), Vec::<String>::new());
    let found = spot(DVec3::new(3.0, 0.0, 0.0));
    assert!(found.len() == 1 && found[0].starts_with("light \"spot\": no object is in its cone"), "{found:?}");
}

/// A camera above the table looks down, past a lamp that shines down.
#[test]
fn lamps_between_camera_and_part_are_hazards() {
    let blocked_part = |x: f32, edit: &dyn Fn(&mut Material), up: bool, is_small: bool| {
        let mut b = table();
        let mut material = lamp();
        edit(&mut material);
        let m = b.add_material(material);
        // The front faces down, or up.
        let (u, v) = if up { (Vec3::X, Vec3::Y) } else { (Vec3::Y, Vec3::X) };
        b.add_object("panel", rectangle(Vec3::new(x - 0.1, -0.1, 0.3), u * 0.2, v * 0.2), m);
        b.add_camera("above", DVec3::new(0.0, 0.001, 0.7), DVec3::ZERO, 0.4);
        if is_small {
            // It fills a tenth of the middle.
            b.instances[0].to_world = DAffine3::from_scale(DVec3::splat(0.05));
        }
        let (scene, _) = b.build().expect("valid");
        let camera = scene.ray_generator(&scene.cameras()[0], 32, 32).expect("a camera");
        let mut report = BuildReport::default();
        scene.report_blocked_view(&camera, [32, 32], &mut report);
        report.findings.iter().map(|f| format!("{}: {}", f.place, f.message)).collect::<Vec<_>>()
    };
    let blocked = |x: f32, edit: &dyn Fn(&mut Material), up: bool| blocked_part(x, edit, up, false);
    for is_small in [false, true] {
        assert_eq!(blocked_part(0.0, &|_| (), false, is_small).len(), 1, "small part: {is_small}");
    }
    let found = blocked(0.0, &|_| (), false);
    assert!(found[0].starts_with("object \"panel\"") && found[0].contains("`elevation`"), "{found:?}");
    assert_eq!(blocked(0.3, &|_| (), false), [""; 0], "beside the axis");
    assert_eq!(
        blocked(0.0, &|m| m.alpha_mode = AlphaMode::FrontOnly, false),
        [""; 0],
        "the image of a lamp in a beam splitter"
    );
    assert_eq!(blocked(0.0, &|_| (), true), [""; 0], "the camera looks at its front");
    assert_eq!(blocked(0.0, &|m| m.base_color.factor = Rgb::splat(0.8), false), [""; 0], "a part that shines");
}

#[test]
fn the_line_rate_follows_the_motion_along_the_height_of_the_image() {
    // A camera above the table, 2 m away, with 100 rows of 1 cm: its up is +y.
    let of = |velocity: DVec3, period: f64| {
        let mut b = table();
        b.instances[0].motion = RigidMotion::linear(velocity);
        let lines = LineScan { period, exposure: period, stages: 1, jitter: 0.0, line: 0.5, rows: 100, in_turn: 1 };
        b.shutter = Some(Shutter::Lines(lines));
        // Without the lamp in front of the table.
        b.instances.truncate(1);
        let (scene, _) = b.build().expect("valid");
        let projection = Projection::Orthographic { half_width: 0.5, half_height: 0.5 };
        let to_world = look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y);
        let camera = Camera { to_world, projection, ..Camera::default() };
        let camera = scene.ray_generator(&camera, 100, 100).expect("valid");
        let mut report = BuildReport::default();
        scene.report_motion(&camera, [100, 100], &mut report);
        report.hazards().map(|f| f.message.clone()).collect::<Vec<_>>().join("; ")
    };
    assert_eq!(of(DVec3::new(0.0, 0.1, 0.0), 0.1), "");
    assert!(of(DVec3::new(0.0, 0.03, 0.0), 0.1).contains("`line_rate = \"3Hz\"`"));
    assert!(
        of(DVec3::new(0.1, 0.0, 0.0), 0.1).contains("moves across the rows; the velocity must be along the height")
    );
    // A speed toward the camera changes no row.
    assert!(of(DVec3::new(0.0, 0.0, 0.1), 0.1).contains("does not move in the middle of the sensor line"));
    assert!(of(DVec3::new(0.1, 1e-12, 0.0), 0.1).contains("moves across the rows"));
    assert!(of(DVec3::new(0.0, 1e-4, 0.0), 1e-3).contains("`line_rate = \"0.01Hz\"`"));
}
