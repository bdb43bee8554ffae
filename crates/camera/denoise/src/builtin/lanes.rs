//! Loops over neighbours in a row. Compilers vectorise them for the registers of the machine. Where several rows share
//! their operands, the loop has vectors of eight numbers, which compilers load once.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

/// The length of a row is a multiple of this number, so that no rest needs a slower loop (compilers use four registers
/// of eight numbers at a time).
pub(super) const WIDTH: usize = 32;

/// Numbers of a vector.
pub(super) const EIGHT: usize = 8;

/// Eight numbers from `start` on.
#[inline(always)]
pub(super) fn read8<S: Simd>(simd: S, values: &[f32], start: usize) -> f32x8<S> {
    f32x8::from_slice(simd, &values[start..start + EIGHT])
}

/// `n` numbers from `start` on.
#[inline(always)]
pub(super) fn lanes(values: &[f32], start: usize, n: usize) -> &[f32] {
    &values[start..start + n]
}

/// The same for writing.
#[inline(always)]
pub(super) fn lanes_mut(values: &mut [f32], start: usize, n: usize) -> &mut [f32] {
    &mut values[start..start + n]
}

/// The minimum of two, the second if one is NaN. It is one instruction, unlike [`f32::min`].
#[inline(always)]
pub(super) fn minimum(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The maximum of two, the second if one is NaN.
#[inline(always)]
pub(super) fn maximum(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Sets each number of a row to an expression of its index and its old value: `each!(row, |place, old| new)`.
///
/// It is a macro, since closures are compiled for the minimum instruction set and are not always inlined into functions
/// for larger ones.
macro_rules! each {
    ($row:expr, |$place:ident, $old:pat_param| $new:expr) => {{
        let row: &mut [f32] = $row;
        // A loop over indices, not an iterator: so the compiler can derive that the indices are valid for other slices
        // of this length.
        #[allow(clippy::needless_range_loop)]
        for $place in 0..row.len() {
            let $old = row[$place];
            row[$place] = $new;
        }
    }};
}
pub(super) use each;

/// All levels that this machine can execute, for tests.
#[cfg(test)]
pub(super) fn levels() -> Vec<fearless_simd::Level> {
    use fearless_simd::Level;
    #[allow(unused_mut)]
    let mut levels = vec![Level::fallback(), Level::baseline()];
    #[cfg(target_arch = "x86_64")]
    {
        let best = Level::new();
        levels.extend(best.as_avx2().map(Level::Avx2));
        levels.extend(best.as_avx512().map(Level::Avx512));
    }
    levels
}
