//! The machined bracket of `scenes/studies/bracket.toml`: a plate with chamfered edges, two holes and a slot.

use glam::DVec2;

use super::glb::{Document, Node};
use super::materials;
use super::mesh::{Mesh, Shell};
use super::outline::{circle, rounded_rectangle, triangulate};
use super::solids::{MM, at_height};

/// Outer size in plan, and radius of the corners.
const SIZE: DVec2 = DVec2::new(60.0 * MM, 36.0 * MM);
const CORNER: f64 = 5.0 * MM;
/// Height, and width of the chamfers at 45 degrees.
const HEIGHT: f64 = 8.0 * MM;
const CHAMFER: f64 = 0.4 * MM;
/// Distance of the holes from the middle, and their radius.
const HOLE: [f64; 2] = [21.0 * MM, 3.3 * MM];
/// Half sizes of the slot in the middle.
const SLOT: DVec2 = DVec2::new(9.0 * MM, 4.5 * MM);

/// The bracket as a scene of its own.
pub(crate) fn scene() -> Document {
    let mut document = Document::default();
    let aluminium = document.material(materials::aluminium("aluminium", 0.3));
    let geometry = document.geometry(&bracket());
    let mesh = document.mesh("bracket", geometry, aluminium);
    document.node(None, Node::new("bracket").with(mesh));
    document
}

/// The bracket, with its foot at the origin.
pub(crate) fn bracket() -> Mesh {
    let moved = |points: Vec<DVec2>, x: f64| points.into_iter().map(|p| p + DVec2::new(x, 0.0)).collect();
    let outer = |inset: f64| rounded_rectangle(SIZE * 0.5 - DVec2::splat(inset), CORNER - inset, 8);
    // A hole grows where the plate is inset.
    let hole = |side: f64| move |inset: f64| moved(circle(HOLE[1] + inset, 48), side * HOLE[0]);
    let slot = |inset: f64| {
        let half = SLOT + DVec2::splat(inset);
        rounded_rectangle(half, half.y * 0.999, 16)
    };
    let holes: [&dyn Fn(f64) -> Vec<DVec2>; 3] = [&hole(-1.0), &slot, &hole(1.0)];
    let profile = [[CHAMFER, 0.0], [0.0, CHAMFER], [0.0, HEIGHT - CHAMFER], [CHAMFER, HEIGHT]];
    let mut shell = Shell::default();
    let mut walls = vec![wall(&mut shell, &profile, &outer, false)];
    walls.extend(holes.map(|outline| wall(&mut shell, &profile, outline, true)));
    for (ring, is_top) in [(0, false), (3, true)] {
        let rings: Vec<Vec<u32>> = walls.iter().map(|rings| rings[ring].clone()).collect();
        let face = bridged(&shell, &rings);
        let plan: Vec<DVec2> = face.iter().map(|i| plan(&shell, *i)).collect();
        for [a, b, c] in triangulate(&plan).into_iter().map(|t| t.map(|i| face[i as usize])) {
            shell.triangles.push(if is_top { [a, b, c] } else { [a, c, b] });
        }
    }
    shell.smooth(35.0)
}

/// Adds a wall along a profile of (inset, height), and gives its rings. The walls of a hole face inward.
fn wall(shell: &mut Shell, profile: &[[f64; 2]], outline: &dyn Fn(f64) -> Vec<DVec2>, is_hole: bool) -> Vec<Vec<u32>> {
    let mut rings: Vec<Vec<u32>> = Vec::new();
    for [inset, height] in profile {
        let first = shell.points.len() as u32;
        shell.points.extend(outline(*inset).into_iter().map(|p| at_height(p, *height)));
        rings.push((first..shell.points.len() as u32).collect());
    }
    for pair in rings.windows(2) {
        for i in 0..pair[0].len() {
            let j = (i + 1) % pair[0].len();
            let (here, next) = if is_hole { (j, i) } else { (i, j) };
            shell.quad(pair[0][here], pair[0][next], pair[1][next], pair[1][here]);
        }
    }
    rings
}

fn plan(shell: &Shell, point: u32) -> DVec2 {
    let p = shell.points[point as usize];
    DVec2::new(p.x, -p.z)
}

/// One polygon of an outline and its holes: each hole joins at the shortest way to what is there.
fn bridged(shell: &Shell, rings: &[Vec<u32>]) -> Vec<u32> {
    let mut face = rings[0].clone();
    for hole in &rings[1..] {
        let ways = (0..face.len()).flat_map(|i| (0..hole.len()).map(move |j| (i, j)));
        let length = |(i, j): (usize, usize)| plan(shell, face[i]).distance(plan(shell, hole[j]));
        let Some((i, j)) = ways.min_by(|a, b| length(*a).total_cmp(&length(*b))) else { continue };
        let around = (0..=hole.len()).map(|k| hole[(j + hole.len() - k % hole.len()) % hole.len()]);
        let bridge: Vec<u32> = around.chain([face[i]]).collect();
        face.splice(i + 1..i + 1, bridge);
    }
    face
}
