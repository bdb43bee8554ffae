//! Eight f32 side by side: additions to the vectors of `fearless_simd`, so that all instruction sets give the same bits.
//!
//! Sums, products, quotients and comparisons are IEEE operations on every level. No product is fused with a sum, since no
//! code here calls `mul_add`, and compilers do not fuse on their own. The minimum and maximum of `fearless_simd` treat NaN
//! and signed zeros as the machine does. Those of this module follow the x86 instructions everywhere.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8, mask32x8};

/// Number of lanes.
pub(crate) const WIDTH: usize = 8;

/// A memory block of eight numbers.
pub(crate) type Eight = [f32; WIDTH];

/// Eight numbers from memory.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, numbers: &Eight) -> f32x8<S> {
    f32x8::load_array_ref(simd, numbers)
}

/// `a < b ? a : b` in each lane: the second operand if either is a NaN. The box test relies on it.
#[inline(always)]
pub(crate) fn lesser<S: Simd>(a: f32x8<S>, b: f32x8<S>) -> f32x8<S> {
    if is_x86_minimum(a) { a.min(b) } else { a.simd_lt(b).select(a, b) }
}

/// `a > b ? a : b` in each lane: the second operand if either is a NaN.
#[inline(always)]
pub(crate) fn greater<S: Simd>(a: f32x8<S>, b: f32x8<S>) -> f32x8<S> {
    if is_x86_minimum(a) { a.max(b) } else { a.simd_gt(b).select(a, b) }
}

/// True if the level has the instructions `minps` and `maxps`. They are faster than a comparison and a selection.
#[inline(always)]
fn is_x86_minimum<S: Simd>(a: f32x8<S>) -> bool {
    cfg!(any(target_arch = "x86", target_arch = "x86_64")) && !a.simd.level().is_fallback()
}

/// The lanes of a mask as a bit set: bit i stands for lane i.
#[inline(always)]
pub(crate) fn bits<S: Simd>(mask: mask32x8<S>) -> u32 {
    mask.to_bitmask() as u32
}

/// Three numbers, each in all lanes of its own vector.
#[inline(always)]
pub(crate) fn splat3<S: Simd>(simd: S, [x, y, z]: [f32; 3]) -> [f32x8<S>; 3] {
    [f32x8::splat(simd, x), f32x8::splat(simd, y), f32x8::splat(simd, z)]
}

/// Evaluates an expression for the best instruction set of a level: `dispatch8!(level, simd => expression)`. All functions
/// in it must be inlined.
///
/// It is `fearless_simd::dispatch` with two differences. Machines without AVX2 use one level less, since SSE4.2 has nothing
/// that is used here. Their code is a separate function: inlined into the caller, its registers and its stack would cost
/// each ray of the other levels some 20 instructions.
macro_rules! dispatch8 {
    ($level:expr, $simd:ident => $op:expr) => {{
        let level: fearless_simd::Level = $level;
        #[cfg(target_arch = "x86_64")]
        match level {
            fearless_simd::Level::Avx512($simd) => fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $op,
            ),
            fearless_simd::Level::Avx2($simd) => fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $op,
            ),
            _ => match level.as_sse2() {
                Some($simd) => crate::simd8::separately(
                    #[inline(always)]
                    || $op,
                ),
                None => {
                    let $simd = fearless_simd::Fallback::new();
                    crate::simd8::separately(
                        #[inline(always)]
                        || $op,
                    )
                }
            },
        }
        #[cfg(not(target_arch = "x86_64"))]
        fearless_simd::dispatch!(level, $simd => $op)
    }};
}
pub(crate) use dispatch8;

/// Calls a function that is not inlined into the caller.
#[cold]
#[inline(never)]
pub(crate) fn separately<R>(f: impl FnOnce() -> R) -> R {
    f()
}

/// All levels that this machine can execute, for tests.
#[cfg(test)]
pub(crate) fn levels() -> Vec<fearless_simd::Level> {
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

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn the_second_operand_is_the_result_if_no_operand_is_smaller_or_larger() {
        let a = [f32::NAN, 1.0, f32::NAN, 0.0, -0.0, 1.0, -3.0, f32::INFINITY];
        let b = [2.0, f32::NAN, f32::NAN, -0.0, 0.0, 1.5, -4.0, f32::NEG_INFINITY];
        let expected = |first: fn(&f32, &f32) -> bool| {
            std::array::from_fn::<_, WIDTH, _>(|i| if first(&a[i], &b[i]) { a[i] } else { b[i] }.to_bits())
        };
        for level in levels() {
            let (low, high): (Eight, Eight) = dispatch8!(level, simd => {
                let (a, b) = (f32x8::from_slice(simd, &a), f32x8::from_slice(simd, &b));
                (lesser(a, b).into(), greater(a, b).into())
            });
            assert_eq!(low.map(f32::to_bits), expected(f32::lt), "{level:?}");
            assert_eq!(high.map(f32::to_bits), expected(f32::gt), "{level:?}");
        }
    }
}
