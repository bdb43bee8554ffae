//! Keyed PCG streams, for consumers that draw an unknown number of values (Poisson noise, tests).

use crate::hash::hash_u64;

/// The generator behind [`keyed_stream`]: PCG-64 MCG (O'Neill 2014), 128 bits of state.
pub type Pcg = rand_pcg::Pcg64Mcg;

/// A stream of random bits that is a pure function of its key.
///
/// `purpose` separates the consumers of one pixel: two streams that differ in any part of the key are independent.
#[inline]
pub fn keyed_stream(seed: u64, frame: u32, pixel: u32, purpose: u64) -> Pcg {
    let key = hash_u64([seed, u64::from(frame) << 32 | u64::from(pixel), purpose]);
    // All 128 bits come from the hash: neighbouring keys start at unrelated places of the cycle.
    Pcg::new(u128::from(hash_u64([key, 1])) << 64 | u128::from(hash_u64([key, 2])))
}
