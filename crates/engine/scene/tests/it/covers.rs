//! Clear covers: detection, assembly of stacks, and the chains of a flat stack. They must pass the real meshes as in
//! the plate that replaces the stack.
//!
//! Replay: `cargo test -p dunkelfeld-scene --test it covers::NAME`.

use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, Ray, Vec2, Vec3};
use dunkelfeld_lanes::MAX_WIDTH;
use dunkelfeld_scene::covers::Wanted;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sheet, sphere, turned};
use dunkelfeld_scene::{AlphaMode, Chain, Effect, Material, Scene, SceneBuilder, Surface, Targets, Volume};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

fn clear(name: &str, ior: f32) -> Material {
    let surface = Surface::Solid(Volume::default());
    Material { name: name.into(), transmission: 1.0.into(), roughness: 0.0.into(), ior, surface, ..Material::default() }
}

/// A scene of objects and a floor far below, which lights and rays can hit.
fn scene(objects: Vec<(Mesh, Material)>) -> Scene {
    builder(objects).build().expect("the scene is valid").0
}

fn builder(objects: Vec<(Mesh, Material)>) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    for (k, (mesh, material)) in objects.into_iter().enumerate() {
        let m = b.add_material(material);
        b.add_object(&format!("object {k}"), mesh, m);
    }
    let m = b.add_material(Material { name: "floor".into(), ..Material::default() });
    b.add_object("floor", rectangle(Vec3::new(-0.2, -0.2, -0.3), Vec3::X * 0.4, Vec3::Y * 0.4), m);
    b
}

/// A plate of 80 mm x 60 mm between two heights \[m\].
fn plate(low: f32, high: f32) -> Mesh {
    cuboid(Vec3::new(-0.04, -0.03, low), Vec3::new(0.04, 0.03, high))
}

/// One number of a stream that is the same in every run, in [0, 1).
fn uniform(random: &mut Pcg32) -> f64 {
    f64::from(random.next_u32()) / 4_294_967_296.0
}

/// A sheet of 80 mm x 60 mm, with `height(side, x, y)` of its lower (0) and upper (1) face; x and y in \[-1, 1\].
fn moulded(cells: u32, height: impl Fn(usize, f64, f64) -> f64) -> Mesh {
    sheet(Vec2::new(0.04, 0.03), cells, |side, x, y| height(side, x / 0.04, y / 0.03))
}

fn assert_near(a: f64, b: f64, tolerance: f64, what: &str) {
    assert!((a - b).abs() <= tolerance, "{what}: {a} against {b}");
}

#[test]
fn a_flat_cover_is_detected_and_listed_with_its_material() {
    let scene = scene(vec![(plate(0.001, 0.005), clear("pmma", 1.49))]);
    let [stack] = scene.covers() else { panic!("{} stacks", scene.covers().len()) };
    assert!(stack.is_flat());
    assert_near(stack.axis().z.abs(), 1.0, 1e-12, "axis");
    // Coordinates of f32 around 0.15 m go in steps of 1.5e-8 m.
    assert_near(stack.thickness(1), 0.004, 2e-8, "thickness");
    assert!(stack.thickness(0).is_infinite() && stack.thickness(2).is_infinite() && stack.thickness(9).is_infinite());
    let layers: Vec<f64> = stack.layers().iter().map(|l| l.ior).collect();
    assert_eq!(layers, [1.0, f64::from(1.49f32), 1.0]);
    for interface in stack.interfaces() {
        let size = interface.footprint[1] - interface.footprint[0];
        assert_near(size.max_element(), 0.08, 2e-8, "length");
        assert_near(size.min_element(), 0.06, 2e-8, "width");
        assert!(interface.deviation < 2e-8);
    }
    assert_eq!(scene.effects().users(Effect::CoverConnection), ["material \"pmma\""]);
    // Its faces belong to it, the floor does not.
    let down = |x: f32| Ray::new((DVec3::new(x.into(), 0.0, 1.0) - scene.world_origin()).as_vec3(), Vec3::NEG_Z);
    let [cover, floor] = [0.0, 0.1].map(|x| scene.intersect(&down(x)).expect("something is below"));
    assert_eq!((scene.cover_of(&cover), scene.cover_of(&floor)), (Some(0), None));
}

#[test]
fn other_objects_are_not_detected_as_covers() {
    let pmma = || clear("pmma", 1.49);
    let rough = Material { roughness: 0.2.into(), ..pmma() };
    let half = Material { transmission: 0.5.into(), ..pmma() };
    let partly = Material { alpha: 0.5.into(), alpha_mode: AlphaMode::Blend, ..pmma() };
    let thin = Material { surface: Surface::Thin, ..pmma() };
    let shining = Material { emission: dunkelfeld_radiometry::Rgb::WHITE.into(), ..pmma() };
    let milky = Volume { scattering: dunkelfeld_radiometry::Rgb::splat(100.0), ..Volume::default() };
    let milky = Material { surface: Surface::Solid(milky), ..pmma() };
    let thin_plate = || plate(0.001, 0.005);
    let cases = [
        ("a ball", sphere(Vec3::ZERO, 0.03, 40, true), pmma()),
        ("a cube", cuboid(Vec3::splat(-0.02), Vec3::splat(0.02)), pmma()),
        ("a bar", cuboid(Vec3::splat(-0.002), Vec3::new(0.1, 0.002, 0.002)), pmma()),
        ("a thick block", plate(0.0, 0.031), pmma()),
        ("a rough sheet", thin_plate(), rough),
        ("a mixed one", thin_plate(), half),
        ("one that is partly there", thin_plate(), partly),
        ("a sheet without thickness", thin_plate(), thin),
        ("a lamp", thin_plate(), shining),
        ("a milky one", thin_plate(), milky),
        ("one of air", thin_plate(), clear("air", 1.0)),
    ];
    for (what, mesh, material) in cases {
        let scene = scene(vec![(mesh, material)]);
        assert!(scene.covers().is_empty(), "{what} is no cover");
        assert!(!scene.effects().has(Effect::CoverConnection));
    }
    assert_eq!(scene(vec![(plate(0.0, 0.029), pmma())]).covers().len(), 1, "just thin enough");
}

#[test]
fn covers_are_detected_at_any_position_and_rotation() {
    // Tilted, scaled unevenly, mirrored, far from the origin; moved to render space, or instanced among many triangles.
    for (mirror, instanced) in [(1.0, false), (-1.0, false), (1.0, true), (-1.0, true)] {
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.5);
        let place = DAffine3::from_scale_rotation_translation(
            DVec3::new(mirror * 1.5, 0.8, 2.0),
            turn,
            DVec3::new(40.0, 7.0, -3.0),
        );
        let mut mesh = plate(0.001, 0.005);
        if instanced {
            // Copies are instanced where they hold many triangles: the upper face as a fine grid.
            mesh = moulded(70, |side, _, _| 0.001 + 0.004 * side as f64);
        }
        let mut b = builder(vec![(mesh, clear("pmma", 1.49))]);
        b.instances[0].to_world = place;
        if instanced {
            let mut twin = b.instances[0].clone();
            twin.to_world = DAffine3::from_translation(DVec3::new(40.0, 7.0, -4.0));
            b.instances.push(twin);
        }
        let scene = b.build().expect("valid").0;
        assert_eq!(scene.summary().instanced_parts, if instanced { 2 } else { 0 });
        assert_eq!(scene.covers().len(), if instanced { 2 } else { 1 }, "mirror {mirror}");
        let stack = scene.covers().iter().max_by(|a, b| a.thickness(1).total_cmp(&b.thickness(1))).expect("a cover");
        assert_near(stack.axis().dot(turn * DVec3::Z).abs(), 1.0, 1e-9, "axis");
        // Thickness along z is doubled; f32 knows places 40 m away to 4 micrometres when they are baked around the
        // origin.
        assert_near(stack.thickness(1), 0.008, 2e-6, "thickness");
        assert!(stack.is_flat());
    }
}

#[test]
fn a_moulded_cover_is_found_and_is_not_flat() {
    let bulge = |sagitta: f64| {
        move |side: usize, x: f64, y: f64| {
            0.001 + 0.004 * side as f64 + sagitta * (1.0 + 0.5 * side as f64) * (1.0 - x * x) * (1.0 - y * y)
        }
    };
    let scene_of = |sagitta: f64| scene(vec![(moulded(24, bulge(sagitta)), clear("pmma", 1.49))]);
    let scene = scene_of(0.0006);
    let [stack] = scene.covers() else { panic!("{} stacks", scene.covers().len()) };
    assert!(!stack.is_flat());
    assert_near(stack.axis().z.abs(), 1.0, 1e-4, "axis");
    // The mean of (1 - x^2)(1 - y^2) is 4/9.
    assert_near(stack.thickness(1), 0.004 + 0.0003 * 4.0 / 9.0, 2e-6, "mean thickness");
    assert!(stack.interfaces().iter().all(|i| i.deviation > 3e-4 && i.deviation < 6e-4));
    assert!(scene_of(0.0).covers()[0].is_flat(), "a fine grid may well be a plane");
    // Planes with the shading normals of a round face refract light as a round face.
    let mut mesh = moulded(24, bulge(0.0006));
    mesh.positions = moulded(24, bulge(0.0)).positions;
    let scene = self::scene(vec![(mesh, clear("pmma", 1.49))]);
    assert!(!scene.covers()[0].is_flat());
}

#[test]
fn chamfers_engravings_and_holes_do_not_prevent_detection() {
    let chamfered = [(0.0, 0.001), (0.0397, 0.001), (0.04, 0.0013), (0.04, 0.0047), (0.0397, 0.005), (0.0, 0.005)];
    let engraved = [
        (0.01, 0.001),
        (0.02, 0.001),
        (0.02, 0.0012),
        (0.022, 0.0012),
        (0.022, 0.001),
        (0.04, 0.001),
        (0.04, 0.005),
        (0.01, 0.005),
    ];
    for (what, outline) in [("chamfers", &chamfered[..]), ("a hole and an engraved ring", &engraved[..])] {
        let outline: Vec<Vec2> = outline.iter().map(|&p| Vec2::from(p)).collect();
        let scene = scene(vec![(turned(&outline, 24), clear("pmma", 1.49))]);
        let [stack] = scene.covers() else { panic!("{what}: {} stacks", scene.covers().len()) };
        assert!(stack.is_flat(), "{what}");
        assert_near(stack.thickness(1), 0.004, 2e-8, what);
        assert_near(stack.axis().z.abs(), 1.0, 1e-9, what);
    }
}

/// Indices of the layers of the only stack, and the thickness of the inner ones \[mm\].
fn layers(scene: &Scene) -> (Vec<f32>, Vec<f64>) {
    let [stack] = scene.covers() else { panic!("{} stacks", scene.covers().len()) };
    // In canonical order, for either direction of the axis: first the side with the smaller index, else with the
    // thinner layer.
    let mut iors: Vec<f32> = stack.layers().iter().map(|l| l.ior as f32).collect();
    let mut thick: Vec<f64> = (1..iors.len() - 1).map(|l| (stack.thickness(l) * 1e6).round() / 1e3).collect();
    if stack.axis().z < 0.0 {
        iors.reverse();
        thick.reverse();
    }
    (iors, thick)
}

#[test]
fn sheets_above_each_other_are_one_stack() {
    let (pmma, film) = (|| clear("pmma", 1.49), || clear("film", 1.58));
    // With air between them.
    let gapped = scene(vec![(plate(0.001, 0.005), pmma()), (plate(0.0055, 0.006), film())]);
    assert_eq!(layers(&gapped), (vec![1.0, 1.49, 1.0, 1.58, 1.0], vec![4.0, 0.5, 0.5]));
    // Glued: one face between them; sunk in by a micrometre as well.
    for film_at in [0.005, 0.004_999] {
        let glued = scene(vec![(plate(0.001, 0.005), pmma()), (plate(film_at, 0.006), film())]);
        let (iors, thickness) = layers(&glued);
        assert_eq!(iors, [1.0, 1.49, 1.58, 1.0]);
        assert_near(thickness[0], 4.0, 1e-3, "the cover");
        assert_near(thickness[1], 1.0, 1e-3, "the film");
        assert_eq!(glued.covers()[0].interfaces().len(), 3);
    }
    // Glued to a sheet of the same index: no face at all.
    let alike = scene(vec![(plate(0.001, 0.005), pmma()), (plate(0.005, 0.006), clear("other pmma", 1.49))]);
    assert_eq!(layers(&alike), (vec![1.0, 1.49, 1.0], vec![5.0]));
    assert_eq!(alike.covers()[0].layers()[1].materials.len(), 2);
    assert_eq!(alike.effects().users(Effect::CoverConnection).len(), 2);
    // An air gap of ten micrometres is one.
    let narrow = scene(vec![(plate(0.001, 0.005), pmma()), (plate(0.005_01, 0.006), film())]);
    assert_eq!(layers(&narrow).0.len(), 5);
}

/// The end of a connection on a light.
#[derive(Clone, Copy)]
enum Target {
    Point(Vec3),
    Direction(Vec3),
}

impl Target {
    fn of_a_lane(self) -> Targets<f32> {
        let (Self::Point(v) | Self::Direction(v)) = self;
        Targets { point: v.into(), direction: v.into(), is_finite: matches!(self, Self::Point(_)) }
    }
}

/// A chain, its first direction and its probability.
type Candidate = (Chain, Vec3, f32);

/// The candidate of a given chain through the first stack.
fn candidate(scene: &Scene, x: Vec3, inside: Option<u32>, target: Target, chain: Chain) -> Option<Candidate> {
    let given = Wanted::Given([(0, chain); MAX_WIDTH]);
    let found = scene.choose_chains::<f32>(given, true, x.into(), &[inside; MAX_WIDTH], &target.of_a_lane());
    assert!(!found.is_some || found.chain[0] == (0, chain));
    found.is_some.then(|| (chain, found.direction.into(), found.probability))
}

/// All candidates through the first stack, if it is the only one.
fn candidates(scene: &Scene, x: Vec3, inside: Option<u32>, target: Target) -> Vec<Candidate> {
    let [stack] = scene.covers() else { panic!("{} stacks", scene.covers().len()) };
    let layers = stack.layers().len() as u8;
    let mut chains: Vec<Chain> = Vec::new();
    for chain in (0..layers * layers).flat_map(|k| stack.chains(k / layers, k % layers)) {
        if !chains.contains(chain) {
            chains.push(*chain);
        }
    }
    let found: Vec<Candidate> =
        chains.into_iter().filter_map(|chain| candidate(scene, x, inside, target, chain)).collect();
    let sum: f32 = found.iter().map(|(_, _, probability)| probability).sum();
    assert!(found.is_empty() || (sum - 1.0).abs() < 1e-5, "the probabilities sum to {sum}");
    for (chain, direction, probability) in &found {
        assert!((direction.length() - 1.0).abs() < 1e-6 && *probability > 0.0, "{chain:?}: {direction}, {probability}");
    }
    found
}

/// The names of chains.
fn words(candidates: &[Candidate]) -> Vec<String> {
    candidates.iter().map(|(chain, _, _)| format!("{chain:?}")).collect()
}

/// Traces a chain through the real scene by Snell's law in f64. Returns its events, and the distance at which it passes
/// `y`; `None` if it hits anything except the stack's faces.
fn trace(scene: &Scene, x: Vec3, &(chain, direction, _): &Candidate, mut inside: f64, y: Vec3) -> Option<f64> {
    let mut direction = direction.as_dvec3();
    let mut origin = x;
    for event in 0..chain.events() {
        let hit = scene.intersect(&Ray::new(origin, direction.as_vec3()))?;
        scene.cover_of(&hit)?;
        let n = hit.normal.as_dvec3();
        if n.z.abs() < 0.99 {
            return None; // The rim is no interface of the stack.
        }
        // From either side: the index behind the face is that of the solid, of air, or of the next solid.
        let cosine = -direction.dot(n);
        let facing = n * cosine.signum();
        if chain.is_reflection(event) {
            direction += facing * (2.0 * cosine.abs());
        } else {
            let just_behind = hit.point + direction.as_vec3() * 2e-5;
            let around = scene.interior_at(just_behind);
            let behind = scene.material_inside(&around).map_or(1.0, |m| f64::from(scene.materials()[m as usize].ior));
            let ratio = inside / behind;
            let square = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
            if square < 0.0 {
                return None;
            }
            direction = direction * ratio + facing * (ratio * cosine.abs() - square.sqrt());
            inside = behind;
        }
        direction = direction.normalize();
        origin = hit.ray_origin(direction.as_vec3());
    }
    let way = y.as_dvec3() - origin.as_dvec3();
    // Nothing may be in between, and the chain must have the right direction.
    let reach = way.dot(direction);
    let shadow = Ray::with_end(origin, direction.as_vec3(), (reach * 0.999) as f32);
    (reach > 0.0 && scene.intersect(&shadow).is_none()).then(|| way.cross(direction).length())
}

#[test]
fn chains_may_start_in_a_scattering_solid_in_contact_with_the_stack() {
    let milky = |ior| {
        let volume = Volume { scattering: dunkelfeld_radiometry::Rgb::splat(100.0), ..Volume::default() };
        Material { surface: Surface::Solid(volume), ..clear("milky", ior) }
    };
    let of = |top: f32, ior| scene(vec![(plate(0.001, 0.005), clear("pmma", 1.49)), (plate(-0.02, top), milky(ior))]);
    let words = |scene: &Scene, inside, to: f64| -> Vec<String> {
        let at = |z: f64| (DVec3::new(0.0, 0.0, z) - scene.world_origin()).as_vec3();
        words(&candidates(scene, at(-0.003), inside, Target::Point(at(to))))
    };
    // With the same index: no face between them. With another one: a face that refracts and reflects.
    assert_eq!(words(&of(0.001, 1.49), Some(1), 0.2), ["T"]);
    assert_eq!(words(&of(0.001, 1.6), Some(1), 0.2), ["TT", "TRRT", "TRRRRT"]);
    assert_eq!(words(&of(0.001, 1.49), Some(1), -0.2), [""; 0], "light from the other side");
    // With air between them its own face would occlude the light.
    assert_eq!(words(&of(0.0, 1.49), Some(1), 0.2), [""; 0]);
    let scene = of(0.001, 1.6);
    let at = |z: f64| (DVec3::new(0.001, 0.0, z) - scene.world_origin()).as_vec3();
    let (x, y) = (at(-0.003), (DVec3::new(0.1, 0.03, 0.2) - scene.world_origin()).as_vec3());
    let found = candidates(&scene, x, Some(1), Target::Point(y));
    assert_eq!(found.len(), 3, "through the cover");
    for candidate in found {
        // The faces in contact have one normal, so either of them gives the same result.
        let miss = trace(&scene, x, &candidate, f64::from(1.6f32), y);
        assert!(miss.is_none_or(|miss| miss < 1e-6), "{candidate:?}: {miss:?}");
    }
}

#[test]
fn chains_connect_the_layers_of_receiver_and_light() {
    let scene = scene(vec![(plate(0.001, 0.005), clear("pmma", 1.49)), (plate(0.006, 0.0065), clear("film", 1.58))]);
    let stack = &scene.covers()[0];
    let at = |z: f64| (DVec3::new(0.0, 0.0, z) - scene.world_origin()).as_vec3();
    let words = |from: f64, to: Target| words(&candidates(&scene, at(from), None, to));
    // From between the sheets only one of them is crossed.
    assert_eq!(words(0.0055, Target::Point(at(0.2))), ["TT", "TRRT", "TRRRRT"]);
    assert_eq!(words(0.2, Target::Point(at(0.0055))), ["TT", "TRRT", "TRRRRT"]);
    let all = words(0.0, Target::Point(at(0.2)));
    assert_eq!(all.len(), dunkelfeld_scene::covers::MAX_CHAINS);
    assert_eq!(all[0], "TTTT");
    assert_eq!(words(0.0, Target::Direction(Vec3::Z)), all);
    assert_eq!(words(0.0, Target::Direction(Vec3::NEG_Z)), [""; 0], "away from the covers");
    assert_eq!(words(0.0, Target::Point(at(-0.2))), [""; 0], "on the same side");
    assert_eq!(stack.chains(0, 99), []);
}

#[test]
fn no_chain_through_the_cover_is_excluded() {
    // Chains are computed with a sheet that is wide enough for all, and traced through a sheet whose rim many of them
    // miss.
    let square = |half: f32| cuboid(Vec3::new(-half, -half, 0.001), Vec3::new(half, half, 0.003));
    let (wide, small) = (
        scene(vec![(square(0.19), clear("pmma", 1.49))]),
        scene(vec![
            (square(0.02), clear("pmma", 1.49)),
            (sphere(Vec3::new(0.0, 0.0, -0.25), 0.01, 3, false), Material::default()),
        ]),
    );
    let mut random = Pcg32::seed_from_u64(5);
    let (mut passes, mut excluded) = (0, 0);
    for _ in 0..3000 {
        let [a, b, c, d, e, f] = std::array::from_fn(|_| uniform(&mut random));
        let x = DVec3::new(0.15 * (a - 0.5), 0.15 * (b - 0.5), -0.02 * e);
        let y = DVec3::new(0.15 * (c - 0.5), 0.15 * (d - 0.5), 0.004 + 0.03 * f);
        let in_scene = |scene: &Scene, p: DVec3| (p - scene.world_origin()).as_vec3();
        let all = candidates(&wide, in_scene(&wide, x), None, Target::Point(in_scene(&wide, y)));
        assert_eq!(all.len(), 3, "wide enough");
        let [sx, sy] = [x, y].map(|p| in_scene(&small, p));
        let may = words(&candidates(&small, sx, None, Target::Point(sy)));
        excluded += usize::from(may.is_empty());
        for candidate in all {
            if trace(&small, sx, &candidate, 1.0, sy).is_some() {
                passes += 1;
                assert!(may.contains(&format!("{:?}", candidate.0)), "{candidate:?} leads from {x} to {y}");
            }
        }
    }
    assert!(passes > 300 && excluded > 1000, "{passes} chains pass, {excluded} connections are excluded");
}
