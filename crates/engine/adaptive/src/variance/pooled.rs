//! The noise of a pixel, estimated from its neighbourhood.
//!
//! A film has the variance of a pixel from the spread of four batches. It has three degrees of freedom, too few for a
//! decision: its 99 % quantile is 3.8 times the true value. It also comes from the samples that are averaged. So a
//! pixel that stops at a small variance stops too early after a chance of low samples (Kirk and Arvo 1991). So
//! variances are pooled over 7 x 7 pixels of the same surface with similar brightness.
//!
//! The pooled variance is the fallback if the scatter of single samples is unknown ([`crate::variance::pixel`]). It
//! also describes the neighbourhood of a pixel.

use dunkelfeld_film::Plane;

use crate::variance::inputs::{NoiseInputs, around};

/// Variances are pooled over squares of 7 x 7 pixels, at most 147 degrees of freedom.
const POOL_REACH: u32 = 3;

/// Estimated noise of the samples of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelNoise {
    /// Variance of one sample [unit^2]. Infinite if it is unknown. For quasi-random samples: the number of samples
    /// times the variance of their mean, which decreases with their number.
    pub variance: f32,
    /// Mean over the neighbourhood \[unit\].
    pub mean: f32,
}

impl PixelNoise {
    /// Unknown noise.
    pub const UNKNOWN: Self = Self { variance: f32::INFINITY, mean: 0.0 };

    /// Variance of the mean of n samples [unit^2]. The certificate uses it.
    #[inline]
    pub fn of_mean(&self, n: u32) -> f32 {
        if n == 0 { f32::INFINITY } else { self.variance / n as f32 }
    }
}

/// The noise of the pixels of one row. Rows are independent of each other, so threads can compute them in parallel.
///
/// # Panics
/// If the planes differ in size.
pub fn noise_row(evidence: &NoiseInputs, y: u32) -> Vec<PixelNoise> {
    assert!(evidence.is_consistent(), "planes differ in size");
    (0..evidence.width()).map(|x| pooled_pixel(evidence, x, y)).collect()
}

/// The noise of all pixels.
pub fn noise(evidence: &NoiseInputs) -> Plane<PixelNoise> {
    let (width, height) = (evidence.width(), evidence.height());
    let noise = (0..height).flat_map(|y| noise_row(evidence, y)).collect();
    Plane::from_vec(width, height, noise).unwrap_or_else(|| Plane::new(width, height, PixelNoise::UNKNOWN))
}

/// The pixels of the neighbourhood that may share their variance with (x, y), including itself.
fn similar_neighbours(evidence: &NoiseInputs, x: u32, y: u32) -> impl Iterator<Item = (u32, u32)> {
    let (surface, level) = (evidence.surface.at(x, y), *evidence.level.at(x, y));
    around(x, y, POOL_REACH, evidence.width(), evidence.height()).filter(move |&(nx, ny)| {
        surface.is_like(evidence.surface.at(nx, ny)) && level.is_like(evidence.level.at(nx, ny))
    })
}

/// The noise of the pixel (x, y).
pub fn pooled_pixel(evidence: &NoiseInputs, x: u32, y: u32) -> PixelNoise {
    let mut pool = Pool::default();
    for (nx, ny) in similar_neighbours(evidence, x, y) {
        let (n, variance) = (*evidence.counts.at(nx, ny), *evidence.variance.at(nx, ny));
        if n > 0 && variance.is_finite() {
            pool.add(f64::from(n) * f64::from(variance), f64::from(*evidence.mean.at(nx, ny)));
        }
    }
    pool.noise()
}

/// Variances of single samples in a neighbourhood.
#[derive(Default)]
pub(crate) struct Pool {
    count: u32,
    sum: f64,
    means: f64,
}

impl Pool {
    pub(crate) fn add(&mut self, variance: f64, mean: f64) {
        self.count += 1;
        self.sum += variance;
        self.means += mean;
    }

    pub(crate) fn noise(&self) -> PixelNoise {
        if self.count == 0 {
            return PixelNoise::UNKNOWN;
        }
        let count = f64::from(self.count);
        PixelNoise { variance: (self.sum / count) as f32, mean: (self.means / count) as f32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variance::inputs::{PixelFeatures, SensorVarianceRange};

    /// An image of one surface.
    fn flat(width: u32, height: u32, variance: impl FnMut(u32, u32) -> f32) -> NoiseInputs {
        NoiseInputs {
            counts: Plane::new(width, height, 16),
            mean: Plane::new(width, height, 2.0),
            variance: Plane::from_fn(width, height, variance),
            scatter: Plane::new(width, height, None),
            largest: Plane::new(width, height, 2.0),
            surface: Plane::new(width, height, PixelFeatures::default()),
            level: Plane::new(width, height, SensorVarianceRange::ANY),
        }
    }

    #[test]
    fn the_variance_of_one_pixel_is_pooled_over_its_neighbourhood() {
        let noise = noise(&flat(20, 20, |x, y| if (x, y) == (10, 10) { 49.0 } else { 0.0 }));
        let near = noise.at(8, 11);
        assert!((near.variance - 16.0).abs() < 1e-5, "{near:?}");
        assert_eq!(noise.at(6, 10).variance, 0.0, "four pixels away");
    }

    #[test]
    fn only_similar_surfaces_share_variance() {
        let mut evidence = flat(12, 8, |x, _| if x < 6 { 1.0 } else { 9.0 });
        evidence.surface =
            Plane::from_fn(12, 8, |x, _| PixelFeatures { object: u32::from(x >= 6), ..PixelFeatures::default() });
        let noise = noise(&evidence);
        assert!((0..8).all(|y| noise.at(5, y).variance == 16.0 && noise.at(6, y).variance == 144.0));
        // A pixel without similar pixels uses its own variance.
        evidence.surface.data_mut()[3 * 12 + 3] = PixelFeatures { object: 99, ..PixelFeatures::default() };
        evidence.variance.data_mut()[3 * 12 + 3] = 25.0;
        assert_eq!(super::noise(&evidence).at(3, 3).variance, 400.0);
    }

    #[test]
    fn a_highlight_does_not_share_variance_with_the_dark_around_it() {
        let is_bright = |x: u32, y: u32| (8..12).contains(&x) && (8..12).contains(&y);
        let mut evidence = flat(20, 20, |x, y| if is_bright(x, y) { 100.0 } else { 1.0 });
        let levels = |x, y| {
            if is_bright(x, y) {
                SensorVarianceRange { least: 900.0, most: 1100.0 }
            } else {
                SensorVarianceRange { least: 9.0, most: 11.0 }
            }
        };
        evidence.level = Plane::from_fn(20, 20, levels);
        let all = noise(&evidence);
        assert!(
            (0..400)
                .all(|i| all.data()[i].variance == if is_bright(i as u32 % 20, i as u32 / 20) { 1600.0 } else { 16.0 })
        );
    }

    #[test]
    fn a_pixel_that_one_sample_has_lit_shares_its_variance() {
        // By its own noise the pixel may be as dark as the others.
        let mut evidence = flat(20, 20, |x, y| if (x, y) == (10, 10) { 49.0 } else { 0.0 });
        evidence.level = Plane::new(20, 20, SensorVarianceRange { least: 9.0, most: 11.0 });
        evidence.level.data_mut()[10 * 20 + 10] = SensorVarianceRange { least: 5.0, most: 500.0 };
        assert!((noise(&evidence).at(8, 11).variance - 16.0).abs() < 1e-5);
    }

    #[test]
    fn unknown_pixels_are_excluded() {
        let mut evidence = flat(9, 9, |x, _| if x % 2 == 0 { f32::INFINITY } else { 0.5 });
        assert!(noise(&evidence).data().iter().all(|n| n.variance == 8.0));
        evidence.variance = Plane::new(9, 9, f32::INFINITY);
        assert!(noise(&evidence).data().iter().all(|n| *n == PixelNoise::UNKNOWN));
        assert!(noise(&flat(0, 0, |_, _| 0.0)).data().is_empty());
    }
}
