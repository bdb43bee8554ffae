//! The sampler of the renderer: an Owen-scrambled Sobol number for every decision of a path.

use crate::hash::{hash_u64, mix64};
use crate::sobol::{owen_reversed, point_reversed};

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
