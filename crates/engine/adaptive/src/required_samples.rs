//! The number of samples that a pixel needs until its render variance is hidden by the sensor variance.
//!
//! A pixel of mean signal mu has the sensor variance `s = mu + sigma_d^2 + sigma_q^2 / K^2` [e-^2] (EMVA 1288). A black
//! pixel has only the floor of it. A pixel is *hidden at k* if the variance of its rendered mean is at most `k^2 s`.
//! The noise of both together is then at most `sqrt(1 + k^2)` times that of the sensor.

use dunkelfeld_film::Plane;

use crate::variance::inputs::SensorVarianceRange;
use crate::variance::pooled::PixelNoise;

/// A render is hidden if at least this share of its unsaturated pixels is hidden, unless another share is set.
pub const HIDDEN_SHARE: f64 = 0.99;
/// Level k of the certificate of a render without a target. At it the total noise is 12 % above that of the sensor.
pub const DEFAULT_TARGET: f64 = 0.5;
/// A pixel is saturated if its mean lies more than this many standard errors above saturation: one in 740 by chance.
const SATURATED_BY: f64 = 3.0;
/// Half width of the interval of the mean in which its sensor variance is taken [standard errors]: 95 %.
const LEVEL_BY: f64 = 2.0;

/// The noise parameters of a sensor that decide whether it hides the noise of a render, in photo-electrons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Variance of a black pixel, `sigma_d^2 + sigma_q^2 / K^2` [e-^2].
    pub floor: f64,
    /// Photo-electrons at which a pixel saturates [e-].
    pub saturation: f64,
}

impl SensorNoise {
    /// The temporal variance of a pixel with this number of photo-electrons [e-^2].
    #[inline]
    pub fn variance(&self, electrons: f64) -> f64 {
        electrons.max(0.0) + self.floor
    }

    /// The range of the sensor variance for a mean with the given variance: two standard errors to both sides. Infinite
    /// for a pixel that is saturated beyond doubt.
    #[inline]
    pub fn level(&self, electrons: f32, variance_of_mean: f32) -> SensorVarianceRange {
        let (mean, variance) = (f64::from(electrons), f64::from(variance_of_mean));
        if self.is_saturated(mean, variance) {
            return SensorVarianceRange { least: f32::INFINITY, most: f32::INFINITY };
        }
        let off = LEVEL_BY * variance.sqrt();
        SensorVarianceRange { least: self.variance(mean - off) as f32, most: self.variance(mean + off) as f32 }
    }

    /// Returns whether a pixel is saturated beyond doubt, if its mean has the given variance.
    #[inline]
    pub fn is_saturated(&self, electrons: f64, variance_of_mean: f64) -> bool {
        electrons - SATURATED_BY * variance_of_mean.sqrt() > self.saturation
    }
}

/// The number of samples at which `variance / n` is `limit`. Infinite if the variance is unknown, or if there is noise
/// and the limit is zero.
fn samples_at(variance: f64, limit: f64) -> f64 {
    if variance <= 0.0 {
        return 0.0;
    }
    let n = variance / limit;
    if n.is_nan() { f64::INFINITY } else { n }
}

/// The samples that each pixel needs to be hidden at some k.
#[derive(Clone, Debug, PartialEq)]
pub struct RequiredSamples {
    /// Required samples per pixel, a fraction of one for little noise. Infinite if the variance is unknown, zero if the
    /// pixel is saturated.
    pub samples: Plane<f32>,
    /// Pixels that are saturated beyond doubt.
    pub saturated: Plane<bool>,
}

/// The required samples of all pixels to be hidden at `k`, from the measured variance of each pixel, in photo-electrons
/// throughout. The forecast of a render uses them.
///
/// The sensor variance is that of the mean of the neighbourhood, or that of the pixel's own mean if it is lower. So no
/// pixel needs fewer samples because its own samples happened to be bright, and a dark pixel among bright ones is
/// compared with its own low sensor variance.
///
/// `mean` and `counts` are the mean electrons and the samples of each pixel.
/// # Panics
/// If the planes differ in size.
pub fn required_samples(
    mean: &Plane<f32>,
    counts: &Plane<u32>,
    noise: &Plane<PixelNoise>,
    sensor: SensorNoise,
    k: f64,
) -> RequiredSamples {
    let size = (noise.width(), noise.height());
    assert_eq!(
        (size, size),
        ((mean.width(), mean.height()), (counts.width(), counts.height())),
        "planes differ in size"
    );
    let pixels = || noise.data().iter().zip(mean.data()).zip(counts.data());
    let is_saturated = |((noise, &mean), &n): ((&PixelNoise, &f32), &u32)| {
        sensor.is_saturated(f64::from(mean), f64::from(noise.of_mean(n)))
    };
    let saturated: Vec<bool> = pixels().map(is_saturated).collect();
    let samples = pixels().zip(&saturated).map(|(((noise, &mean), _), &full)| {
        let limit = k * k * sensor.variance(f64::from(mean.min(noise.mean)));
        if full { 0.0 } else { samples_at(f64::from(noise.variance), limit) as f32 }
    });
    let (width, height) = (noise.width(), noise.height());
    RequiredSamples {
        samples: Plane::from_vec(width, height, samples.collect()).unwrap_or_else(|| noise.map(|_| f32::INFINITY)),
        saturated: Plane::from_vec(width, height, saturated).unwrap_or_else(|| noise.map(|_| false)),
    }
}

impl RequiredSamples {
    /// Those at k, from those at k = 1.
    #[must_use]
    pub fn at(&self, k: f64) -> Self {
        Self { samples: self.samples.map(|&n| (f64::from(n) / (k * k)) as f32), saturated: self.saturated.clone() }
    }

    /// Those that are enough for two images of the same samples.
    #[must_use]
    pub fn max(mut self, other: &Self) -> Self {
        let pairs = self.samples.data_mut().iter_mut().zip(other.samples.data());
        pairs.for_each(|(n, &other)| *n = n.max(other));
        let pairs = self.saturated.data_mut().iter_mut().zip(other.saturated.data());
        pairs.for_each(|(is_full, other)| *is_full &= other);
        self
    }

    /// Samples per pixel after which this share of the pixels is hidden, if the samples beyond `counts` are distributed in
    /// proportion to weights ([`crate::plan::next_round`]).
    pub fn if_weighted(&self, counts: &Plane<u32>, weights: &Plane<f32>, share: f64) -> Plane<f32> {
        // The level at which a pixel has its required samples. Pixels that have them already need no level.
        let levels = self.samples.data().iter().zip(weights.data()).zip(counts.data()).zip(self.saturated.data());
        let levels = levels.filter(|(_, full)| !**full).map(|(((&need, &w), &c), _)| {
            let has_enough = need <= c as f32;
            if has_enough { 0.0 } else { need / w }
        });
        let level = quantile_of(levels, share).unwrap_or(0.0);
        let mut targets = weights.map(|&w| if level > 0.0 { level * w } else { 0.0 });
        targets.data_mut().iter_mut().zip(counts.data()).for_each(|(n, &c)| *n = n.max(c as f32));
        targets
    }
}

/// Sum of the samples of all pixels. Infinite if the value of a pixel is infinite.
pub fn total(targets: &Plane<f32>) -> f64 {
    targets.data().iter().map(|&n| f64::from(n)).sum()
}

/// The smallest value that is not below the given share of all values. `None` without values. NaN counts as infinite.
fn quantile_of(values: impl Iterator<Item = f32>, share: f64) -> Option<f32> {
    quantile_in(&mut values.map(|v| if v.is_nan() { f32::INFINITY } else { v }).collect::<Vec<f32>>(), share)
}

/// The same for values without NaN. It changes their order.
pub(crate) fn quantile_in(values: &mut [f32], share: f64) -> Option<f32> {
    let rank = (share * values.len() as f64).ceil() as usize;
    let index = rank.saturating_sub(1).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(index, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variance::inputs::{NoiseInputs, PixelFeatures, SensorVarianceRange};
    use crate::variance::pooled::noise;

    const SENSOR: SensorNoise = SensorNoise { floor: 10.0, saturation: 10_000.0 };

    fn scene(mean: f32, variance: f32, width: u32) -> NoiseInputs {
        NoiseInputs {
            counts: Plane::new(width, 16, 16),
            mean: Plane::new(width, 16, mean),
            variance: Plane::new(width, 16, variance / 16.0),
            scatter: Plane::new(width, 16, None),
            largest: Plane::new(width, 16, mean),
            surface: Plane::new(width, 16, PixelFeatures::default()),
            level: Plane::new(width, 16, SensorVarianceRange::ANY),
        }
    }

    fn needs_of(evidence: &NoiseInputs, k: f64) -> RequiredSamples {
        required_samples(&evidence.mean, &evidence.counts, &noise(evidence), SENSOR, k)
    }

    #[test]
    fn black_pixels_are_compared_with_the_noise_floor() {
        let required_samples = needs_of(&scene(0.0, 40.0, 16), 0.5);
        // v / (k^2 floor) = 40 / 2.5.
        assert_eq!(*required_samples.samples.at(8, 8), 16.0);
        let lit = needs_of(&scene(90.0, 40.0, 16), 0.5);
        assert!((lit.samples.at(8, 8) - 1.6).abs() < 1e-6);
    }

    #[test]
    fn saturated_pixels_need_nothing() {
        // 3 standard errors: sqrt(16 * 625 / 16) * 3 = 75.
        let sure = needs_of(&scene(10_100.0, 16.0 * 625.0, 16), 0.5);
        assert!(sure.saturated.data().iter().all(|s| *s) && sure.samples.data().iter().all(|n| *n == 0.0));
        let unsure = needs_of(&scene(10_070.0, 16.0 * 625.0, 16), 0.5);
        assert!(unsure.saturated.data().iter().all(|s| !s) && *unsure.samples.at(3, 3) > 0.0);
    }

    #[test]
    fn a_dark_pixel_among_bright_ones_is_compared_with_its_own_sensor_noise() {
        let mut evidence = scene(90.0, 40.0, 16);
        evidence.mean.data_mut()[8 * 16 + 8] = 0.0;
        let required_samples = needs_of(&evidence, 0.5);
        assert!(
            (*required_samples.samples.at(8, 8) - 16.0).abs() < 1e-5,
            "by the floor: {}",
            required_samples.samples.at(8, 8)
        );
        assert!(*required_samples.samples.at(7, 8) < 1.7, "{}", required_samples.samples.at(7, 8));
    }

    #[test]
    fn totals_follow_from_needs() {
        let evidence = scene(0.0, 400.0, 16);
        let required_samples = needs_of(&evidence, 0.5);
        let weights = Plane::new(16, 16, 1.0);
        // 400 / 2.5 = 160 everywhere.
        assert!(
            (total(&required_samples.if_weighted(&evidence.counts, &weights, HIDDEN_SHARE)) - 160.0 * 256.0).abs()
                < 0.1
        );
        // All pixels have their required samples already.
        assert_eq!(
            total(&required_samples.if_weighted(&Plane::new(16, 16, 200), &weights, HIDDEN_SHARE)),
            200.0 * 256.0
        );
    }
}
