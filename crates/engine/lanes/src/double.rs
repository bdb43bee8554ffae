//! Double precision per lane: a pair of vectors, each with half of the lanes.

use crate::{Lanes, MAX_WIDTH, Mask, Real};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// A double-precision number for each lane of `F`.
pub trait Double<F: Lanes>: Real + Add<f64, Output = Self> + Sub<f64, Output = Self> + Mul<f64, Output = Self> {
    /// The same number in all lanes.
    fn splat(token: F::Token, x: f64) -> Self;
    /// The numbers, one for each lane.
    fn load(token: F::Token, from: &[f64; MAX_WIDTH]) -> Self;
    /// Writes the lanes to the first places of an array.
    fn store(self, to: &mut [f64; MAX_WIDTH]);
    /// The numbers in double precision.
    fn widen(x: F) -> Self;
    /// The nearest numbers of single precision.
    fn narrow(self) -> F;
    /// The mask for numbers of single precision.
    fn narrow_mask(mask: Self::Mask) -> F::Mask;
    /// The mask for numbers of double precision.
    fn widen_mask(mask: F::Mask) -> Self::Mask;
}

/// The first half of the lanes, and the second one.
#[derive(Clone, Copy, Debug)]
pub struct Pair<V> {
    pub(crate) low: V,
    pub(crate) high: V,
}

macro_rules! operators {
    ($($trait:ident $method:ident;)*) => {$(
        impl<V: $trait<Output = V>> $trait for Pair<V> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { low: self.low.$method(other.low), high: self.high.$method(other.high) }
            }
        }
    )*};
}
operators! {
    Add add;
    Sub sub;
    Mul mul;
    Div div;
    BitAnd bitand;
    BitOr bitor;
    BitXor bitxor;
}

macro_rules! operators_with_constants {
    ($($trait:ident $method:ident;)*) => {$(
        impl<V: $trait<f64, Output = V>> $trait<f64> for Pair<V> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self { low: self.low.$method(other), high: self.high.$method(other) }
            }
        }
    )*};
}
operators_with_constants! {
    Add add;
    Sub sub;
    Mul mul;
}

impl<V: Neg<Output = V>> Neg for Pair<V> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { low: -self.low, high: -self.high }
    }
}

impl<V: Not<Output = V>> Not for Pair<V> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self { low: !self.low, high: !self.high }
    }
}

impl<V: Real> Real for Pair<V>
where
    Pair<V::Mask>: Mask<Self>,
{
    type Mask = Pair<V::Mask>;

    #[inline(always)]
    fn constant(self, x: f32) -> Self {
        Self { low: self.low.constant(x), high: self.low.constant(x) }
    }
    #[inline(always)]
    fn tiny(self) -> Self {
        Self { low: self.low.tiny(), high: self.low.tiny() }
    }
    #[inline(always)]
    fn epsilon(self) -> Self {
        Self { low: self.low.epsilon(), high: self.low.epsilon() }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { low: self.low.sqrt(), high: self.high.sqrt() }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self { low: self.low.abs(), high: self.high.abs() }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.min(other.high) }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.max(other.high) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        Pair { low: self.low.lt(other.low), high: self.high.lt(other.high) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        Pair { low: self.low.le(other.low), high: self.high.le(other.high) }
    }
    #[inline(always)]
    fn angle(x: Self, y: Self) -> Self {
        Self { low: V::angle(x.low, y.low), high: V::angle(x.high, y.high) }
    }
    #[inline(always)]
    fn cos_sin(angle: Self) -> (Self, Self) {
        let ((c0, s0), (c1, s1)) = (V::cos_sin(angle.low), V::cos_sin(angle.high));
        (Self { low: c0, high: c1 }, Self { low: s0, high: s1 })
    }
}

/// See [`Real::angle`].
#[inline(always)]
pub(crate) fn angle<V: Real + Add<f64, Output = V> + Mul<f64, Output = V>>(x: V, y: V) -> V {
    let ax = x.abs();
    // Both are zero for the origin.
    let (small, large) = (ax.min(y), ax.max(y).max(x.tiny()));
    // atan(s / l) = a + atan((s - l tan a) / (l + s tan a)) with a of 0, 0.1 pi and 0.2 pi, which leaves angles up to pi / 20.
    let (is_middle, is_far) = (small.gt(large * 0.158_384_440_325), small.gt(large * 0.509_525_449_494));
    let zero = x.constant(0.0);
    let tan = is_far.select(zero + 0.726_542_528_005_360_9, (zero + 0.324_919_696_232_906_3).only(is_middle));
    let turned = is_far.select(zero + 0.2 * PI, (zero + 0.1 * PI).only(is_middle));
    let r = (small - large * tan) / (large + small * tan);
    // At pi / 20 the next term of the Taylor series is 3e-17 of the sum.
    let odd = [-1.0 / 3.0, 0.2, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0, -1.0 / 15.0, 1.0 / 17.0];
    let angle = turned + r * series(r * r, odd);
    let angle = y.gt(ax).select(-angle + FRAC_PI_2, angle);
    x.lt(zero).select(-angle + PI, angle)
}

/// See [`Real::cos_sin`].
#[inline(always)]
pub(crate) fn cos_sin<V: Real + Add<f64, Output = V> + Mul<f64, Output = V>>(angle: V) -> (V, V) {
    // The reduction of a turn to an eighth of it is exact.
    let turn = angle * (1.0 / TAU);
    let is_lower = turn.gt(turn.constant(0.5));
    let half = is_lower.select(turn.one_minus(), turn);
    let is_left = half.gt(turn.constant(0.25));
    let quarter = is_left.select(turn.constant(0.5) - half, half);
    let is_steep = quarter.gt(turn.constant(0.125));
    let x = is_steep.select(turn.constant(0.25) - quarter, quarter) * TAU;
    let x2 = x * x;
    // Taylor series: at pi/4 the next terms are 1e-19 and 2e-18.
    let sin = x * series(
        x2,
        [
            -1.0 / 6.0,
            1.0 / 120.0,
            -1.0 / 5040.0,
            1.0 / 362_880.0,
            -1.0 / 39_916_800.0,
            1.0 / 6_227_020_800.0,
            -1.0 / 1_307_674_368_000.0,
            1.0 / 355_687_428_096_000.0,
        ],
    );
    let cos = series(
        x2,
        [
            -0.5,
            1.0 / 24.0,
            -1.0 / 720.0,
            1.0 / 40_320.0,
            -1.0 / 3_628_800.0,
            1.0 / 479_001_600.0,
            -1.0 / 87_178_291_200.0,
            1.0 / 20_922_789_888_000.0,
        ],
    );
    let (cos, sin) = (is_steep.select(sin, cos), is_steep.select(cos, sin));
    (is_left.select(-cos, cos), is_lower.select(-sin, sin))
}

/// `1 + x (c0 + x (c1 + ..))`, in pairs (Estrin 1960), which have a shorter chain of operations than one after the other.
#[inline(always)]
fn series<V: Real + Add<f64, Output = V> + Mul<f64, Output = V>>(x: V, c: [f64; 8]) -> V {
    let (x2, one) = (x * x, x.constant(1.0));
    let low = (x * c[1] + c[0]) + (x * c[3] + c[2]) * x2;
    let high = (x * c[5] + c[4]) + (x * c[7] + c[6]) * x2;
    one + x * (low + high * (x2 * x2))
}
