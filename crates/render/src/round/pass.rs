//! Amount of work per pass of a round.

use dunkelfeld_sampling::mix64;

/// Time limit of a tile until it is added to the film [s]. Checkpoints contain only finished tiles, so this is their
/// delay.
const SECONDS: f64 = 0.5;
/// Samples of a pixel in the first pass, when their cost is unknown.
const FIRST: u32 = 16;

/// Maximum number of samples of a pixel in the next pass of a round. It depends on the clock. No bit of a result
/// depends on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stride(u32);

impl Default for Stride {
    fn default() -> Self {
        Self(FIRST)
    }
}

impl Stride {
    /// At least one.
    pub(crate) fn samples(self) -> u32 {
        self.0
    }

    /// Updates the cost from the seconds of the slowest tile of a pass.
    pub(crate) fn measured(&mut self, seconds: f64) {
        if seconds < 0.5 * SECONDS {
            self.0 = self.0.saturating_mul(2);
        } else if seconds > 2.0 * SECONDS {
            self.0 = (self.0 / 2).max(1);
        }
    }
}

/// The part of a round that one pass renders while its film is watched. It depends on the clock. No bit of a result depends
/// on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Portion {
    /// Maximum number of samples of a pixel.
    pub(crate) samples: u32,
    /// One in so many pixels gets samples.
    pub(crate) one_in: u32,
}

impl Portion {
    /// The first one: a coarse image.
    const FIRST: Self = Self { samples: 1, one_in: 16 };

    /// A pass of about `interval` seconds of an image with so many pixels, at a known number of samples per second.
    pub(crate) fn watched(interval: f64, pixels: u64, rate: Option<f64>) -> Self {
        let Some(rate) = rate else { return Self::FIRST };
        let spp = rate * interval / pixels.max(1) as f64;
        // `as` saturates.
        if spp >= 1.0 {
            Self { samples: spp as u32, one_in: 1 }
        } else {
            Self { samples: 1, one_in: spp.recip().ceil().clamp(1.0, 4096.0) as u32 }
        }
    }

    /// Limits the new samples of a round to those of a pass with this number.
    pub(crate) fn limit(self, increment: &mut [u32], pass: u64) {
        increment.iter_mut().for_each(|n| *n = (*n).min(self.samples));
        let one_in = u64::from(self.one_in);
        if one_in <= 1 {
            return;
        }
        let is_in = |pixel: u64| mix64(pixel) % one_in == pass % one_in;
        let has_samples = (0..).zip(&*increment).any(|(pixel, &n)| n > 0 && is_in(pixel));
        if has_samples {
            (0..).zip(increment).filter(|(pixel, _)| !is_in(*pixel)).for_each(|(_, n)| *n = 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Passes of any portion take all samples of a round, and the first one a sixteenth.
    #[test]
    fn portions_take_all_samples() {
        assert_eq!(Portion::watched(0.5, 1 << 20, None), Portion::FIRST);
        assert_eq!(Portion::watched(0.5, 1000, Some(64_000.0)), Portion { samples: 32, one_in: 1 });
        assert_eq!(Portion::watched(0.5, 1000, Some(500.0)), Portion { samples: 1, one_in: 4 });
        for portion in [Portion::FIRST, Portion { samples: 3, one_in: 1 }, Portion { samples: 1, one_in: 4096 }] {
            let mut left: Vec<u32> = (0..1000).map(|pixel| pixel % 9).collect();
            let mut pass = 0;
            while left.iter().any(|&n| n > 0) {
                let mut increment = left.clone();
                portion.limit(&mut increment, pass);
                let taken: u32 = increment.iter().sum();
                assert!(taken > 0 && increment.iter().zip(&left).all(|(n, left)| n <= left));
                if pass == 0 && portion == Portion::FIRST {
                    assert!((30..100).contains(&taken), "{taken}");
                }
                left.iter_mut().zip(&increment).for_each(|(left, n)| *left -= n);
                pass += 1;
            }
        }
    }

    /// For any cost of a sample, the time of a tile soon approaches its limit. Where a single sample takes longer, a
    /// pass has one.
    #[test]
    fn the_duration_of_passes_approaches_its_limit() {
        for (seconds_per_sample, least, most) in
            [(1e-7, 2.0e6, 1.1e7), (1e-3, 250.0, 1000.0), (0.04, 6.0, 25.0), (3.0, 1.0, 1.0)]
        {
            let mut stride = Stride::default();
            for _ in 0..40 {
                stride.measured(f64::from(stride.samples()) * seconds_per_sample);
            }
            let samples = f64::from(stride.samples());
            assert!((least..=most).contains(&samples), "{samples} of {seconds_per_sample} s");
        }
        let mut stride = Stride::default();
        (0..100).for_each(|_| stride.measured(0.0));
        assert_eq!(stride.samples(), u32::MAX);
    }
}
