#![allow(missing_docs, dead_code, unreachable_pub, clippy::print_stdout)]
mod sobol {
    // The first four dimensions of the Sobol sequence and its Owen scrambling, both in bit-reversed form.
    //
    // Owen scrambling flips a digit as a function of the more significant ones. On bit-reversed words it becomes a hash in
    // which a bit depends on less significant bits only. Sums and products have this property (Laine and Karras 2011).
    // Everything here therefore uses reversed words, for the index as well as for the coordinates: one reversal of the
    // input, and one of each coordinate of the output.

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
    pub fn point_reversed(index_reversed: u32) -> [u32; 4] {
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
    pub fn owen_reversed(x: u32, seed: u32) -> u32 {
        let mut x = x ^ x.wrapping_mul(0x3d20_adea);
        x = x.wrapping_add(seed);
        x = x.wrapping_mul((seed >> 16) | 1);
        x ^= x.wrapping_mul(0x0552_6c56);
        x ^ x.wrapping_mul(0x53a2_2864)
    }
}
mod old {
    // The sampler of the renderer: an Owen-scrambled Sobol number for every decision of a path.

    use super::sobol::{owen_reversed, point_reversed};
    use dunkelfeld_sampling::{hash_u64, mix64};

    /// Number of independently scrambled batches. The samples of a pixel are assigned to them in turn.
    ///
    /// Points of one scrambled sequence are correlated by design, so their scatter does not estimate the error of their
    /// mean. The means of the batches are independent and identically distributed, so their scatter does.
    pub const BATCHES: u32 = 4;

    /// The random numbers of one camera sample: a pure function of (seed, frame, pixel, sample index, dimension set).
    ///
    /// Sample `s` is point `s / BATCHES` of batch `s % BATCHES`. Numbers come in *sets* of four dimensions. Within a set
    /// the points of a batch are an Owen-scrambled Sobol sequence (Owen 1995): each aligned power-of-two run of points is
    /// stratified in all four one-dimensional projections, and the first two dimensions form a (0,2)-sequence in base 2.
    /// Different sets are the same sequence, shuffled and scrambled independently ("padding", Burley 2020). So there is no
    /// limit to the number of sets and no correlation between them.
    ///
    /// The caller chooses the set and should use a separate one for each decision. Then the decisions of two paths stay
    /// aligned, whatever the shape of the paths before. Set numbers need not be dense. `get_1d`, `get_2d` and `get_4d` of
    /// one set return prefixes of the same four numbers, so a set should be drawn from only once.
    ///
    /// All values lie in `[0, 1)` and are multiples of 2^-24; 1 is never returned. Indices are valid up to `u32::MAX`.
    #[derive(Clone, Copy, Debug)]
    pub struct Sampler {
        key: u64,
        index_reversed: u32,
    }

    impl Sampler {
        /// The numbers of sample `sample` of the pixel with linear index `pixel` in frame `frame`.
        #[inline]
        pub fn new(seed: u64, frame: u32, pixel: u32, sample: u32) -> Self {
            let key = hash_u64([seed, u64::from(frame) << 32 | u64::from(pixel), u64::from(sample % BATCHES)]);
            Self { key, index_reversed: (sample / BATCHES).reverse_bits() }
        }

        /// The numbers of set `set`. Each is computed on access.
        #[inline]
        pub fn numbers(&self, set: u32) -> Numbers {
            let h = mix64(self.key ^ u64::from(set));
            let (a, b) = (mix64(h ^ 1), mix64(h ^ 2));
            // Scrambling of the *index* permutes the points and moves them to another block of the sequence. It keeps every
            // aligned power-of-two run of them together (Burley 2020).
            let point = point_reversed(owen_reversed(self.index_reversed, h as u32));
            Numbers { point, seeds: [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32] }
        }

        /// Four numbers of set `set`.
        #[inline]
        pub fn get_4d(&self, set: u32) -> [f32; 4] {
            let numbers = self.numbers(set);
            let ([x, y], [z, w]) = (numbers.first_two(), numbers.last_two());
            [x, y, z, w]
        }

        /// The first two numbers of set `set`.
        #[inline]
        pub fn get_2d(&self, set: u32) -> [f32; 2] {
            self.numbers(set).first_two()
        }

        /// The first number of set `set`.
        #[inline]
        pub fn get_1d(&self, set: u32) -> f32 {
            self.numbers(set).get(0)
        }
    }

    /// The four numbers of a set.
    #[derive(Clone, Copy, Debug)]
    pub struct Numbers {
        /// The shuffled Sobol point, in bit-reversed form.
        point: [u32; 4],
        /// The scrambling seed of each of its dimensions.
        seeds: [u32; 4],
    }

    impl Numbers {
        /// The number with index `dimension`, 0 to 3.
        #[inline]
        pub fn get(&self, dimension: usize) -> f32 {
            to_unit(self.scrambled(dimension))
        }

        /// The numbers with indices 0 and 1.
        #[inline]
        pub fn first_two(&self) -> [f32; 2] {
            to_units([self.scrambled(0), self.scrambled(1)])
        }

        /// The numbers with indices 2 and 3.
        #[inline]
        pub fn last_two(&self) -> [f32; 2] {
            to_units([self.scrambled(2), self.scrambled(3)])
        }

        /// A number in bit-reversed form.
        #[inline]
        fn scrambled(&self, dimension: usize) -> u32 {
            owen_reversed(self.point[dimension], self.seeds[dimension])
        }
    }

    /// A bit-reversed 32-bit fraction as a float in `[0, 1)`: the 24 most significant bits, so that nothing rounds up to 1.
    #[inline]
    fn to_unit(reversed: u32) -> f32 {
        fraction(reversed.reverse_bits())
    }

    /// [`to_unit`] of two: a word of 64 bits is reversed in as many steps as one of 32.
    #[inline]
    fn to_units([first, second]: [u32; 2]) -> [f32; 2] {
        let both = (u64::from(second) << 32 | u64::from(first)).reverse_bits();
        [fraction((both >> 32) as u32), fraction(both as u32)]
    }

    /// The 24 most significant bits of a 32-bit fraction.
    #[inline]
    fn fraction(word: u32) -> f32 {
        (word >> 8) as f32 * (1.0 / (1 << 24) as f32)
    }
}
use dunkelfeld_lanes::*;
use dunkelfeld_sampling::Sampler;
use std::hint::black_box;
use std::time::Instant;

#[inline(always)]
fn lanes<F: Lanes>(token: F::Token, s: &[Sampler; MAX_WIDTH], n: u32, what: u32) -> f32 {
    let s = Sampler::<F>::from_lanes(token, s);
    let mut sum = F::splat(token, 0.0);
    for set in 0..n {
        let x = s.numbers(set);
        match what {
            0 => {
                let [a, b] = x.first_two();
                let [c, d] = x.last_two();
                sum += a + b + c + d;
            }
            1 => {
                let [a, b] = x.first_two();
                sum += a + b;
            }
            2 => {
                let [a, b] = x.first_two();
                sum += a + b + x.get(2);
            }
            _ => sum += x.get(2),
        }
    }
    sum.to_array().iter().sum()
}

fn old(s: &[old::Sampler; MAX_WIDTH], n: u32, what: u32) -> f32 {
    let mut sum = 0.0;
    for set in 0..n {
        let x = s[0].numbers(set);
        match what {
            0 => {
                let [a, b] = x.first_two();
                let [c, d] = x.last_two();
                sum += a + b + c + d;
            }
            1 => {
                let [a, b] = x.first_two();
                sum += a + b;
            }
            2 => {
                let [a, b] = x.first_two();
                sum += a + b + x.get(2);
            }
            _ => sum += x.get(2),
        }
    }
    sum
}

fn main() {
    let s: [Sampler; MAX_WIDTH] = std::array::from_fn(|k| Sampler::new(1, 0, k as u32, 7));
    let o: [old::Sampler; MAX_WIDTH] = std::array::from_fn(|k| old::Sampler::new(1, 0, k as u32, 7));
    const N: u32 = 300_000;
    for (what, name) in ["four", "first two", "first two and third", "third"].into_iter().enumerate() {
        let what = what as u32;
        for round in 0..2 {
            let t = Instant::now();
            black_box(old(black_box(&o), N, what));
            if round == 1 {
                println!("{name}: former scalar {:.2} ns a set", t.elapsed().as_nanos() as f64 / f64::from(N));
            }
            for set in InstructionSet::all() {
                let t = Instant::now();
                let s = black_box(&s);
                black_box(dispatch!(set, F, token => lanes::<F>(token, s, N, what)));
                if round == 1 {
                    println!(
                        "{name}: {} lanes {:.2} ns a set and lane",
                        set.lanes(),
                        t.elapsed().as_nanos() as f64 / f64::from(N) / set.lanes() as f64
                    );
                }
            }
        }
    }
}
