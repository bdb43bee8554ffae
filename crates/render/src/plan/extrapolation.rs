//! How the samples that an image is said to take change with those that it has.
//!
//! What rare light a pixel has seen once is shared out among those around that may meet it ([`dunkelfeld_adaptive::variance::pixel`]), so that few samples say of
//! more pixels than in truth that they are noisy; and quasi-random samples of smooth light do the better the more there are. Both
//! make the samples that it takes until an image is hidden look fewer with each doubling, N(n) ~ n^-a. What it takes in the end is where that meets n:
//! N* = (N n^a)^(1 / (1 + a)).

use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

/// Looks that are remembered: two doublings, if each follows one.
const LOOKS: usize = 3;
/// With fewer samples per pixel the first looks see little but their own error.
const LEAST: f64 = 8.0;
/// The part of the slope over these looks that is believed to go on.
const SLOPE_DAMPING: f64 = 0.75;
/// The slope of a pilot that was looked at once.
const USUAL: f64 = 1.0 / 3.0;
/// No slope is believed to be steeper: twice the samples, half of what it was said to take.
const STEEPEST: f64 = 1.0;

/// What it was said to take, look by look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ConvergenceFit {
    /// Samples per pixel that there were, and that it takes, the last ones first; zeros where there was no look.
    looks: [(f64, f64); LOOKS],
}

impl ConvergenceFit {
    /// Remembers a look at `spp` samples per pixel that said it takes `needed`; one that could not say is none.
    pub(crate) fn note(&mut self, spp: f64, needed: f64) {
        if spp >= LEAST && spp > self.looks[0].0 && needed > 0.0 && needed.is_finite() {
            self.looks.rotate_right(1);
            self.looks[0] = (spp, needed);
        }
    }

    /// The slope a that is believed to go on, zero at least.
    fn slope(&self) -> f64 {
        let first = self.looks.iter().rev().find(|look| look.0 > 0.0);
        let (last, first) = (self.looks[0], first.copied().unwrap_or_default());
        if last.0 <= first.0 {
            return USUAL;
        }
        let slope = (first.1 / last.1).ln() / (last.0 / first.0).ln();
        (SLOPE_DAMPING * slope).clamp(0.0, STEEPEST)
    }

    /// Samples per pixel that an image takes if a look at `counts` says it takes `targets`, and the trend goes on. Nothing changes
    /// where these are not known.
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

    fn after(looks: &[(f64, f64)]) -> ConvergenceFit {
        let mut trend = ConvergenceFit::default();
        looks.iter().for_each(|&(spp, needed)| trend.note(spp, needed));
        trend
    }

    fn foretold(trend: &ConvergenceFit, spp: u32, needed: f32) -> f32 {
        trend.extrapolate(Plane::new(3, 2, needed), &Plane::new(3, 2, spp)).data()[4]
    }

    #[test]
    fn a_level_trend_changes_nothing_and_a_rising_one_neither() {
        for needed in [[800.0; 3], [500.0, 600.0, 800.0]] {
            let looks: Vec<_> = [8.0, 16.0, 32.0].into_iter().zip(needed).collect();
            assert_eq!(foretold(&after(&looks), 32, 800.0), 800.0);
        }
    }

    #[test]
    fn a_falling_trend_goes_on_until_it_is_met() {
        // Halved by two doublings: a slope of a half, of which three quarters go on. What came before does not count.
        let trend = after(&[(4.0, 9e9), (8.0, 5000.0), (16.0, 1600.0), (32.0, 1300.0), (64.0, 800.0)]);
        assert!((trend.slope() - 0.375).abs() < 1e-12, "{}", trend.slope());
        let n = f64::from(foretold(&trend, 64, 800.0));
        // There it takes as many as there are.
        assert!((800.0 * (64.0 / n).powf(0.375) / n - 1.0).abs() < 1e-5, "{n}");
        // A cliff is not believed.
        assert_eq!(after(&[(8.0, 1e6), (16.0, 10.0)]).slope(), STEEPEST);
    }

    #[test]
    fn a_single_look_is_followed_by_the_usual_slope_and_what_is_not_known_stays() {
        let usual = foretold(&ConvergenceFit::default(), 16, 1600.0);
        assert!((f64::from(usual) / 1600.0 - (1.0f64 / 100.0).powf(0.25)).abs() < 1e-5, "{usual}");
        assert_eq!(after(&[(16.0, 1600.0)]), after(&[(16.0, 1600.0), (16.0, 90.0), (32.0, f64::INFINITY)]));
        assert_eq!(foretold(&ConvergenceFit::default(), 16, f32::INFINITY), f32::INFINITY);
        assert_eq!(foretold(&ConvergenceFit::default(), 64, 50.0), 50.0, "enough already");
    }

    #[test]
    fn no_pixel_is_foretold_less_than_it_has() {
        let targets = Plane::from_vec(2, 1, vec![1000.0, 40.0]).expect("two");
        let counts = Plane::from_vec(2, 1, vec![10, 39]).expect("two");
        assert_eq!(ConvergenceFit::default().extrapolate(targets, &counts).data()[1], 39.0);
    }

    #[test]
    fn it_can_be_stored() {
        let trend = after(&[(8.0, 1600.0), (16.0, 1300.5)]);
        let text = serde_json::to_string(&trend).expect("numbers");
        assert_eq!(serde_json::from_str::<ConvergenceFit>(&text).expect("the same"), trend);
    }
}
