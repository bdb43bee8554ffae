//! Numbers in messages.

use std::fmt;

/// A number for messages: all of its digits, and a power of ten where there would be many zeros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number(pub f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(v) = self;
        let is_plain = *v == 0.0 || !v.is_finite() || (1e-6..1e16).contains(&v.abs());
        if is_plain { write!(f, "{v}") } else { write!(f, "{v:e}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extreme_numbers_are_short_and_usual_ones_are_plain() {
        let shown = [0.0, 1.5, -0.001, 512.0, 1e15, 1e-308, -2.5e-7, 1e300, f64::NAN, f64::INFINITY];
        let shown = shown.map(|v| Number(v).to_string());
        assert_eq!(
            shown,
            ["0", "1.5", "-0.001", "512", "1000000000000000", "1e-308", "-2.5e-7", "1e300", "NaN", "inf"]
        );
        assert!([f64::MIN_POSITIVE, f64::MAX, 5e-324].iter().all(|v| Number(*v).to_string().len() < 25));
    }
}
