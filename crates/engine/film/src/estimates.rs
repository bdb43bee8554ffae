//! Estimates from the sums of a pixel: means, variances and scatter.

use crate::accumulator::{BATCHES, PixelSums, RadianceSum, signed_number};
use crate::units::{DEPTH_BITS, UNIT_BITS, UNIT_SQUARE_BITS};
use dunkelfeld_radiometry::Rgb;

/// Scatter of the luminance of a pixel's samples, under the assumption of independence: variances of their mean
/// [(W/(m^2 sr))^2].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Variance from all samples.
    pub all: f64,
    /// The part of `all` that comes from the sample with the largest luminance.
    pub largest: f64,
}

/// Mean radiance of a pixel, and the sums of its batches as floating-point numbers [W/(m^2 sr)].
#[derive(Clone, Copy, Debug)]
pub struct Means {
    /// [`PixelSums::mean`].
    pub mean: [f64; 3],
    sums: [[f64; 3]; BATCHES],
    counts: [u32; BATCHES],
}

impl Means {
    /// Batches with samples: numbers of samples and sums.
    fn used(&self) -> impl Iterator<Item = (f64, [f64; 3])> {
        let batches = self.counts.into_iter().zip(self.sums);
        batches.filter(|(count, _)| *count > 0).map(|(count, sum)| (f64::from(count), sum))
    }

    /// (B - 1) n for B batches with n samples. `None` with fewer than two batches.
    fn divisor(&self) -> Option<f64> {
        let used = self.used().count() as u32;
        (used > 1).then(|| f64::from(used - 1) * f64::from(self.counts.iter().sum::<u32>()))
    }

    /// Estimated variance of the mean per channel [(W/(m^2 sr))^2], from the spread of the batch means: `sum n_b
    /// (m_b - m)^2 / ((B - 1) n)` over the B batches that hold samples. Unbiased for independent samples, and for
    /// samples that are quasi-random within a batch. Infinite with fewer than two batches, since the variance is then
    /// unknown. Then the same of the covariances of red and green, red and blue, green and blue.
    pub fn variance_and_covariance(&self) -> ([f64; 3], [f64; 3]) {
        let Some(divisor) = self.divisor() else { return ([f64::INFINITY; 3], [f64::INFINITY; 3]) };
        let (mut squares, mut products) = ([0.0; 3], [0.0; 3]);
        for (count, sum) in self.used() {
            let [r, g, b] = [0, 1, 2].map(|c: usize| sum[c] / count - self.mean[c]);
            let (square, product) = ([r * r, g * g, b * b], [r * g, r * b, g * b]);
            for c in 0..3 {
                squares[c] += count * square[c];
                products[c] += count * product[c];
            }
        }
        (squares.map(|s| s / divisor), products.map(|s| s / divisor))
    }

    /// Mean, and estimated variance of that mean, of a weighted sum of the channels: [`PixelSums::mean`] and
    /// [`PixelSums::variance_of_mean`] of `sum w_c L_c`. The variance includes the covariance of the channels, which their
    /// variances alone do not contain. Without samples the mean is zero. With fewer than two batches the variance is
    /// infinite.
    pub fn weighted_mean_and_variance(&self, weights: [f64; 3]) -> (f64, f64) {
        let mean = weighted(self.mean, weights);
        let Some(divisor) = self.divisor() else { return (mean, f64::INFINITY) };
        let mut spread = 0.0;
        for (count, sum) in self.used() {
            spread += count * (weighted(sum, weights) / count - mean).powi(2);
        }
        (mean, spread / divisor)
    }
}

#[inline]
fn weighted(v: [f64; 3], weights: [f64; 3]) -> f64 {
    weights[0] * v[0] + weights[1] * v[1] + weights[2] * v[2]
}

/// Variance of the mean of `n` samples from their mean and the mean of their squares. Infinite with fewer than two. The
/// formula assumes independent samples. Those of a pixel are spread more evenly, and their mean varies less.
fn variance_of_mean(mean: f64, mean_square: f64, n: u32) -> f32 {
    if n < 2 { f32::INFINITY } else { ((mean_square - mean * mean).max(0.0) / f64::from(n - 1)) as f32 }
}

impl PixelSums {
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

    /// Mean first light [W/(m^2 sr)] per channel ([`crate::Sample::first_light`]); zero without samples.
    pub fn mean_first_light(&self) -> [f32; 3] {
        let n = f64::from(self.count().max(1));
        self.first_light.to_f64().map(|sum| (sum / n) as f32)
    }

    /// First moments of the radiance in the pixel, for the two axes and per channel: the covariance of the radiance of a sample
    /// with its [place](crate::Sample::place), a twelfth of the gradient. Even light has none, wherever its samples are. Zero
    /// without samples.
    pub fn mean_moments(&self) -> [[f32; 3]; 2] {
        let (n, mean) = (f64::from(self.count().max(1)), self.mean());
        let of_axis = |axis: usize| {
            let place = self.places[axis] as f64 * (-f64::from(UNIT_BITS)).exp2() / n;
            [0, 1, 2].map(|c: usize| (signed_number(self.moments[axis][c]) / n - mean[c] * place) as f32)
        };
        [of_axis(0), of_axis(1)]
    }

    /// The means of the pixel and its batches, for several estimates from the same numbers.
    pub fn means(&self) -> Means {
        Means { mean: self.mean(), sums: self.batches.map(RadianceSum::to_f64), counts: self.counts }
    }

    /// [`Means::variance_and_covariance`]: the variance.
    pub fn variance_of_mean(&self) -> [f64; 3] {
        self.means().variance_and_covariance().0
    }

    /// [`Means::variance_and_covariance`]: the covariance.
    pub fn covariance_of_mean(&self) -> [f64; 3] {
        self.means().variance_and_covariance().1
    }

    /// Mean of a weighted sum of the channels. Zero without samples.
    #[inline]
    pub fn weighted_mean(&self, weights: [f64; 3]) -> f64 {
        weighted(self.mean(), weights)
    }

    /// [`Means::weighted_mean_and_variance`].
    pub fn weighted_mean_and_variance(&self, weights: [f64; 3]) -> (f64, f64) {
        self.means().weighted_mean_and_variance(weights)
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
        self.scatter_about(self.mean())
    }

    /// [`Self::scatter`], given the mean of the pixel.
    pub fn scatter_about(&self, [r, g, b]: [f64; 3]) -> Option<Scatter> {
        let count = self.count();
        if count < 2 {
            return None;
        }
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
    use crate::accumulator::{Accumulate, Sample, sample};

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
