//! One number per lane: the arithmetic of code that computes several paths at once.
//!
//! A formula is one function, generic over [`Lanes`]. `f32` is one lane, and the reference of all others. The vectors of
//! `fearless_simd` have 4, 8 and 16 lanes. Every operation is an IEEE operation or one of integers, none is fused or
//! approximate, so a lane has the same bits at every width. [`Lanes::Double`] has double precision. A formula over [`Real`]
//! has either precision.
//!
//! Constants come from a *token*, which exists only on machines with the instructions of its width. [`dispatch!`] calls
//! code with the token of an [`InstructionSet`]. All code in it must be `#[inline(always)]`, closures included: a function
//! that is not inlined is compiled without the instructions, and calls each of them.
//!
//! ```
//! use dunkelfeld_lanes::{InstructionSet, Lanes, dispatch};
//!
//! #[inline(always)]
//! fn lengths<F: Lanes>(token: F::Token, x: &[f32], y: &[f32], out: &mut [f32]) {
//!     for at in (0..x.len()).step_by(F::WIDTH) {
//!         let (x, y) = (F::load(token, &x[at..]), F::load(token, &y[at..]));
//!         (x * x + y * y).sqrt().store(&mut out[at..]);
//!     }
//! }
//!
//! let mut out = [0.0; 16];
//! dispatch!(InstructionSet::best(), F, token => lengths::<F>(token, &[3.0; 16], &[4.0; 16], &mut out));
//! assert_eq!(out, [5.0; 16]);
//! ```

#![forbid(unsafe_code)]

mod double;
mod frame;
mod functions;
mod instruction_set;
mod one;
mod real;
mod v3;
mod vectors;

pub use double::Double;
#[doc(hidden)]
pub use double::Pair;
pub use frame::Frame;
pub use functions::{atan2, cos_sin_of_angle, cos_sin_of_turn, exp, ln, pow};
pub use instruction_set::InstructionSet;
#[doc(hidden)]
pub use instruction_set::separately;
pub use one::{DoubleMask, One, OneLong};
pub use real::Real;
pub use v3::V3;
#[doc(hidden)]
pub use vectors::Halves;

#[doc(hidden)]
pub use fearless_simd;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, BitOr, BitXor, Div, Mul, MulAssign, Not, Shl, Shr, Sub, SubAssign};

/// No type has more lanes.
pub const MAX_WIDTH: usize = 16;

/// A truth value per lane, for numbers of type `F`.
pub trait Mask<F>:
    Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + BitXor<Output = Self> + Not<Output = Self>
{
    /// Bit i stands for lane i. Bits beyond the last lane are zero.
    fn bits(self) -> u32;
    /// `yes` in the lanes that are true, `no` in the others.
    fn select(self, yes: F, no: F) -> F;
    /// Is any lane true?
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
    /// The numbers of the lanes that are true, in ascending order.
    #[inline(always)]
    fn lanes(self) -> TrueLanes {
        TrueLanes(self.bits())
    }
    /// Calls `f` for the number of each lane that is true, in ascending order.
    #[inline(always)]
    fn each(self, mut f: impl FnMut(usize)) {
        let mut bits = self.bits();
        while bits != 0 {
            f(bits.trailing_zeros() as usize);
            bits &= bits - 1;
        }
    }
}

/// An unsigned 32-bit integer per lane, with wrapping arithmetic.
pub trait Word:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + BitXor<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + Add<u32, Output = Self>
    + Sub<u32, Output = Self>
    + Mul<u32, Output = Self>
    + BitXor<u32, Output = Self>
    + BitAnd<u32, Output = Self>
    + BitOr<u32, Output = Self>
    + Shl<u32, Output = Self>
    + Shr<u32, Output = Self>
{
    /// The bits in reverse order.
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        let x = ((self >> 1) & 0x5555_5555) | ((self & 0x5555_5555) << 1);
        let x = ((x >> 2) & 0x3333_3333) | ((x & 0x3333_3333) << 2);
        let x = ((x >> 4) & 0x0f0f_0f0f) | ((x & 0x0f0f_0f0f) << 4);
        let x = ((x >> 8) & 0x00ff_00ff) | ((x & 0x00ff_00ff) << 8);
        (x >> 16) | (x << 16)
    }
}

/// An unsigned 64-bit integer per lane, with wrapping arithmetic.
pub trait Long:
    Copy
    + Debug
    + BitXor<Output = Self>
    + BitXor<u64, Output = Self>
    + Add<u64, Output = Self>
    + Mul<u64, Output = Self>
    + Shr<u32, Output = Self>
{
}

/// A single-precision number per lane.
pub trait Lanes:
    Real
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
    + Div<f32, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// Number of lanes: 1, 4, 8 or 16.
    const WIDTH: usize;
    /// Exists only where the instructions of this type do.
    type Token: Copy + Debug;
    /// Numbers of double precision for the same lanes.
    type Double: Double<Self>;
    /// Integers of the same lanes.
    type Word: Word;
    /// Long integers of the same lanes.
    type Long: Long;

    /// Calls code with the instructions of the lanes. A function that is not inlined contains its code in such a call.
    fn vectorize<R>(token: Self::Token, code: impl FnOnce() -> R) -> R;
    /// The same number in all lanes.
    fn splat(token: Self::Token, x: f32) -> Self;
    /// The token of this value.
    fn token(self) -> Self::Token;
    /// The first numbers of a slice, one for each lane.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn load(token: Self::Token, from: &[f32]) -> Self;
    /// Writes the lanes to the first places of a slice.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn store(self, to: &mut [f32]);
    /// The integers of a slice, like [`Self::load`].
    fn load_word(token: Self::Token, from: &[u32]) -> Self::Word;
    /// Writes integers to a slice, like [`Self::store`].
    fn store_word(word: Self::Word, to: &mut [u32]);
    /// The same integer in all lanes.
    fn splat_word(token: Self::Token, x: u32) -> Self::Word;
    /// The lanes whose bits are set.
    fn mask(token: Self::Token, bits: u32) -> Self::Mask;
    /// The four numbers of each lane, which lie side by side in memory: the first one of each lane, and so on.
    fn load_rows<'a>(token: Self::Token, row: impl Fn(usize) -> &'a [f32; 4]) -> [Self; 4];
    /// The inverse of [`Self::load_rows`]. Rows beyond the last lane are zero.
    fn to_rows(columns: [Self; 4]) -> [[f32; 4]; MAX_WIDTH];
    /// The lanes of a mask side by side, in the first lanes.
    fn compress(self, mask: Self::Mask) -> Self;
    /// Is it equal?
    fn eq(self, other: Self) -> Self::Mask;
    /// The bits of the number.
    fn to_bits(self) -> Self::Word;
    /// The number with these bits.
    fn from_bits(bits: Self::Word) -> Self;
    /// The value of integers below 2^31, rounded to nearest.
    fn from_word(word: Self::Word) -> Self;
    /// The long integers with these low and high words.
    fn join(low: Self::Word, high: Self::Word) -> Self::Long;
    /// The low and the high words of long integers.
    fn split(long: Self::Long) -> [Self::Word; 2];
    /// Are the integers equal?
    fn word_eq(a: Self::Word, b: Self::Word) -> Self::Mask;

    /// `low` below `low`, `high` above `high`. A NaN becomes `low`.
    #[inline(always)]
    fn clamp(self, low: f32, high: f32) -> Self {
        self.max(self.constant(low)).min(self.constant(high))
    }
    /// The magnitude of this number with the sign bit of another one.
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Self::from_bits((self.to_bits() & 0x7fff_ffff) | (sign.to_bits() & 0x8000_0000))
    }
    /// The nearest integer, ties to even, for magnitudes below 2^22. Negative integers are in two's complement.
    #[inline(always)]
    fn round_to_word(self) -> Self::Word {
        // Adding 3 * 2^22 rounds to an integer and leaves it in the low bits.
        (self + 12_582_912.0).to_bits() - 0x4b40_0000
    }
    /// The nearest integer, ties to even, for magnitudes below 2^22.
    #[inline(always)]
    fn round(self) -> Self {
        (self + 12_582_912.0) - 12_582_912.0
    }
    /// The largest integer that is not greater, for magnitudes below 2^22.
    #[inline(always)]
    fn floor(self) -> Self {
        let nearest = self.round();
        nearest - self.constant(1.0).only(self.lt(nearest))
    }
    /// The number of each lane in `from`.
    ///
    /// # Panics
    /// If an index is beyond the slice.
    #[inline(always)]
    fn gather(token: Self::Token, from: &[f32], at: &[u32; MAX_WIDTH]) -> Self {
        let mut lanes = [0.0; MAX_WIDTH];
        for lane in 0..Self::WIDTH {
            lanes[lane] = from[at[lane] as usize];
        }
        Self::load(token, &lanes)
    }
    /// Appends the lanes of a mask to a list.
    #[inline(always)]
    fn append(self, mask: Self::Mask, to: &mut Vec<f32>) {
        let len = to.len();
        to.resize(len + Self::WIDTH, 0.0);
        self.compress(mask).store(&mut to[len..]);
        to.truncate(len + mask.bits().count_ones() as usize);
    }
    /// The lanes as an array; lanes beyond the last one are zero.
    #[inline(always)]
    fn to_array(self) -> [f32; MAX_WIDTH] {
        let mut lanes = [0.0; MAX_WIDTH];
        self.store(&mut lanes);
        lanes
    }
    /// The integers as an array; lanes beyond the last one are zero.
    #[inline(always)]
    fn word_to_array(word: Self::Word) -> [u32; MAX_WIDTH] {
        let mut lanes = [0; MAX_WIDTH];
        Self::store_word(word, &mut lanes);
        lanes
    }
}

/// The numbers of the lanes of a mask that are true, in ascending order.
#[derive(Clone, Copy, Debug)]
pub struct TrueLanes(u32);

impl Iterator for TrueLanes {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let (bits, lane) = (self.0, self.0.trailing_zeros() as usize % MAX_WIDTH);
        self.0 &= bits.wrapping_sub(1);
        if bits != 0 { Some(lane) } else { None }
    }
}

/// The content of a function that is not inlined, with the instructions of the lanes: `vectorize!(F, token, expression)`. See
/// [`Lanes::vectorize`].
#[macro_export]
macro_rules! vectorize {
    ($F:ty, $token:expr, $body:expr) => {
        <$F as $crate::Lanes>::vectorize(
            $token,
            #[inline(always)]
            || $body,
        )
    };
}

/// Calls code for the lanes of an instruction set: `dispatch!(set, F, token => expression)`. In the expression `F` is the
/// type of the lanes and `token` its token. All functions in it must be inlined.
#[macro_export]
macro_rules! dispatch {
    ($set:expr, $F:ident, $token:ident => $body:expr) => {{
        use $crate::fearless_simd as simd;
        match $set {
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx512($token) => {
                type $F = simd::f32x16<simd::Avx512>;
                simd::Simd::vectorize(
                    $token,
                    #[inline(always)]
                    || $body,
                )
            }
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx2($token) => {
                type $F = simd::f32x8<simd::Avx2>;
                simd::Simd::vectorize(
                    $token,
                    #[inline(always)]
                    || $body,
                )
            }
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Sse2($token) => {
                type $F = simd::f32x4<simd::Sse2>;
                $crate::separately(
                    #[inline(always)]
                    || $body,
                )
            }
            #[cfg(target_arch = "aarch64")]
            $crate::InstructionSet::Neon($token) => {
                type $F = simd::f32x4<simd::Neon>;
                simd::Simd::vectorize(
                    $token,
                    #[inline(always)]
                    || $body,
                )
            }
            $crate::InstructionSet::Scalar => {
                type $F = f32;
                let $token = ();
                $crate::separately(
                    #[inline(always)]
                    || $body,
                )
            }
        }
    }};
}
