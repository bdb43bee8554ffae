//! The inspection station around the part: housing, lights and shutter, mount, camera.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec2, DVec3};

use super::glb::{Document, Node};
use super::materials;
use super::outline::{fillet, rounded_rectangle};
use super::part::{self, Cover, FLANGE_BOTTOM};
use super::solids::{Ends, MM, circle_tube, loft, panel, rounded_box, screw, slotted_profile};

/// Half the housing's outer width and depth \[m\].
const HALF: f64 = 0.3;
/// Height of the housing's lower and upper end; 0 is the plane of the symbols \[m\].
const FOOT: f64 = -0.14;
const HEAD: f64 = 0.5;
/// Distance that keeps neighbouring bodies from touching \[m\].
const CLEARANCE: f64 = 0.05 * MM;
/// Half the width of an aluminium profile \[m\].
const PROFILE: f64 = 10.0 * MM;
/// Upper side of the mount's plate and rails: the flange rests on it \[m\].
const MOUNT_TOP: f64 = FLANGE_BOTTOM - CLEARANCE;
/// Distance of the mount's rails from the middle \[m\].
const RAIL: f64 = 52.0 * MM;

/// Meshes that several groups use.
struct Stock {
    aluminium: usize,
    plate: usize,
    /// Profile that spans the housing between its posts.
    beam: usize,
}

/// The whole scene with the chosen cover.
pub(crate) fn scene(cover: Cover) -> Document {
    let mut document = Document::default();
    let root = document.node(None, Node::new("inspection-station"));
    let aluminium = document.material(materials::aluminium("aluminium", 0.3));
    let plate = document.material(materials::dielectric("black-plate", [0.025, 0.025, 0.026], 0.4));
    let beam = document.geometry(&slotted_profile(2.0 * (HALF - 2.0 * PROFILE - CLEARANCE)));
    let stock = Stock { aluminium, plate, beam: document.mesh("profile-beam", beam, aluminium) };
    add_housing(&mut document, root, &stock);
    add_lighting(&mut document, root, &stock);
    add_mount(&mut document, root, &stock);
    part::add(&mut document, root, cover);
    add_camera(&mut document, root, &stock);
    document
}

/// Posts and beams at the edges of the box, black plates in their slots.
fn add_housing(document: &mut Document, root: usize, stock: &Stock) {
    let housing = document.node(Some(root), Node::new("housing"));
    let frame = document.node(Some(housing), Node::new("frame"));
    let (edge, middle) = (HALF - PROFILE, 0.5 * (FOOT + HEAD));
    let geometry = document.geometry(&slotted_profile(HEAD - FOOT));
    let post = document.mesh("profile-post", geometry, stock.aluminium);
    let upright = DQuat::from_rotation_z(FRAC_PI_2);
    let across = DQuat::from_rotation_y(FRAC_PI_2);
    for (z_name, z) in [("rear", -edge), ("front", edge)] {
        for (x_name, x) in [("left", -edge), ("right", edge)] {
            let node = Node::new(format!("post-{z_name}-{x_name}"));
            document.node(Some(frame), node.at(x, middle, z).turned(upright).with(post));
        }
    }
    for (y_name, y) in [("lower", FOOT + PROFILE), ("upper", HEAD - PROFILE)] {
        for (name, sign) in [("rear", -1.0), ("front", 1.0)] {
            let node = Node::new(format!("beam-{y_name}-{name}"));
            document.node(Some(frame), node.at(0.0, y, sign * edge).with(stock.beam));
        }
        for (name, sign) in [("left", -1.0), ("right", 1.0)] {
            let node = Node::new(format!("beam-{y_name}-{name}"));
            let node = node.at(sign * edge, y, 0.0).turned(across);
            document.node(Some(frame), node.with(stock.beam));
        }
    }

    let plates = document.node(Some(housing), Node::new("plates"));
    // Each plate reaches 4.8 mm into the slots around it, short of their ground, and is 4 mm thick; a slot is 6.2 mm wide.
    let reach = 4.8 * MM;
    let span = 2.0 * (HALF - 2.0 * PROFILE + reach);
    let rise = HEAD - FOOT - 4.0 * PROFILE + 2.0 * reach;
    let board = |document: &mut Document, name, size| {
        let geometry = document.geometry(&rounded_box(size, 0.6 * MM, 0.4 * MM));
        document.mesh(name, geometry, stock.plate)
    };
    let level = board(document, "plate-level", DVec3::new(span, 4.0 * MM, span));
    let wall = board(document, "plate-wall", DVec3::new(span, rise, 4.0 * MM));
    for (name, y) in [("floor", FOOT + PROFILE), ("ceiling", HEAD - PROFILE)] {
        document.node(Some(plates), Node::new(name).at(0.0, y, 0.0).with(level));
    }
    for (name, sign) in [("wall-rear", -1.0), ("wall-front", 1.0)] {
        let node = Node::new(name).at(0.0, middle, sign * edge);
        document.node(Some(plates), node.with(wall));
    }
    for (name, sign) in [("wall-left", -1.0), ("wall-right", 1.0)] {
        let node = Node::new(name).at(sign * edge, middle, 0.0).turned(across);
        document.node(Some(plates), node.with(wall));
    }
}

/// Three bars low on the walls, aimed at the part; one panel at the bottom with its shutter.
fn add_lighting(document: &mut Document, root: usize, stock: &Stock) {
    document.uses("KHR_materials_emissive_strength");
    let lighting = document.node(Some(root), Node::new("lighting"));
    let bar = DVec2::new(160.0, 24.0) * MM;
    let case = DVec3::new(172.0, 16.0, 34.0) * MM;
    let bar_case = document.geometry(&rounded_box(case, 2.0 * MM, 1.0 * MM));
    let bar_case = document.mesh("light-bar-case", bar_case, stock.plate);
    let bar_panel = document.geometry(&panel(bar));
    let (distance, height) = (0.235_f64, 0.075_f64);
    // A bar's panel faces +y; tipped forward it faces the part below, then it is turned to its wall.
    let tip = DQuat::from_rotation_x(FRAC_PI_2 + (height / distance).atan());
    for (name, turn, nits) in
        [("light-rear", 0.0, 14_000.0), ("light-left", FRAC_PI_2, 20_000.0), ("light-right", -FRAC_PI_2, 20_000.0)]
    {
        let turn = DQuat::from_rotation_y(turn);
        let at = turn * DVec3::new(0.0, height, -distance);
        let bar =
            document.node(Some(lighting), Node::new(format!("{name}-bar")).at(at.x, at.y, at.z).turned(turn * tip));
        let material = document.material(materials::emitter(name, nits));
        let mesh = document.mesh(name, bar_panel, material);
        document.node(Some(bar), Node::new(name).with(mesh));
        let behind = -0.5 * case.y - 0.5 * MM;
        let node = Node::new(format!("{name}-case")).at(0.0, behind, 0.0);
        document.node(Some(bar), node.with(bar_case));
    }

    let floor = FOOT + PROFILE + 2.0 * MM;
    let case = DVec3::new(220.0, 10.0, 180.0) * MM;
    let geometry = document.geometry(&rounded_box(case, 3.0 * MM, 1.0 * MM));
    let mesh = document.mesh("light-bottom-case", geometry, stock.plate);
    let node = Node::new("light-bottom-case").at(0.0, floor + CLEARANCE + 0.5 * case.y, 0.0);
    document.node(Some(lighting), node.with(mesh));
    let geometry = document.geometry(&panel(DVec2::new(200.0, 160.0) * MM));
    let material = document.material(materials::emitter("light-bottom", 5_000.0));
    let mesh = document.mesh("light-bottom", geometry, material);
    let node = Node::new("light-bottom").at(0.0, floor + case.y + 0.5 * MM, 0.0);
    document.node(Some(lighting), node.with(mesh));

    // Move the shutter along z to let more of the bottom light past; here a strip at the front stays open.
    let shutter = DVec3::new(230.0, 2.0, 190.0) * MM;
    let geometry = document.geometry(&rounded_box(shutter, 2.0 * MM, 0.4 * MM));
    let mesh = document.mesh("shutter", geometry, stock.plate);
    let node = Node::new("shutter").at(0.0, -0.1, -40.0 * MM);
    document.node(Some(lighting), node.with(mesh));
}

/// Two rails on posts, a plate with a window between them, and the part's flange on the plate.
fn add_mount(document: &mut Document, root: usize, stock: &Stock) {
    let mount = document.node(Some(root), Node::new("mount"));
    let rail_height = MOUNT_TOP - PROFILE;
    let foot = FOOT + PROFILE + 2.0 * MM + CLEARANCE;
    let length = rail_height - PROFILE - CLEARANCE - foot;
    let geometry = document.geometry(&slotted_profile(length));
    let post = document.mesh("profile-mount-post", geometry, stock.aluminium);
    let geometry = document.geometry(&rounded_box(DVec3::new(14.0, 3.0, 18.0) * MM, 1.5 * MM, 0.4 * MM));
    let tab = document.mesh("tab", geometry, stock.aluminium);
    let steel = document.material(materials::aluminium("screw-head", 0.2));
    let geometry = document.geometry(&screw(5.5 * MM));
    let screw = document.mesh("screw-large", geometry, steel);
    for (z_name, sign) in [("rear", -1.0), ("front", 1.0)] {
        let node = Node::new(format!("rail-{z_name}")).at(0.0, rail_height, sign * RAIL);
        document.node(Some(mount), node.with(stock.beam));
        for (x_name, x) in [("left", -150.0 * MM), ("right", 150.0 * MM)] {
            let node = Node::new(format!("mount-post-{z_name}-{x_name}"))
                .at(x, foot + 0.5 * length, sign * RAIL)
                .turned(DQuat::from_rotation_z(FRAC_PI_2));
            document.node(Some(mount), node.with(post));
        }
        for (x_name, x) in [("left", -37.0 * MM), ("right", 37.0 * MM)] {
            let lift = MOUNT_TOP + CLEARANCE + 1.5 * MM;
            let node = Node::new(format!("tab-{z_name}-{x_name}")).at(x, lift, sign * 45.6 * MM);
            let tab = document.node(Some(mount), node.with(tab));
            for (name, z) in [("inner", -5.2 * MM), ("outer", 5.2 * MM)] {
                let node = Node::new(format!("screw-{z_name}-{x_name}-{name}"))
                    .at(0.0, 1.5 * MM + CLEARANCE, sign * z)
                    .turned(DQuat::from_rotation_y(x * 700.0 + z * 900.0));
                document.node(Some(tab), node.with(screw));
            }
        }
    }

    // The flange rests on the window's front and rear edge; at its sides light from below may pass.
    let half = DVec2::new(58.0, 41.5) * MM;
    let plate = document.material(materials::dielectric("mount-plate", [0.03, 0.03, 0.032], 0.4));
    let section = [(0.0, -4.0), (0.0, 0.0), (9.0, 0.0), (9.0, -4.0)];
    let profile = fillet(&section.map(|(inset, y)| (DVec2::new(inset, y) * MM, 0.4 * MM)), true, 3);
    let ring = loft(&profile, Ends::Joined, |inset| rounded_rectangle(half - inset, 4.0 * MM, 6));
    let geometry = document.geometry(&ring.smooth(35.0));
    let mesh = document.mesh("mount-plate", geometry, plate);
    let node = Node::new("mount-plate").at(0.0, MOUNT_TOP, 0.0);
    document.node(Some(mount), node.with(mesh));
}

/// A camera on a beam, tilted down a little from the front; the pinhole sits just before the lens barrel.
fn add_camera(document: &mut Document, root: usize, stock: &Stock) {
    let (distance, tilt) = (0.39, 5.0_f64.to_radians());
    let beam = Node::new("camera-beam").at(0.0, distance + 56.0 * MM, 66.0 * MM);
    document.node(Some(root), beam.with(stock.beam));
    let assembly = Node::new("camera-assembly")
        .at(0.0, distance * tilt.cos(), distance * tilt.sin())
        .turned(DQuat::from_rotation_x(tilt - FRAC_PI_2));
    let assembly = document.node(Some(root), assembly);
    let camera = document.node(Some(assembly), Node::new("camera"));
    document.camera(camera, "camera", 2.0 * (54.5 * MM / distance).atan());

    let geometry = document.geometry(&circle_tube([8.0 * MM, 15.0 * MM], 36.0 * MM, 0.5 * MM, 48));
    let barrel = document.mesh("lens-barrel", geometry, stock.plate);
    let node = Node::new("lens-barrel").at(0.0, 0.0, 1.0 * MM).turned(DQuat::from_rotation_x(FRAC_PI_2));
    document.node(Some(assembly), node.with(barrel));
    let geometry = document.geometry(&rounded_box(DVec3::new(29.0, 29.0, 40.0) * MM, 2.0 * MM, 1.0 * MM));
    let body = document.mesh("camera-body", geometry, stock.plate);
    let node = Node::new("camera-body").at(0.0, 0.0, 58.0 * MM);
    document.node(Some(assembly), node.with(body));
}
