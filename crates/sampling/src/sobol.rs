//! The first four dimensions of the Sobol sequence and its Owen scrambling, both in bit-reversed form.
//!
//! Owen scrambling flips a digit as a function of the more significant ones. On bit-reversed words it becomes a hash in
//! which a bit depends on less significant bits only. Sums and products have this property (Laine and Karras 2011).
//! Everything here therefore uses reversed words, for the index as well as for the coordinates: one reversal of the
//! input, and one of each coordinate of the output.

/// Primitive polynomials and initial direction numbers (Joe and Kuo 2008): degree, inner coefficients, m_i.
const JOE_KUO: [(usize, u32, [u32; 3]); 3] = [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

/// Direction numbers: `[dimension][index bit]`, the most significant bit stands for 1/2.
const DIRECTIONS: [[u32; 32]; 4] = {
    let mut v = [[0u32; 32]; 4];
    let mut i = 0;
    while i < 32 {
        v[0][i] = 1 << (31 - i);
        i += 1;
    }
    let mut d = 1;
    while d < 4 {
        let (degree, coefficients, m) = JOE_KUO[d - 1];
        let mut i = 0;
        while i < 32 {
            v[d][i] = if i < degree {
                m[i] << (31 - i)
            } else {
                let mut x = v[d][i - degree] ^ (v[d][i - degree] >> degree);
                let mut k = 1;
                while k < degree {
                    if coefficients >> (degree - 1 - k) & 1 == 1 {
                        x ^= v[d][i - k];
                    }
                    k += 1;
                }
                x
            };
            i += 1;
        }
        d += 1;
    }
    v
};

/// `[byte of the reversed index][value of the byte]` -> the contribution of this byte to the reversed coordinates.
static BY_BYTE: [[[u32; 4]; 256]; 4] = {
    let mut table = [[[0u32; 4]; 256]; 4];
    let mut byte = 0;
    while byte < 4 {
        let mut value = 0;
        while value < 256 {
            let mut bit = 0;
            while bit < 8 {
                if value >> bit & 1 == 1 {
                    let mut d = 0;
                    while d < 4 {
                        table[byte][value][d] ^= DIRECTIONS[d][31 - (8 * byte + bit)].reverse_bits();
                        d += 1;
                    }
                }
                bit += 1;
            }
            value += 1;
        }
        byte += 1;
    }
    table
};

/// The Sobol point of a bit-reversed index: four bit-reversed 32-bit fractions. Valid for all 2^32 indices.
#[inline]
pub(crate) fn point_reversed(index_reversed: u32) -> [u32; 4] {
    let [b0, b1, b2, b3] = index_reversed.to_le_bytes();
    let (p0, p1) = (&BY_BYTE[0][b0 as usize], &BY_BYTE[1][b1 as usize]);
    let (p2, p3) = (&BY_BYTE[2][b2 as usize], &BY_BYTE[3][b3 as usize]);
    std::array::from_fn(|d| p0[d] ^ p1[d] ^ p2[d] ^ p3[d])
}

/// Owen scrambling of a bit-reversed word: output bit i depends on input bits 0..=i and on the seed.
///
/// The form is that of Laine and Karras (2011) and Burley (2020). The constants are those of Vegdahl (2021), found by
/// search for the least bias. The tests measure that bias again.
#[inline]
pub(crate) fn owen_reversed(x: u32, seed: u32) -> u32 {
    let mut x = x ^ x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mix64;

    #[test]
    fn the_first_points_are_those_of_the_literature() {
        // Joe and Kuo (2008), in natural (not Gray-code) order, in units of 1/8.
        let expected = [
            [0, 0, 0, 0],
            [4, 4, 4, 4],
            [2, 6, 6, 6],
            [6, 2, 2, 2],
            [1, 5, 3, 1],
            [5, 1, 7, 5],
            [3, 3, 5, 7],
            [7, 7, 1, 3],
        ];
        for (i, e) in expected.into_iter().enumerate() {
            let p = point_reversed((i as u32).reverse_bits()).map(|x| x.reverse_bits() >> 29);
            assert_eq!(p, e, "point {i}");
        }
    }

    #[test]
    fn each_dimension_permutes_every_aligned_block_even_beyond_65536() {
        for start in [0u32, 1 << 16, 3 << 24, u32::MAX - 4095] {
            for d in 0..4 {
                let mut seen = vec![false; 4096];
                for i in 0..4096 {
                    let x = point_reversed((start + i).reverse_bits())[d].reverse_bits();
                    assert!(
                        !std::mem::replace(&mut seen[(x >> 20) as usize], true),
                        "dimension {d}, index {}",
                        start + i
                    );
                }
            }
        }
    }

    #[test]
    fn scrambling_is_a_nested_bijection() {
        for k in 0..64 {
            let seed = mix64(k) as u32;
            for bits in [1u32, 4, 9] {
                let mask = (1 << bits) - 1;
                let mut seen = vec![false; 1 << bits];
                for low in 0..1u32 << bits {
                    let a = owen_reversed(low, seed);
                    let b = owen_reversed(low | (0xdead_beef << bits), seed);
                    assert_eq!(a & mask, b & mask, "a bit depends on a more significant one");
                    assert!(!std::mem::replace(&mut seen[(a & mask) as usize], true));
                }
            }
        }
    }

    #[test]
    fn scrambling_has_little_bias() {
        // If input bit i is flipped, output bit o > i must flip for half of the seeds, for any word.
        const TRIALS: u32 = 20_000;
        let mut worst = 0.0f64;
        for i in 0..31 {
            let mut flips = [0u32; 32];
            for k in 0..TRIALS {
                let h = mix64(u64::from(k) << 8 | i);
                let (x, seed) = (h as u32, (h >> 32) as u32);
                let d = owen_reversed(x, seed) ^ owen_reversed(x ^ (1 << i), seed);
                for (o, f) in flips.iter_mut().enumerate() {
                    *f += d >> o & 1;
                }
            }
            for (o, f) in flips.into_iter().enumerate() {
                let p = f64::from(f) / f64::from(TRIALS);
                match o.cmp(&(i as usize)) {
                    std::cmp::Ordering::Less => assert_eq!(f, 0),
                    std::cmp::Ordering::Equal => assert_eq!(f, TRIALS),
                    std::cmp::Ordering::Greater => worst = worst.max((p - 0.5).abs()),
                }
            }
        }
        // The standard deviation of p is 0.0035; the bound leaves 0.03 for the bias of the hash itself.
        assert!(worst < 0.055, "worst bias {worst}");
    }
}
