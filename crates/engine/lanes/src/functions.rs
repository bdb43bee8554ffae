//! Elementary functions from IEEE operations alone, so that they have the same bits on every machine. The library of C
//! does not promise that.

use crate::{Lanes, Mask};
use std::f32::consts::{FRAC_PI_2, LN_2, LOG2_E, PI, TAU};

/// Cosine and sine of a fraction of a turn, `|turn| <= 1e6`, with an absolute error below 1.3e-7 for `|turn| <= 2`. The
/// reduction to an eighth of a turn is exact.
#[inline(always)]
pub fn cos_sin_of_turn<F: Lanes>(turn: F) -> (F, F) {
    let quarter = (turn * 4.0).round();
    let x = (turn - quarter * 0.25) * TAU;
    let x2 = x * x;
    // Taylor series to x^9 and x^8: at pi/4 the next terms are 2e-9 and 2.5e-8.
    let sin = x * (x2 * (x2 * (x2 * (x2 * (1.0 / 362_880.0) + (-1.0 / 5040.0)) + 1.0 / 120.0) + (-1.0 / 6.0)) + 1.0);
    let cos = x2 * (x2 * (x2 * (x2 * (1.0 / 40_320.0) + (-1.0 / 720.0)) + 1.0 / 24.0) + (-0.5)) + 1.0;
    let quarter = (turn * 4.0).round_to_word();
    let is_odd = F::word_eq(quarter & 1, F::splat_word(turn.token(), 1));
    let (c, s) = (is_odd.select(-sin, cos), is_odd.select(cos, sin));
    // In the second half of the turn both change their sign.
    let flip = (quarter & 2) << 30;
    (F::from_bits(c.to_bits() ^ flip), F::from_bits(s.to_bits() ^ flip))
}

/// Cosine and sine of any finite angle \[rad\], with an absolute error below 2.5e-7 for `|angle| <= 1e6`.
#[inline]
pub fn cos_sin_of_angle(angle: f32) -> (f32, f32) {
    let turns = f64::from(angle) / std::f64::consts::TAU;
    cos_sin_of_turn((turns - turns.round()) as f32)
}

/// See [`crate::Real::cos_sin`].
#[inline(always)]
pub(crate) fn cos_sin<F: Lanes>(angle: F) -> (F, F) {
    cos_sin_of_turn(angle * (1.0 / TAU))
}

/// The angle of the point (x, y) from the positive x axis, in [-pi, pi], with a relative error below 4e-7. Zero for the
/// origin.
#[inline(always)]
pub fn atan2<F: Lanes>(y: F, x: F) -> F {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = (ax.min(ay), ax.max(ay));
    // The ratio in [0, 1]; zero if both are zero.
    let t = small / large.max(large.constant(f32::MIN_POSITIVE));
    // atan t = pi/8 + atan((t - k) / (1 + k t)) with k = tan(pi/8), above t = k / 2 only.
    const K: f32 = 0.414_213_57;
    let is_far = t.gt(t.constant(0.5 * K));
    let r = is_far.select((t + -K) / (t * K + 1.0), t);
    let r2 = r * r;
    // Taylor series to r^13 of an argument up to 0.4143.
    let series = r2
        * (r2 * (r2 * (r2 * (r2 * (r2 * (1.0 / 13.0) + (-1.0 / 11.0)) + 1.0 / 9.0) + (-1.0 / 7.0)) + 0.2)
            + (-1.0 / 3.0))
        + 1.0;
    let angle = r * series + r.constant(0.25 * FRAC_PI_2).only(is_far);
    let angle = ay.gt(ax).select(-angle + FRAC_PI_2, angle);
    let angle = x.lt(x.constant(0.0)).select(-angle + PI, angle);
    angle.copysign(y)
}

/// See [`crate::Real::angle`].
#[inline(always)]
pub(crate) fn angle<F: Lanes>(x: F, y: F) -> F {
    atan2(y, x)
}

/// The exponential function with a relative error below 2e-7; zero below -87, and the value at 88 above.
#[inline(always)]
pub fn exp<F: Lanes>(x: F) -> F {
    let is_tiny = x.lt(x.constant(-87.0));
    let x = x.clamp(-87.0, 88.0);
    let n = (x * LOG2_E).round();
    // x - n ln 2 in two parts; the first one has zeros in its last bits.
    let r = (x - n * 0.693_359_4) - n * -2.121_944_4e-4;
    let p = r
        * (r * (r * (r * (r * (r * (r * (1.0 / 5040.0) + 1.0 / 720.0) + 1.0 / 120.0) + 1.0 / 24.0) + 1.0 / 6.0) + 0.5)
            + 1.0)
        + 1.0;
    let scale = F::from_bits(((x * LOG2_E).round_to_word() + 127) << 23);
    (p * scale).only(!is_tiny)
}

/// The natural logarithm of a positive normal number, with an error below 2e-7 or the same share of the result.
#[inline(always)]
pub fn ln<F: Lanes>(x: F) -> F {
    let bits = x.to_bits();
    // The mantissa between sqrt(1/2) and sqrt(2), and the exponent.
    let shifted = bits - 0x3f35_04f3;
    let exponent = F::from_word(shifted >> 23) - F::from_word((shifted >> 31) * 512);
    let m = F::from_bits((shifted & 0x007f_ffff) + 0x3f35_04f3);
    // ln m = 2 artanh s with s = (m - 1) / (m + 1), |s| < 0.172.
    let s = (m + -1.0) / (m + 1.0);
    let s2 = s * s;
    let series = s2 * (s2 * (s2 * (s2 * (2.0 / 9.0) + 2.0 / 7.0) + 2.0 / 5.0) + 2.0 / 3.0) + 2.0;
    s * series + exponent * LN_2
}

/// `x^y` for positive normal `x`, with a relative error of about 2e-7 times `1 + |y ln x|`.
#[inline(always)]
pub fn pow<F: Lanes>(x: F, y: F) -> F {
    exp(ln(x) * y)
}
