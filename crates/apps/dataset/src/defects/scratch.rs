//! Scratches.

use super::draw::{self, Harmonics};
use super::material;
use super::patch::Patch;
use super::shapes::{self, GROOVE, Groove};
use super::shell;
use super::site::{Made, Site};
use super::spec::{ColdShut, Scratch};
use super::walk::Course;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_sampling::Pcg;
use std::f64::consts::PI;

/// Places across a scratch, in half widths from its middle.
const ACROSS: [f64; 11] = [-1.0, -0.8, -0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
/// Place of the ridges in the same unit.
const RIDGE: f64 = 0.6;
/// Half of the width of the groove of a cold shut, over that with its lips.
const SEAM: f64 = 0.15;
/// Each end becomes narrow over this share of the length.
const TAPER: f64 = 0.2;
/// Width of the ends over that of the middle.
const END: f64 = 0.15;
/// Largest distance between facets and patch, over the width.
const LARGEST_RISE: f64 = 0.5;

/// Height over depth of the two ridges of a scratch in an opaque body. The groove between them ends at the surface.
fn ridges(u: f64) -> f64 {
    let a = u.abs();
    if a < RIDGE {
        (0.5 * PI * a / RIDGE).sin().powi(2)
    } else {
        (0.5 * PI * (a - RIDGE) / (1.0 - RIDGE)).cos().powi(2)
    }
}

/// Height over depth of the groove in a clear solid.
fn groove(u: f64) -> f64 {
    -(0.5 * PI * u).cos().powi(2)
}

/// Height over depth of a groove that is cut into an opaque body, with burrs of the height `burr` beside it.
fn cut(u: f64, burr: f64) -> f64 {
    let a = u.abs();
    if a < GROOVE { groove(u / GROOVE) } else { burr * (PI * (a - GROOVE) / (1.0 - GROOVE)).sin().powi(2) }
}

/// Height over depth of a cold shut: a narrow groove between two lips, one higher than the other.
fn seam(u: f64) -> f64 {
    let (a, lip) = (u.abs(), if u < 0.0 { 0.5 } else { 0.25 });
    if a < SEAM { -(1.0 - a / SEAM) } else { lip * (PI * ((a - SEAM) / (1.0 - SEAM)).sqrt()).sin().powi(2) }
}

/// Width and depth over those in the middle, at a share of the length.
fn taper(t: f64) -> f64 {
    let share = (t.min(1.0 - t) / TAPER).min(1.0);
    END + (1.0 - END) * share * share * (3.0 - 2.0 * share)
}

/// A cold shut along an irregular curve.
pub(super) fn cold_shut(site: &Site<'_>, shut: &ColdShut, stream: &mut Pcg) -> Option<Made> {
    let wander = Harmonics::draw(stream, 1, 8, 0.4);
    let breadth = Harmonics::draw(stream, 2, 8, 0.25);
    let angle = shut.angle.map_or_else(|| draw::angle(stream), |angle| angle.0);
    let groove = Groove {
        size: [shut.length.0, shut.width.0],
        turn: [angle, shut.curvature.map_or(0.0, |turn| turn.0)],
        wander: &wander,
        at: &|t| [0.5 * shut.width.0 * taper(t) * (1.0 + breadth.at(t)).max(0.3), shut.depth.0 * taper(t)],
        profile: &seam,
    };
    shapes::groove(site, &groove)
}

/// A scratch along a curve on the surface.
pub(super) fn scratch(site: &Site<'_>, scratch: &Scratch, stream: &mut Pcg) -> Option<Made> {
    let (surface, length, width, depth) = (&site.surface, scratch.length.0, scratch.width.0, scratch.depth.0);
    let curvature = scratch.curvature.map_or(0.0, |turn| turn.0);
    let wander = Harmonics::draw(stream, 1, 4, 0.03);
    let breadth = Harmonics::draw(stream, 3, 12, 0.15);
    let angle = scratch.angle.map_or_else(|| draw::angle(stream), |angle| angle.0);
    // Steps of the width, unless the scratch is very long or very short.
    let steps = (0.5 * length / width).clamp(24.0, 200.0) as usize;
    let at = |t: f64| {
        let taper = taper(t);
        (taper * (1.0 + breadth.at(t)).max(0.3), taper)
    };
    let course = Course { length, steps, angle, curvature, wander: &wander };
    let curve = course.on(surface, site.foot).filter(|_| scratch.burr.is_none() || site.volume.is_some());
    let Some(curve) = curve else {
        if site.volume.is_some() {
            return None;
        }
        let burr = scratch.burr.map_or(1.0, |burr| burr.0);
        let groove = Groove {
            size: [length, width],
            turn: [angle, curvature],
            wander: &wander,
            at: &|t| [0.5 * width * at(t).0, depth * at(t).1],
            profile: &|u| cut(u, burr),
        };
        return shapes::groove(site, &groove);
    };
    let last = (curve.len() - 1) as f64;
    let sizes = |row: usize| at(row as f64 / last);
    let mut feet = Vec::with_capacity(curve.len() * ACROSS.len());
    for (row, foot) in curve.iter().enumerate() {
        let half = 0.5 * width * sizes(row).0;
        for u in ACROSS {
            feet.push(if u == 0.0 { foot.hit } else { foot.beside(surface, half * u)? });
        }
    }
    let columns = ACROSS.len();
    let patch = Patch::grid(feet, columns);
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * width)?;
    let offset = site.lift + rise;
    let is_edge = |i: usize| i.is_multiple_of(columns) || i % columns == columns - 1;
    // The slope across the scratch is that of the mesh: the mean of both sides, and half of the only side at an edge.
    let normal = |height: &dyn Fn(usize) -> f64, i: usize| -> DVec3 {
        let (row, column) = (i / columns, i % columns);
        let half = 0.5 * width * sizes(row).0;
        let slope = |from: usize| {
            let rise = height(row * columns + from + 1) - height(row * columns + from);
            rise / (half * (ACROSS[from + 1] - ACROSS[from]))
        };
        let right = if column > 0 { slope(column - 1) } else { 0.0 };
        let left = if column + 1 < columns { slope(column) } else { 0.0 };
        let n = patch.feet[i].normal;
        (n - curve[row].left() * (0.5 * (left + right))).try_normalize().unwrap_or(n)
    };
    if let Some(volume) = &site.volume {
        let bottom = |i: usize| {
            let depth = depth * sizes(i / columns).1 + offset;
            // The edges of both sheets are the same points.
            if is_edge(i) { offset } else { offset + depth * groove(ACROSS[i % columns]) }
        };
        let mesh = shell::closed(&patch, surface, |_| offset, bottom, |i| normal(&bottom, i));
        return Some(Made::new(mesh, Some(angle), material::gas(&site.finish, volume, material::SCRATCH_ROUGHNESS)));
    }
    // The edges are below the surface, so that no gap is visible at grazing angles.
    let height = |i: usize| {
        let ridge = depth * sizes(i / columns).1 * ridges(ACROSS[i % columns]);
        if is_edge(i) { -site.lift } else { offset + ridge }
    };
    let (mesh, has_uvs) = patch.mesh(surface, Some(site.below), height, |i| normal(&height, i));
    Some(Made::new(mesh, Some(angle), material::cut(site.host, &site.finish, has_uvs)))
}
