//! Arithmetic that single and double precision share.

use crate::Mask;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number per lane, of single or of double precision.
pub trait Real:
    Copy
    + Debug
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + 'static
{
    /// Result of comparisons.
    type Mask: Mask<Self>;

    /// A constant in the lanes of this value.
    fn constant(self, x: f32) -> Self;
    /// The smallest positive normal number, in the lanes of this value.
    fn tiny(self) -> Self;
    /// The difference between 1 and the next larger number, in the lanes of this value.
    fn epsilon(self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// `self < other ? self : other`: `other` if either is a NaN, as `minps` of x86.
    fn min(self, other: Self) -> Self;
    /// `self > other ? self : other`: `other` if either is a NaN, as `maxps` of x86.
    fn max(self, other: Self) -> Self;
    /// Is it less?
    fn lt(self, other: Self) -> Self::Mask;
    /// Is it less or equal?
    fn le(self, other: Self) -> Self::Mask;
    /// The angle of the point (x, y) from the positive x axis, in [0, pi], for `y >= 0`. Zero for the origin. The relative
    /// error is below 4e-7 in single and 1e-15 in double precision.
    fn angle(x: Self, y: Self) -> Self;
    /// Cosine and sine of an angle in [0, 2 pi], with an absolute error below 1e-6 in single and 2e-15 in double precision.
    fn cos_sin(angle: Self) -> (Self, Self);

    /// Is it greater?
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// Is it greater or equal?
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// Is it above zero?
    #[inline(always)]
    fn is_positive(self) -> Self::Mask {
        self.constant(0.0).lt(self)
    }
    /// Is it a number, and not infinite?
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(self.constant(f32::INFINITY))
    }
    /// `1 / self`.
    #[inline(always)]
    fn recip(self) -> Self {
        self.constant(1.0) / self
    }
    /// `1 - self`.
    #[inline(always)]
    fn one_minus(self) -> Self {
        self.constant(1.0) - self
    }
    /// This number where the mask is true, zero elsewhere.
    #[inline(always)]
    fn only(self, mask: Self::Mask) -> Self {
        mask.select(self, self.constant(0.0))
    }
}
