//! The shares of the pixels of a film that are hidden, at all levels of the target.

use dunkelfeld::Certified;

/// The range of the target k.
pub(crate) const TARGETS: std::ops::RangeInclusive<f64> = 0.05..=4.0;
/// Levels of a table. Each is 1.7 % above the one before.
const LEVELS: usize = 256;

/// The shares at 256 levels in equal ratios from the smallest to the largest target.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct HiddenShares(Vec<f32>);

/// A level of the table.
fn level(i: usize) -> f64 {
    TARGETS.start() * (TARGETS.end() / TARGETS.start()).powf(i as f64 / (LEVELS - 1) as f64)
}

impl HiddenShares {
    /// The shares of the pixels that a certificate counts; 1 if it counts none.
    pub(crate) fn new(certified: &Certified) -> Self {
        Self::of_ratios(certified.counted())
    }

    /// The shares of pixels with these ratios of variances.
    fn of_ratios(ratios: impl Iterator<Item = f32>) -> Self {
        let limits: Vec<f64> = (0..LEVELS).map(|i| level(i).powi(2)).collect();
        // Pixels by the first level at which they are hidden.
        let mut counts = [0u64; LEVELS + 1];
        let mut all = 0u64;
        for ratio in ratios {
            counts[limits.partition_point(|limit| *limit < f64::from(ratio))] += 1;
            all += 1;
        }
        let share = |sum: u64| if all == 0 { 1.0 } else { (sum as f64 / all as f64) as f32 };
        let sums = counts[..LEVELS].iter().scan(0, |sum, n| {
            *sum += n;
            Some(share(*sum))
        });
        Self(sums.collect())
    }

    /// The share at a level of [`TARGETS`], between two levels of the table by linear interpolation over log k.
    pub(crate) fn at(&self, k: f64) -> f64 {
        let place = (k / TARGETS.start()).ln() / (TARGETS.end() / TARGETS.start()).ln() * (LEVELS - 1) as f64;
        let place = place.clamp(0.0, (LEVELS - 1) as f64);
        let share = |i: usize| self.0.get(i).map_or(1.0, |&share| f64::from(share));
        let (below, part) = (place as usize, place.fract());
        share(below) + part * (share((below + 1).min(LEVELS - 1)) - share(below))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels with k evenly from 0 to 2: the share at k is k / 2, up to one pixel and the rounding of f32.
    #[test]
    fn shares_are_those_of_the_distribution() {
        let n = 20_000;
        let shares = HiddenShares::of_ratios((0..n).map(|i| (2.0 * (i as f32 + 0.5) / n as f32).powi(2)));
        for k in [0.05, 0.0733, 0.3, 0.5, 0.999, 1.7, 1.9] {
            // Linear over log k instead of k: an eighth of the square of the step of 1.7 %.
            assert!((shares.at(k) - 0.5 * k).abs() < 1e-4 + 4e-5 * k, "{k}: {}", shares.at(k));
        }
        assert_eq!(shares.at(2.5), 1.0);
        // At each level of the table a pixel exactly on the limit is hidden, as in the certificate.
        for i in [0, 17, 255] {
            let limit = level(i).powi(2) as f32;
            let below = f64::from(limit) <= level(i).powi(2);
            let own = HiddenShares::of_ratios([limit, f32::INFINITY].into_iter());
            assert_eq!(own.0[i], if below { 0.5 } else { 0.0 }, "{i}");
        }
    }

    #[test]
    fn unknown_pixels_are_not_hidden_and_no_pixels_are() {
        assert_eq!(HiddenShares::of_ratios([f32::INFINITY; 3].into_iter()).at(4.0), 0.0);
        assert_eq!(HiddenShares::of_ratios(std::iter::empty()).at(0.3), 1.0);
        assert_eq!(HiddenShares::of_ratios([0.0; 3].into_iter()).at(0.05), 1.0);
    }
}
