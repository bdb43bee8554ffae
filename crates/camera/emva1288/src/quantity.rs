//! A result with all data that a report needs.

use serde::Serialize;

/// A measured number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantity {
    /// Symbol of the standard, in ASCII: `K`, `sigma_y^2`.
    pub symbol: &'static str,
    /// Name of the quantity, in words.
    pub name: &'static str,
    /// The estimate.
    pub value: f64,
    /// Its standard error: one standard deviation of the estimate over repetitions of the whole measurement.
    pub standard_error: f64,
    /// The unit of both.
    pub unit: &'static str,
    /// Section of the standard with the rule.
    pub section: &'static str,
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // The error determines the number of digits: the error itself has two.
        let digits = if self.standard_error > 0.0 && self.standard_error.is_finite() {
            (1.0 - self.standard_error.log10().floor()).clamp(0.0, 12.0) as usize
        } else {
            6
        };
        write!(f, "{} = {:.digits$} +- {:.digits$} {}", self.symbol, self.value, self.standard_error, self.unit)
    }
}
