//! Eight f32 side by side: one trait, written once for AVX2 and once in plain Rust.
//!
//! Both do the same IEEE operations in the same order and never fuse a product with a sum, so a traversal gives the same
//! bits on either. `min` and `max` follow the x86 instructions, which return the *second* operand if either is a NaN;
//! the box test relies on it.

/// Number of lanes.
pub(crate) const WIDTH: usize = 8;

/// A memory block of eight numbers.
pub(crate) type Eight = [f32; WIDTH];

/// Arithmetic on eight f32. Masks are bit sets: bit i stands for lane i.
pub(crate) trait Lanes: Copy {
    /// Eight numbers, in registers if the machine has them.
    type F: Copy;
    fn splat(x: f32) -> Self::F;
    fn load(x: &Eight) -> Self::F;
    fn store(x: Self::F) -> Eight;
    fn add(a: Self::F, b: Self::F) -> Self::F;
    fn sub(a: Self::F, b: Self::F) -> Self::F;
    fn mul(a: Self::F, b: Self::F) -> Self::F;
    fn div(a: Self::F, b: Self::F) -> Self::F;
    fn abs(a: Self::F) -> Self::F;
    fn neg(a: Self::F) -> Self::F;
    /// `a < b ? a : b` in each lane.
    fn min(a: Self::F, b: Self::F) -> Self::F;
    /// `a > b ? a : b` in each lane.
    fn max(a: Self::F, b: Self::F) -> Self::F;
    /// Lanes with `a <= b`; false for NaN.
    fn le(a: Self::F, b: Self::F) -> u32;
    /// Lanes with `a < b`; false for NaN.
    fn lt(a: Self::F, b: Self::F) -> u32;
    /// Lanes with `a == b`; false for NaN.
    fn eq(a: Self::F, b: Self::F) -> u32;
}

/// Plain Rust, which compilers vectorise for the target (SSE2, NEON).
#[derive(Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn each(a: Eight, b: Eight, f: impl Fn(f32, f32) -> f32) -> Eight {
    let mut out = [0.0; WIDTH];
    for i in 0..WIDTH {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn bits(a: Eight, b: Eight, f: impl Fn(f32, f32) -> bool) -> u32 {
    let mut out = 0;
    for i in 0..WIDTH {
        out |= u32::from(f(a[i], b[i])) << i;
    }
    out
}

impl Lanes for Portable {
    type F = Eight;
    #[inline(always)]
    fn splat(x: f32) -> Eight {
        [x; WIDTH]
    }
    #[inline(always)]
    fn load(x: &Eight) -> Eight {
        *x
    }
    #[inline(always)]
    fn store(x: Eight) -> Eight {
        x
    }
    #[inline(always)]
    fn add(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn abs(a: Eight) -> Eight {
        each(a, a, |a, _| a.abs())
    }
    #[inline(always)]
    fn neg(a: Eight) -> Eight {
        each(a, a, |a, _| -a)
    }
    #[inline(always)]
    fn min(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(a: Eight, b: Eight) -> Eight {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn le(a: Eight, b: Eight) -> u32 {
        bits(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    fn lt(a: Eight, b: Eight) -> u32 {
        bits(a, b, |a, b| a < b)
    }
    #[inline(always)]
    fn eq(a: Eight, b: Eight) -> u32 {
        bits(a, b, |a, b| a == b)
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Eight, Lanes};
    use std::arch::x86_64::*;

    /// AVX2 registers. Only code under `#[target_feature(enable = "avx2")]` may use this type. Everything here is
    /// inlined into such a function, which is called only after `is_x86_feature_detected!("avx2")`.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2;

    impl Lanes for Avx2 {
        type F = __m256;
        #[inline(always)]
        fn splat(x: f32) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_set1_ps(x) }
        }
        #[inline(always)]
        fn load(x: &Eight) -> __m256 {
            // SAFETY: as above; the reference is valid for 32 bytes, and an unaligned load needs no more.
            unsafe { _mm256_loadu_ps(x.as_ptr()) }
        }
        #[inline(always)]
        fn store(x: __m256) -> Eight {
            let mut out = [0.0; 8];
            // SAFETY: as above; the array is valid for 32 bytes, and an unaligned store needs no more.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), x) };
            out
        }
        #[inline(always)]
        fn add(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_add_ps(a, b) }
        }
        #[inline(always)]
        fn sub(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_sub_ps(a, b) }
        }
        #[inline(always)]
        fn mul(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_mul_ps(a, b) }
        }
        #[inline(always)]
        fn div(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_div_ps(a, b) }
        }
        #[inline(always)]
        fn abs(a: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
        }
        #[inline(always)]
        fn neg(a: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), a) }
        }
        #[inline(always)]
        fn min(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_min_ps(a, b) }
        }
        #[inline(always)]
        fn max(a: __m256, b: __m256) -> __m256 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_max_ps(a, b) }
        }
        #[inline(always)]
        fn le(a: __m256, b: __m256) -> u32 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32 }
        }
        #[inline(always)]
        fn lt(a: __m256, b: __m256) -> u32 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) as u32 }
        }
        #[inline(always)]
        fn eq(a: __m256, b: __m256) -> u32 {
            // SAFETY: see `Avx2`: the machine has AVX2 wherever this runs.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(a, b)) as u32 }
        }
    }
}
