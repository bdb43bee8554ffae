//! The sampler of the renderer: an Owen-scrambled Sobol number for every decision of a path.

use crate::hash::{hash_u64, mix64};
use crate::sobol::{owen_reversed, point_reversed};

/// Number of independently scrambled batches that the samples of a pixel are dealt to in turn.
///
/// Points of one scrambled sequence are correlated (that is their use), so their spread says little about the error of
/// their mean. The means of the batches are independent and identically distributed; their spread does.
pub const BATCHES: u32 = 4;

/// The random numbers of one camera sample: a pure function of (seed, frame, pixel, sample index, dimension set).
///
/// Sample `s` is point `s / BATCHES` of batch `s % BATCHES`. Numbers come in *sets* of four dimensions. Within a set
/// the points of a batch are an Owen-scrambled Sobol sequence (Owen 1995): each aligned power-of-two run of points is
/// stratified in all four one-dimensional projections, and the first two dimensions form a (0,2)-sequence in base 2.
/// Different sets are the same sequence, shuffled and scrambled independently ("padding", Burley 2020), so there is no
/// limit to the number of sets and no correlation between them.
///
/// The caller names the set, and should give each decision its own: then the decisions of two paths stay aligned,
/// whatever shape the paths took before. Set numbers need not be dense. `get_1d`, `get_2d` and `get_4d` of one set
/// return prefixes of the same four numbers, so a set should be drawn from only once.
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

    /// Four numbers of set `set`.
    #[inline]
    pub fn get_4d(&self, set: u32) -> [f32; 4] {
        let (point, seeds) = self.unscrambled(set);
        std::array::from_fn(|d| to_unit(owen_reversed(point[d], seeds[d])))
    }

    /// The first two numbers of set `set`.
    #[inline]
    pub fn get_2d(&self, set: u32) -> [f32; 2] {
        let (point, seeds) = self.unscrambled(set);
        std::array::from_fn(|d| to_unit(owen_reversed(point[d], seeds[d])))
    }

    /// The first number of set `set`.
    #[inline]
    pub fn get_1d(&self, set: u32) -> f32 {
        let (point, seeds) = self.unscrambled(set);
        to_unit(owen_reversed(point[0], seeds[0]))
    }

    /// The shuffled Sobol point of a set in bit-reversed form, with the scrambling seed of each of its dimensions.
    #[inline]
    fn unscrambled(&self, set: u32) -> ([u32; 4], [u32; 4]) {
        let h = mix64(self.key ^ u64::from(set));
        let (a, b) = (mix64(h ^ 1), mix64(h ^ 2));
        // Scrambling the *index* permutes the points and moves them to another block of the sequence, but keeps every
        // aligned power-of-two run of them together (Burley 2020).
        let point = point_reversed(owen_reversed(self.index_reversed, h as u32));
        (point, [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32])
    }
}

/// A bit-reversed 32-bit fraction as a float in `[0, 1)`: the 24 most significant bits, so that nothing rounds up to 1.
#[inline]
fn to_unit(reversed: u32) -> f32 {
    (reversed.reverse_bits() >> 8) as f32 * (1.0 / (1 << 24) as f32)
}
