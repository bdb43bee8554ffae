//! Double-precision numbers of lanes, for sums in which digits cancel.

use crate::{Lanes, V3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f64x2, f64x4, f64x8};
use glam::DVec3;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Sub};

/// A double-precision number per lane.
pub trait Double:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// The single-precision number of the same lanes.
    type Single: Lanes<Double = Self>;

    /// The same number in all lanes.
    fn splat(token: <Self::Single as Lanes>::Token, x: f64) -> Self;
    /// The token of this value.
    fn token(self) -> <Self::Single as Lanes>::Token;
    /// The nearest single-precision number.
    fn to_single(self) -> Self::Single;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Is it less than a number?
    fn lt(self, other: f64) -> <Self::Single as Lanes>::Mask;
}

impl Double for f64 {
    type Single = f32;

    #[inline(always)]
    fn splat((): (), x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn token(self) {}
    #[inline(always)]
    fn to_single(self) -> f32 {
        self as f32
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: f64) -> bool {
        self < other
    }
}

/// Numbers of the first and of the second half of the lanes.
#[derive(Clone, Copy, Debug)]
pub struct Doubles<D> {
    pub(crate) low: D,
    pub(crate) high: D,
}

macro_rules! operators {
    ($($trait:ident $method:ident;)*) => {$(
        impl<D: Copy + $trait<Output = D>> $trait for Doubles<D> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { low: self.low.$method(other.low), high: self.high.$method(other.high) }
            }
        }
        impl<D: Copy + $trait<f64, Output = D>> $trait<f64> for Doubles<D> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self { low: self.low.$method(other), high: self.high.$method(other) }
            }
        }
    )*};
}
operators! {
    Add add;
    Sub sub;
    Mul mul;
    Div div;
}

macro_rules! doubles {
    ($double:ident, $number:ident) => {
        impl<S: Simd> Double for Doubles<$double<S>> {
            type Single = fearless_simd::$number<S>;

            #[inline(always)]
            fn splat(token: S, x: f64) -> Self {
                let half = SimdBase::splat(token, x);
                Self { low: half, high: half }
            }
            #[inline(always)]
            fn token(self) -> S {
                self.low.simd
            }
            #[inline(always)]
            fn to_single(self) -> Self::Single {
                self.low.narrow(self.high)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self { low: SimdFloat::sqrt(self.low), high: SimdFloat::sqrt(self.high) }
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self { low: SimdBase::abs(self.low), high: SimdBase::abs(self.high) }
            }
            #[inline(always)]
            fn lt(self, other: f64) -> <Self::Single as Lanes>::Mask {
                self.low.simd_lt(other).narrow(self.high.simd_lt(other))
            }
        }
    };
}
doubles!(f64x2, f32x4);
doubles!(f64x4, f32x8);
doubles!(f64x8, f32x16);

impl<F: Lanes> V3<F> {
    /// The same vectors in double precision.
    #[inline(always)]
    pub fn to_double(self) -> V3<F::Double> {
        V3::new(self.x.to_double(), self.y.to_double(), self.z.to_double())
    }
}

impl<D: Double> V3<D> {
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn splat_double(token: <D::Single as Lanes>::Token, v: DVec3) -> Self {
        Self::new(D::splat(token, v.x), D::splat(token, v.y), D::splat(token, v.z))
    }
    /// The nearest vectors in single precision.
    #[inline(always)]
    pub fn to_single(self) -> V3<D::Single> {
        V3::new(self.x.to_single(), self.y.to_single(), self.z.to_single())
    }
    /// Absolute values of the coordinates, in double precision.
    #[inline(always)]
    pub fn abs_double(self) -> Self {
        Self::new(self.x.abs(), self.y.abs(), self.z.abs())
    }
}
