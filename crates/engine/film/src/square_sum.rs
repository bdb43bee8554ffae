//! Exact sums of squares of luminance.

use crate::accumulator::number;
use crate::units::SQUARE_BITS;

/// A sum of squares of luminance in units of 2^-80 (W/(m^2 sr))^2, as a whole number of 256 bits: its lower and upper half.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SquareSum(pub [u128; 2]);

impl SquareSum {
    /// Adds the square of a luminance [W/(m^2 sr)] that is finite and not negative, rounded down if bits are lost.
    #[inline(always)]
    pub(crate) fn add(&mut self, luminance: f32) {
        let bits = luminance.to_bits();
        // A luminance is its mantissa times 2^exponent.
        let (mantissa, exponent) = (u64::from(bits & 0x7f_ffff | 0x80_0000), (bits >> 23) as i32 - 150);
        let square = u128::from(mantissa * mantissa); // Below 2^48.
        let (lower, upper) = if exponent <= 0 {
            // Subnormal luminances lose all bits.
            ((square << SQUARE_BITS).unbounded_shr((-2 * exponent) as u32), 0)
        } else {
            // Luminances of samples are below 2^47, so that the largest shift is 126.
            let shift = (SQUARE_BITS + 2 * exponent).min(127);
            (square << shift, square >> (128 - shift))
        };
        let (sum, carry) = self.0[0].overflowing_add(lower);
        self.0[0] = sum;
        if carry || upper != 0 {
            self.0[1] = self.0[1].saturating_add(upper).saturating_add(u128::from(carry));
        }
    }

    /// Adds another sum.
    #[inline]
    pub(crate) fn merge(&mut self, other: &Self) {
        let (lower, carry) = self.0[0].overflowing_add(other.0[0]);
        self.0 = [lower, self.0[1].saturating_add(other.0[1]).saturating_add(u128::from(carry))];
    }

    /// The sum nearest to a number that is finite and not negative [(W/(m^2 sr))^2].
    pub(crate) fn from_f64(sum: f64) -> Self {
        let (units, upper_unit) = (sum * f64::from(SQUARE_BITS).exp2(), 128f64.exp2());
        // `as` saturates.
        let upper = (units / upper_unit) as u128;
        Self([(units - upper as f64 * upper_unit) as u128, upper])
    }

    /// The sum as a floating-point number [(W/(m^2 sr))^2].
    pub fn to_f64(self) -> f64 {
        let unit = (-f64::from(SQUARE_BITS)).exp2();
        number(self.0[1]) * (unit * 128f64.exp2()) + number(self.0[0]) * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_as_by_the_compiler() {
        let mut bits = 0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c834_u128;
        for shift in 0..=128u32 {
            for _ in 0..1000 {
                bits = bits.wrapping_mul(0x2360_ed05_1fc6_5da4_4385_df64_9fcc_f645).wrapping_add(1);
                let v = bits.checked_shr(shift).unwrap_or(0);
                // Ties and their neighbours too.
                let top = v & !0 << (128 - v.leading_zeros()).saturating_sub(54);
                for v in [v, top, top.wrapping_add(1), top.wrapping_sub(1)] {
                    assert_eq!(number(v).to_bits(), (v as f64).to_bits(), "{v}");
                }
            }
        }
    }

    fn square(luminance: f32) -> SquareSum {
        let mut sum = SquareSum::default();
        sum.add(luminance);
        sum
    }

    #[test]
    fn squares_are_exact_where_they_can_be() {
        for v in [0.0f32, 1.0, 0.1, 3.7e5, 1.5e-6, 2e-11, 6e13, 1.3e-15, 1.0e2, 33.0] {
            let (back, square) = (square(v).to_f64(), f64::from(v) * f64::from(v));
            assert!((back - square).abs() <= 1e-15 * square + (-80f64).exp2(), "{v}: {back}");
        }
        assert_eq!(square(1.0).0, [1 << 80, 0]);
        for v in [0.0, 0.1, 7e14, 2.8e14, 2.9e14, 3.7e40] {
            let back = SquareSum::from_f64(v).to_f64();
            assert!((back - v).abs() <= 1e-15 * v, "{v}: {back}");
        }
        assert_eq!(square(f32::MIN_POSITIVE).0, [0, 0]);
        // A carry goes from the lower half to the upper half.
        let mut sum = SquareSum([u128::MAX, 7]);
        sum.merge(&SquareSum([2, 1]));
        assert_eq!(sum.0, [1, 9]);
    }
}
