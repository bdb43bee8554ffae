//! Numbers and times as text in reports.

use super::chart::power_of_ten;

/// Three significant digits, as text.
pub(crate) fn rounded(v: f64) -> String {
    if !v.is_finite() {
        return "-".into();
    }
    let digits = if v == 0.0 { 0 } else { v.abs().log10().floor() as i32 };
    match digits {
        ..-4 | 5.. => format!("{:.2}\u{b7}{}", v / 10f64.powi(digits), power_of_ten(digits)),
        _ => format!("{v:.*}", (2 - digits).max(0) as usize),
    }
}

/// A time with two or three digits, in the unit that suits it.
pub(crate) fn duration(seconds: f64) -> String {
    let units = [("years", 31_557_600.0), ("days", 86_400.0), ("h", 3600.0), ("min", 60.0)];
    match units.into_iter().find(|(_, size)| seconds >= 2.0 * size) {
        Some((name, size)) => format!("{} {name}", rounded(seconds / size)),
        None => format!("{} s", rounded(seconds)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_times_keep_three_digits() {
        let shown = [0.0, 1.0, 12.345, 999.6, 12_345.0, -0.001_234].map(rounded);
        assert_eq!(shown, ["0.00", "1.00", "12.3", "1000", "12345", "-0.00123"]);
        assert_eq!(
            [6.69e7, 1e-5, f64::NAN].map(rounded),
            ["6.69\u{b7}10\u{2077}", "1.00\u{b7}10\u{207b}\u{2075}", "-"]
        );
        let times = [0.5, 119.0, 600.0, 36_000.0, 1.07e7, 1e10].map(duration);
        assert_eq!(times, ["0.500 s", "119 s", "10.0 min", "10.0 h", "124 days", "317 years"]);
    }
}
