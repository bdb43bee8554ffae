//! The first four dimensions of the Sobol sequence and its Owen scrambling, both in bit-reversed form.
//!
//! Owen scrambling flips a digit as a function of the more significant ones. On bit-reversed words it becomes a hash in
//! which a bit depends on less significant bits only. Sums and products have this property (Laine and Karras 2011).
//!
//! The reversed coordinate of an index is a product with a matrix over the field of two elements. The recurrence of the
//! direction numbers (Joe and Kuo 2008) has this consequence: with the bits of the index as the coefficients of a
//! polynomial i(x), the matrix maps `p(x) g(x)` to the image of `g(x)`, shifted by the degree of the primitive polynomial
//! p. So the digits of i(x) in base p(x) are mapped one by one. They are found by division by p^16, p^8, p^4 and so on,
//! which are sparse, because squares over this field have no mixed terms.

use dunkelfeld_lanes::Word;

/// The bit-reversed coordinate of the Sobol point of an index, a 32-bit fraction. Valid for all 2^32 indices.
#[inline(always)]
pub(crate) fn coordinate_reversed<W: Word, const DIMENSION: usize>(index: W) -> W {
    match DIMENSION {
        0 => index,
        // p = x + 1: Pascal's triangle.
        1 => {
            let i = index;
            let i = i ^ ((i >> 16) & 0x0000_ffff);
            let i = i ^ ((i >> 8) & 0x00ff_00ff);
            let i = i ^ ((i >> 4) & 0x0f0f_0f0f);
            let i = i ^ ((i >> 2) & 0x3333_3333);
            i ^ ((i >> 1) & 0x5555_5555)
        }
        // p = x^2 + x + 1, with the initial direction numbers 1, 3.
        2 => {
            let i = divided(index, [16, 8], [0x00ff_0000, 0x0000_ffff, 0x0000_ff00]);
            let i = divided(i, [8, 4], [0x0f00_0f00, 0x00ff_00ff, 0x00f0_00f0]);
            let i = divided(i, [4, 2], [0x3030_3030, 0x0f0f_0f0f, 0x0c0c_0c0c]);
            let i = divided(i, [2, 1], [0x4444_4444, 0x3333_3333, 0x2222_2222]);
            i ^ ((i >> 1) & 0x5555_5555)
        }
        // p = x^3 + x + 1, with the initial direction numbers 1, 3, 1.
        _ => {
            let i = divided(index, [24, 16], [0, 0x0000_00ff, 0x0000_ff00]);
            let i = divided(i, [12, 8], [0x0000_f000, 0x0000_0fff, 0x0000_0ff0]);
            let i = divided(i, [6, 4], [0x000c_00c0, 0x3f03_f03f, 0x3c03_c03c]);
            let i = divided(i, [3, 2], [0x0820_8208, 0x071c_71c7, 0x0618_6186]);
            i ^ ((i >> 1) & 0x4924_9249)
        }
    }
}

/// Divides polynomials by `x^n + x^m + 1`, all blocks of 2 n bits at once. The quotients get the high bits.
/// `shifts` are n and n - m. `masks` select the low bits of a quotient that its high ones change, the remainders, and their
/// bits from m on.
#[inline(always)]
fn divided<W: Word>(x: W, shifts: [u32; 2], masks: [u32; 3]) -> W {
    let x = x ^ ((x >> shifts[1]) & masks[0]);
    x ^ ((x >> shifts[0]) & masks[1]) ^ ((x >> shifts[1]) & masks[2])
}

/// Owen scrambling of a bit-reversed word: output bit i depends on input bits 0..=i and on the seed.
///
/// The form is that of Laine and Karras (2011) and Burley (2020). The constants are those of Vegdahl (2021), found by
/// search for the least bias. The tests measure that bias again.
#[inline(always)]
pub(crate) fn owen_reversed<W: Word>(x: W, seed: W) -> W {
    let x = x ^ (x * 0x3d20_adea);
    let x = x + seed;
    let x = x * ((seed >> 16) | 1);
    let x = x ^ (x * 0x0552_6c56);
    x ^ (x * 0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mix64;
    use dunkelfeld_lanes::One;

    fn point_reversed(index_reversed: u32) -> [u32; 4] {
        let index = One(index_reversed.reverse_bits());
        [
            coordinate_reversed::<_, 0>(index).0,
            coordinate_reversed::<_, 1>(index).0,
            coordinate_reversed::<_, 2>(index).0,
            coordinate_reversed::<_, 3>(index).0,
        ]
    }

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
    fn scrambling_has_little_bias() {
        // If input bit i is flipped, output bit o > i must flip for half of the seeds, for any word.
        const TRIALS: u32 = 20_000;
        let mut worst = 0.0f64;
        for i in 0..31 {
            let mut flips = [0u32; 32];
            for k in 0..TRIALS {
                let h = mix64(u64::from(k) << 8 | i);
                let (x, seed) = (h as u32, (h >> 32) as u32);
                let d = owen_reversed(One(x), One(seed)).0 ^ owen_reversed(One(x ^ (1 << i)), One(seed)).0;
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
