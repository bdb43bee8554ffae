//! The part under inspection: thermoplastic base, deformed film, printed symbols, clear cover.

use glam::{DVec2, DVec3};
use serde_json::json;

use super::cover;
use super::glb::{Document, Node};
use super::materials;
use super::mesh::{Mesh, Shell};
use super::outline::{fillet, rounded_rectangle};
use super::solids::{Ends, MM, at_height, loft, post, rounded_box, screw};
use super::symbols::{self, Drawing};

/// Which cover a scene has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cover {
    /// Bulged faces, rounded rim.
    Moulded,
    /// Plane-parallel faces.
    Flat,
    /// None: the film lies open.
    None,
}

/// Height of the flange's lower side above the symbols' mean plane \[m\].
pub(crate) const FLANGE_BOTTOM: f64 = -8.0 * MM;
/// Height of the flange's upper side \[m\].
const FLANGE_TOP: f64 = -4.0 * MM;
/// Half size of the film in plan \[m\].
pub(crate) const FILM_HALF: DVec2 = DVec2::new(33.0 * MM, 23.0 * MM);
/// Thickness of the film \[m\].
pub(crate) const FILM_THICKNESS: f64 = 0.125 * MM;
/// Height of the ink above the film: clear of the film's chords, and wide enough for single precision \[m\].
const INK_HEIGHT: f64 = 0.04 * MM;
/// Floor of the recess below the film \[m\].
pub(crate) const FLOOR: f64 = -0.6 * MM;

/// Adds the part under `parent`; its origin is the middle of the symbols' plane.
pub(crate) fn add(document: &mut Document, parent: usize, cover: Cover) {
    let part = document.node(Some(parent), Node::new("part"));
    let thermoplastic = document.material(materials::dielectric("thermoplastic", [0.05, 0.052, 0.056], 0.6));
    let film = document.material(materials::dielectric("film", [0.075, 0.075, 0.08], 0.35));

    let geometry = document.geometry(&base());
    let mesh = document.mesh("base", geometry, thermoplastic);
    document.node(Some(part), Node::new("base").with(mesh));
    add_bosses_and_ribs(document, part, thermoplastic);

    let geometry = document.geometry(&film_sheet());
    let mesh = document.mesh("film", geometry, film);
    document.node(Some(part), Node::new("film").with(mesh));

    add_symbols(document, part);

    let (name, shape) = match cover {
        Cover::Moulded => ("cover-moulded", cover::moulded()),
        Cover::Flat => ("cover-flat", cover::flat()),
        Cover::None => return,
    };
    for extension in ["KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume"] {
        document.uses(extension);
    }
    let pmma = document.material(materials::pmma());
    let geometry = document.geometry(&shape);
    let mesh = document.mesh(name, geometry, pmma);
    document.node(Some(part), Node::new("cover").with(mesh));
}

/// The base body in one piece: flange, wall, raised rim, the ledge that carries the cover, the recess for the film.
pub(crate) fn base() -> Mesh {
    let half = DVec2::new(45.0, 35.0) * MM;
    // (inset from the flange's outline, height, fillet radius), from the bottom around to the floor of the recess.
    let path = [
        (2.0, FLANGE_BOTTOM / MM, 0.0),
        (0.0, FLANGE_BOTTOM / MM, 0.4),
        (0.0, FLANGE_TOP / MM, 0.6),
        (4.6, FLANGE_TOP / MM, 0.5),
        (5.0, 3.9, 0.7),
        (6.6, 3.9, 0.3),
        (6.6, 0.94, 0.0),
        (10.4, 0.94, 0.3),
        (11.0, FLOOR / MM, 0.0),
    ];
    let path = path.map(|(inset, y, radius)| (DVec2::new(inset, y) * MM, radius * MM));
    let profile = fillet(&path, false, 3);
    loft(&profile[1..], Ends::Capped, |inset| rounded_rectangle(half - inset, (10.0 * MM - inset).max(1.2 * MM), 6))
        .smooth(35.0)
}

/// Height of the film's upper side over a plan point \[m\]: waves of a tenth of a millimetre and two dents.
pub(crate) fn film_height(p: DVec2) -> f64 {
    let (x, y) = (p.x / MM, p.y / MM);
    let wave = |length: f64, phase: f64, s: f64| (s * std::f64::consts::TAU / length + phase).sin();
    let dent = |cx: f64, cy: f64, radius: f64| {
        let d = DVec2::new(x - cx, y - cy) / radius;
        (-d.length_squared()).exp()
    };
    let height = 0.09 * wave(33.0, 0.6, x) * wave(27.0, 1.3, y) + 0.05 * wave(19.0, 0.0, x + 0.6 * y)
        - 0.10 * dent(-12.0, 7.0, 6.0)
        + 0.08 * dent(11.0, -7.5, 5.0);
    height * MM
}

/// Upward normal of the film by central differences over a micrometre.
fn film_normal(p: DVec2) -> DVec3 {
    let step = 1e-6;
    let slope = |axis: DVec2| (film_height(p + axis * step) - film_height(p - axis * step)) / (2.0 * step);
    at_height(-DVec2::new(slope(DVec2::X), slope(DVec2::Y)), 1.0).normalize()
}

/// The film as a closed sheet of even thickness.
pub(crate) fn film_sheet() -> Mesh {
    let (nx, ny) = (66_u32, 46_u32);
    let mut shell = Shell::default();
    for lift in [-FILM_THICKNESS, 0.0] {
        for j in 0..=ny {
            for i in 0..=nx {
                let t = DVec2::new(f64::from(i) / f64::from(nx), f64::from(j) / f64::from(ny));
                let p = FILM_HALF * (2.0 * t - 1.0);
                shell.points.push(at_height(p, film_height(p) + lift));
            }
        }
    }
    let index = |side: u32, i: u32, j: u32| side * (nx + 1) * (ny + 1) + j * (nx + 1) + i;
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| [index(0, i, j), index(1, i, j)]);
            shell.quad(a[0], d[0], c[0], b[0]);
            shell.quad(a[1], b[1], c[1], d[1]);
        }
    }
    let mut wall = |from: (u32, u32), to: (u32, u32)| {
        shell.quad(index(0, from.0, from.1), index(0, to.0, to.1), index(1, to.0, to.1), index(1, from.0, from.1));
    };
    for i in 0..nx {
        wall((i, 0), (i + 1, 0));
        wall((i + 1, ny), (i, ny));
    }
    for j in 0..ny {
        wall((nx, j), (nx, j + 1));
        wall((0, j + 1), (0, j));
    }
    shell.smooth(35.0)
}

/// A symbol's drawing laid over the film at a plan position.
pub(crate) fn drape(drawing: &Drawing, centre: DVec2) -> Mesh {
    let plan: Vec<DVec2> = drawing.points.iter().map(|p| *p * MM + centre).collect();
    Mesh {
        positions: plan.iter().map(|p| at_height(*p, film_height(*p) + INK_HEIGHT)).collect(),
        normals: plan.iter().map(|p| film_normal(*p)).collect(),
        triangles: drawing.triangles.clone(),
    }
}

/// Plan position of the symbol of that number: three rows of three.
pub(crate) fn symbol_centre(number: usize) -> DVec2 {
    let (column, row) = (number % 3, number / 3);
    DVec2::new(column as f64 - 1.0, 1.0 - row as f64) * DVec2::new(21.0, 14.8) * MM
}

fn add_symbols(document: &mut Document, part: usize) {
    let group = document.node(Some(part), Node::new("symbols"));
    for (number, symbol) in symbols::all().into_iter().enumerate() {
        let material = document.material(materials::ink(symbol.name, symbol.colour, symbol.coverage));
        let geometry = document.geometry(&drape(&symbol.drawing, symbol_centre(number)));
        let name = format!("symbol-{}", symbol.name);
        let mesh = document.mesh(&name, geometry, material);
        document.node(Some(group), Node::new(name).with(mesh));
    }
}

fn add_bosses_and_ribs(document: &mut Document, part: usize, thermoplastic: usize) {
    let steel = document.material(json!({
        "name": "steel",
        "pbrMetallicRoughness": { "baseColorFactor": [0.62, 0.6, 0.58, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.25 },
    }));
    // Feet stand half a millimetre deep in the flange, so that no two faces share a plane.
    let sunk = 0.5 * MM;
    let geometry = document.geometry(&post(4.6 * MM, 3.0 * MM + sunk, 0.3 * MM, 32));
    let boss = document.mesh("boss", geometry, thermoplastic);
    let geometry = document.geometry(&screw(3.6 * MM));
    let screw = document.mesh("screw-small", geometry, steel);
    let geometry = document.geometry(&rounded_box(DVec3::new(1.2, 4.0, 4.0) * MM, 0.3 * MM, 0.2 * MM));
    let rib = document.mesh("rib", geometry, thermoplastic);

    let bosses = document.node(Some(part), Node::new("bosses"));
    let ribs = document.node(Some(part), Node::new("ribs"));
    for (side, edge) in [("rear", -32.6 * MM), ("front", 32.6 * MM)] {
        for (name, x) in [("left", -30.0), ("middle", 0.0), ("right", 30.0)] {
            let top = FLANGE_TOP + 3.0 * MM;
            let foot = Node::new(format!("boss-{side}-{name}"));
            let boss = document.node(Some(bosses), foot.at(x * MM, FLANGE_TOP - sunk, edge).with(boss));
            let lift = top - (FLANGE_TOP - sunk) + 0.05 * MM;
            let head = Node::new(format!("screw-{side}-{name}"));
            document.node(Some(boss), head.at(0.0, lift, 0.0).with(screw));
        }
        for (number, x) in [-20.0, -10.0, 10.0, 20.0].into_iter().enumerate() {
            let node = Node::new(format!("rib-{side}-{}", number + 1));
            let z = edge.signum() * 31.6 * MM;
            document.node(Some(ribs), node.at(x * MM, FLANGE_TOP + 1.6 * MM, z).with(rib));
        }
    }
}
