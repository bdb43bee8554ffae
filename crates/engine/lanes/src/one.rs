//! One lane: plain numbers.

use crate::{Double, Lanes, Long, MAX_WIDTH, Mask, Real, Word, double, functions};
use std::ops::{Add, BitAnd, BitOr, BitXor, Mul, Not, Shl, Shr, Sub};

/// A wrapping integer of one lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct One(pub u32);

macro_rules! operators {
    ($($trait:ident $method:ident $op:expr;)*) => {$(
        impl $trait for One {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self($op(self.0, other.0))
            }
        }
        impl $trait<u32> for One {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: u32) -> Self {
                Self($op(self.0, other))
            }
        }
    )*};
}
operators! {
    Add add u32::wrapping_add;
    Sub sub u32::wrapping_sub;
    Mul mul u32::wrapping_mul;
    BitXor bitxor |a, b| a ^ b;
    BitAnd bitand |a, b| a & b;
    BitOr bitor |a, b| a | b;
}

impl Shl<u32> for One {
    type Output = Self;
    #[inline(always)]
    fn shl(self, bits: u32) -> Self {
        Self(self.0 << bits)
    }
}

impl Shr<u32> for One {
    type Output = Self;
    #[inline(always)]
    fn shr(self, bits: u32) -> Self {
        Self(self.0 >> bits)
    }
}

impl Word for One {
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        Self(self.0.reverse_bits())
    }
}

/// A wrapping long integer of one lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OneLong(pub u64);

impl Long for OneLong {}

impl BitXor for OneLong {
    type Output = Self;
    #[inline(always)]
    fn bitxor(self, other: Self) -> Self {
        Self(self.0 ^ other.0)
    }
}

impl BitXor<u64> for OneLong {
    type Output = Self;
    #[inline(always)]
    fn bitxor(self, other: u64) -> Self {
        Self(self.0 ^ other)
    }
}

impl Add<u64> for OneLong {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: u64) -> Self {
        Self(self.0.wrapping_add(other))
    }
}

impl Mul<u64> for OneLong {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: u64) -> Self {
        Self(self.0.wrapping_mul(other))
    }
}

impl Shr<u32> for OneLong {
    type Output = Self;
    #[inline(always)]
    fn shr(self, bits: u32) -> Self {
        Self(self.0 >> bits)
    }
}

/// A truth value of one number in double precision. It is not `bool`, so that methods of a `bool` are those for `f32`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DoubleMask(bool);

impl BitAnd for DoubleMask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for DoubleMask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitXor for DoubleMask {
    type Output = Self;
    #[inline(always)]
    fn bitxor(self, other: Self) -> Self {
        Self(self.0 ^ other.0)
    }
}

impl Not for DoubleMask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

macro_rules! real {
    ($number:ident, $mask:ident, $new:expr, $functions:ident) => {
        impl Mask<$number> for $mask {
            #[inline(always)]
            fn bits(self) -> u32 {
                u32::from(self == $new(true))
            }
            #[inline(always)]
            fn select(self, yes: $number, no: $number) -> $number {
                if self == $new(true) { yes } else { no }
            }
        }

        impl Real for $number {
            type Mask = $mask;

            #[inline(always)]
            fn constant(self, x: f32) -> Self {
                x.into()
            }
            #[inline(always)]
            fn tiny(self) -> Self {
                $number::MIN_POSITIVE
            }
            #[inline(always)]
            fn epsilon(self) -> Self {
                $number::EPSILON
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $number::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $number::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                $new(self < other)
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask {
                $new(self <= other)
            }
            #[inline(always)]
            fn angle(x: Self, y: Self) -> Self {
                $functions::angle(x, y)
            }
            #[inline(always)]
            fn cos_sin(angle: Self) -> (Self, Self) {
                $functions::cos_sin(angle)
            }
        }
    };
}
real!(f32, bool, std::convert::identity, functions);
real!(f64, DoubleMask, DoubleMask, double);

impl Lanes for f32 {
    const WIDTH: usize = 1;
    type Token = ();
    type Double = f64;
    type Word = One;
    type Long = OneLong;

    #[inline(always)]
    fn vectorize<R>((): (), code: impl FnOnce() -> R) -> R {
        code()
    }
    #[inline(always)]
    fn splat((): (), x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn token(self) {}
    #[inline(always)]
    fn load((): (), from: &[f32]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[0] = self;
    }
    #[inline(always)]
    fn load_word((): (), from: &[u32]) -> One {
        One(from[0])
    }
    #[inline(always)]
    fn store_word(word: One, to: &mut [u32]) {
        to[0] = word.0;
    }
    #[inline(always)]
    fn splat_word((): (), x: u32) -> One {
        One(x)
    }
    #[inline(always)]
    fn mask((): (), bits: u32) -> bool {
        bits & 1 == 1
    }
    #[inline(always)]
    fn load_rows<'a>((): (), row: impl Fn(usize) -> &'a [f32; 4]) -> [Self; 4] {
        *row(0)
    }
    #[inline(always)]
    fn to_rows(columns: [Self; 4]) -> [[f32; 4]; MAX_WIDTH] {
        let mut rows = [[0.0; 4]; MAX_WIDTH];
        rows[0] = columns;
        rows
    }
    #[inline(always)]
    fn compress(self, _: bool) -> Self {
        self
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn to_bits(self) -> One {
        One(f32::to_bits(self))
    }
    #[inline(always)]
    fn from_bits(bits: One) -> Self {
        f32::from_bits(bits.0)
    }
    #[inline(always)]
    fn from_word(word: One) -> Self {
        word.0 as i32 as f32
    }
    #[inline(always)]
    fn join(low: One, high: One) -> OneLong {
        OneLong(u64::from(high.0) << 32 | u64::from(low.0))
    }
    #[inline(always)]
    fn split(long: OneLong) -> [One; 2] {
        [One(long.0 as u32), One((long.0 >> 32) as u32)]
    }
    #[inline(always)]
    fn word_eq(a: One, b: One) -> bool {
        a.0 == b.0
    }
}

impl Double<f32> for f64 {
    #[inline(always)]
    fn splat((): (), x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn load((): (), from: &[f64; MAX_WIDTH]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; MAX_WIDTH]) {
        to[0] = self;
    }
    #[inline(always)]
    fn widen(x: f32) -> Self {
        x.into()
    }
    #[inline(always)]
    fn narrow(self) -> f32 {
        self as f32
    }
    #[inline(always)]
    fn narrow_mask(mask: DoubleMask) -> bool {
        mask.0
    }
    #[inline(always)]
    fn widen_mask(mask: bool) -> DoubleMask {
        DoubleMask(mask)
    }
}
