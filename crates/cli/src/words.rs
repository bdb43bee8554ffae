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

/// An expected time: only digits within its accuracy.
pub(crate) fn remaining(s: f64) -> String {
    match s.max(0.0).round() as u64 {
        s if s < 120 => format!("{s} s"),
        s if s < 7200 => format!("{} min {:02} s", s / 60, s % 60),
        s => format!("{} h {:02} min", s / 3600, s / 60 % 60),
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
    fn exposure_times_have_their_unit() {
        for (s, words) in [(5e-3, "5.000 ms"), (1.234_56e-4, "123.46 us"), (2.0, "2.000 s")] {
            assert_eq!(exposure_time(s), words);
        }
    }

    #[test]
    fn times_keep_the_digits_that_matter() {
        assert_eq!(seconds(20.44), "20.4 s");
        assert_eq!(seconds(119.96), "120.0 s");
        assert_eq!(seconds(725.0), "12 min 05 s");
        assert_eq!(remaining(0.4), "0 s");
        assert_eq!(remaining(119.6), "2 min 00 s");
        assert_eq!(remaining(9000.0), "2 h 30 min");
        assert_eq!(remaining(-1.0), "0 s");
    }

    #[test]
    fn counts_are_rounded_to_three_digits_or_so() {
        assert_eq!(
            [count(9_999), count(12_345), count(3_640_000), count(7_200_000_000)],
            ["9999", "12.3 k", "3.6 M", "7.2 G"]
        );
    }

    #[test]
    fn a_shell_reads_back_what_was_written() {
        assert_eq!(shell(["render", "a b.glb", "it's", ""]), r"render 'a b.glb' 'it'\''s' ''");
    }
}
