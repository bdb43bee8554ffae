//! Animations of nodes: the pose at a time, and the motion of the objects.

use super::support::{Asset, load_bytes};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::import::{ImportOptions, Imported};
use dunkelfeld_scene::Instance;
use serde_json::{Value, json};

/// A node "arm" at (1, 0, 0) with a child "part", which shows a triangle at (0, 2, 0) of the arm. `animate` adds the
/// animation.
fn load(time: f64, animate: impl FnOnce(&mut Asset) -> Value) -> Imported {
    let mut asset = Asset::with_primitive(|a| {
        let position = a.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        json!({"attributes": {"POSITION": position}})
    });
    asset.json["nodes"] = json!([
        {"name": "arm", "translation": [1, 0, 0], "children": [1]},
        {"name": "part", "mesh": 0, "translation": [0, 2, 0]}
    ]);
    let animation = animate(&mut asset);
    asset.json["animations"] = json!([animation]);
    let options = ImportOptions::default().with_animation_time(time);
    load_bytes(&asset.gltf(), "animated.gltf", &options).unwrap_or_else(|e| panic!("{e}"))
}

fn one(input: usize, output: usize, node: u32, path: &str, interpolation: &str) -> Value {
    json!({
        "samplers": [{"input": input, "output": output, "interpolation": interpolation}],
        "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]
    })
}

fn part(imported: &Imported) -> &Instance {
    &imported.scene.instances[0]
}

#[test]
fn a_translation_gives_pose_and_velocity() {
    // From (1, 0, 0) to (1, 0, 4) in two seconds, then at rest.
    let animate = |a: &mut Asset| {
        let input = a.floats(&[[0.0], [2.0], [3.0]]);
        let output = a.floats(&[[1.0, 0.0, 0.0], [1.0, 0.0, 4.0], [1.0, 0.0, 4.0]]);
        one(input, output, 0, "translation", "LINEAR")
    };
    for (time, z, speed) in [(0.0, 0.0, 2.0), (0.5, 1.0, 2.0), (2.5, 4.0, 0.0), (9.0, 4.0, 0.0)] {
        let imported = load(time, animate);
        let part = part(&imported);
        assert!((part.to_world.translation - DVec3::new(1.0, 2.0, z)).length() < 1e-9, "{time}");
        assert!((part.motion.velocity - DVec3::new(0.0, 0.0, speed)).length() < 1e-6, "{time}: {:?}", part.motion);
        assert!(part.motion.spin.is_none() && imported.warnings.iter().any(|w| w.message.contains("animation_time")));
    }
}

#[test]
fn a_rotation_of_a_parent_moves_its_children_on_a_circle() {
    // A quarter turn about z in half a second: pi rad/s.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let imported = load(0.25, |a| {
        let input = a.floats(&[[0.0], [0.5]]);
        let output = a.floats(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, half, half]]);
        one(input, output, 0, "rotation", "LINEAR")
    });
    let part = part(&imported);
    // The part is 2 m from the arm, at 45 degrees of the turn.
    let arm = DVec3::X;
    let expected = arm + 2.0 * DVec3::new(-0.5f64.sqrt(), 0.5f64.sqrt(), 0.0);
    assert!((part.to_world.translation - expected).length() < 1e-6);
    // Any of its points moves as on the arm, to second order of the step of the difference.
    let point = expected + DVec3::new(0.3, -0.2, 0.5);
    let velocity = std::f64::consts::PI * DVec3::Z.cross(point - arm);
    assert!((part.motion.velocity_at(point) - velocity).length() < 1e-5, "{:?}", part.motion);
}

#[test]
fn splines_have_the_velocity_of_their_tangents_and_steps_have_none() {
    let spline = load(0.0, |a| {
        let input = a.floats(&[[0.0], [1.0]]);
        let zero = [0.0; 3];
        let output = a.floats(&[zero, zero, [3.0, 0.0, 0.0], zero, zero, zero]);
        one(input, output, 1, "translation", "CUBICSPLINE")
    });
    // The difference lies within the keys and begins at the first one: an error of the order of its length.
    let velocity = part(&spline).motion.velocity;
    assert!((velocity - DVec3::new(3.0, 0.0, 0.0)).length() < 1e-2, "{velocity}");
    let steps = load(1.0, |a| {
        let input = a.floats(&[[0.0], [1.0], [2.0]]);
        let output = a.floats(&[[0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0; 3]]);
        one(input, output, 1, "translation", "STEP")
    });
    assert!(part(&steps).motion.is_static() && part(&steps).to_world.translation == DVec3::new(1.0, 5.0, 0.0));
}

#[test]
fn faults_and_changes_of_size_are_warnings() {
    let says = |imported: &Imported, part: &str| imported.warnings.iter().any(|w| w.message.contains(part));
    let growing = load(0.5, |a| {
        let input = a.floats(&[[0.0], [1.0]]);
        let output = a.floats(&[[1.0; 3], [2.0; 3]]);
        one(input, output, 1, "scale", "LINEAR")
    });
    assert!(part(&growing).motion.is_static() && says(&growing, "changes its shape"), "{:?}", growing.warnings);
    for (path, node, interpolation, times, part_of_message) in [
        ("translation", 7, "LINEAR", [[0.0f32], [1.0]], "does not exist"),
        ("translation", 1, "WAVY", [[0.0], [1.0]], "does not exist"),
        ("translation", 1, "LINEAR", [[1.0], [1.0]], "not increasing"),
        ("translation", 1, "CUBICSPLINE", [[0.0], [1.0]], "do not fit"),
        ("rotation", 1, "LINEAR", [[0.0], [1.0]], "components belong"),
    ] {
        let broken = load(0.5, |a| {
            let input = a.floats(&times);
            let output = a.floats(&[[0.0; 3], [1.0, 0.0, 0.0]]);
            one(input, output, node, path, interpolation)
        });
        assert!(part(&broken).motion.is_static() && says(&broken, part_of_message), "{:?}", broken.warnings);
    }
    // Data that is no animation is skipped.
    for odd in [json!(7), json!({"channels": 3}), json!({})] {
        assert!(part(&load(0.0, |_| odd)).motion.is_static());
    }
}
