//! Mean and variance in one pass.

/// Count, mean and spread of a sample, updated value by value (Welford 1962).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleMoments {
    count: u64,
    mean: f64,
    sum_of_squares: f64,
}

impl SampleMoments {
    /// Takes in one value.
    pub fn push(&mut self, x: f64) {
        self.count += 1;
        let delta = x - self.mean;
        self.mean += delta / self.count as f64;
        self.sum_of_squares += delta * (x - self.mean);
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Arithmetic mean, zero for no values.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Unbiased variance of the values; NaN for fewer than two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { f64::NAN } else { self.sum_of_squares / (self.count - 1) as f64 }
    }

    /// Standard error of the mean; NaN for fewer than two values.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.count as f64).sqrt()
    }
}

impl FromIterator<f64> for SampleMoments {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut moments = Self::default();
        values.into_iter().for_each(|x| moments.push(x));
        moments
    }
}
