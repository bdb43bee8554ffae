//! Closed bodies by lofting: outlines in the ground plane, stacked along a profile.

use glam::{DVec2, DVec3};

use super::mesh::{Mesh, Shell};
use super::outline::{circle, fillet, rounded_rectangle, triangulate};

/// A millimetre in metres: the drawings are in millimetres, the files in metres.
pub(crate) const MM: f64 = 1e-3;

/// How a loft ends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ends {
    /// A flat cap below the first ring and above the last.
    Capped,
    /// The last ring joins the first: a frame.
    Joined,
}

/// Puts a drawing-plane point (x to the right, y to the rear) at a height: rear is -z, up is +y.
pub(crate) fn at_height(plan: DVec2, height: f64) -> DVec3 {
    DVec3::new(plan.x, height, -plan.y)
}

/// Stacks `outline(inset)` at the heights of `profile`, a path of (inset, height), from the bottom up and over.
///
/// Every outline must have the same number of points and run counter-clockwise seen from above.
pub(crate) fn loft(profile: &[DVec2], ends: Ends, outline: impl Fn(f64) -> Vec<DVec2>) -> Shell {
    let mut shell = Shell::default();
    let rings: Vec<Vec<DVec2>> = profile.iter().map(|p| outline(p.x)).collect();
    let n = rings[0].len();
    for (ring, p) in rings.iter().zip(profile) {
        shell.points.extend(ring.iter().map(|q| at_height(*q, p.y)));
    }
    let index = |ring: usize, i: usize| (ring * n + i % n) as u32;
    let steps = match ends {
        Ends::Capped => rings.len() - 1,
        Ends::Joined => rings.len(),
    };
    for ring in 0..steps {
        let above = (ring + 1) % rings.len();
        for i in 0..n {
            shell.quad(index(ring, i), index(ring, i + 1), index(above, i + 1), index(above, i));
        }
    }
    if ends == Ends::Capped {
        let last = rings.len() - 1;
        for [a, b, c] in triangulate(&rings[0]) {
            shell.triangles.push([a, c, b]);
        }
        for t in triangulate(&rings[last]) {
            shell.triangles.push(t.map(|i| i + index(last, 0)));
        }
    }
    shell
}

/// A box of `size` centred on its own origin, its edges rounded by `radius`, corners by `corner` in plan.
pub(crate) fn rounded_box(size: DVec3, corner: f64, radius: f64) -> Mesh {
    let (half, top) = (DVec2::new(size.x, size.z) * 0.5, size.y * 0.5);
    // The two ends of the profile lie inside the caps, so that the cap's edge is a ring of its own.
    let profile = fillet(
        &[
            (DVec2::new(2.0 * radius, -top), 0.0),
            (DVec2::new(0.0, -top), radius),
            (DVec2::new(0.0, top), radius),
            (DVec2::new(2.0 * radius, top), 0.0),
        ],
        false,
        3,
    );
    let outline = |inset: f64| rounded_rectangle(half - inset, (corner - inset).max(0.2 * radius), 3);
    loft(&profile[1..profile.len() - 1], Ends::Capped, outline).smooth(35.0)
}

/// An upright cylinder with its foot at the origin, the upper edge rounded by `radius`.
pub(crate) fn post(width: f64, height: f64, radius: f64, points: usize) -> Mesh {
    let mut profile = fillet(
        &[(DVec2::new(0.0, 0.0), 0.0), (DVec2::new(0.0, height), radius), (DVec2::new(2.0 * radius, height), 0.0)],
        false,
        3,
    );
    profile.pop();
    loft(&profile, Ends::Capped, |inset| circle(width * 0.5 - inset, points)).smooth(35.0)
}

/// A pan-head screw, foot of the head at the origin, with a six-lobed socket.
pub(crate) fn screw(width: f64) -> Mesh {
    let r = width * 0.5;
    let (height, socket) = (0.75 * r, 0.5 * r);
    let mut profile = fillet(
        &[
            (DVec2::new(0.0, 0.0), 0.0),
            (DVec2::new(0.0, height), 0.45 * r),
            (DVec2::new(r - socket, height), 0.04 * r),
            (DVec2::new(r - socket, 0.3 * height), 0.0),
        ],
        false,
        4,
    );
    profile.dedup_by(|a, b| a.distance(*b) < 1e-9);
    // A lobe is 12 % of the radius deep, and grows in over the last third of the top face.
    let lobes = |inset: f64| 0.12 * ((inset / (r - socket) - 0.7) / 0.3).clamp(0.0, 1.0);
    loft(&profile, Ends::Capped, |inset| {
        circle(r - inset, 48)
            .into_iter()
            .enumerate()
            .map(|(i, p)| p * (1.0 + lobes(inset) * (i as f64 * std::f64::consts::TAU / 8.0).cos()))
            .collect()
    })
    .smooth(35.0)
}

/// An extruded aluminium profile, 20 x 20 mm with four T-slots, along x, centred, of the given length.
pub(crate) fn slotted_profile(length: f64) -> Mesh {
    // One side, facing +x: lower half of the lip, the slot, the upper half, the corner.
    let side = [
        (10.0, -3.1, 0.3),
        (8.2, -3.1, 0.2),
        (8.2, -5.0, 0.0),
        (6.2, -5.0, 0.0),
        (4.2, -3.0, 0.0),
        (4.2, 3.0, 0.0),
        (6.2, 5.0, 0.0),
        (8.2, 5.0, 0.0),
        (8.2, 3.1, 0.2),
        (10.0, 3.1, 0.3),
        (10.0, 10.0, 1.5),
    ];
    let mut section = Vec::new();
    for turn in 0..4 {
        let rotation = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y][turn];
        section.extend(side.map(|(x, y, radius)| (rotation.rotate(DVec2::new(x, y)) * MM, radius * MM)));
    }
    let section = fillet(&section, true, 3);
    let ends = [-0.5, 0.5].map(|end| DVec2::new(0.0, end * length));
    let mut shell = loft(&ends, Ends::Capped, |_| section.clone());
    // Lofts stand upright; a profile lies along x. (x, y, z) -> (y, z, x) is a rotation, so winding stays.
    for p in &mut shell.points {
        *p = DVec3::new(p.y, p.z, p.x);
    }
    shell.smooth(35.0)
}

/// A flat rectangle of `size` facing +y, centred: two triangles.
pub(crate) fn panel(size: DVec2) -> Mesh {
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
    Mesh {
        positions: corners.map(|(x, y)| at_height(size * DVec2::new(x, y), 0.0)).to_vec(),
        normals: vec![DVec3::Y; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// An upright tube with its foot at the origin; `radii` are inner and outer, edges rounded by `radius`.
pub(crate) fn circle_tube(radii: [f64; 2], height: f64, radius: f64, points: usize) -> Mesh {
    let [inner, outer] = radii;
    let corners = [
        DVec2::new(0.0, 0.0),
        DVec2::new(0.0, height),
        DVec2::new(outer - inner, height),
        DVec2::new(outer - inner, 0.0),
    ];
    let profile = fillet(&corners.map(|c| (c, radius)), true, 3);
    loft(&profile, Ends::Joined, |inset| circle(outer - inset, points)).smooth(35.0)
}
