//! Four, eight and sixteen lanes: the vectors of `fearless_simd`.

use crate::{Lanes, Mask, Word};
use fearless_simd::prelude::*;
use fearless_simd::{
    Simd, SimdCvtFloat, f32x4, f32x8, f32x16, i32x4, i32x8, i32x16, mask32x4, mask32x8, mask32x16, u32x4, u32x8, u32x16,
};

macro_rules! vector {
    ($width:literal, $number:ident, $word:ident, $signed:ident, $mask:ident) => {
        impl<S: Simd> Word for $word<S> {}

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

        impl<S: Simd> Lanes for $number<S> {
            const WIDTH: usize = $width;
            type Token = S;
            type Mask = $mask<S>;
            type Word = $word<S>;

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
                    Mask::select(Lanes::lt(self, other), self, other)
                }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if has_x86_minimum(self.simd) {
                    SimdBase::max(self, other)
                } else {
                    Mask::select(Lanes::lt(other, self), self, other)
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
            fn word_eq(a: Self::Word, b: Self::Word) -> Self::Mask {
                a.simd_eq(b)
            }
        }
    };
}

vector!(4, f32x4, u32x4, i32x4, mask32x4);
vector!(8, f32x8, u32x8, i32x8, mask32x8);
vector!(16, f32x16, u32x16, i32x16, mask32x16);

/// True if the minimum of the instruction set is that of x86. It is faster than a comparison and a selection.
#[inline(always)]
fn has_x86_minimum<S: Simd>(simd: S) -> bool {
    cfg!(any(target_arch = "x86", target_arch = "x86_64")) && !simd.level().is_fallback()
}
