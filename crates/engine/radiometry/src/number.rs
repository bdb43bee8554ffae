//! Numbers in messages.

use std::fmt;

/// A number for messages: a whole number with all of its digits, another one with nine significant digits, and a power of ten
/// where there would be many zeros. A value that was converted from another unit has rounding errors in its last digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number(pub f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(v) = self;
        let is_whole = v.fract() == 0.0 && v.abs() < 1e16;
        let v = if is_whole { *v } else { format!("{v:.8e}").parse().unwrap_or(*v) };
        let is_plain = v == 0.0 || !v.is_finite() || (1e-6..1e16).contains(&v.abs());
        if is_plain { write!(f, "{v}") } else { write!(f, "{v:e}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_errors_of_units_are_not_shown() {
        let shown = [
            100.000_000_000_000_01,
            0.020_000_000_000_000_004,
            0.000_009_999_999_999_999_999,
            1.047_197_551_196_597_7e39,
        ];
        assert_eq!(shown.map(|v| Number(v).to_string()), ["100", "0.02", "0.00001", "1.04719755e39"]);
        assert_eq!(Number(4_294_967_297.0).to_string(), "4294967297");
    }
}
