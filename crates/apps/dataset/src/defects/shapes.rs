//! The shapes of defects that are cut into a body: dents, pores, chatter marks, chips, scratches and cold shuts.

use super::carve::{Change, carve};
use super::draw::{self, Harmonics, Waves};
use super::material;
use super::pieces::{Pieces, Stride};
use super::site::{Made, Site};
use super::spec::{Chatter, Chip, Dent, Pore};
use super::walk::tangent_at;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_sampling::Pcg;
use std::f64::consts::{PI, TAU};

/// Pieces of a round defect over its radius.
const STEP: f64 = 1.0 / 16.0;
/// Largest deviation of the outline of a pore from a circle, over its radius.
const PORE_WAVES: f64 = 0.2;
/// Roughness of the heights of a break, over its depth.
const BREAK_WAVES: f64 = 0.25;
/// Highest part of the body above the edge that breaks, over the depth.
const LARGEST_OVERLAP: f64 = 0.2;
/// Width of a groove over that of the whole scratch; burrs are beside it.
pub(super) const GROOVE: f64 = 0.6;
/// Longest edge of the pieces of a groove, over its width.
const GROOVE_STEP: f64 = 0.1;

/// The start of a walk from the drawn point, in the direction `angle` \[rad\].
fn start(site: &Site<'_>, pieces: &Pieces, angle: f64) -> Option<Stride> {
    let facet = site.surface.facets[site.foot.facet];
    let piece = pieces.whole(facet.triangle).filter(|_| facet.part == site.below.0)?;
    let normal = pieces.oriented_area(piece).try_normalize()?;
    let stride = Stride { piece, point: site.foot.point, along: tangent_at(normal, angle), normal };
    Some(stride)
}

/// The direction out of the body: the mean normal half a radius away.
fn outward(site: &Site<'_>, pieces: &Pieces, radius: f64) -> Option<DVec3> {
    let mut sum = DVec3::ZERO;
    for k in 0..16 {
        sum += pieces.step(&start(site, pieces, TAU * f64::from(k) / 16.0)?, 0.5 * radius, 0.0)?.normal;
    }
    sum.try_normalize()
}

/// A round change within `radius` \[m\] of the drawn point: `height` gives the displacement \[m\] along the normal from the
/// place over the radius.
fn round(site: &Site<'_>, radius: f64, step: f64, height: impl Fn(DVec3, DVec3) -> f64) -> Option<Made> {
    let pieces = site.pieces();
    let (middle, axis) = (site.foot.point, outward(site, &pieces, radius)?);
    let distance = |p: DVec3| p.distance(middle) - radius;
    let shift = |p: DVec3| if distance(p) < 0.0 { axis * height((p - middle) / radius, axis) } else { DVec3::ZERO };
    let change = Change { distance: &distance, shift: &shift, axis, step };
    carve(site, pieces, &change, material::like_surface(site.host, &site.finish, true))
}

/// A dent with the depth `d (1 + cos(pi r / R)) / 2` at the distance r from its middle.
pub(super) fn dent(site: &Site<'_>, dent: &Dent) -> Option<Made> {
    let (radius, depth) = (0.5 * dent.length.0, dent.depth.0);
    round(site, radius, STEP * radius, |p, _| -0.5 * depth * (1.0 + (PI * p.length()).cos()))
}

/// A pore: a pit with steep walls, half an ellipsoid with an irregular outline.
pub(super) fn pore(site: &Site<'_>, pore: &Pore, stream: &mut Pcg) -> Option<Made> {
    let (radius, depth) = (0.5 * pore.length.0, pore.depth.0);
    let outline = Harmonics::draw(stream, 2, 6, PORE_WAVES);
    let largest = (0..64).map(|k| outline.at(f64::from(k) / 64.0)).fold(0.0, f64::max);
    let made = round(site, radius, 0.5 * STEP * radius, |p, axis| {
        let x = axis.any_orthonormal_vector();
        let angle = axis.cross(x).dot(p).atan2(x.dot(p));
        let r = p.length() * (1.0 + largest) / (1.0 + outline.at(angle / TAU)).max(0.3);
        -depth * (1.0 - r * r).max(0.0).sqrt()
    });
    made.map(|made| Made { material: material::cut(site.host, &site.finish, true), ..made })
}

/// Chatter marks: waves of one pitch that a vibrating tool leaves, fading towards a round outline.
pub(super) fn chatter(site: &Site<'_>, chatter: &Chatter, stream: &mut Pcg) -> Option<Made> {
    let (radius, pitch, depth) = (0.5 * chatter.length.0, chatter.pitch.0, chatter.depth.0);
    let angle = chatter.angle.map_or_else(|| draw::angle(stream), |angle| angle.0);
    let made = round(site, radius, pitch / 10.0, |p, axis| {
        let along = tangent_at(axis, angle).dot(p) * radius;
        let fade = 0.5 * (1.0 + (PI * p.length()).cos());
        -0.5 * depth * fade.sqrt() * (1.0 - (TAU * along / pitch).cos())
    });
    made.map(|made| Made { angle: Some(angle), ..made })
}

/// A break of an edge: what is above a rough hollow through the body is gone. The hollow is deepest in the middle of its length.
pub(super) fn chip(site: &Site<'_>, chip: &Chip, stream: &mut Pcg) -> Option<Made> {
    let (half, depth, axis) = (0.5 * chip.length.0, chip.depth.0, site.anchor.normal);
    let along = site.anchor.edge?;
    let (across, middle) = (axis.cross(along), site.foot.point);
    let waves = Waves::draw(stream, [3.0 * depth, 0.5 * depth], BREAK_WAVES);
    let place = |p: DVec3| ((p - middle).dot(along), (p - middle).dot(across), (p - middle).dot(axis));
    let hollow = |s: f64, w: f64| {
        let share = 1.0 - (s / half).powi(2);
        -depth * share * (1.0 + waves.at(s, w))
    };
    let lowest = -2.0 * depth;
    let distance = |p: DVec3| {
        let (s, w, z) = place(p);
        (s.abs() - half).max(lowest - z).max(w.abs() - chip.length.0.max(4.0 * depth)).max(z - half)
    };
    let shift = |p: DVec3| {
        let (s, w, z) = place(p);
        if distance(p) < 0.0 { axis * (hollow(s, w) - z).min(0.0) } else { DVec3::ZERO }
    };
    let pieces = site.pieces();
    // Nothing of the body rises beside the edge.
    if pieces.points.iter().any(|p| distance(*p) < 0.0 && place(*p).2 > LARGEST_OVERLAP * depth) {
        return None;
    }
    let change = Change { distance: &distance, shift: &shift, axis, step: 0.1 * depth };
    carve(site, pieces, &change, material::cut(site.host, &site.finish, true))
}

/// A groove along a curve that may cross edges.
pub(super) struct Groove<'a> {
    /// Length, and width in the middle with the burrs \[m\].
    pub(super) size: [f64; 2],
    /// Direction in the middle, and total turn \[rad\].
    pub(super) turn: [f64; 2],
    /// Further changes of the direction \[rad\], over the length.
    pub(super) wander: &'a Harmonics,
    /// Half of the width \[m\] and the depth \[m\] at a share of the length.
    pub(super) at: &'a dyn Fn(f64) -> [f64; 2],
    /// Height over depth at a place across, -1 on the right and 1 on the left.
    pub(super) profile: &'a dyn Fn(f64) -> f64,
}

/// A groove that is cut into the body.
pub(super) fn groove(site: &Site<'_>, groove: &Groove<'_>) -> Option<Made> {
    let pieces = site.pieces();
    let ([length, width], [angle, _]) = (groove.size, groove.turn);
    let curve = groove.course(site, &pieces)?;
    let reach = curve.iter().map(|stride| stride.point.length()).fold(0.0, f64::max) + width;
    let nearest = |p: DVec3| {
        let mut best = (f64::INFINITY, 0, 0.0);
        for (i, pair) in curve.windows(2).enumerate() {
            let way = pair[1].point - pair[0].point;
            let t = ((p - pair[0].point).dot(way) / way.length_squared()).clamp(0.0, 1.0);
            let square = p.distance_squared(pair[0].point + way * t);
            if square < best.0 {
                best = (square, i, t);
            }
        }
        (best.0.sqrt(), best.1, best.2)
    };
    let is_far = |p: DVec3| p.length() > reach;
    let distance = |p: DVec3| if is_far(p) { p.length() - reach + width } else { nearest(p).0 - width };
    let last = (curve.len() - 1) as f64;
    let shift = |p: DVec3| {
        if is_far(p) {
            return DVec3::ZERO;
        }
        let (distance, i, t) = nearest(p);
        let [half, depth] = (groove.at)((i as f64 + t) / last);
        let normal = curve[i].normal.lerp(curve[i + 1].normal, t).normalize_or_zero();
        let left = (p - curve[i].point.lerp(curve[i + 1].point, t)).dot(normal.cross(curve[i].along));
        if distance < half { normal * (depth * (groove.profile)(distance.copysign(left) / half)) } else { DVec3::ZERO }
    };
    let axis = curve.iter().map(|stride| stride.normal).sum::<DVec3>().try_normalize()?;
    let change = Change { distance: &distance, shift: &shift, axis, step: (GROOVE_STEP * width).max(length / 2000.0) };
    let made = carve(site, pieces, &change, material::cut(site.host, &site.finish, true))?;
    Some(Made { angle: Some(angle), ..made })
}

impl Groove<'_> {
    /// The points of the curve from its start to its end, with normals that turn over edges within a half width.
    fn course(&self, site: &Site<'_>, pieces: &Pieces) -> Option<Vec<Stride>> {
        let ([length, width], [angle, turn]) = (self.size, self.turn);
        let steps = (length / width).clamp(24.0, 400.0) as i32;
        let step = 0.5 * length / f64::from(steps);
        let heading = |k: i32| {
            let share = 0.5 * f64::from(k) / f64::from(steps);
            turn * share + self.wander.at(0.5 + share) - self.wander.at(0.5)
        };
        let first = start(site, pieces, angle)?;
        let half = |sign: i32| {
            let mut stride = Stride { along: first.along * f64::from(sign), ..first };
            let mut all = Vec::new();
            for k in 0..steps {
                stride = pieces.step(&stride, step, heading(sign * (k + 1)) - heading(sign * k))?;
                all.push(Stride { along: stride.along * f64::from(sign), ..stride });
            }
            Some(all)
        };
        let course: Vec<Stride> = half(-1)?.into_iter().rev().chain([first]).chain(half(1)?).collect();
        let near = (0.5 * width / step).ceil() as usize;
        let smooth = |i: usize| {
            let around = &course[i.saturating_sub(near)..(i + near + 1).min(course.len())];
            around.iter().map(|stride| stride.normal).sum::<DVec3>().normalize_or_zero()
        };
        Some((0..course.len()).map(|i| Stride { normal: smooth(i), ..course[i] }).collect())
    }
}
