//! Amount of work per pass of a round.

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

#[cfg(test)]
mod tests {
    use super::*;

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
