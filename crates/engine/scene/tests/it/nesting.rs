//! Solids that touch, overlap and contain each other: the solid that fills a place, and the interfaces along a ray.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it nesting`.

use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{keyed_stream, mix64};
use dunkelfeld_scene::shapes::{cuboid, sphere};
use dunkelfeld_scene::{Boundary, Interior, Material, Scene, SceneBuilder, Surface, Volume};
use rand_core::Rng;

struct Uniform(dunkelfeld_sampling::Pcg);

impl Uniform {
    fn new(key: u64) -> Self {
        Self(keyed_stream(37, 0, 0, mix64(key)))
    }

    /// Uniform in [-1, 1).
    fn next(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vector();
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}

fn solid(name: &str, ior: f32, priority: i32) -> Material {
    let volume = Volume { priority, absorption: Rgb::splat(ior), ..Volume::default() };
    Material {
        name: name.into(),
        ior,
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        surface: Surface::Solid(volume),
        ..Material::default()
    }
}

/// A scene of solids, each a mesh with an index of refraction, a priority and a place.
fn scene(solids: Vec<(&str, Mesh, f32, i32, DAffine3)>) -> Scene {
    let mut b = SceneBuilder::default();
    for (name, mesh, ior, priority, place) in solids {
        let m = b.add_material(solid(name, ior, priority));
        let object = b.add_object(name, mesh, m);
        b.instances[object].to_world = place;
    }
    b.build().expect("valid").0
}

fn name_inside<'a>(scene: &'a Scene, inside: &Interior) -> &'a str {
    scene.material_inside(inside).map_or("air", |m| &scene.materials()[m as usize].name)
}

/// Traces a ray straight through everything, from outside. Calls `seen` with the indices at each interface between two
/// media. Returns the interior at the end.
fn trace_materials(scene: &Scene, mut ray: Ray, mut seen: impl FnMut(&Ray, &str, &str, f32)) -> Interior {
    let mut inside = scene.interior_at(ray.origin);
    for _ in 0..1000 {
        let Some(hit) = scene.intersect(&ray) else { return inside };
        let interface = scene.interface(&ray, &hit, &inside);
        let far = interface.beyond(ray.direction);
        if let Boundary::Between { eta } = interface.boundary {
            let (before, after) = (name_inside(scene, &inside), name_inside(scene, &far));
            let outward = ray.direction.dot(interface.surface.normal) > 0.0;
            seen(&ray, before, after, if outward { 1.0 / eta } else { eta });
        }
        assert_eq!(interface.beyond(-ray.direction), inside, "a ray that turns back is where it was");
        inside = far;
        ray = Ray::new(interface.surface.ray_origin(ray.direction), ray.direction);
    }
    panic!("a ray that does not end");
}

/// Two boxes that share the face x = 0.1, glass on the left, water on the right, turned and placed anywhere.
fn touching(order: [usize; 2], place: DAffine3, priorities: [i32; 2]) -> Scene {
    let glass = ("glass", cuboid(Vec3::new(-0.2, -0.1, -0.3), Vec3::new(0.1, 0.2, 0.3)), 1.5, priorities[0], place);
    let water = ("water", cuboid(Vec3::new(0.1, -0.1, -0.3), Vec3::new(0.4, 0.2, 0.3)), 1.33, priorities[1], place);
    let list = [glass, water];
    scene(order.map(|i| list[i].clone()).to_vec())
}

#[test]
fn touching_boxes_share_one_interface_in_either_order_and_anywhere() {
    let turned = DAffine3::from_rotation_translation(
        DQuat::from_axis_angle(DVec3::new(0.48, 0.6, -0.64), 1.1),
        DVec3::new(3.0, -20.0, 0.7),
    );
    let far = DAffine3::from_translation(DVec3::new(1000.0, 0.0, -1000.0));
    let mut u = Uniform::new(1);
    for place in [DAffine3::IDENTITY, far, turned] {
        for (order, priorities) in [([0, 1], [2, 1]), ([1, 0], [2, 1]), ([0, 1], [1, 2]), ([1, 0], [0, 0])] {
            let scene = touching(order, place, priorities);
            assert!(scene.has_nesting());
            let to_render = |p: DVec3| (place.transform_point3(p) - scene.world_origin()).as_vec3();
            let mut crossed = 0;
            for k in 0..3000 {
                // Through the shared face, from left or right, at all angles.
                let at = DVec3::new(0.1, 0.05 + 0.14 * f64::from(u.next()), 0.29 * f64::from(u.next()));
                let d = u.direction();
                let side = if k % 2 == 0 { -1.0 } else { 1.0 };
                let origin = to_render(at - side * d.as_dvec3() * f64::from(d.x.signum()));
                let ray = Ray::new(origin, (to_render(at) - origin).normalize());
                let mut pairs = Vec::new();
                let end = trace_materials(&scene, ray, |_, before, after, eta| {
                    pairs.push((before.to_owned(), after.to_owned(), eta))
                });
                assert_eq!(end, Interior::OUTSIDE, "{pairs:?}");
                for (before, after, eta) in &pairs {
                    let index = |n: &str| match n {
                        "glass" => 1.5,
                        "water" => 1.33,
                        _ => 1.0,
                    };
                    assert!((eta - index(after) / index(before)).abs() < 1e-6, "{before} to {after}: {eta}");
                }
                let names: Vec<&str> = pairs.iter().map(|p| p.0.as_str()).chain(["air"]).collect();
                let expected: [&str; 4] = if check_materials_along_ray(&ray, &place) {
                    ["air", "glass", "water", "air"]
                } else {
                    ["air", "water", "glass", "air"]
                };
                // The shared face lies 0.01 m or more inside of both boxes' other faces, except for rays that pass an
                // edge.
                assert_eq!(names, expected, "sample {k} of {order:?}, {priorities:?}");
                crossed += 1;
            }
            assert_eq!(crossed, 3000);
        }
    }
}

fn check_materials_along_ray(ray: &Ray, place: &DAffine3) -> bool {
    place.matrix3.x_axis.dot(ray.direction.as_dvec3()) > 0.0
}

#[test]
fn overlaps_belong_to_the_higher_priority_and_small_to_what_lies_inside() {
    let ball = |x: f32, r: f32| sphere(Vec3::new(x, 0.0, 0.0), r, 16, false);
    let along_x = |scene: &Scene| {
        let mut names = Vec::new();
        let start = Vec3::new(-5.0, 0.013, 0.007) - scene.world_origin().as_vec3();
        let end = trace_materials(scene, Ray::new(start, Vec3::X), |_, _, after, _| names.push(after.to_owned()));
        assert_eq!(end, Interior::OUTSIDE);
        names.join(" ")
    };
    let id = DAffine3::IDENTITY;
    let overlap = |p| scene(vec![("a", ball(0.0, 1.0), 1.5, p, id), ("b", ball(1.0, 1.0), 1.3, 0, id)]);
    assert_eq!(along_x(&overlap(1)), "a b air");
    assert_eq!(along_x(&overlap(-1)), "a b air");
    // The position of the face shows which solid fills the overlap: at x = 1 the glass ends, at x = 0 the other begins.
    for (priority, expected) in [(1, 1.0), (-1, 0.0)] {
        let scene = overlap(priority);
        let mut inside = scene.interior_at(scene_point(&scene, Vec3::new(0.5, 0.0, 0.0)));
        assert_eq!(inside.ranks().len(), 2);
        let winner = if priority > 0 { "a" } else { "b" };
        assert_eq!(name_inside(&scene, &inside), winner);
        inside.leave(inside.top().expect("two"));
        assert_ne!(name_inside(&scene, &inside), winner);
        let mut at = Vec::new();
        trace_materials(
            &scene,
            Ray::new(scene_point(&scene, Vec3::new(-5.0, 0.0, 0.0)), Vec3::X),
            |ray, before, after, _| {
                if (before, after) == ("a", "b") {
                    let hit = scene.intersect(ray).expect("a face");
                    at.push(hit.point.x + scene.world_origin().x as f32);
                }
            },
        );
        assert!(at.len() == 1 && (at[0] - expected).abs() < 1e-3, "{at:?}");
    }
    // Without priorities the inner solid fills its place, in any order of the file.
    let nested = [("shell", ball(0.0, 2.0), 1.5, 0, id), ("core", ball(0.5, 0.5), 1.3, 0, id)];
    assert_eq!(along_x(&scene(nested.to_vec())), "shell core shell air");
    assert_eq!(along_x(&scene(nested.iter().rev().cloned().collect())), "shell core shell air");
    // A shell of higher priority replaces its core.
    let mut swallowed = nested.to_vec();
    swallowed[0].3 = 3;
    assert_eq!(along_x(&scene(swallowed)), "shell air");
}

fn scene_point(scene: &Scene, p: Vec3) -> Vec3 {
    (p.as_dvec3() - scene.world_origin()).as_vec3()
}

#[test]
fn a_path_that_scatters_anywhere_keeps_its_medium() {
    // Boxes that touch with whole and with partial faces, overlap, and contain each other, some turned, one an instance
    // of a mesh with many triangles. Rays turn at random faces in random directions. At every start the interior of the
    // path must equal the one computed by `interior_at`.
    let id = DAffine3::IDENTITY;
    let tilt = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.4), DVec3::new(0.35, 0.1, 0.0));
    let cube = |lo: [f32; 3], hi: [f32; 3]| cuboid(Vec3::from_array(lo), Vec3::from_array(hi));
    let scene = scene(vec![
        ("a", cube([0.0; 3], [0.1; 3]), 1.5, 0, id),
        ("b", cube([0.1, 0.0, 0.0], [0.2, 0.1, 0.1]), 1.3, 0, id),
        ("c", cube([0.05, 0.1, 0.0], [0.15, 0.2, 0.1]), 1.4, 0, id),
        ("d", cube([0.02, 0.02, 0.02], [0.18, 0.08, 0.08]), 1.6, 1, id),
        ("e", cube([0.0, 0.0, 0.1], [0.2, 0.2, 0.10001]), 1.7, 0, id),
        ("f", cube([-0.1; 3], [0.1; 3]), 1.2, 0, tilt),
        ("g", sphere(Vec3::new(0.1, 0.1, 0.05), 0.04, 80, true), 1.8, 0, id),
    ]);
    let mut u = Uniform::new(5);
    let (mut steps, mut wrong) = (0, Vec::new());
    for _ in 0..20_000 {
        let mut ray = Ray::new(scene_point(&scene, 0.15 * u.vector() + Vec3::splat(0.1)), u.direction());
        let mut inside = scene.interior_at(ray.origin);
        for _ in 0..12 {
            let Some(hit) = scene.intersect(&ray) else { break };
            let interface = scene.interface(&ray, &hit, &inside);
            let d = u.direction();
            inside = interface.beyond(d);
            ray = Ray::new(interface.surface.ray_origin(d), d);
            steps += 1;
            let asked = scene.interior_at(ray.origin);
            if asked != inside {
                wrong.push((ray.origin, inside, asked));
                break;
            }
        }
    }
    assert!(steps > 20_000, "{steps}");
    assert!(wrong.is_empty(), "{} of {steps}: {:?}", wrong.len(), &wrong[..wrong.len().min(3)]);
}

#[test]
fn a_point_in_several_solids_is_found_in_all_of_them() {
    let id = DAffine3::IDENTITY;
    let shells: Vec<_> = (0..12)
        .map(|k| ("shell", sphere(Vec3::ZERO, 1.0 + 0.1 * k as f32, 12, false), 1.1 + 0.1 * k as f32, 0, id))
        .collect();
    let scene = scene(shells);
    for (r, expected) in [(0.0, 12), (1.02, 11), (1.55, 6), (2.05, 1), (2.5, 0)] {
        let p = scene_point(&scene, Vec3::new(0.6, 0.0, 0.8) * r);
        assert_eq!(scene.interior_at(p).ranks().len(), expected, "at radius {r}");
    }
    // The innermost is the smallest.
    let (inside, materials) = (scene.interior_at(scene_point(&scene, Vec3::ZERO)), scene.materials());
    let top = scene.material_inside(&inside).expect("a shell") as usize;
    assert!((materials[top].ior - 1.1).abs() < 1e-6);
}

#[test]
fn an_opaque_floor_in_contact_replaces_the_face_above_it() {
    // Glass on a floor in the same plane: from inside, the ray hits the floor, in any order of the faces.
    for order in [false, true] {
        let mut b = SceneBuilder::default();
        let (glass, paint) = (b.add_material(solid("glass", 1.5, 0)), b.add_material(Material::default()));
        let above = b.add_material(solid("above", 1.4, 0));
        let floor = dunkelfeld_scene::shapes::rectangle(Vec3::new(-1.0, -1.0, 0.3), Vec3::X * 2.0, Vec3::Y * 2.0);
        let body = cuboid(Vec3::new(-0.2, -0.2, 0.3), Vec3::new(0.2, 0.2, 0.5));
        if order {
            b.add_object("floor", floor.clone(), paint);
        }
        b.add_object("glass", body, glass);
        b.add_object("above", cuboid(Vec3::new(-0.2, -0.2, 0.5), Vec3::new(0.2, 0.2, 0.6)), above);
        if !order {
            b.add_object("floor", floor, paint);
        }
        let scene = b.build().expect("valid").0;
        let mut u = Uniform::new(9);
        for _ in 0..2000 {
            let from = Vec3::new(0.19 * u.next(), 0.19 * u.next(), 0.31 + 0.18 * u.next().abs());
            let to = Vec3::new(0.19 * u.next(), 0.19 * u.next(), 0.3);
            let ray = Ray::new(scene_point(&scene, from), (to - from).normalize());
            let inside = scene.interior_at(ray.origin);
            assert_eq!(name_inside(&scene, &inside), "glass");
            let hit = scene.intersect(&ray).expect("the bottom");
            let interface = scene.interface(&ray, &hit, &inside);
            assert_eq!(interface.boundary, Boundary::Surface);
            assert_eq!(scene.object_names()[scene.ids(&interface.surface).0 as usize], "floor");
            assert_eq!(interface.beyond(-ray.direction), inside);
        }
    }
}
