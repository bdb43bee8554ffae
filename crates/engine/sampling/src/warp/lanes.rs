//! Warps that compute a point per lane.

use dunkelfeld_lanes::{Lanes, Mask, V3, cos_sin_of_turn};
use std::f32::consts::FRAC_1_PI;
use std::f64::consts::TAU;

/// Unit square to unit disk, concentric (Shirley and Chiu 1997): keeps strata compact.
#[inline(always)]
pub fn sample_disk<F: Lanes>([u0, u1]: [F; 2]) -> [F; 2] {
    let (a, b) = (u0 * 2.0 - 1.0, u1 * 2.0 - 1.0);
    let is_first = a.abs().gt(b.abs());
    let (r, other) = (is_first.select(a, b), is_first.select(b, a));
    let eighth = other / r.eq(r.constant(0.0)).select(r.constant(1.0), r) * 0.125;
    let (sin, cos) = sin_cos_turn(is_first.select(eighth, eighth.constant(0.25) - eighth));
    [r * cos, r * sin]
}

/// Unit square to the upper hemisphere with density cos(theta) / pi (Malley's method).
#[inline(always)]
pub fn sample_cosine_hemisphere<F: Lanes>(u: [F; 2]) -> V3<F> {
    let [x, y] = sample_disk(u);
    // Near the rim the cosine is computed from the distance to the rim. It stays above zero so that no division by it
    // fails.
    V3::new(x, y, (x * x + y * y).one_minus().max(x.constant(1e-10)).sqrt())
}

/// Density of [`sample_cosine_hemisphere`] per steradian.
#[inline(always)]
pub fn pdf_cosine_hemisphere<F: Lanes>(w: V3<F>) -> F {
    w.z.max(w.z.constant(0.0)) * FRAC_1_PI
}

/// Unit square to the whole sphere, uniform.
#[inline(always)]
pub fn sample_sphere<F: Lanes>([u0, u1]: [F; 2]) -> V3<F> {
    let radius = (u0 * u0.one_minus()).sqrt() * 2.0;
    let (sin, cos) = sin_cos_turn(u1);
    V3::new(radius * cos, radius * sin, (u0 * 2.0).one_minus())
}

/// Sine and cosine of a fraction of a turn, `|turn| <= 2`, to 1.3e-7: several times faster than via radians, because the
/// reduction to an eighth of a turn is exact.
#[inline(always)]
pub fn sin_cos_turn<F: Lanes>(turn: F) -> (F, F) {
    let (cos, sin) = cos_sin_of_turn(turn);
    (sin, cos)
}

/// Unit square to the regular polygon of [`super::sample_polygon`].
#[inline(always)]
pub fn sample_polygon<F: Lanes>([u0, u1]: [F; 2], corners: u32, rotation: f32) -> [F; 2] {
    let n = corners.max(3) as f32;
    let sector = (u0 * n).floor().min(u0.constant(n - 1.0));
    let v = u0 * n - sector;
    // A triangle from the centre: the square root makes the area below a radius grow linearly with u1.
    let r = u1.sqrt();
    let first = (f64::from(rotation) / TAU).fract() as f32;
    let (sin0, cos0) = sin_cos_turn(sector / n + first);
    let (sin1, cos1) = sin_cos_turn((sector + 1.0) / n + first);
    [r * (cos0 + (cos1 - cos0) * v), r * (sin0 + (sin1 - sin0) * v)]
}
