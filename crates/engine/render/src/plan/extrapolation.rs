//! The trend of the estimated samples until an image is hidden, over the samples that it has.
//!
//! Rare light that a pixel has sampled once is distributed over the pixels around it that may receive it
//! ([`dunkelfeld_adaptive::variance::pixel`]). So with few samples, more pixels are estimated as noisy than are in
//! truth. Quasi-random samples of smooth light converge faster than independent ones. For both reasons the estimate of
//! the required samples decreases with each doubling, N(n) ~ n^-a. The final number is the fixed point of this law: N*
//! = (N n^a)^(1 / (1 + a)).

use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

/// Stored estimates: two doublings, if each follows one.
const ESTIMATES: usize = 3;
/// With fewer samples per pixel the first estimates are dominated by their own error.
const MIN_SPP: f64 = 8.0;
/// The part of the slope over these estimates that is extrapolated. With more, forecasts were further below the samples
/// taken.
const SLOPE_DAMPING: f64 = 0.75;
/// The slope of a pilot with one estimate: the mean of the shipped scenes.
const DEFAULT_SLOPE: f64 = 1.0 / 3.0;
/// Upper bound of the slope: with twice the samples, half of the estimate.
const MAX_SLOPE: f64 = 1.0;

/// The estimates of the required samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ConvergenceFit {
    /// Samples per pixel: taken, and required. The last estimate is first. Zero means no estimate.
    looks: [(f64, f64); ESTIMATES],
}

impl ConvergenceFit {
    /// Stores an estimate at `spp` samples per pixel of the required number `needed`. One without a result is not
    /// stored.
    pub(crate) fn note(&mut self, spp: f64, needed: f64) {
        if spp >= MIN_SPP && spp > self.looks[0].0 && needed > 0.0 && needed.is_finite() {
            self.looks.rotate_right(1);
            self.looks[0] = (spp, needed);
        }
    }

    /// The extrapolated slope a, at least zero.
    fn slope(&self) -> f64 {
        let first = self.looks.iter().rev().find(|estimate| estimate.0 > 0.0);
        let (last, first) = (self.looks[0], first.copied().unwrap_or_default());
        if last.0 <= first.0 {
            return DEFAULT_SLOPE;
        }
        let slope = (first.1 / last.1).ln() / (last.0 / first.0).ln();
        (SLOPE_DAMPING * slope).clamp(0.0, MAX_SLOPE)
    }

    /// Required samples per pixel if the estimate at `counts` is `targets`, and the trend continues. Unknown values
    /// stay unchanged.
    pub(crate) fn extrapolate(&self, mut targets: Plane<f32>, counts: &Plane<u32>) -> Plane<f32> {
        let pixels = targets.data().len().max(1) as f64;
        let needed = targets.data().iter().map(|&n| f64::from(n)).sum::<f64>() / pixels;
        let taken = counts.data().iter().map(|&n| f64::from(n)).sum::<f64>() / pixels;
        if !(needed > taken && taken > 0.0 && needed.is_finite()) {
            return targets;
        }
        let a = self.slope();
        let factor = ((needed * taken.powf(a)).powf(1.0 / (1.0 + a)) / needed) as f32;
        targets.data_mut().iter_mut().zip(counts.data()).for_each(|(n, &c)| *n = (factor * *n).max(c as f32));
        targets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(estimates: &[(f64, f64)]) -> ConvergenceFit {
        let mut trend = ConvergenceFit::default();
        estimates.iter().for_each(|&(spp, needed)| trend.note(spp, needed));
        trend
    }

    fn extrapolated_at(trend: &ConvergenceFit, spp: u32, needed: f32) -> f32 {
        trend.extrapolate(Plane::new(3, 2, needed), &Plane::new(3, 2, spp)).data()[4]
    }

    #[test]
    fn constant_and_rising_trends_are_not_extrapolated() {
        for needed in [[800.0; 3], [500.0, 600.0, 800.0]] {
            let estimates: Vec<_> = [8.0, 16.0, 32.0].into_iter().zip(needed).collect();
            assert_eq!(extrapolated_at(&after(&estimates), 32, 800.0), 800.0);
        }
    }

    #[test]
    fn a_falling_trend_is_extrapolated_to_its_target() {
        // Halved by two doublings: a slope of a half, of which three quarters are extrapolated. Earlier estimates do
        // not count.
        let trend = after(&[(4.0, 9e9), (8.0, 5000.0), (16.0, 1600.0), (32.0, 1300.0), (64.0, 800.0)]);
        assert!((trend.slope() - 0.375).abs() < 1e-12, "{}", trend.slope());
        let n = f64::from(extrapolated_at(&trend, 64, 800.0));
        // At the fixed point the required number equals the number taken.
        assert!((800.0 * (64.0 / n).powf(0.375) / n - 1.0).abs() < 1e-5, "{n}");
        // A steep fall is bounded.
        assert_eq!(after(&[(8.0, 1e6), (16.0, 10.0)]).slope(), MAX_SLOPE);
    }

    #[test]
    fn a_single_check_uses_the_default_slope_and_unknown_pixels_are_unchanged() {
        let usual = extrapolated_at(&ConvergenceFit::default(), 16, 1600.0);
        assert!((f64::from(usual) / 1600.0 - (1.0f64 / 100.0).powf(0.25)).abs() < 1e-5, "{usual}");
        assert_eq!(after(&[(16.0, 1600.0)]), after(&[(16.0, 1600.0), (16.0, 90.0), (32.0, f64::INFINITY)]));
        assert_eq!(extrapolated_at(&ConvergenceFit::default(), 16, f32::INFINITY), f32::INFINITY);
        assert_eq!(extrapolated_at(&ConvergenceFit::default(), 64, 50.0), 50.0, "enough already");
    }
}
