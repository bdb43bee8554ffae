//! Four, eight and sixteen lanes: the vectors of `fearless_simd`.

use crate::double::{self, Pair};
use crate::{Double, Lanes, Long, MAX_WIDTH, Mask, Real, Word, functions};
use fearless_simd::prelude::*;
use fearless_simd::{
    MaskNarrow, MaskWiden, Simd, SimdCvtFloat, SimdNarrow, SimdWiden, f32x4, f32x8, f32x16, f64x2, f64x4, f64x8, i32x4,
    i32x8, i32x16, mask32x4, mask32x8, mask32x16, mask64x2, mask64x4, mask64x8, u32x4, u32x8, u32x16, u64x2, u64x4,
    u64x8,
};
use std::ops::{Add, BitXor, Mul, Shr};

macro_rules! real {
    ($number:ident, $mask:ident, $scalar:ident, $functions:ident) => {
        impl<S: Simd> Mask<$number<S>> for $mask<S> {
            #[inline(always)]
            fn bits(self) -> u32 {
                self.to_bitmask() as u32
            }
            #[inline(always)]
            fn select(self, yes: $number<S>, no: $number<S>) -> $number<S> {
                Select::select(self, yes, no)
            }
        }

        impl<S: Simd> Real for $number<S> {
            type Mask = $mask<S>;

            #[inline(always)]
            fn constant(self, x: f32) -> Self {
                SimdBase::splat(self.simd, x.into())
            }
            #[inline(always)]
            fn tiny(self) -> Self {
                SimdBase::splat(self.simd, $scalar::MIN_POSITIVE)
            }
            #[inline(always)]
            fn epsilon(self) -> Self {
                SimdBase::splat(self.simd, $scalar::EPSILON)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                SimdFloat::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                SimdBase::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if has_x86_minimum(self.simd) {
                    SimdBase::min(self, other)
                } else {
                    Mask::select(Real::lt(self, other), self, other)
                }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if has_x86_minimum(self.simd) {
                    SimdBase::max(self, other)
                } else {
                    Mask::select(Real::lt(other, self), self, other)
                }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> Self::Mask {
                self.simd_lt(other)
            }
            #[inline(always)]
            fn le(self, other: Self) -> Self::Mask {
                self.simd_le(other)
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
real!(f32x4, mask32x4, f32, functions);
real!(f32x8, mask32x8, f32, functions);
real!(f32x16, mask32x16, f32, functions);
real!(f64x2, mask64x2, f64, double);
real!(f64x4, mask64x4, f64, double);
real!(f64x8, mask64x8, f64, double);

macro_rules! vector {
    ($width:literal, $number:ident, $word:ident, $signed:ident, $long:ident, $double:ident, $mask64:ident, $columns:ident) => {
        impl<S: Simd> Word for $word<S> {}

        impl<S: Simd> Lanes for $number<S> {
            const WIDTH: usize = $width;
            type Token = S;
            type Double = Pair<$double<S>>;
            type Word = $word<S>;
            type Long = Halves<$long<S>>;

            #[inline(always)]
            fn vectorize<R>(token: S, code: impl FnOnce() -> R) -> R {
                Simd::vectorize(token, code)
            }
            #[inline(always)]
            fn splat(token: S, x: f32) -> Self {
                SimdBase::splat(token, x)
            }
            #[inline(always)]
            fn token(self) -> S {
                self.simd
            }
            #[inline(always)]
            fn load(token: S, from: &[f32]) -> Self {
                SimdBase::from_slice(token, &from[..$width])
            }
            #[inline(always)]
            fn store(self, to: &mut [f32]) {
                self.store_slice(&mut to[..$width]);
            }
            #[inline(always)]
            fn load_word(token: S, from: &[u32]) -> Self::Word {
                SimdBase::from_slice(token, &from[..$width])
            }
            #[inline(always)]
            fn store_word(word: Self::Word, to: &mut [u32]) {
                word.store_slice(&mut to[..$width]);
            }
            #[inline(always)]
            fn splat_word(token: S, x: u32) -> Self::Word {
                SimdBase::splat(token, x)
            }
            #[inline(always)]
            fn mask(token: S, bits: u32) -> Self::Mask {
                SimdMask::from_bitmask(token, u64::from(bits))
            }
            #[inline(always)]
            fn load_rows<'a>(token: S, row: impl Fn(usize) -> &'a [f32; 4]) -> [Self; 4] {
                $columns(token, &row, 0)
            }
            #[inline(always)]
            fn to_rows([a, b, c, d]: [Self; 4]) -> [[f32; 4]; MAX_WIDTH] {
                let (ac, bd) = ([a.zip_low(c), a.zip_high(c)], [b.zip_low(d), b.zip_high(d)]);
                let mut rows = [[0.0; 4]; MAX_WIDTH];
                let numbers = rows.as_flattened_mut();
                ac[0].zip_low(bd[0]).store_slice(&mut numbers[..$width]);
                ac[0].zip_high(bd[0]).store_slice(&mut numbers[$width..2 * $width]);
                ac[1].zip_low(bd[1]).store_slice(&mut numbers[2 * $width..3 * $width]);
                ac[1].zip_high(bd[1]).store_slice(&mut numbers[3 * $width..4 * $width]);
                rows
            }
            #[inline(always)]
            fn compress(self, mask: Self::Mask) -> Self {
                SimdBase::compress(self, mask)
            }
            #[inline(always)]
            fn eq(self, other: Self) -> Self::Mask {
                self.simd_eq(other)
            }
            #[inline(always)]
            fn to_bits(self) -> Self::Word {
                self.bitcast()
            }
            #[inline(always)]
            fn from_bits(bits: Self::Word) -> Self {
                bits.bitcast()
            }
            #[inline(always)]
            fn from_word(word: Self::Word) -> Self {
                let signed: $signed<S> = word.bitcast();
                Self::float_from(signed)
            }
            #[inline(always)]
            fn join(low: Self::Word, high: Self::Word) -> Self::Long {
                let (low, high): ($long<S>, $long<S>) = (low.bitcast(), high.bitcast());
                Halves {
                    even: (low & 0xffff_ffff_u64) | (high << 32),
                    odd: (low >> 32) | (high & 0xffff_ffff_0000_0000_u64),
                }
            }
            #[inline(always)]
            fn split(long: Self::Long) -> [Self::Word; 2] {
                let low = (long.even & 0xffff_ffff_u64) | (long.odd << 32);
                let high = (long.even >> 32) | (long.odd & 0xffff_ffff_0000_0000_u64);
                [low.bitcast(), high.bitcast()]
            }
            #[inline(always)]
            fn word_eq(a: Self::Word, b: Self::Word) -> Self::Mask {
                a.simd_eq(b)
            }
        }

        impl<S: Simd> Mask<Pair<$double<S>>> for Pair<$mask64<S>> {
            #[inline(always)]
            fn bits(self) -> u32 {
                (self.low.to_bitmask() | self.high.to_bitmask() << ($width / 2)) as u32
            }
            #[inline(always)]
            fn select(self, yes: Pair<$double<S>>, no: Pair<$double<S>>) -> Pair<$double<S>> {
                Pair {
                    low: Select::select(self.low, yes.low, no.low),
                    high: Select::select(self.high, yes.high, no.high),
                }
            }
        }

        impl<S: Simd> Double<$number<S>> for Pair<$double<S>> {
            #[inline(always)]
            fn splat(token: S, x: f64) -> Self {
                Self { low: SimdBase::splat(token, x), high: SimdBase::splat(token, x) }
            }
            #[inline(always)]
            fn load(token: S, from: &[f64; MAX_WIDTH]) -> Self {
                let (low, high) = from[..$width].split_at($width / 2);
                Self { low: SimdBase::from_slice(token, low), high: SimdBase::from_slice(token, high) }
            }
            #[inline(always)]
            fn store(self, to: &mut [f64; MAX_WIDTH]) {
                let (low, high) = to[..$width].split_at_mut($width / 2);
                self.low.store_slice(low);
                self.high.store_slice(high);
            }
            #[inline(always)]
            fn widen(x: $number<S>) -> Self {
                let (low, high) = SimdWiden::widen(x);
                Self { low, high }
            }
            #[inline(always)]
            fn narrow(self) -> $number<S> {
                SimdNarrow::narrow(self.low, self.high)
            }
            #[inline(always)]
            fn narrow_mask(mask: Self::Mask) -> <$number<S> as Real>::Mask {
                MaskNarrow::narrow(mask.low, mask.high)
            }
            #[inline(always)]
            fn widen_mask(mask: <$number<S> as Real>::Mask) -> Self::Mask {
                let (low, high) = MaskWiden::widen(mask);
                Pair { low, high }
            }
        }
    };
}

vector!(4, f32x4, u32x4, i32x4, u64x2, f64x2, mask64x2, four_columns);
vector!(8, f32x8, u32x8, i32x8, u64x4, f64x4, mask64x4, eight_columns);
vector!(16, f32x16, u32x16, i32x16, u64x8, f64x8, mask64x8, sixteen_columns);

/// The columns of four rows, from the row `first`.
#[inline(always)]
fn four_columns<'a, S: Simd>(token: S, row: &impl Fn(usize) -> &'a [f32; 4], first: usize) -> [f32x4<S>; 4] {
    let a = f32x4::from_slice(token, row(first));
    let b = f32x4::from_slice(token, row(first + 1));
    let c = f32x4::from_slice(token, row(first + 2));
    let d = f32x4::from_slice(token, row(first + 3));
    let (ac, bd) = ((a.zip_low(c), a.zip_high(c)), (b.zip_low(d), b.zip_high(d)));
    [ac.0.zip_low(bd.0), ac.0.zip_high(bd.0), ac.1.zip_low(bd.1), ac.1.zip_high(bd.1)]
}

#[inline(always)]
fn eight_columns<'a, S: Simd>(token: S, row: &impl Fn(usize) -> &'a [f32; 4], first: usize) -> [f32x8<S>; 4] {
    let ([a, b, c, d], [e, f, g, h]) = (four_columns(token, row, first), four_columns(token, row, first + 4));
    [a.combine(e), b.combine(f), c.combine(g), d.combine(h)]
}

#[inline(always)]
fn sixteen_columns<'a, S: Simd>(token: S, row: &impl Fn(usize) -> &'a [f32; 4], first: usize) -> [f32x16<S>; 4] {
    let ([a, b, c, d], [e, f, g, h]) = (eight_columns(token, row, first), eight_columns(token, row, first + 8));
    [a.combine(e), b.combine(f), c.combine(g), d.combine(h)]
}

/// Long integers of the lanes with even numbers and of those with odd numbers.
#[derive(Clone, Copy, Debug)]
pub struct Halves<L> {
    even: L,
    odd: L,
}

macro_rules! halves {
    ($($trait:ident $method:ident $other:ty;)*) => {$(
        impl<L: Copy + $trait<$other, Output = L>> $trait<$other> for Halves<L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: $other) -> Self {
                Self { even: self.even.$method(other), odd: self.odd.$method(other) }
            }
        }
    )*};
}
halves! {
    BitXor bitxor u64;
    Add add u64;
    Mul mul u64;
    Shr shr u32;
}

impl<L: BitXor<Output = L>> BitXor for Halves<L> {
    type Output = Self;
    #[inline(always)]
    fn bitxor(self, other: Self) -> Self {
        Self { even: self.even ^ other.even, odd: self.odd ^ other.odd }
    }
}

impl<L> Long for Halves<L> where
    Self: Copy
        + std::fmt::Debug
        + BitXor<Output = Self>
        + BitXor<u64, Output = Self>
        + Add<u64, Output = Self>
        + Mul<u64, Output = Self>
        + Shr<u32, Output = Self>
{
}

/// True if the minimum of the instruction set is that of x86. It is faster than a comparison and a selection.
#[inline(always)]
fn has_x86_minimum<S: Simd>(simd: S) -> bool {
    cfg!(any(target_arch = "x86", target_arch = "x86_64")) && !simd.level().is_fallback()
}
