//! A number with its standard error.

use serde::Serialize;

/// A number with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Estimate {
    /// The number.
    pub(crate) value: f64,
    /// One standard error. NaN where it is unknown.
    pub(crate) error: f64,
}

impl Estimate {
    /// An unknown value.
    pub(crate) const NONE: Self = Self { value: f64::NAN, error: f64::NAN };

    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self { value: self.value * factor, error: self.error * factor.abs() }
    }

    /// The product of two independent estimates, errors to first order.
    pub(crate) fn times(self, other: Self) -> Self {
        let error = (self.value * other.error).hypot(other.value * self.error);
        Self { value: self.value * other.value, error }
    }
}

/// Mean and standard error of independent numbers.
pub(crate) fn mean(values: &[f64]) -> Estimate {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (n - 1.0);
    Estimate { value, error: (variance / n).sqrt() }
}
