//! Exact sums of samples.
//!
//! Sample sets must be additive to the last bit: [0, 64) plus [64, 128) equals [0, 128), in any order, on any number of
//! threads. Floating-point addition is not associative, integer addition is. So radiance is summed in 128-bit fixed
//! point: one unit is 2^-48 W/(m^2 sr) (3.6e-15), and a sum ends at 2^80 W/(m^2 sr). A sample is rounded once, to that
//! unit. No further precision is lost for any number of samples. The unit is far below the resolution of a camera:
//! behind f/4, a pixel of 3.45 um collects about 1e6 electrons per second from 1 W/(m^2 sr), so that a unit is one
//! electron in 9 years. A sample beyond the range of 2^46 W/(m^2 sr) is not clamped. It is counted as invalid, like one
//! that is not finite.

use crate::square_sum::SquareSum;
use crate::units::{DEPTH_BITS, DEPTH_LIMIT_BITS, RADIANCE_BITS, RADIANCE_LIMIT_BITS, UNIT_BITS, UNIT_SQUARE_BITS};
use dunkelfeld_radiometry::Rgb;

/// Number of batches, as in [`dunkelfeld_sampling::BATCHES`]. Each sample belongs to one of these independently scrambled batches (sample index modulo
/// `BATCHES`). The spread of the batch means gives the variance of their mean. The spread of single quasi-Monte Carlo
/// samples, which are correlated, would not.
pub const BATCHES: usize = dunkelfeld_sampling::BATCHES as usize;

/// Samples at or above this radiance are invalid. A sum has room for four thousand million of them.
const RADIANCE_LIMIT: f32 = (1u64 << RADIANCE_LIMIT_BITS) as f32;
const DEPTH_LIMIT: f32 = (1u64 << DEPTH_LIMIT_BITS) as f32;

/// Samples whose sums have room in integers of 64 bits: parts of radiance have at most 47 bits.
const NARROW: usize = 1 << 12;

/// The result of one camera sample.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Sample {
    /// Radiance [W/(m^2 sr)] along the camera ray.
    pub radiance: Rgb,
    /// The part of it that is *first light* [W/(m^2 sr)]: emission before the first surface that scatters light, and the light
    /// samples of that surface. The rest has been scattered twice, or was found by scattering.
    pub first_light: Rgb,
    /// Its place in the pixel, from the middle, to the right and down, in [-0.5, 0.5]. Zero if the film needs no
    /// [`PixelSums::moments`].
    pub place: [f32; 2],
    /// Reflectance of the first surface that scatters light (behind smooth glass, not the glass), in \[0, 1\].
    pub albedo: Rgb,
    /// Shading normal of that surface in world space. Zero without a surface.
    pub normal: [f32; 3],
    /// Length of the path to that surface \[m\]. Zero without a surface.
    pub depth: f32,
    /// The ray hit a surface.
    pub hit: bool,
}

impl Sample {
    /// A sample that hit no surface.
    pub const MISS: Self = Self {
        radiance: Rgb::BLACK,
        first_light: Rgb::BLACK,
        place: [0.0; 2],
        albedo: Rgb::BLACK,
        normal: [0.0; 3],
        depth: 0.0,
        hit: false,
    };

    /// Returns whether the radiance can be summed: finite, not negative, and inside the range.
    #[inline]
    pub fn is_valid(&self) -> bool {
        let ok = |v: f32| (0.0..RADIANCE_LIMIT).contains(&v);
        ok(self.radiance.r) & ok(self.radiance.g) & ok(self.radiance.b)
    }
}

/// A sum of radiances in fixed point, per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RadianceSum(pub [u128; 3]);

impl RadianceSum {
    #[inline]
    pub(crate) fn merge(&mut self, other: &Self) {
        for (sum, o) in self.0.iter_mut().zip(other.0) {
            *sum = sum.saturating_add(o);
        }
    }

    /// The sum as floating-point numbers [W/(m^2 sr)].
    #[inline]
    pub fn to_f64(self) -> [f64; 3] {
        self.0.map(|v| number(v) * (-RADIANCE_BITS as f64).exp2())
    }
}

/// A whole number as a floating-point number, rounded to nearest: that of its first 64 bits, the last of which also stands for
/// the bits below it. The conversion of 128 bits by the compiler takes several times as long.
#[inline]
pub(crate) fn number(v: u128) -> f64 {
    let shift = 64u32.saturating_sub(v.leading_zeros());
    let is_cut = v & ((1 << shift) - 1) != 0;
    ((v >> shift) as u64 | u64::from(is_cut)) as f64 * f64::from_bits(u64::from(1023 + shift) << 52)
}

/// A signed sum in the units of [`RadianceSum`] as a floating-point number [W/(m^2 sr)].
#[inline]
pub(crate) fn signed_number(v: i128) -> f64 {
    number(v.unsigned_abs()).copysign(v.signum() as f64) * (-RADIANCE_BITS as f64).exp2()
}

/// Floating-point numbers near these have no bits below one: a number that is added is rounded to nearest even. The number of
/// the second kind may be negative.
const INTEGERS: [f64; 2] = [(1u64 << 52) as f64, 1.5 * (1u64 << 52) as f64];

/// `v * 2^48` as integers in two parts, the first of which has units of 2^48. Lost bits are rounded to nearest even. The
/// numbers are finite and in `(-2^46, 2^46)`.
#[inline(always)]
fn to_fixed(v: [f32; 4]) -> [[i64; 4]; 2] {
    let mut parts = [[0; 4]; 2];
    for c in 0..4 {
        let v = f64::from(v[c]);
        let near = v + INTEGERS[1];
        let rest = (v - (near - INTEGERS[1])) * (1u64 << RADIANCE_BITS) as f64 + INTEGERS[1];
        parts[0][c] = near.to_bits().wrapping_sub(INTEGERS[1].to_bits()) as i64;
        parts[1][c] = rest.to_bits().wrapping_sub(INTEGERS[1].to_bits()) as i64;
    }
    parts
}

/// The sums of the samples of a pixel. Addition is exact, so the order has no effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelSums {
    /// Radiance per batch.
    pub batches: [RadianceSum; BATCHES],
    /// Number of samples per batch, invalid ones included.
    pub counts: [u32; BATCHES],
    /// Albedo in units of 2^-24.
    pub albedo: [i64; 3],
    /// Normal in units of 2^-24.
    pub normal: [i64; 3],
    /// Depth in units of 2^-24 m, over the samples that hit.
    pub depth: i64,
    /// Squares of the albedo in units of 2^-30.
    pub albedo_squares: [u64; 3],
    /// Squares of the normal in units of 2^-30.
    pub normal_squares: [u64; 3],
    /// Squares of the depth in units of 2^-48 m^2, over the samples that hit.
    pub depth_squares: u128,
    /// Samples that hit a surface.
    pub hits: u32,
    /// Samples that were not finite, negative or out of range. They count as samples, with radiance zero.
    pub invalid: u32,
    /// The sample with the largest luminance, as one number with the same order. It holds the bit pattern of the
    /// luminance (the order of the bits is that of non-negative floats), then the complement of the index, so that the
    /// first of equal ones counts.
    pub heaviest_key: u64,
    /// Squares of the luminance.
    pub luminance_squares: SquareSum,
    /// First light of all samples ([`Sample::first_light`]).
    pub first_light: RadianceSum,
    /// First moments of the radiance in the pixel: radiance times the place of its sample ([`Sample::place`]), for the two axes,
    /// in units of 2^-48 W/(m^2 sr). A lens that blurs the image needs them.
    pub moments: [[i128; 3]; 2],
    /// Places of the samples, for the two axes, in units of 2^-24 pixels.
    pub places: [i64; 2],
}

/// A type to which samples can be added.
pub trait Accumulate {
    /// Adds the sample with the given index.
    fn add(&mut self, index: u32, sample: &Sample);
}

impl Accumulate for PixelSums {
    #[inline]
    fn add(&mut self, index: u32, sample: &Sample) {
        self.add_range(index, std::slice::from_ref(sample));
    }
}

impl PixelSums {
    /// The sums without samples: the default, as a constant.
    pub const EMPTY: Self = Self {
        batches: [RadianceSum([0; 3]); BATCHES],
        counts: [0; BATCHES],
        albedo: [0; 3],
        normal: [0; 3],
        depth: 0,
        albedo_squares: [0; 3],
        normal_squares: [0; 3],
        depth_squares: 0,
        hits: 0,
        invalid: 0,
        heaviest_key: 0,
        luminance_squares: SquareSum([0; 2]),
        first_light: RadianceSum([0; 3]),
        moments: [[0; 3]; 2],
        places: [0; 2],
    };

    /// Adds samples with consecutive indices, the first of which is given. The same as [`Accumulate::add`] of each, in less
    /// time: they are summed in narrow integers first. Code of any instruction set can inline it.
    #[inline(always)]
    pub fn add_range(&mut self, first: u32, samples: &[Sample]) {
        for (chunk, samples) in samples.chunks(NARROW).enumerate() {
            for start in 0..samples.len().min(BATCHES) {
                self.add_batch(first.wrapping_add((chunk * NARROW + start) as u32), &samples[start..]);
            }
        }
    }

    /// Adds every [`BATCHES`]th of at most [`NARROW`] samples: those of one batch.
    #[inline(always)]
    fn add_batch(&mut self, first: u32, samples: &[Sample]) {
        let (mut parts, mut places, mut auxiliary) = ([[[0; 4]; 2]; 4], [0i64; 2], Auxiliary::default());
        for (i, sample) in samples.iter().step_by(BATCHES).enumerate() {
            let index = first.wrapping_add((i * BATCHES) as u32);
            if sample.is_valid() {
                let [right, down] = sample.place.map(|place| sample.radiance * place);
                for (sum, Rgb { r, g, b }) in parts.iter_mut().zip([sample.radiance, sample.first_light, right, down]) {
                    let parts = to_fixed([r, g, b, b]);
                    for c in 0..4 {
                        sum[0][c] += parts[0][c];
                        sum[1][c] += parts[1][c];
                    }
                }
                for (sum, place) in places.iter_mut().zip(sample.place) {
                    let near = f64::from(place) * (1u64 << UNIT_BITS) as f64 + INTEGERS[1];
                    *sum += near.to_bits().wrapping_sub(INTEGERS[1].to_bits()) as i64;
                }
                // Minus zero is valid.
                let luminance = sample.radiance.luminance().abs();
                self.heaviest_key = self.heaviest_key.max(heaviest_key(index, luminance));
                self.luminance_squares.add(luminance);
            } else {
                self.invalid += 1;
            }
            if sample.hit {
                self.hits += 1;
                auxiliary.add(sample);
                let depth = depth_to_fixed(sample.depth);
                self.depth = self.depth.saturating_add(depth as i64);
                self.depth_squares = self.depth_squares.saturating_add(u128::from(depth) * u128::from(depth));
            }
        }
        let batch = first as usize % BATCHES;
        self.counts[batch] += samples.len().div_ceil(BATCHES) as u32;
        let whole =
            |parts: &[[i64; 4]; 2], c: usize| (i128::from(parts[0][c]) << RADIANCE_BITS) + i128::from(parts[1][c]);
        for c in 0..3 {
            for (sums, parts) in [&mut self.batches[batch], &mut self.first_light].into_iter().zip(&parts[..2]) {
                sums.0[c] = sums.0[c].saturating_add(whole(parts, c) as u128);
            }
            for (sums, parts) in self.moments.iter_mut().zip(&parts[2..]) {
                sums[c] = sums[c].saturating_add(whole(parts, c));
            }
        }
        self.places.iter_mut().zip(places).for_each(|(sum, places)| *sum += places);
        for c in 0..3 {
            self.albedo[c] += auxiliary.sums[c];
            self.normal[c] += auxiliary.sums[4 + c];
            self.albedo_squares[c] += auxiliary.squares[c];
            self.normal_squares[c] += auxiliary.squares[4 + c];
        }
    }
}

/// See [`PixelSums::heaviest_key`].
#[inline]
pub(crate) fn heaviest_key(index: u32, luminance: f32) -> u64 {
    u64::from(luminance.to_bits()) << 32 | u64::from(!index)
}

/// Sums of the albedo (0 to 2) and of the normal (4 to 6) of samples, and of their squares: [`PixelSums`] has the units. The
/// others have no meaning. Auxiliary layers are not measurements: numbers are clamped to [-1, 1], and NaN becomes zero.
#[derive(Default)]
struct Auxiliary {
    sums: [i64; 8],
    squares: [u64; 8],
}

impl Auxiliary {
    #[inline(always)]
    fn add(&mut self, sample: &Sample) {
        // The products are exact. The last bit of the factor rounds ties away from zero.
        const UNITS: f64 = (1u64 << UNIT_BITS) as f64 + 1.0 / 16.0;
        // Half of it moves no sum to a tie: a half is rounded up.
        const SQUARE_UNITS: f64 = 1.0 / (1u64 << (2 * UNIT_BITS - UNIT_SQUARE_BITS)) as f64;
        let (Rgb { r, g, b }, [x, y, z]) = (sample.albedo, sample.normal);
        for (c, v) in [r, g, b, b, x, y, z, z].into_iter().enumerate() {
            let number = if v.is_nan() { 0.0 } else { v };
            let near = f64::from(number.clamp(-1.0, 1.0)) * UNITS + INTEGERS[1];
            self.sums[c] += near.to_bits().wrapping_sub(INTEGERS[1].to_bits()) as i64;
            let whole = near - INTEGERS[1];
            let square = whole * whole * SQUARE_UNITS + 0.5 * SQUARE_UNITS + INTEGERS[0];
            self.squares[c] += square.to_bits().wrapping_sub(INTEGERS[0].to_bits());
        }
    }
}

/// A depth in units of 2^-24 m, rounded down. It is at most 2^31 m, and zero if it is negative or not finite.
#[inline(always)]
fn depth_to_fixed(depth: f32) -> u64 {
    if !depth.is_finite() {
        return 0;
    }
    let bits = depth.clamp(0.0, DEPTH_LIMIT).abs().to_bits();
    let mantissa = u64::from(bits & 0x7f_ffff | 0x80_0000);
    // A number is its mantissa times 2^(exponent - 150). The limit has the exponent 158. Small numbers lose all bits.
    const ROOM: i32 = 32;
    let shift = (150 + ROOM - DEPTH_BITS - (bits >> 23) as i32).min(63);
    (mantissa << ROOM) >> shift
}

impl PixelSums {
    /// Adds all samples of `other`. The caller must ensure that the two sets are disjoint.
    pub fn merge(&mut self, other: &Self) {
        for b in 0..BATCHES {
            self.batches[b].merge(&other.batches[b]);
            self.counts[b] += other.counts[b];
        }
        for c in 0..3 {
            self.albedo[c] += other.albedo[c];
            self.normal[c] += other.normal[c];
            self.albedo_squares[c] += other.albedo_squares[c];
            self.normal_squares[c] += other.normal_squares[c];
        }
        self.depth = self.depth.saturating_add(other.depth);
        self.depth_squares = self.depth_squares.saturating_add(other.depth_squares);
        self.hits += other.hits;
        self.invalid += other.invalid;
        self.heaviest_key = self.heaviest_key.max(other.heaviest_key);
        self.luminance_squares.merge(&other.luminance_squares);
        self.first_light.merge(&other.first_light);
        for (sums, others) in self.moments.iter_mut().zip(other.moments) {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum = sum.saturating_add(other));
        }
        self.places.iter_mut().zip(other.places).for_each(|(sum, other)| *sum += other);
    }

    /// Number of samples.
    #[inline]
    pub fn count(&self) -> u32 {
        self.counts.iter().sum()
    }
}

/// A sample for tests.
#[cfg(test)]
pub(crate) fn sample(radiance: Rgb) -> Sample {
    let (albedo, normal) = (Rgb::new(0.5, 0.25, 1.0), [0.0, -1.0, 0.0]);
    Sample { radiance, first_light: radiance * 0.25, place: [0.25, -0.5], albedo, normal, depth: 2.5, hit: true }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_lanes::{InstructionSet, dispatch};

    /// A cheap deterministic stream of radiances over twenty orders of magnitude.
    fn radiances(n: u32) -> impl Iterator<Item = Rgb> {
        (0..n).map(|i| {
            let h = i.wrapping_mul(0x9e37_79b9) ^ (i >> 3).wrapping_mul(0x85eb_ca6b);
            let v = (h % 1000) as f32 * 10f32.powi((h >> 16) as i32 % 20 - 12);
            Rgb::new(v, v * 0.3, v * 7.0)
        })
    }

    #[test]
    fn fixed_point_is_exact_where_it_can_be_and_rounds_once_elsewhere() {
        let fixed = |v: f32| {
            let mut p = PixelSums::default();
            p.add(0, &Sample { radiance: Rgb::splat(v), ..Sample::MISS });
            p.batches[0].0[0]
        };
        for v in [0.0, 1.0, 0.1, 1e-6, 3.7e12, 1.5e-9, f32::MIN_POSITIVE, 1e-40] {
            let back = fixed(v) as f64 * (-48f64).exp2();
            assert!((back - f64::from(v)).abs() <= (-49f64).exp2(), "{v} came back as {back}");
        }
        assert_eq!(fixed(1.0), 1 << 48);
        let units = |units: f32| fixed(units * (-48f32).exp2());
        assert_eq!([0.5, 1.5, 2.5, 3.5, 2.5000002].map(units), [0, 2, 2, 4, 3]);
        assert_eq!(fixed((1u64 << 46) as f32 * (1.0 - f32::EPSILON)), (1 << 94) - (1 << 71));
        assert_eq!(fixed(0.75 + 3.0), 15 << 46);
    }

    /// A sample as the sums have it, computed number by number with integers.
    fn one(index: u32, sample: &Sample) -> PixelSums {
        let mut p = PixelSums::default();
        let unit =
            |v: f32| (f64::from(if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) }) * 16_777_216.0).round() as i64;
        let square = |v: i64| (v.unsigned_abs().pow(2) + (1 << 17)) >> 18;
        p.counts[index as usize % BATCHES] = 1;
        if sample.is_valid() {
            let fixed = |v: f32| {
                let scaled = f64::from(v) * 48f64.exp2();
                if scaled < 64f64.exp2() {
                    scaled.round_ties_even() as u128
                } else {
                    (scaled / 32f64.exp2()) as u128 * (1 << 32)
                }
            };
            p.batches[index as usize % BATCHES].0 = sample.radiance.to_array().map(fixed);
            p.first_light.0 = sample.first_light.to_array().map(fixed);
            p.moments = sample.place.map(|place| {
                (sample.radiance * place).to_array().map(|v| (fixed(v.abs()) as i128) * if v < 0.0 { -1 } else { 1 })
            });
            p.places = sample.place.map(|place| (f64::from(place) * 16_777_216.0).round_ties_even() as i64);
            let luminance = sample.radiance.luminance().abs();
            p.heaviest_key = heaviest_key(index, luminance);
            p.luminance_squares.add(luminance);
        } else {
            p.invalid = 1;
        }
        if sample.hit {
            p.hits = 1;
            p.albedo = sample.albedo.to_array().map(unit);
            p.normal = sample.normal.map(unit);
            p.albedo_squares = p.albedo.map(square);
            p.normal_squares = p.normal.map(square);
            if sample.depth.is_finite() {
                p.depth = (f64::from(sample.depth.clamp(0.0, DEPTH_LIMIT)) * 16_777_216.0) as i64;
            }
            p.depth_squares = u128::from(p.depth.unsigned_abs()).pow(2);
        }
        p
    }

    /// Ranges of every instruction set, single samples, and sums of numbers that are computed one by one have the same bits.
    #[test]
    fn samples_of_a_range_are_added_as_single_ones() {
        let mut bits = 1u32;
        let mut random = || {
            bits = bits.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d) >> 8
        };
        let (rare, mut samples) = ([f32::NAN, f32::INFINITY, -0.0, 2.0, -3.0, 1e30, 1e-40, 0.5], Vec::new());
        for _ in 0..20_000 {
            let mut number = |least: i32, most: i32| match random() {
                h if h.is_multiple_of(59) => rare[h as usize / 59 % 8],
                h => random() as f32 * ((least + h as i32 % (most - least)) as f32 - 24.0).exp2(),
            };
            let mut unit = || number(-24, 1) * if number(0, 1) > 0.5 { -1.0 } else { 1.0 };
            let (albedo, normal) = (Rgb::new(unit(), unit(), unit()), [unit(), unit(), unit()]);
            let place = [unit(), unit()].map(|v| if v.is_nan() { 0.0 } else { v.clamp(-0.5, 0.5) });
            let radiance = Rgb::new(number(-50, 48), number(-10, 10), number(-30, 5));
            let (first_light, depth, hit) = (radiance * 0.25, number(-30, 33), number(0, 1) > 0.1);
            samples.push(Sample { radiance, first_light, place, albedo, normal, depth, hit });
        }
        for (first, count) in [(0, 20_000), (3, 1), (7, 2), (5, 17), (u32::MAX - 20, 19), (2, 9000)] {
            let mut wanted = PixelSums::default();
            (first..).zip(&samples[..count]).for_each(|(index, sample)| wanted.merge(&one(index, sample)));
            let mut single = PixelSums::default();
            (first..).zip(&samples[..count]).for_each(|(index, sample)| single.add(index, sample));
            assert_eq!(single, wanted, "{count} samples from {first}");
            for set in InstructionSet::all() {
                let mut sums = PixelSums::EMPTY;
                dispatch!(set, _F, _token => sums.add_range(first, &samples[..count]));
                assert_eq!(sums, wanted, "{count} samples from {first}, {set:?}");
            }
        }
    }

    #[test]
    fn sets_add_to_the_last_bit_in_any_order() {
        let all: Vec<Rgb> = radiances(1000).collect();
        let sum = |range: &mut dyn Iterator<Item = usize>| {
            let mut p = PixelSums::default();
            range.for_each(|i| p.add(i as u32, &sample(all[i])));
            p
        };
        let whole = sum(&mut (0..1000));
        let (a, b) = (sum(&mut (0..137)), sum(&mut (137..1000).rev()));
        let mut ab = a;
        ab.merge(&b);
        let mut ba = b;
        ba.merge(&a);
        assert_eq!(whole, ab);
        assert_eq!(whole, ba);
    }

    #[test]
    fn ten_million_bright_samples_keep_their_exact_mean() {
        let mut p = PixelSums::default();
        for i in 0..10_000_000 {
            p.add(i, &sample(Rgb::new(16_777_215.0, 0.1, 1e-9)));
        }
        // The dark channel is rounded once, to a unit.
        let rounded = (f64::from(1e-9f32) * 48f64.exp2()).round() * (-48f64).exp2();
        let expected = [16_777_215.0, f64::from(0.1f32), rounded];
        for (m, e) in p.mean().into_iter().zip(expected) {
            assert!((m - e).abs() <= 1e-9 * e, "mean {m}, expected {e}");
        }
        // Constant samples have no variance beyond the rounding of the means to f64.
        for (v, e) in p.variance_of_mean().into_iter().zip(expected) {
            assert!(v <= 1e-30 * e * e, "variance {v}");
        }
    }

    #[test]
    fn the_heaviest_sample_is_the_same_in_any_order() {
        let values = [0.5, 3.0, 7.0, 1.0, 7.0, 0.0];
        let of = |indices: &[u32]| {
            let mut p = PixelSums::default();
            indices.iter().for_each(|&i| p.add(i, &sample(Rgb::splat(values[i as usize]))));
            p
        };
        let luminance = Rgb::splat(7.0).luminance();
        for split in 0..6 {
            let (mut a, b) = (of(&[5, 4, 3, 2, 1, 0][..split]), of(&[5, 4, 3, 2, 1, 0][split..]));
            a.merge(&b);
            assert_eq!(a.heaviest(), Some((2, luminance)), "split at {split}");
        }
        assert_eq!(of(&[5]).heaviest(), None, "a black pixel has none");
        let mut invalid = of(&[0]);
        invalid.add(9, &sample(Rgb::splat(f32::INFINITY)));
        assert_eq!(invalid.heaviest(), Some((0, Rgb::splat(0.5).luminance())), "an invalid sample weighs nothing");
    }

    #[test]
    fn invalid_samples_are_counted_never_summed() {
        let mut p = PixelSums::default();
        for (i, v) in [f32::NAN, f32::INFINITY, -1e-3, 1e15, 2.0].into_iter().enumerate() {
            p.add(i as u32, &sample(Rgb::new(1.0, v, 1.0)));
        }
        assert_eq!((p.invalid, p.count()), (4, 5));
        assert!((p.mean()[1] - 0.4).abs() < 1e-12);
    }
}
