//! The cosine-weighted hemisphere in lanes.

use dunkelfeld_lanes::{Lanes, Mask, V3, cos_sin_of_turn};

/// Unit square to the upper hemisphere with density cos(theta) / pi (Shirley and Chiu 1997, Malley's method).
#[inline(always)]
pub(crate) fn sample_cosine_hemisphere<F: Lanes>([u0, u1]: [F; 2]) -> V3<F> {
    let (a, b) = (u0 * 2.0 - 1.0, u1 * 2.0 - 1.0);
    let is_wide = b.abs().lt(a.abs());
    let (r, other) = (is_wide.select(a, b), is_wide.select(b, a));
    let zero = a.constant(0.0);
    let part = other / r.eq(zero).select(a.constant(1.0), r) * 0.125;
    let (c, s) = cos_sin_of_turn(is_wide.select(part, part.constant(0.25) - part));
    let (x, y) = (r * c, r * s);
    // Near the rim the cosine is computed from the distance to the rim. It stays above zero so that no division by it
    // fails.
    V3::new(x, y, (x * x + y * y).one_minus().max(a.constant(1e-10)).sqrt())
}
