//! The sampler of the renderer: an Owen-scrambled Sobol number for every decision of a path.

use crate::hash::{hash_u64, mix_lanes};
use crate::sobol::{coordinate_reversed, owen_reversed};
use dunkelfeld_lanes::{Lanes, Mask, One, OneLong, Word};

/// Number of independently scrambled batches. The samples of a pixel are assigned to them in turn.
///
/// Points of one scrambled sequence are correlated by design, so their scatter does not estimate the error of their
/// mean. The means of the batches are independent and identically distributed, so their scatter does.
pub const BATCHES: u32 = 4;

/// The random numbers of one camera sample per lane: a pure function of (seed, frame, pixel, sample index, dimension set).
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
pub struct Sampler<F: Lanes = f32> {
    token: F::Token,
    key: F::Long,
    index_reversed: F::Word,
}

impl Sampler {
    /// The numbers of sample `sample` of the pixel with linear index `pixel` in frame `frame`.
    #[inline]
    pub fn new(seed: u64, frame: u32, pixel: u32, sample: u32) -> Self {
        let key = hash_u64([seed, u64::from(frame) << 32 | u64::from(pixel), u64::from(sample % BATCHES)]);
        let index_reversed = One((sample / BATCHES).reverse_bits());
        Self { token: (), key: OneLong(key), index_reversed }
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

impl<F: Lanes> Sampler<F> {
    /// The sampler with these [`Self::words`].
    #[inline(always)]
    pub fn from_words(token: F::Token, [low, high, index_reversed]: [F::Word; 3]) -> Self {
        Self { token, key: F::join(low, high), index_reversed }
    }

    /// The whole state.
    #[inline(always)]
    pub fn words(&self) -> [F::Word; 3] {
        let [low, high] = F::split(self.key);
        [low, high, self.index_reversed]
    }

    /// The numbers of child `child` of 2^`splits` that each sample of some lanes is split into; those of the sample in other
    /// lanes. The children of an aligned power-of-two run of samples are such a run of points themselves. Samples that are
    /// not split have other numbers. Indices of samples are below 2^(32 - `splits`) times [`BATCHES`].
    #[inline(always)]
    pub fn child(&self, child: u32, splits: u32, lanes: F::Mask) -> Self {
        let [low, high, index] = self.words();
        let (mut low, mut index) = (F::word_to_array(low), F::word_to_array(index));
        for lane in lanes.lanes() {
            low[lane] = !low[lane];
            index[lane] = (index[lane] >> splits) | child.reverse_bits();
        }
        Self::from_words(self.token, [F::load_word(self.token, &low), high, F::load_word(self.token, &index)])
    }

    /// The numbers of set `set`. Each is computed on access.
    #[inline(always)]
    pub fn numbers(&self, set: u32) -> Numbers<F> {
        let hash = mix_lanes(self.key ^ u64::from(set));
        // Scrambling of the *index* permutes the points and moves them to another block of the sequence. It keeps every
        // aligned power-of-two run of them together (Burley 2020).
        let [seed, _] = F::split(hash);
        Numbers { token: self.token, hash, index: owen_reversed(self.index_reversed, seed).reverse_bits() }
    }
}

/// The four numbers of a set, per lane.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<F: Lanes = f32> {
    token: F::Token,
    /// The hash of the set.
    hash: F::Long,
    /// The index of the shuffled point.
    index: F::Word,
}

impl<F: Lanes> Numbers<F> {
    /// The number with index `dimension`, 0 to 3. It is zero for others.
    #[inline(always)]
    pub fn get(&self, dimension: usize) -> F {
        match dimension {
            0 => self.first_two()[0],
            1 => self.first_two()[1],
            2 => self.last_two()[0],
            3 => self.last_two()[1],
            _ => F::splat(self.token, 0.0),
        }
    }

    /// The numbers with indices 0 and 1.
    #[inline(always)]
    pub fn first_two(&self) -> [F; 2] {
        let [x, y] = F::split(mix_lanes(self.hash ^ 1));
        [self.scrambled::<0>(x), self.scrambled::<1>(y)]
    }

    /// The numbers with indices 2 and 3.
    #[inline(always)]
    pub fn last_two(&self) -> [F; 2] {
        let [z, w] = F::split(mix_lanes(self.hash ^ 2));
        [self.scrambled::<2>(z), self.scrambled::<3>(w)]
    }

    /// A coordinate of the point, scrambled with a seed: the 24 most significant bits, so that nothing rounds up to 1.
    #[inline(always)]
    fn scrambled<const DIMENSION: usize>(&self, seed: F::Word) -> F {
        let reversed = owen_reversed(coordinate_reversed::<F::Word, DIMENSION>(self.index), seed);
        F::from_word(reversed.reverse_bits() >> 8) * (1.0 / (1 << 24) as f32)
    }
}
