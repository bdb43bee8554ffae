//! Integer hashes: the mixing of all keys.

use dunkelfeld_lanes::Long;

/// A bijection of 64-bit words in which each input bit flips each output bit with probability near one half.
///
/// It is the finaliser of SplitMix64 (Steele, Lea and Flood 2014) with the constants of Stafford's variant 13 (2011),
/// after an addition that keeps zero from being a fixed point.
#[inline]
pub const fn mix64(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// [`mix64`] of each lane.
#[inline(always)]
pub(crate) fn mix_lanes<L: Long>(x: L) -> L {
    let x = x + 0x9e37_79b9_7f4a_7c15;
    let x = (x ^ (x >> 30)) * 0xbf58_476d_1ce4_e5b9;
    let x = (x ^ (x >> 27)) * 0x94d0_49bb_1331_11eb;
    x ^ (x >> 31)
}

/// Hashes a sequence of words to one; the order of the words matters.
///
/// The chain is nested, `h(a, b) = mix(mix(a) ^ b)`, so that regular grids of keys (pixels, frames, samples) do not
/// cancel against each other.
#[inline]
pub const fn hash_u64<const N: usize>(words: [u64; N]) -> u64 {
    let mut h = 0;
    let mut i = 0;
    while i < N {
        h = mix64(h ^ words[i]);
        i += 1;
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_input_bit_flips_each_output_bit_half_the_time() {
        const TRIALS: u32 = 4096;
        for bit in 0..64 {
            let mut flips = [0u32; 64];
            for k in 0..TRIALS {
                // A counter is the hardest realistic input: keys are small integers.
                let d = mix64(u64::from(k)) ^ mix64(u64::from(k) ^ (1 << bit));
                for (o, f) in flips.iter_mut().enumerate() {
                    *f += (d >> o & 1) as u32;
                }
            }
            for (o, f) in flips.into_iter().enumerate() {
                // Binomial(4096, 1/2) has standard deviation 32; 4096 comparisons at 7.5 sigma are a false alarm of
                // 3e-10.
                assert!((f64::from(f) - 2048.0).abs() < 7.5 * 32.0, "input bit {bit}, output bit {o}: {f} of {TRIALS}");
            }
        }
    }
}
