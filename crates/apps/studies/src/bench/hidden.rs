//! The number of samples and the time until the noise of a render is hidden by the noise of the sensor.
//!
//! A pixel is hidden at k if the variance of its rendered mean is at most k^2 times the sensor's own variance s. A
//! render is hidden at k if 99 % of its unsaturated pixels are. The noise of a picture taken then is `sqrt(1 + k^2)`
//! times the sensor's.

use super::statistics::{Deviations, pooled};
use crate::report::estimate::Estimate;
use crate::series::statistics::quantile;
use dunkelfeld::film::Plane;
use dunkelfeld_report::words::{coarse, coarse_duration};

/// Share of the unsaturated pixels that must be hidden.
pub(super) const SHARE: f64 = 0.99;

/// A headline does not extrapolate beyond this many times the measured samples: the trend there is unknown.
const REACH: f64 = 100.0;

/// The cost of hiding at k with one strategy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Price {
    pub(super) k: f64,
    /// Mean samples per pixel.
    pub(super) spp: Estimate,
    /// Seconds of rendering.
    pub(super) seconds: Estimate,
    /// `spp` over the measured samples per pixel.
    pub(super) factor: f64,
}

impl Price {
    /// Is it so far beyond the measurement that only a lower bound is stated?
    pub(super) fn is_beyond_reach(&self) -> bool {
        self.factor > REACH
    }

    /// Seconds and samples per pixel with two digits.
    pub(super) fn words(&self) -> [String; 2] {
        let (prefix, part) = if self.is_beyond_reach() { ("more than ", REACH / self.factor) } else { ("", 1.0) };
        let [seconds, spp] = [self.seconds, self.spp].map(|v| part * v.value);
        [coarse_duration(seconds), coarse(spp)].map(|words| format!("{prefix}{words}"))
    }
}

/// Ratio of the total noise of a picture to the sensor's own, minus one.
pub(super) fn growth(k: f64) -> f64 {
    (1.0 + k * k).sqrt() - 1.0
}

/// The 99 % quantile of `variance / s` over the included pixels. The variance is pooled over 7 x 7 pixels.
///
/// Pooling is necessary with few renders. Without it, the variance of 8 renders scatters by a factor of two, and its
/// highest per cent would depend on chance.
pub(super) fn worst_ratio(deviations: &Deviations, s: &Plane<f64>, counts: &[bool]) -> Estimate {
    deviations.jackknife(|variance| quantile(ratios(variance, s, counts), SHARE))
}

/// Share of the included pixels that are hidden at k.
pub(super) fn share(variance: &Plane<f64>, s: &Plane<f64>, counts: &[bool], k: f64) -> f64 {
    let ratios = ratios(variance, s, counts);
    ratios.iter().filter(|r| **r <= k * k).count() as f64 / ratios.len() as f64
}

fn ratios(variance: &Plane<f64>, s: &Plane<f64>, counts: &[bool]) -> Vec<f64> {
    let pooled = pooled(variance);
    let all = pooled.data().iter().zip(s.data()).zip(counts);
    all.filter(|(_, counts)| **counts).map(|((v, s), _)| v / s).collect()
}

/// The cost of k, computed from the 99 % quantile at `spp` samples per pixel, which take `seconds`. The variance of a
/// mean is in proportion to the inverse of its samples, and the time is in proportion to them.
pub(super) fn price(k: f64, worst: Estimate, spp: f64, seconds: Estimate) -> Price {
    let samples = worst.scaled(spp / (k * k));
    Price { k, spp: samples, seconds: samples.times(seconds.scaled(1.0 / spp)), factor: samples.value / spp }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sampling::keyed_stream;
    use rand_core::Rng;

    #[test]
    fn a_quarter_of_the_variance_costs_four_times_the_samples() {
        let worst = Estimate { value: 2.0, error: 0.2 };
        let seconds = Estimate { value: 10.0, error: 0.1 };
        let (half, quarter) = (price(0.5, worst, 64.0, seconds), price(0.25, worst, 64.0, seconds));
        assert!((half.spp.value - 512.0).abs() < 1e-9 && (quarter.spp.value - 2048.0).abs() < 1e-9);
        assert!((half.seconds.value - 80.0).abs() < 1e-9);
        // 10 % of the ratio and 1 % of the time.
        assert!((half.seconds.error - 80.0 * 0.0101f64.sqrt()).abs() < 1e-3, "{half:?}");
    }

    #[test]
    fn noise_of_a_known_variance_is_hidden_where_it_must_be() {
        // Uniform numbers of variance 3 everywhere, s = 4 on the left half and 1 on the right. The last column is
        // excluded.
        let (width, height) = (64, 32);
        let planes: Vec<Plane<f32>> = (0..16)
            .map(|seed| {
                let mut rng = keyed_stream(seed, 0, 0, 0);
                Plane::from_fn(width, height, |_, _| 100.0 + 6.0 * (rng.next_u32() as f32 / u32::MAX as f32 - 0.5))
            })
            .collect();
        let s = Plane::from_fn(width, height, |x, _| if x < width / 2 { 4.0 } else { 1.0 });
        let counts: Vec<bool> = (0..width * height).map(|i| i % width != width - 1).collect();
        let deviations = Deviations::of(&planes).expect("sixteen");
        let worst = worst_ratio(&deviations, &s, &counts);
        // The right half holds half of the pixels, so the 99 % quantile lies in the upper 2 % of its ratios: 3 with a spread
        // of sqrt((1.8 - 1 + 2 / 15) / (16 * 49)) = 3.5 % after pooling; 2 sigma above, give or take three more.
        assert!(worst.value > 3.0 * 1.0 && worst.value < 3.0 * 1.18, "{worst:?}");
        let variance = deviations.variance();
        let at = |k| share(&variance, &s, &counts, k);
        // Left: 3 / 4 is hidden at k = 1, right: 3 is not. Of 63 columns 32 are left.
        assert!((at(1.0) - 32.0 / 63.0).abs() < 1e-12, "{}", at(1.0));
        assert!(at(2.0) == 1.0 && at(0.5) == 0.0);
    }
}
