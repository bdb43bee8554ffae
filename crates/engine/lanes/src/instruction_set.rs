//! The instruction sets that this machine has.

use fearless_simd::Level;

/// An instruction set with its number of lanes. A value exists only on machines that have it.
#[derive(Clone, Copy, Debug)]
pub enum InstructionSet {
    /// One lane, on all machines.
    Scalar,
    /// Four lanes.
    #[cfg(target_arch = "x86_64")]
    Sse2(fearless_simd::Sse2),
    /// Eight lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2(fearless_simd::Avx2),
    /// Sixteen lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512(fearless_simd::Avx512),
    /// Four lanes.
    #[cfg(target_arch = "aarch64")]
    Neon(fearless_simd::Neon),
}

impl InstructionSet {
    /// The widest one of this machine.
    pub fn best() -> Self {
        Self::all().last().copied().unwrap_or(Self::Scalar)
    }

    /// All that this machine has, in ascending order of their lanes.
    pub fn all() -> Vec<Self> {
        let level = Level::new();
        let mut all = vec![Self::Scalar];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(level.as_sse2().map(Self::Sse2));
            all.extend(level.as_avx2().map(Self::Avx2));
            all.extend(level.as_avx512().map(Self::Avx512));
        }
        #[cfg(target_arch = "aarch64")]
        all.extend(level.as_neon().map(Self::Neon));
        let _ = level;
        all
    }

    /// Number of lanes.
    pub fn lanes(self) -> usize {
        match self {
            Self::Scalar => 1,
            #[cfg(target_arch = "x86_64")]
            Self::Sse2(_) => 4,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => 8,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => 16,
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => 4,
        }
    }
}

/// Calls a function that is not inlined into the caller, so that the code of one instruction set costs the others nothing.
#[inline(never)]
pub fn separately<R>(f: impl FnOnce() -> R) -> R {
    f()
}
