//! Tests of the defects.

use super::*;
use crate::defects::host::AreaTable;
use dunkelfeld_geometry::health::MeshHealth;
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Mesh, RigidMotion, Vec2, Vec3, geometric_normal};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::keyed_stream;
use dunkelfeld_scene::{AlphaMode, Image, Instance, Material, Surface, Texels, Volume, shapes};
use std::sync::Arc;
use toml::Table;

const SURFACE: [&str; 5] = ["scratch", "dent", "stain", "dust", "fibre"];
const CUT: [&str; 4] = ["pore", "chip", "chatter", "cold_shut"];
const INSIDE: [&str; 2] = ["bubble", "inclusion"];
const CHANGE: [&str; 3] = ["missing", "faded", "shifted"];

fn stream(seed: u64) -> Pcg {
    keyed_stream(seed, 0, 0, 1)
}

/// The values of a kind, with other values for the keys that it has.
fn table(kind: &str, values: &str) -> Table {
    let text = match kind {
        "scratch" => "length = 0.05\nwidth = 0.002\ndepth = 0.0005\ncurvature = '0.3rad'",
        "dent" => "length = 0.05\ndepth = 0.0005",
        "stain" => "length = 0.05\nstrength = 0.5",
        "pore" | "chip" => "length = 0.05\ndepth = 0.01",
        "chatter" => "length = 0.05\npitch = 0.005\ndepth = 0.0005",
        "cold_shut" => "length = 0.05\nwidth = 0.004\ndepth = 0.001\ncurvature = '0.3rad'",
        "fibre" => "length = 0.05\nwidth = 0.002\ncurvature = '0.3rad'",
        "missing" => "",
        "faded" => "strength = 0.5",
        _ => "length = 0.05",
    };
    let mut keys: Table = text.parse().expect("TOML");
    for (key, value) in values.parse::<Table>().expect("TOML") {
        if keys.contains_key(&key) || ["angle", "burr", "facing", "roughness"].contains(&key.as_str()) {
            keys.insert(key, value);
        }
    }
    keys
}

fn spec_with(kind: &str, on: &[usize], values: &str) -> DefectSpec {
    let defect = Defect::read(kind, &table(kind, values)).expect("a defect");
    DefectSpec { name: "defect".into(), on: on.to_vec(), defect, image: None }
}

fn spec(kind: &str, on: &[usize]) -> DefectSpec {
    spec_with(kind, on, "")
}

fn clear() -> Material {
    let volume = Volume { priority: 4, ..Volume::default() };
    Material { transmission: 1.0.into(), ior: 1.49, surface: Surface::Solid(volume), ..Material::default() }
}

/// Object 0: an opaque sphere of radius 0.5 with smooth normals, turned and moved. Object 1: a clear box. Object 2: a
/// plane that is as large as object 0 in total, a reflected one. Object 3: a lamp.
fn scene() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let opaque = b.add_material(Material { roughness: 0.4.into(), ..Material::default() });
    let solid = b.add_material(clear());
    let lamp = b.add_material(Material { emission: Rgb::WHITE.into(), ..Material::default() });
    b.add_object("ball", shapes::sphere(Vec3::ZERO, 0.5, 96, true), opaque);
    b.add_object("block", shapes::cuboid(Vec3::new(2.0, 0.0, 0.0), Vec3::new(3.0, 0.5, 0.3)), solid);
    b.add_object("plane", shapes::rectangle(Vec3::ZERO, Vec3::X, Vec3::NEG_Z), opaque);
    b.add_object("lamp", shapes::rectangle(Vec3::splat(3.0), Vec3::X, Vec3::NEG_Z), lamp);
    b.instances[0].to_world =
        DAffine3::from_mat3_translation(DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.7), CENTER);
    b.instances[2].to_world =
        DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 2.0)), DVec3::new(0.0, -2.0, 0.0));
    b
}

const CENTER: DVec3 = DVec3::new(-3.0, 0.2, 1.0);

/// The mesh of the last object in the world, in f64.
fn placed(b: &SceneBuilder) -> (Vec<DVec3>, Arc<Mesh>) {
    let instance = b.instances.last().unwrap();
    let mesh = b.meshes[instance.meshes[0]].mesh.clone();
    (mesh.positions.iter().map(|p| instance.to_world.transform_point3(p.as_dvec3())).collect(), mesh)
}

/// The quantile of chi-squared with `k` degrees of freedom that a fraction of 1e-9 exceeds (Wilson and Hilferty 1931).
fn bound(k: f64) -> f64 {
    let s = 2.0 / (9.0 * k);
    k * (1.0 - s + 6.0 * s.sqrt()).powi(3)
}

#[test]
fn drawn_points_are_uniform_by_area() {
    let b = scene();
    let table = AreaTable::new(&b, &spec("dust", &[0, 2])).unwrap();
    // 8 bands of equal area of the sphere (of area 3.14 but for the facets), 8 rectangles of the plane (2 m²).
    let sphere = MeshHealth::from_mesh(&b.meshes[0].mesh).area;
    let (n, mut counts, mut stream) = (100_000, [0u32; 16], stream(5));
    for _ in 0..n {
        let anchor = table.draw(&b, &mut stream).unwrap();
        let cell = if anchor.instance == 0 {
            // Bands around an axis that the mesh does not have.
            let z = (anchor.point - CENTER).normalize().dot(DVec3::new(0.48, 0.6, 0.64));
            ((0.5 * (z + 1.0) * 8.0) as usize).min(7)
        } else {
            assert!((anchor.normal - DVec3::Y).length() < 1e-12, "a reflected object keeps its front");
            let (x, z) = (-anchor.point.x, -anchor.point.z);
            8 + 4 * ((2.0 * x) as usize).min(1) + ((2.0 * z) as usize).min(3)
        };
        counts[cell] += 1;
    }
    let total = sphere + 2.0;
    // The facets are within 0.1 % of the area of the sphere, which adds at most 1e-6 n = 0.1 to the statistic.
    let expected = |i: usize| f64::from(n) * if i < 8 { sphere / 8.0 } else { 0.25 } / total;
    let chi: f64 = (0..16).map(|i| (f64::from(counts[i]) - expected(i)).powi(2) / expected(i)).sum();
    assert!(chi < bound(15.0), "chi-squared {chi} of 15 degrees, {counts:?} (false alarm rate 1e-9)");
}

#[test]
fn patches_follow_a_sphere() {
    for kind in ["scratch", "dent", "stain"] {
        for seed in 0..8 {
            let mut b = scene();
            let spec = spec_with(kind, &[0], "length = 0.4\nwidth = 0.02\ndepth = 1e-3");
            let done = add_defect(&mut b, &spec, &mut stream(seed)).unwrap();
            let (points, mesh) = placed(&b);
            // The facets of the sphere are up to 0.5 (1 - cos(pi / 96)) = 2.7e-4 m below it. A ridge is 1e-3 m high.
            let ridge = if kind == "scratch" { 1e-3 } else { 0.0 };
            for p in &points {
                let height = (*p - CENTER).length() - 0.5;
                assert!((-4e-4..ridge + 8e-4).contains(&height), "{kind:?} {seed}: {height}");
            }
            for t in 0..mesh.triangles.len() {
                let middle = mesh.triangles[t].map(|i| points[i as usize]).iter().sum::<DVec3>() / 3.0;
                let outward = (middle - CENTER).normalize();
                let normal = geometric_normal(&mesh.corners(t)).as_dvec3();
                let least = if kind == "scratch" { 0.5 } else { 0.95 };
                assert!(normal.dot(outward) > least, "{kind:?} winds inward: {normal} {outward}");
            }
            assert!(done.extent > 0.2 && done.extent < 0.5, "{kind:?}: {}", done.extent);
            assert_eq!((done.object.as_str(), done.on.as_str()), ("defect", "ball"));
            assert!(((done.at - CENTER).length() - 0.5).abs() < 4e-4);
        }
    }
}

#[test]
fn the_normals_of_a_dent_are_those_of_its_bell() {
    let mut b = scene();
    let spec = spec_with("dent", &[2], "length = 0.2\ndepth = 0.009\nfacing = [0, 1, 0]");
    let done = add_defect(&mut b, &spec, &mut stream(3)).unwrap();
    let (points, mesh) = placed(&b);
    for (p, n) in points.iter().zip(&mesh.normals) {
        let way = *p - done.at;
        let r = (way.x.hypot(way.z) / 0.1).min(1.0);
        let slope = 0.5 * std::f64::consts::PI * 0.009 / 0.1 * (std::f64::consts::PI * r).sin();
        let inward = -n.as_dvec3().dot(DVec3::new(way.x, 0.0, way.z).normalize_or_zero());
        assert!((inward - slope / (1.0 + slope * slope).sqrt()).abs() < 1e-5, "{r}: {inward} {slope}");
        assert!((n.length() - 1.0).abs() < 1e-5 && way.y.abs() < 5e-5);
    }
}

#[test]
fn texture_coordinates_continue_and_seams_are_cut() {
    // Two triangles with texture coordinates that jump by 10 at the common edge.
    let mut mesh = shapes::rectangle(Vec3::ZERO, Vec3::X, Vec3::NEG_Z);
    let corners: Vec<Vec3> = (0..2).flat_map(|t| mesh.corners(t)).collect();
    mesh.uvs[0] = corners.iter().enumerate().map(|(i, p)| Vec2::new(p.x + 10.0 * (i / 3) as f32, -p.z)).collect();
    (mesh.positions, mesh.triangles, mesh.normals) = (corners, vec![[0, 1, 2], [3, 4, 5]], vec![]);
    let mut b = SceneBuilder::default();
    b.add_material(Material::default());
    b.add_object("sheet", mesh, 0);
    add_defect(&mut b, &spec_with("dent", &[0], "length = 0.8\ndepth = 0.01"), &mut stream(1)).unwrap();
    let (points, mesh) = placed(&b);
    assert_eq!(mesh.uvs[0].len(), points.len());
    let mut sides = [0; 2];
    for triangle in &mesh.triangles {
        let uv = triangle.map(|i| mesh.uvs[0][i as usize]);
        let p = triangle.map(|i| points[i as usize]);
        let jump = f64::from(uv[0].x) - p[0].x;
        sides[usize::from(jump > 5.0)] += 1;
        for k in 0..3 {
            assert!((f64::from(uv[k].x) - p[k].x - 10.0 * (jump / 10.0).round()).abs() < 1e-4, "{uv:?} {p:?}");
            assert!((f64::from(uv[k].y) + p[k].z).abs() < 1e-4);
        }
    }
    assert!(sides.iter().all(|n| *n > 100), "{sides:?}");
}

#[test]
fn hollows_in_clear_solids_are_closed_and_displace_the_solid() {
    for kind in ["scratch", "dent"] {
        let mut b = scene();
        let done = add_defect(&mut b, &spec_with(kind, &[1], "width = 0.01"), &mut stream(2)).unwrap();
        let part = b.meshes.last().unwrap();
        let health = MeshHealth::from_mesh(&part.mesh);
        assert!(health.is_closed() && health.signed_volume > 0.0, "{kind:?} {health:?}");
        let Surface::Solid(volume) = b.materials[part.material].surface else { panic!("{kind:?} is no solid") };
        assert_eq!((volume.priority, b.materials[part.material].ior), (5, 1.0));
        let height = |p: &DVec3| (*p - done.at).dot(done.normal);
        let offset = placed(&b).0.iter().map(height).fold(0.0, f64::max);
        assert!(offset < 5e-5, "{offset}");
        // The volume of the bell is depth * area * (1 / 2 - 2 / pi²). It starts above the surface.
        if kind == "dent" {
            let bell =
                (5e-4 + offset) * std::f64::consts::PI * 0.025f64.powi(2) * (0.5 - 2.0 / std::f64::consts::PI.powi(2));
            assert!((health.signed_volume / bell - 1.0).abs() < 0.01, "{} {bell}", health.signed_volume);
        }
        let lowest = placed(&b).0.iter().map(height).fold(0.0, f64::min);
        assert!((lowest / -5e-4 - 1.0).abs() < 0.02, "{kind:?}: {lowest}");
    }
}

/// The meshes of an object and of the defect in it, joined. They are in one space.
fn joined(b: &SceneBuilder, object: usize) -> Mesh {
    let mut all = Mesh::default();
    for part in b.instances[object].meshes.iter().chain(&b.instances.last().unwrap().meshes) {
        let (first, mesh) = (all.positions.len() as u32, &b.meshes[*part].mesh);
        all.positions.extend(&mesh.positions);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| first + i)));
        assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
    }
    all
}

/// A metal body on its own: a box with edges of 1.0, 0.5 and 0.3.
fn block() -> SceneBuilder {
    let mut b = scene();
    b.materials[1] = Material { metallic: 1.0.into(), ..Material::default() };
    b
}

/// The volume that a defect takes away from object 1.
fn loss(before: &SceneBuilder, after: &SceneBuilder) -> f64 {
    let health = MeshHealth::from_mesh(&joined(after, 1));
    assert!(health.is_closed(), "{health:?}");
    let (_, mesh) = placed(after);
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let front = geometric_normal(&mesh.corners(t));
        assert!(corners.iter().all(|i| front.dot(mesh.normals[*i as usize]) > 0.7));
    }
    MeshHealth::from_mesh(&before.meshes[1].mesh).signed_volume - health.signed_volume
}

/// The distance of a place on the block to the nearest edge.
fn margin(at: DVec3) -> f64 {
    let mut sides: Vec<f64> =
        (at - DVec3::new(2.0, 0.0, 0.0)).min(DVec3::new(3.0, 0.5, 0.3) - at).to_array().map(f64::abs).to_vec();
    sides.sort_by(f64::total_cmp);
    sides[1]
}

/// What a break of an edge of 90 degrees removes has the area D² across the edge at the depth D. So it is 16/15 of half of the
/// length times the square of the depth in the middle; its roughness adds at most a few per cent.
#[test]
fn a_chip_takes_its_volume_from_an_edge() {
    let (mut sum, mut count) = (0.0, 0);
    for seed in 0..30 {
        let mut b = block();
        let done =
            add_defect(&mut b, &spec_with("chip", &[1], "length = 0.06\ndepth = 0.01"), &mut stream(seed)).unwrap();
        let volume = loss(&block(), &b) / (16.0 / 15.0 * 0.03 * 0.01f64.powi(2));
        assert!(margin(done.at) < 1e-6 && (0.5..2.0).contains(&volume), "{seed}: {volume}");
        // Away from corners.
        if (done.at - DVec3::new(2.5, 0.25, 0.15)).abs().cmplt(DVec3::new(0.4, 0.15, 0.05)).any() {
            (sum, count) = (sum + volume, count + 1);
        }
    }
    assert!(count > 15 && (sum / f64::from(count) - 1.0).abs() < 0.1, "{} of {count}", sum / f64::from(count));
    let mut ball = scene();
    assert!(add_defect(&mut ball, &spec_with("chip", &[0], "length = 0.06\ndepth = 0.01"), &mut stream(1)).is_err());
}

/// Pores, chatter marks, cold shuts and scratches have their depth, and the joint with the body is closed to the last bit, also
/// where they lie over an edge.
#[test]
fn cut_defects_have_their_depth_and_may_cross_edges() {
    for (kind, values, extent) in [
        ("pore", "length = 0.05\ndepth = 0.01", 0.7..1.05),
        ("chatter", "length = 0.1\ndepth = 0.001\npitch = 0.01", 0.9..1.05),
        ("cold_shut", "length = 0.2\ndepth = 0.004\nwidth = 0.02", 0.7..1.05),
        ("scratch", "length = 0.2\ndepth = 0.002\nwidth = 0.01\nburr = 0.3\ncurvature = '0.3rad'", 0.9..1.05),
    ] {
        let mut over_edges = 0;
        for seed in 0..12 {
            let mut b = block();
            let done = add_defect(&mut b, &spec_with(kind, &[1], values), &mut stream(seed)).unwrap();
            let (volume, values) = (loss(&block(), &b), table(kind, values));
            let [length, depth] = ["length", "depth"].map(|key| values[key].as_float().unwrap());
            if margin(done.at) > 0.5 * length + 0.02 {
                assert!(volume > 0.0 || kind == "cold_shut", "{kind} {seed}: {volume}");
                let lowest = placed(&b).0.iter().map(|p| (*p - done.at).dot(done.normal)).fold(0.0, f64::min);
                assert!((lowest / -depth - 1.0).abs() < 0.06, "{kind} {seed}: {lowest}");
                assert!(extent.contains(&(done.extent / length)), "{kind} {seed}: {}", done.extent);
            } else {
                over_edges += 1;
            }
        }
        // The walls of a pore are too steep for that.
        assert_eq!(over_edges > 1, kind != "pore", "{kind}");
    }
    // Triangles without area, and a face that is there twice, are no obstacle elsewhere.
    let mut b = block();
    let mesh = Arc::make_mut(&mut b.meshes[1].mesh);
    let first = mesh.triangles[0];
    mesh.triangles.extend([[0, 0, 1], first]);
    for seed in 0..4 {
        add_defect(&mut b.clone(), &spec("pore", &[1]), &mut stream(seed)).unwrap();
        add_defect(&mut b.clone(), &spec("chip", &[1]), &mut stream(seed)).unwrap();
    }
    let most = spec_with("chatter", &[1], "length = 0.1\npitch = 0.004\ndepth = 0.0003");
    add_defect(&mut b.clone(), &most, &mut stream(1)).unwrap();
    let fine = spec_with("chatter", &[1], "length = 0.2\npitch = 0.002\ndepth = 0.0003");
    assert!(add_defect(&mut b, &fine, &mut stream(1)).unwrap_err().help.contains("25 waves"));
    let mut clear = scene();
    let pore = spec_with("pore", &[1], "length = 0.05\ndepth = 0.01");
    assert!(add_defect(&mut clear, &pore, &mut stream(1)).unwrap_err().help.contains("opaque"));
}

/// Around a cylinder and along it, a picture has its size to 2 %: the area of its patch, and the way along its middle row.
#[test]
fn a_decal_has_its_size_around_a_cylinder() {
    let outline = [[0.0, -1.5], [0.5, -1.5], [0.5, 1.5], [0.0, 1.5]].map(Vec2::from);
    for (mode, angle, seed) in
        [("mask", "0deg", 1), ("color", "90deg", 2), ("roughness", "35deg", 3), ("height", "80deg", 4)]
    {
        let mut b = SceneBuilder::default();
        b.add_material(Material::default());
        b.add_object("rod", shapes::turned(&outline, 256), 0);
        let depth = if mode == "height" { "depth = 1e-4" } else { "" };
        let keys: Table =
            format!("image = 'x'\nmode = '{mode}'\nlength = 0.9\nangle = '{angle}'\n{depth}").parse().unwrap();
        let texels = Arc::new(Texels::Gray8(vec![[255]; 4 * 2]));
        let image = Some(Image { name: "x".into(), width: 4, height: 2, texels });
        let spec =
            DefectSpec { name: "decal".into(), on: vec![0], defect: Defect::read("decal", &keys).unwrap(), image };
        let done = add_defect(&mut b, &spec, &mut stream(seed)).unwrap();
        let (points, mesh) = placed(&b);
        let area = MeshHealth::from_mesh(&mesh).area;
        assert!((area / (0.9 * 0.45) - 1.0).abs() < 0.02, "{angle}: {area}");
        let mut middle: Vec<(f32, DVec3)> = mesh.uvs[0]
            .iter()
            .zip(&points)
            .filter(|(uv, _)| (uv.y - 0.5).abs() < 1e-3)
            .map(|(uv, p)| (uv.x, *p))
            .collect();
        middle.sort_by(|a, b| a.0.total_cmp(&b.0));
        let way: f64 = middle.windows(2).map(|pair| pair[0].1.distance(pair[1].1)).sum();
        assert!((way / 0.9 - 1.0).abs() < 0.02, "{angle}: {way}");
        assert!(points.iter().all(|p| (p.x.hypot(p.y) - 0.5).abs() < 2e-3), "{angle}");
        let material = &b.materials[b.meshes.last().unwrap().material];
        assert!(material.clone().texture_slots().any(|slot| slot.is_some_and(|t| t.image.0 == 0)), "{mode}");
        b.add_camera("camera", DVec3::new(0.0, 0.0, 8.0), DVec3::ZERO, 0.8);
        b.build().unwrap();
        assert_eq!(done.on, "rod");
        let wrong: Table = "image = 'x'\nmode = 'height'\nlength = 0.9".parse().unwrap();
        assert!(Defect::read("decal", &wrong).unwrap().check().is_err());
    }
}

/// The volume of a dent is depth * area * (1 / 2 - 2 / pi²). The joint with its body is closed to the last bit.
#[test]
fn a_deep_dent_is_cut_into_its_body() {
    let bell = |length: f64, depth: f64| {
        depth * std::f64::consts::PI * (0.5 * length).powi(2) * (0.5 - 2.0 / std::f64::consts::PI.powi(2))
    };
    for seed in 0..20 {
        let mut b = block();
        let to_world = DAffine3::from_translation(DVec3::Z * 2.0);
        let twin = Instance { name: "twin".into(), to_world, ..b.instances[1].clone() };
        b.instances.push(twin);
        let before = b.clone();
        let dent = spec_with("dent", &[1], "length = 0.1\ndepth = 0.01");
        let done = add_defect(&mut b, &dent, &mut stream(seed)).unwrap();
        let volume = loss(&before, &b);
        let is_flat = margin(done.at) > 0.05;
        assert!(if is_flat { (volume / bell(0.1, 0.01) - 1.0).abs() < 0.01 } else { volume > 0.0 }, "{volume}");
        assert!(((done.extent / 0.1 - 1.0).abs() < 0.06 || !is_flat) && done.replaces == Some(1), "{done:?}");
        // Only the struck object has the hole, and nothing of it is left inside.
        assert_eq!(b.instances[4].meshes, before.instances[4].meshes);
        assert!(Arc::ptr_eq(&b.meshes[1].mesh, &before.meshes[1].mesh));
        let (cut, origin) = (&b.meshes[b.instances[1].meshes[0]].mesh, b.instances[1].to_world.translation);
        for t in 0..cut.triangles.len() {
            let middle = origin + cut.corners(t).iter().map(|p| p.as_dvec3()).sum::<DVec3>() / 3.0 - done.at;
            assert!(!is_flat || middle.length() > 0.048 || middle.dot(done.normal).abs() > 0.01, "{seed}: {middle}");
        }
        // A plane that is reflected and stretched, and a ball with smooth normals.
        for (object, is_open) in [(2, true), (0, false)] {
            let mut b = scene();
            let dent = DefectSpec { on: vec![object], ..dent.clone() };
            add_defect(&mut b, &dent, &mut stream(seed)).unwrap();
            let health = MeshHealth::from_mesh(&joined(&b, object));
            let faults = [health.inconsistent_edges, health.non_manifold_edges];
            assert!(faults == [0, 0] && (health.open_edges > 0) == is_open, "{object} {seed}: {health:?}");
            let (_, mesh) = placed(&b);
            for (t, corners) in mesh.triangles.iter().enumerate() {
                let front = geometric_normal(&mesh.corners(t));
                assert!(corners.iter().all(|i| front.dot(mesh.normals[*i as usize]) > 0.8), "{object} {seed}");
            }
        }
    }
    // A thin plate bulges on its other side.
    let mut b = SceneBuilder::default();
    b.add_material(Material { metallic: 1.0.into(), ..Material::default() });
    b.add_object("plate", shapes::cuboid(Vec3::ZERO, Vec3::new(1.0, 0.02, 1.0)), 0);
    let dent = spec_with("dent", &[0], "length = 0.3\ndepth = 0.05\nfacing = [0, 1, 0]");
    let mut over = b.clone();
    let is_inside = |at: DVec3| (at.x - 0.5).abs().max((at.z - 0.5).abs()) < 0.3;
    let inside = |seed: &u64| is_inside(add_defect(&mut b.clone(), &dent, &mut stream(*seed)).unwrap().at);
    let seed = (0..20).find(inside).unwrap();
    add_defect(&mut b, &dent, &mut stream(seed)).unwrap();
    let health = MeshHealth::from_mesh(&joined(&b, 0));
    assert!(health.is_closed() && (health.signed_volume / 0.02 - 1.0).abs() < 5e-3, "{health:?}");
    assert!((health.bounds.min.y + 0.05).abs() < 0.003 && health.bounds.max.y == 0.02, "{:?}", health.bounds);
    // There is no room for it above a table.
    over.add_object("table", shapes::rectangle(Vec3::new(-1.0, -0.01, 2.0), Vec3::X * 3.0, Vec3::NEG_Z * 3.0), 0);
    assert!(add_defect(&mut over, &dent, &mut stream(seed)).map_or(true, |done| !is_inside(done.at)));
}

/// A bar with chamfers at 45 degrees: stains lie on its flat top as a whole.
#[test]
fn stains_do_not_cross_bevels() {
    let outline = [[-0.5, 0.0], [0.5, 0.0], [0.5, 0.4], [0.4, 0.5], [-0.4, 0.5], [-0.5, 0.4]];
    let at = |i: usize, z: f32| Vec3::new(outline[i % 6][0], outline[i % 6][1], z);
    let side = |i: usize| [at(i, 1.0), at(i, -1.0), at(i + 1, -1.0), at(i, 1.0), at(i + 1, -1.0), at(i + 1, 1.0)];
    let positions: Vec<Vec3> = (0..6).rev().flat_map(side).collect();
    let triangles = (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mut bar = SceneBuilder::default();
    bar.add_material(Material::default());
    bar.add_object("bar", Mesh { positions, triangles, ..Mesh::default() }, 0);
    for seed in 0..60 {
        let stain = spec_with("stain", &[0], "length = 0.2\nfacing = [0, 1, 0]");
        let done = add_defect(&mut bar.clone(), &stain, &mut stream(seed)).unwrap();
        assert!((done.at.y - 0.5).abs() < 1e-9 && done.at.x.abs() <= 0.34 + 1e-6, "{}", done.at);
    }
}

#[test]
fn bodies_of_foreign_matter_are_closed_and_have_their_size() {
    for kind in ["dust", "fibre", "bubble", "inclusion"] {
        for seed in 0..10 {
            let mut b = scene();
            let on = if INSIDE.contains(&kind) { 1 } else { 0 };
            let done = add_defect(&mut b, &spec(kind, &[on]), &mut stream(seed)).unwrap();
            let health = MeshHealth::from_mesh(&b.meshes.last().unwrap().mesh);
            assert!(health.is_closed() && health.signed_volume > 0.0, "{kind:?} {health:?}");
            let range = if kind == "fibre" { 0.04..0.053 } else { 0.04..0.0501 };
            assert!(range.contains(&done.extent), "{kind:?} {}", done.extent);
            if kind == "dust" {
                let heights = placed(&b).0.into_iter().map(|p| (p - done.at).dot(done.normal));
                let lowest = heights.fold(f64::INFINITY, f64::min);
                assert!((-0.0025..0.0).contains(&lowest), "{lowest}");
            }
        }
    }
}

#[test]
fn bubbles_lie_inside_and_are_uniform() {
    let b = scene();
    let (n, mut counts, mut stream) = (4000, [0u32; 8], stream(9));
    for _ in 0..n {
        let mut b = b.clone();
        let done = add_defect(&mut b, &spec("bubble", &[1]), &mut stream).unwrap();
        let (low, high) = (DVec3::new(2.0, 0.0, 0.0), DVec3::new(3.0, 0.5, 0.3));
        let margin = (done.at - low).min(high - done.at).min_element();
        assert!(margin >= 0.025, "{margin}");
        assert!(placed(&b).0.iter().all(|p| p.cmpgt(low).all() && p.cmplt(high).all()));
        let share = (done.at - low - 0.0255) / (high - low - 0.051);
        let bit = |v: f64| usize::from(v > 0.5);
        counts[4 * bit(share.x) + 2 * bit(share.y) + bit(share.z)] += 1;
    }
    let expected = f64::from(n) / 8.0;
    let chi: f64 = counts.iter().map(|c| (f64::from(*c) - expected).powi(2) / expected).sum();
    assert!(chi < bound(7.0), "chi-squared {chi} of 7 degrees, {counts:?} (false alarm rate 1e-9)");
}

#[test]
fn the_result_depends_on_the_stream_alone() {
    for kind in SURFACE.into_iter().chain(CUT).chain(INSIDE).chain(CHANGE) {
        let on = if INSIDE.contains(&kind) || CUT.contains(&kind) { 1 } else { 0 };
        let run = |seed| {
            let mut b = if CUT.contains(&kind) { block() } else { scene() };
            let done = add_defect(&mut b, &spec(kind, &[on]), &mut stream(seed)).unwrap();
            (done, format!("{:?}", b.instances), placed(&b).1)
        };
        assert_eq!(run(1), run(1), "{kind:?}");
        if !matches!(kind, "missing" | "faded") {
            assert_ne!(run(1), run(2), "{kind:?}");
        }
    }
}

#[test]
fn every_defect_compiles_without_repairs_and_moves_with_its_body() {
    let mut b = scene();
    b.shutter = Some(dunkelfeld_scene::Shutter::Frame { exposure: 1e-3 });
    let motion = RigidMotion::linear(DVec3::X);
    b.instances[0].motion = motion;
    b.instances[1].motion = motion;
    for kind in SURFACE.into_iter().chain(INSIDE) {
        for on in if INSIDE.contains(&kind) { 1..2 } else { 0..2 } {
            let seed = 10 + on as u64;
            add_defect(&mut b, &spec_with(kind, &[on], "width = 0.004"), &mut stream(seed)).unwrap();
            assert_eq!(b.instances.last().unwrap().motion, motion, "{kind:?}");
        }
    }
    b.add_camera("camera", DVec3::new(0.0, 0.0, 8.0), DVec3::ZERO, 0.8);
    let (_, report) = b.build().unwrap();
    let about = |f: &&dunkelfeld_scene::Finding| f.place.contains("defect") && f.message.contains("remove");
    assert!(!report.findings.iter().any(|f| about(&f)), "{:?}", report.findings);
}

#[test]
fn changed_objects_have_copies_of_what_they_share() {
    for kind in CHANGE {
        let mut b = scene();
        let mut twin = b.instances[0].clone();
        twin.name = "twin".into();
        b.instances.push(twin);
        let before = b.clone();
        let done = add_defect(
            &mut b,
            &spec_with(kind, &[0], if kind == "shifted" { "angle = '0.5rad'" } else { "" }),
            &mut stream(4),
        )
        .unwrap();
        assert_eq!((b.instances[0].name.as_str(), done.on.as_str(), done.host), ("ball", "ball", 0));
        let twin = b.instances.last().unwrap();
        assert_eq!((&twin.meshes, twin.to_world), (&before.instances[4].meshes, before.instances[4].to_world));
        assert_eq!(b.materials[b.meshes[twin.meshes[0]].material], before.materials[0]);
        let own = &b.meshes[b.instances[0].meshes[0]];
        assert!(Arc::ptr_eq(&own.mesh, &before.meshes[0].mesh), "the triangles are not copied");
        let m = &b.materials[own.material];
        match kind {
            "missing" => assert!(m.alpha.factor < 1.0 && m.alpha_mode == AlphaMode::Mask { cutoff: 1.0 }),
            "faded" => assert_eq!((m.alpha.factor, m.alpha_mode), (0.5, AlphaMode::Blend)),
            _ => {
                let moved = b.instances[0].to_world.translation - before.instances[0].to_world.translation;
                assert!((moved.length() - 0.05).abs() < 1e-12 && moved.dot(done.normal).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn what_cannot_be_made_is_refused() {
    let refused = |spec: DefectSpec, word: &str| {
        let mut b = scene();
        let before = format!("{:?}", b.instances);
        let error = add_defect(&mut b, &spec, &mut stream(1)).unwrap_err();
        assert!(error.problem.contains(word), "{error:?}");
        assert_eq!(before, format!("{:?}", b.instances));
    };
    for kind in SURFACE.into_iter().chain(INSIDE) {
        let on: &[usize] = if INSIDE.contains(&kind) { &[1] } else { &[0] };
        for length in ["0.0", "-1.0", "nan", "inf"] {
            let fault = Defect::read(kind, &table(kind, &format!("length = {length}"))).unwrap_err();
            assert_eq!(
                (fault.path, fault.help.contains("above 0")),
                (vec!["length".to_owned()], true),
                "{kind}: {length}"
            );
        }
        let large = if kind == "scratch" { "depth = 0.01" } else { "" };
        let large = format!("length = 30.0\nwidth = 0.1\n{large}");
        if kind != "dust" {
            refused(spec_with(kind, if on == [0] { &[2] } else { on }, &large), "no room");
        }
        refused(spec(kind, &[3]), "emits light");
        assert!(Defect::read(kind, &table(kind, "roughness = nan")).is_err());
    }
    refused(spec_with("dust", &[2], "facing = [0, -1, 0]"), "faces the direction");
    refused(spec_with("scratch", &[0], "depth = 0.002"), "too deep");
    for (kind, value) in
        [("scratch", "width = nan"), ("dent", "depth = nan"), ("stain", "strength = 2"), ("dust", "facing = [0, 0, 0]")]
    {
        assert!(Defect::read(kind, &table(kind, value)).is_err(), "{value}");
    }
    refused(spec("bubble", &[0]), "no candidate is a clear solid");
    refused(spec("faded", &[1]), "cannot fade");
    let mut b = scene();
    Arc::make_mut(&mut b.meshes[1].mesh).triangles.pop();
    let error = add_defect(&mut b, &spec("bubble", &[1]), &mut stream(1)).unwrap_err();
    assert!(error.problem.contains("not closed"), "{error:?}");
}

#[test]
fn rays_pass_a_missing_object_unchanged() {
    for material in [
        Material::default(),
        Material { transmission: 0.7.into(), base_color: Rgb::new(0.9, 0.5, 0.1).into(), ..Material::default() },
        clear(),
    ] {
        let mut b = SceneBuilder::default();
        b.add_material(material);
        b.add_object("ball", shapes::sphere(Vec3::ZERO, 0.5, 16, true), 0);
        b.add_camera("camera", DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, 0.5);
        add_defect(&mut b, &spec("missing", &[0]), &mut stream(1)).unwrap();
        let (scene, _) = b.build().unwrap();
        // The ray passes the middle of the scene, wherever its origin is.
        let ray = dunkelfeld_geometry::Ray::with_end(Vec3::new(0.03, 0.02, 2.0), Vec3::NEG_Z, 4.0);
        assert_eq!(scene.shadow_transmittance(&ray, &dunkelfeld_scene::Interior::OUTSIDE), Rgb::WHITE);
        let hit = scene.intersect(&ray).unwrap();
        assert_eq!(scene.coverage(&hit, ray.direction), 0.0);
    }
}
