//! Numbers, times and names as text in reports.

/// Three significant digits, with a power of ten below 0.0001 and from 100 000. A dash for a number that is not finite.
pub fn rounded(v: f64) -> String {
    with_decimals(v, 2)
}

/// A forecast: two significant digits, as [`rounded`].
pub fn coarse(v: f64) -> String {
    let unit = 10f64.powi(magnitude(v) - 1);
    with_decimals((v / unit).round() * unit, 1)
}

fn magnitude(v: f64) -> i32 {
    if v == 0.0 { 0 } else { v.abs().log10().floor() as i32 }
}

/// A number with so many decimals behind its first digit.
fn with_decimals(v: f64, decimals: i32) -> String {
    if !v.is_finite() {
        return "-".into();
    }
    let digits = magnitude(v);
    match digits {
        ..-4 | 5.. => format!("{:.*}\u{b7}{}", decimals as usize, v / 10f64.powi(digits), power_of_ten(digits)),
        _ => format!("{v:.*}", (decimals - digits).max(0) as usize),
    }
}

/// A time \[s\] with three digits, in the unit that suits it: seconds to years.
pub fn duration(seconds: f64) -> String {
    in_unit(seconds, rounded)
}

/// A forecast of a time \[s\] with two digits, as [`duration`].
pub fn coarse_duration(seconds: f64) -> String {
    in_unit(seconds, coarse)
}

fn in_unit(seconds: f64, digits: fn(f64) -> String) -> String {
    let units = [("years", 31_557_600.0), ("days", 86_400.0), ("h", 3600.0), ("min", 60.0)];
    match units.into_iter().find(|(_, size)| seconds >= 2.0 * size) {
        Some((name, size)) => format!("{} {name}", digits(seconds / size)),
        None => format!("{} s", digits(seconds)),
    }
}

/// A number of bytes with three digits, in the unit that suits it. A kilobyte has 1000 bytes.
pub fn bytes(n: f64) -> String {
    let units = [("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)];
    match units.into_iter().find(|(_, size)| n >= *size) {
        Some((name, size)) => format!("{} {name}", rounded(n / size)),
        None => format!("{n:.0} B"),
    }
}

/// A share of one in percent, a dash if it is not finite. Shares that are not exactly zero or one do not become 0 % or
/// 100 %.
pub fn percent(share: f64) -> String {
    let v = 100.0 * share;
    match v {
        _ if !v.is_finite() => "-".into(),
        _ if v > 0.0 && v < 0.1 => "< 0.1 %".into(),
        _ if v < 100.0 && v > 99.9 => "> 99.9 %".into(),
        _ if v == 0.0 || v == 100.0 || (9.5..99.0).contains(&v) => format!("{v:.0} %"),
        _ => format!("{v:.1} %"),
    }
}

/// A number of things, in the singular or the plural.
pub fn counted(n: u64, thing: &str) -> String {
    if n == 1 { format!("1 {thing}") } else { format!("{n} {thing}s") }
}

/// A number with as many digits as it needs, at most six after the point; with a power of ten and two digits if its
/// magnitude is below 0.001 or from 10 000.
pub fn label(v: f64) -> String {
    if v == 0.0 || (1e-3..1e4).contains(&v.abs()) {
        // The digits of the value, without the rounding error of its last bits.
        let text = format!("{v:.6}");
        return text.trim_end_matches('0').trim_end_matches('.').to_string();
    }
    let power = v.abs().log10().floor() as i32;
    let factor = v / 10f64.powi(power);
    let factor = format!("{factor:.1}");
    match factor.trim_end_matches(".0") {
        "1" => power_of_ten(power),
        factor => format!("{factor}\u{b7}{}", power_of_ten(power)),
    }
}

/// A power of ten with its exponent in raised digits.
pub fn power_of_ten(power: i32) -> String {
    let raised = |c| match c {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        c => char::from_u32(0x2070 + c.to_digit(10).unwrap_or(0)).unwrap_or(c),
    };
    format!("10{}", power.to_string().chars().map(raised).collect::<String>())
}

/// A text with at most `longest` characters. An ellipsis replaces the rest.
pub fn shortened(text: &str, longest: usize) -> String {
    match text.char_indices().nth(longest) {
        None => text.into(),
        Some(_) => text.chars().take(longest.saturating_sub(1)).chain(['\u{2026}']).collect(),
    }
}
