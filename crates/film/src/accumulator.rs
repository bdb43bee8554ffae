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
    pub const MISS: Self = Self { radiance: Rgb::BLACK, albedo: Rgb::BLACK, normal: [0.0; 3], depth: 0.0, hit: false };

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
    fn merge(&mut self, other: &Self) {
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

#[inline]
fn weighted(v: [f64; 3], weights: [f64; 3]) -> f64 {
    weights[0] * v[0] + weights[1] * v[1] + weights[2] * v[2]
}

/// A whole number as a floating-point number, rounded to nearest: that of its first 64 bits, the last of which also stands for
/// the bits below it. The conversion of 128 bits by the compiler takes several times as long.
#[inline]
pub(crate) fn number(v: u128) -> f64 {
    let shift = 64u32.saturating_sub(v.leading_zeros());
    let is_cut = v & ((1 << shift) - 1) != 0;
    ((v >> shift) as u64 | u64::from(is_cut)) as f64 * f64::from_bits(u64::from(1023 + shift) << 52)
}

/// Floating-point numbers near these have no bits below one: a number that is added is rounded to nearest even. The number of
/// the second kind may be negative.
const INTEGERS: [f64; 2] = [(1u64 << 52) as f64, 1.5 * (1u64 << 52) as f64];

/// `v * 2^48` as integers in two parts, the first of which has units of 2^48. Lost bits are rounded to nearest even. The
/// numbers are finite and in `[0, 2^46)`.
#[inline(always)]
fn to_fixed(v: [f32; 4]) -> [[i64; 4]; 2] {
    let mut parts = [[0; 4]; 2];
    for c in 0..4 {
        let v = f64::from(v[c]);
        let near = v + INTEGERS[0];
        let rest = (v - (near - INTEGERS[0])) * (1u64 << RADIANCE_BITS) as f64 + INTEGERS[1];
        parts[0][c] = near.to_bits().wrapping_sub(INTEGERS[0].to_bits()) as i64;
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
}

/// Scatter of the luminance of a pixel's samples, under the assumption of independence: variances of their mean
/// [(W/(m^2 sr))^2].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Variance from all samples.
    pub all: f64,
    /// The part of `all` that comes from the sample with the largest luminance.
    pub largest: f64,
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
        let (mut radiance, mut auxiliary) = ([[0; 4]; 2], Auxiliary::default());
        for (i, sample) in samples.iter().step_by(BATCHES).enumerate() {
            let index = first.wrapping_add((i * BATCHES) as u32);
            if sample.is_valid() {
                let Rgb { r, g, b } = sample.radiance;
                let parts = to_fixed([r, g, b, b]);
                for c in 0..4 {
                    radiance[0][c] += parts[0][c];
                    radiance[1][c] += parts[1][c];
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
        for (c, sum) in self.batches[batch].0.iter_mut().enumerate() {
            let [whole, rest] = [radiance[0][c], radiance[1][c]].map(|part| i128::from(part) as u128);
            *sum = sum.saturating_add((whole << RADIANCE_BITS).wrapping_add(rest));
        }
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
fn heaviest_key(index: u32, luminance: f32) -> u64 {
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
        let v = [r, g, b, b, x, y, z, z];
        for c in 0..8 {
            let number = if v[c].is_nan() { 0.0 } else { v[c] };
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
    // The limit has the exponent 158 and is shifted by 9 + 23 bits. Small numbers lose all bits.
    (mantissa << 32) >> (158 - (bits >> 23)).min(63)
}

/// Variance of the mean of `n` samples from their mean and the mean of their squares. Infinite with fewer than two. The
/// formula assumes independent samples. Those of a pixel are spread more evenly, and their mean varies less.
fn variance_of_mean(mean: f64, mean_square: f64, n: u32) -> f32 {
    if n < 2 { f32::INFINITY } else { ((mean_square - mean * mean).max(0.0) / f64::from(n - 1)) as f32 }
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
    }

    /// Number of samples.
    #[inline]
    pub fn count(&self) -> u32 {
        self.counts.iter().sum()
    }

    /// Mean radiance [W/(m^2 sr)] per channel; zero without samples.
    pub fn mean(&self) -> [f64; 3] {
        let n = self.count();
        if n == 0 {
            return [0.0; 3];
        }
        let mut total = RadianceSum::default();
        for b in &self.batches {
            total.merge(b);
        }
        total.to_f64().map(|s| s / f64::from(n))
    }

    /// Estimated variance of [`Self::mean`] per channel [(W/(m^2 sr))^2], from the spread of the batch means: `sum n_b
    /// (m_b - m)^2 / ((B - 1) n)` over the B batches that hold samples. Unbiased for independent samples, and for
    /// samples that are quasi-random within a batch. Infinite with fewer than two batches, since the variance is then
    /// unknown.
    pub fn variance_of_mean(&self) -> [f64; 3] {
        self.products_of_batches(|d| d.map(|d| d * d))
    }

    /// Estimated covariance of red and green, red and blue, green and blue of [`Self::mean`], likewise.
    pub fn covariance_of_mean(&self) -> [f64; 3] {
        self.products_of_batches(|[r, g, b]| [r * g, r * b, g * b])
    }

    /// Products of the differences between the batch means and the mean, normalised as in [`Self::variance_of_mean`].
    fn products_of_batches(&self, products: impl Fn([f64; 3]) -> [f64; 3]) -> [f64; 3] {
        let used = self.counts.iter().filter(|&&n| n > 0).count();
        if used < 2 {
            return [f64::INFINITY; 3];
        }
        let (n, mean) = (f64::from(self.count()), self.mean());
        let mut spread = [0.0; 3];
        for (batch, &count) in self.batches.iter().zip(&self.counts).filter(|(_, c)| **c > 0) {
            let batch_mean = batch.to_f64().map(|s| s / f64::from(count));
            let products = products([0, 1, 2].map(|c: usize| batch_mean[c] - mean[c]));
            for c in 0..3 {
                spread[c] += f64::from(count) * products[c];
            }
        }
        spread.map(|s| s / ((used - 1) as f64 * n))
    }

    /// Mean of a weighted sum of the channels. Zero without samples.
    #[inline]
    pub fn weighted_mean(&self, weights: [f64; 3]) -> f64 {
        weighted(self.mean(), weights)
    }

    /// Mean, and estimated variance of that mean, of a weighted sum of the channels: [`Self::mean`] and
    /// [`Self::variance_of_mean`] of `sum w_c L_c`. The variance includes the covariance of the channels, which their
    /// variances alone do not contain. Without samples the mean is zero. With fewer than two batches the variance is
    /// infinite.
    pub fn weighted_mean_and_variance(&self, weights: [f64; 3]) -> (f64, f64) {
        let weigh = |v: [f64; 3]| weighted(v, weights);
        let mean = self.weighted_mean(weights);
        let (mut used, mut spread) = (0u32, 0.0);
        for (batch, &count) in self.batches.iter().zip(&self.counts).filter(|(_, c)| **c > 0) {
            used += 1;
            spread += f64::from(count) * (weigh(batch.to_f64()) / f64::from(count) - mean).powi(2);
        }
        let variance = if used < 2 { f64::INFINITY } else { spread / (f64::from(used - 1) * f64::from(self.count())) };
        (mean, variance)
    }

    /// The largest luminance of a single sample [W/(m^2 sr)].
    pub fn max_luminance(&self) -> f32 {
        f32::from_bits((self.heaviest_key >> 32) as u32)
    }

    /// The sample with the largest luminance: its index and its luminance [W/(m^2 sr)], the first of equal ones. `None`
    /// while the pixel is black. The result does not depend on the order in which samples were added or sums merged.
    pub fn heaviest(&self) -> Option<(u32, f32)> {
        let luminance = self.max_luminance();
        (luminance > 0.0).then_some((!(self.heaviest_key as u32), luminance))
    }

    /// Scatter of the luminance of the samples. `None` with fewer than two. In contrast to [`Self::variance_of_mean`]
    /// it overestimates the noise of quasi-random samples, but it uses all samples instead of four batches.
    pub fn scatter(&self) -> Option<Scatter> {
        let count = self.count();
        if count < 2 {
            return None;
        }
        let [r, g, b] = self.mean();
        let [wr, wg, wb] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
            .map(|(r, g, b)| f64::from(Rgb::new(r, g, b).luminance()));
        let (n, mean) = (f64::from(count), wr * r + wg * g + wb * b);
        let mean_square = self.luminance_squares.to_f64() / n;
        let all = (mean_square - mean * mean).max(0.0) / (n - 1.0);
        // The contribution of this sample to the sum of squared deviations is (n - 1) / n times its squared distance
        // from the mean of the others (Welford 1962).
        let from_others = (f64::from(self.max_luminance()) - mean) * n / (n - 1.0);
        Some(Scatter { all, largest: (from_others / n).powi(2).min(all) })
    }

    /// Mean albedo over all samples. Those that hit no surface count as zero.
    pub fn mean_albedo(&self) -> [f32; 3] {
        let n = f64::from(self.count().max(1));
        self.albedo.map(|v| (v as f64 * (-f64::from(UNIT_BITS)).exp2() / n) as f32)
    }

    /// Mean normal over all samples. It is shorter than one if normals differ or samples hit no surface.
    pub fn mean_normal(&self) -> [f32; 3] {
        let n = f64::from(self.count().max(1));
        self.normal.map(|v| (v as f64 * (-f64::from(UNIT_BITS)).exp2() / n) as f32)
    }

    /// Mean distance \[m\] over the samples that hit a surface. Zero if none did.
    pub fn mean_depth(&self) -> f32 {
        (self.depth as f64 * (-f64::from(DEPTH_BITS)).exp2() / f64::from(self.hits.max(1))) as f32
    }

    /// Estimated variance of [`Self::mean_albedo`], as of independent samples. Infinite with fewer than two.
    pub fn variance_of_albedo(&self) -> [f32; 3] {
        self.variance_of_unit(&self.albedo, &self.albedo_squares)
    }

    /// Estimated variance of [`Self::mean_normal`], as of independent samples. Infinite with fewer than two.
    pub fn variance_of_normal(&self) -> [f32; 3] {
        self.variance_of_unit(&self.normal, &self.normal_squares)
    }

    /// Estimated variance of [`Self::mean_depth`] \[m^2\], as of independent samples. Infinite with fewer than two that
    /// hit a surface. Zero if several samples were taken and none hit: the depth is then zero.
    pub fn variance_of_depth(&self) -> f32 {
        if self.hits == 0 && self.count() > 1 {
            return 0.0;
        }
        let unit = (-f64::from(DEPTH_BITS)).exp2();
        let n = f64::from(self.hits.max(1));
        variance_of_mean(self.depth as f64 * unit / n, self.depth_squares as f64 * unit * unit / n, self.hits)
    }

    fn variance_of_unit(&self, sums: &[i64; 3], squares: &[u64; 3]) -> [f32; 3] {
        let count = self.count();
        let mean = |sum: f64, bits: i32| sum * (-f64::from(bits)).exp2() / f64::from(count.max(1));
        let variance = |c: usize| {
            let (mean, mean_square) = (mean(sums[c] as f64, UNIT_BITS), mean(squares[c] as f64, UNIT_SQUARE_BITS));
            variance_of_mean(mean, mean_square, count)
        };
        std::array::from_fn(variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_lanes::{InstructionSet, dispatch};

    fn sample(radiance: Rgb) -> Sample {
        Sample { radiance, albedo: Rgb::new(0.5, 0.25, 1.0), normal: [0.0, -1.0, 0.0], depth: 2.5, hit: true }
    }

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
            let radiance = Rgb::new(number(-50, 48), number(-10, 10), number(-30, 5));
            samples.push(Sample { radiance, albedo, normal, depth: number(-30, 33), hit: number(0, 1) > 0.1 });
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
    fn scatter_is_that_of_the_samples_with_and_without_the_largest() {
        let values = [0.5, 3.0, 7.0, 1.0, 0.0, 2.5];
        let of = |values: &[f32]| {
            let mut p = PixelSums::default();
            values.iter().enumerate().for_each(|(i, &v)| p.add(i as u32, &sample(Rgb::splat(v))));
            p
        };
        let direct = |values: &[f32]| {
            let n = values.len() as f64;
            let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
            values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>()
        };
        let scatter = of(&values).scatter().expect("six samples");
        assert!((scatter.all - direct(&values) / 30.0).abs() < 1e-6, "{scatter:?}");
        let without = [0.5, 3.0, 1.0, 0.0, 2.5];
        assert!((scatter.all - scatter.largest - direct(&without) / 30.0).abs() < 1e-6, "{scatter:?}");
        assert_eq!(of(&values[..1]).scatter(), None);
        let bright = of(&[1e13, 0.0]).scatter().expect("two samples");
        assert!((bright.all / 2.5e25 - 1.0).abs() < 1e-6 && bright.largest == bright.all, "{bright:?}");
        assert_eq!(of(&[0.0, 0.0]).scatter(), Some(Scatter { all: 0.0, largest: 0.0 }));
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

    #[test]
    fn batch_variance_is_unbiased_also_with_unequal_batches() {
        // Mean of the estimate over many pixels of independent uniform samples against the truth, 1/12 per sample.
        let n = 6; // Batches hold 2, 2, 1, 1 samples.
        let pixels = 40_000;
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u32 << 24) as f32
        };
        let mut total = 0.0;
        for _ in 0..pixels {
            let mut p = PixelSums::default();
            for i in 0..n {
                p.add(i, &sample(Rgb::splat(uniform())));
            }
            total += p.variance_of_mean()[0];
        }
        let (mean, truth) = (total / f64::from(pixels), 1.0 / 12.0 / f64::from(n));
        // The estimate has 3 degrees of freedom: relative standard error about sqrt(2/3/40000) = 0.4 %; six of them.
        assert!((mean / truth - 1.0).abs() < 0.025, "{mean} against {truth}");
    }

    #[test]
    fn a_weighted_sum_includes_the_covariance_of_the_channels() {
        // Red and green always add up to one: their sum has no variance, their difference twice the standard deviation
        // of each.
        let mut p = PixelSums::default();
        for (i, r) in [0.1, 0.9, 0.4, 0.7, 0.2, 0.3].into_iter().enumerate() {
            p.add(i as u32, &sample(Rgb::new(r, 1.0 - r, 5.0)));
        }
        let (mean, variance) = p.weighted_mean_and_variance([1.0, 1.0, 0.0]);
        assert!((mean - 1.0).abs() < 1e-7 && variance < 1e-14, "{mean}, {variance}");
        let (_, difference) = p.weighted_mean_and_variance([1.0, -1.0, 0.0]);
        let [red, ..] = p.variance_of_mean();
        assert!((difference / (4.0 * red) - 1.0).abs() < 1e-6, "{difference} against {red}");
        let (mean, variance) = p.weighted_mean_and_variance([0.0, 2.0, 0.0]);
        assert!((mean - 2.0 * p.mean()[1]).abs() < 1e-12);
        assert!((variance / (4.0 * p.variance_of_mean()[1]) - 1.0).abs() < 1e-9);
        // The variance of the sum of two channels is the sum of their variances and twice their covariance. Blue does
        // not vary.
        let [green, blue] = [p.variance_of_mean()[1], p.variance_of_mean()[2]];
        let [rg, rb, gb] = p.covariance_of_mean();
        assert!(
            (rg / green + 1.0).abs() < 1e-6 && blue < 1e-14 && rb.abs().max(gb.abs()) < 1e-9 * green,
            "{rg} {rb} {gb}"
        );
        assert_eq!(PixelSums::default().covariance_of_mean(), [f64::INFINITY; 3]);
    }

    #[test]
    fn layers_have_the_variance_of_their_means() {
        // Two of five samples miss. The albedos are 0, 0, a, b, c, with a variance in closed form. A constant normal
        // varies by the misses.
        let (albedos, depths) = ([0.2f32, 0.9, 0.4], [1.0f32, 1e6, 3.5]);
        let mut p = PixelSums::default();
        (0..2).for_each(|i| p.add(i, &Sample::MISS));
        for (i, (a, depth)) in albedos.into_iter().zip(depths).enumerate() {
            p.add(2 + i as u32, &Sample { albedo: Rgb::splat(a), depth, ..sample(Rgb::WHITE) });
        }
        let expected = |values: &[f32]| {
            let n = values.len() as f64;
            let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
            values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / (n - 1.0) / n
        };
        let near = |got: f32, values: &[f32]| {
            let e = expected(values);
            assert!((f64::from(got) / e - 1.0).abs() < 1e-6, "{got} instead of {e}");
        };
        near(p.variance_of_albedo()[1], &[0.0, 0.0, 0.2, 0.9, 0.4]);
        near(p.variance_of_normal()[1], &[0.0, 0.0, -1.0, -1.0, -1.0]);
        assert_eq!(p.variance_of_normal()[0], 0.0);
        near(p.variance_of_depth(), &depths);
        // Constant layers have no variance beyond the rounding of their squares, for any number of samples.
        let mut p = PixelSums::default();
        (0..100_000).for_each(|i| p.add(i, &Sample { albedo: Rgb::splat(0.7), ..sample(Rgb::WHITE) }));
        assert!(p.variance_of_albedo().iter().all(|&v| v < 1e-14), "{:?}", p.variance_of_albedo());
        assert_eq!(p.variance_of_depth(), 0.0);
    }

    #[test]
    fn variance_is_unknown_from_one_batch() {
        let mut p = PixelSums::default();
        p.add(0, &sample(Rgb::WHITE));
        assert_eq!(p.weighted_mean_and_variance([2.0, 0.0, 0.0]), (2.0, f64::INFINITY));
        assert!(p.variance_of_mean()[0].is_infinite());
        assert_eq!(p.mean_albedo(), [0.5, 0.25, 1.0]);
        assert_eq!(p.mean_depth(), 2.5);
        assert!(p.variance_of_albedo()[0].is_infinite() && p.variance_of_depth().is_infinite());
    }
}
