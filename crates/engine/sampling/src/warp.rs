//! Maps from the unit square to shapes, each with its density and its inverse.
//!
//! Directions are unit vectors around +z. Densities are with respect to area for plane shapes and to solid angle for
//! directions, and zero outside the shape. Uniform numbers lie in `[0, 1)`. The inverse of a sampled point returns the
//! uniform numbers up to rounding.
//!
//! The functions of [`lanes`] compute a point per lane. The functions of the same names here are those of one lane.

pub mod lanes;

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, TAU};

/// Unit square to unit disk, concentric (Shirley and Chiu 1997): keeps strata compact.
#[inline]
pub fn sample_disk(u: [f32; 2]) -> Vec2 {
    lanes::sample_disk(u).into()
}

/// Density of [`sample_disk`] per unit area.
#[inline]
pub fn pdf_disk(p: Vec2) -> f32 {
    if p.length_squared() <= 1.0 { FRAC_1_PI } else { 0.0 }
}

/// The uniform numbers that give a point of the unit disk.
#[inline]
pub fn invert_disk(p: Vec2) -> [f32; 2] {
    let r = p.length();
    // The square is divided into four wedges. The wedge determines which coordinate is the signed radius.
    let (a, b) = if p.x.abs() > p.y.abs() {
        let r = r.copysign(p.x);
        (r, r * (p.y / p.x).atan() / FRAC_PI_4)
    } else if p.y != 0.0 {
        let r = r.copysign(p.y);
        (r * (p.x / p.y).atan() / FRAC_PI_4, r)
    } else {
        (0.0, 0.0)
    };
    [0.5 * (a + 1.0), 0.5 * (b + 1.0)]
}

/// Unit square to the upper hemisphere with density cos(theta) / pi (Malley's method).
#[inline]
pub fn sample_cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    lanes::sample_cosine_hemisphere(u).into()
}

/// Density of [`sample_cosine_hemisphere`] per steradian.
#[inline]
pub fn pdf_cosine_hemisphere(w: Vec3) -> f32 {
    lanes::pdf_cosine_hemisphere(w.into())
}

/// The uniform numbers that give a direction in [`sample_cosine_hemisphere`].
#[inline]
pub fn invert_cosine_hemisphere(w: Vec3) -> [f32; 2] {
    invert_disk(w.truncate())
}

/// Unit square to the whole sphere, uniform.
#[inline]
pub fn sample_sphere(u: [f32; 2]) -> Vec3 {
    lanes::sample_sphere(u).into()
}

/// Density of [`sample_sphere`] per steradian.
#[inline]
pub fn pdf_sphere(_w: Vec3) -> f32 {
    0.25 * FRAC_1_PI
}

/// The uniform numbers that give a direction in [`sample_sphere`].
#[inline]
pub fn invert_sphere(w: Vec3) -> [f32; 2] {
    [0.5 * (1.0 - w.z), azimuth(w)]
}

/// Unit square to the regular polygon with `corners` (at least 3) corners on the unit circle, the first one at angle
/// `rotation` (radians) from +x: the aperture of a lens with straight blades.
#[inline]
pub fn sample_polygon(u: [f32; 2], corners: u32, rotation: f32) -> Vec2 {
    lanes::sample_polygon(u, corners, rotation).into()
}

/// Density of [`sample_polygon`] per unit area.
#[inline]
pub fn pdf_polygon(p: Vec2, corners: u32, rotation: f32) -> f32 {
    let n = corners.max(3) as f32;
    let (_, along, radius) = polygon_coordinates(p, n, rotation);
    if radius <= 1.0 && (-1e-6..=1.000_001).contains(&along) { 2.0 / (n * (TAU / n).sin()) } else { 0.0 }
}

/// The uniform numbers that give a point in [`sample_polygon`].
#[inline]
pub fn invert_polygon(p: Vec2, corners: u32, rotation: f32) -> [f32; 2] {
    let n = corners.max(3) as f32;
    let (sector, along, radius) = polygon_coordinates(p, n, rotation);
    [((sector + along) / n).clamp(0.0, 1.0), (radius * radius).min(1.0)]
}

/// Sector of a point, its place along the sector's edge, and its distance from the centre relative to that edge.
fn polygon_coordinates(p: Vec2, n: f32, rotation: f32) -> (f32, f32, f32) {
    let angle = (p.y.atan2(p.x) - rotation).rem_euclid(TAU);
    let sector = (angle * n / TAU).floor().min(n - 1.0);
    let corner = |k: f32| Vec2::from_angle(rotation + TAU * k / n);
    let (a, b) = (corner(sector), corner(sector + 1.0));
    let det = a.perp_dot(b);
    let (s, t) = (p.perp_dot(b) / det, a.perp_dot(p) / det);
    let radius = s + t;
    (sector, if radius > 0.0 { t / radius } else { 0.0 }, radius)
}

/// Sine and cosine of a fraction of a turn, `|turn| <= 2`, to 1.3e-7.
#[inline]
pub fn sin_cos_turn(turn: f32) -> (f32, f32) {
    lanes::sin_cos_turn(turn)
}

/// Azimuth as a fraction of a turn in `[0, 1)`.
#[inline]
pub fn azimuth(w: Vec3) -> f32 {
    let phi = w.y.atan2(w.x) / TAU;
    let phi = if phi < 0.0 { phi + 1.0 } else { phi };
    if phi < 1.0 { phi } else { 0.0 }
}
