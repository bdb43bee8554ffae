//! Eight f32 side by side, for traversal by a single ray: a box or a triangle in each lane.

use dunkelfeld_lanes::Real;
use fearless_simd::{Simd, f32x8};

/// Number of lanes.
pub(crate) const WIDTH: usize = 8;

/// A memory block of eight numbers.
pub(crate) type Eight = [f32; WIDTH];

/// Eight numbers of an instruction set.
pub(crate) type F8<S> = f32x8<S>;

/// `a > b ? a : b` in each lane: the second operand if either is a NaN.
#[inline(always)]
pub(crate) fn greater<S: Simd>(a: F8<S>, b: F8<S>) -> F8<S> {
    Real::max(a, b)
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

/// All levels that this machine can execute, plain Rust first.
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
