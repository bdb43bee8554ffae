//! Numbers and commands as text for users.

/// A time that was measured: tenths of a second up to ten minutes.
pub(crate) fn seconds(s: f64) -> String {
    match s {
        s if s < 600.0 => format!("{s:.1} s"),
        s => remaining(s),
    }
}

/// An exposure time in the unit that suits it.
pub(crate) fn exposure_time(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => format!("{:.2} us", s * 1e6),
        s if s < 1.0 => format!("{:.3} ms", s * 1e3),
        s => format!("{s:.3} s"),
    }
}

/// A number with three significant digits: `0.0123`, `4.50`, `123`, `45600`, and `1.23e-7` outside 0.001 to a million.
pub(crate) fn three_digits(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 || !magnitude.is_finite() {
        return format!("{value}");
    }
    // Rounded first: 0.9996 has the magnitude of 1.00.
    let rounded: f64 = format!("{magnitude:.2e}").parse().unwrap_or(magnitude);
    if !(1e-3..1e6).contains(&rounded) {
        return format!("{value:.2e}");
    }
    let digits = (2.0 - rounded.log10().floor()).max(0.0) as usize;
    format!("{value:.digits$}")
}

/// A radiant power with three significant digits, in the unit that suits it.
pub(crate) fn power(watts: f64) -> String {
    match watts.abs() {
        w if w >= 1.0 || w == 0.0 => format!("{} W", three_digits(watts)),
        w if w >= 1e-3 => format!("{} mW", three_digits(watts * 1e3)),
        w if w >= 1e-6 => format!("{} uW", three_digits(watts * 1e6)),
        _ => format!("{} W", three_digits(watts)),
    }
}

/// An expected time: only digits within its accuracy.
pub(crate) fn remaining(s: f64) -> String {
    match s.max(0.0).round() as u64 {
        s if s < 120 => format!("{s} s"),
        s if s < 7200 => format!("{} min {:02} s", s / 60, s % 60),
        s => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}

/// A forecast of a time: two significant digits, in the unit that suits it.
pub(crate) fn about(seconds: f64) -> String {
    let units = [("days", 86_400.0), ("h", 3600.0), ("min", 60.0)];
    let (name, size) = units.into_iter().find(|(_, size)| seconds >= 2.0 * size).unwrap_or(("s", 1.0));
    let value = seconds.max(0.0) / size;
    match value {
        v if v < 9.95 => format!("{v:.1} {name}"),
        v => {
            let unit = 10f64.powf(v.log10().floor() - 1.0).max(1.0);
            format!("{:.0} {name}", (v / unit).round() * unit)
        }
    }
}

/// A large number.
pub(crate) fn count(n: u64) -> String {
    match n as f64 {
        x if x < 1e4 => n.to_string(),
        x if x < 1e6 => format!("{:.1} k", x * 1e-3),
        x if x < 1e9 => format!("{:.1} M", x * 1e-6),
        x => format!("{:.1} G", x * 1e-9),
    }
}

/// A command line that a shell parses into these words.
pub(crate) fn shell<S: AsRef<str>>(words: impl IntoIterator<Item = S>) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    let quoted = words.into_iter().map(|word| match word.as_ref() {
        word if !word.is_empty() && word.chars().all(plain) => word.to_string(),
        word => format!("'{}'", word.replace('\'', r"'\''")),
    });
    quoted.collect::<Vec<_>>().join(" ")
}

/// A number of things: `1 object`, `2 objects`.
pub(crate) fn counted(n: u64, thing: &str) -> String {
    format!("{n} {thing}{}", if n == 1 { "" } else { "s" })
}

/// The line about pixels of a file with an invalid variance.
pub(crate) fn flagged_variances(pixels: u64) -> String {
    let pixels = counted(pixels, "pixel");
    format!("flagged: the variance of {pixels} is negative or not a number; the noise there counts as unknown")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_never_vanish_by_rounding() {
        for (value, words) in [
            (0.0, "0"),
            (0.012_345, "0.0123"),
            (0.000_999_6, "0.00100"),
            (0.9996, "1.00"),
            (4.5, "4.50"),
            (123.4, "123"),
            (45_678.0, "45678"),
            (1.234e-7, "1.23e-7"),
            (-2.5e9, "-2.50e9"),
        ] {
            assert_eq!(three_digits(value), words);
        }
        for (watts, words) in
            [(0.0, "0 W"), (12.0, "12.0 W"), (0.0123, "12.3 mW"), (4.56e-6, "4.56 uW"), (7.89e-9, "7.89e-9 W")]
        {
            assert_eq!(power(watts), words);
        }
    }

    #[test]
    fn a_shell_reads_back_what_was_written() {
        assert_eq!(shell(["render", "a b.glb", "it's", ""]), r"render 'a b.glb' 'it'\''s' ''");
    }
}
