//! Numbers with units as text: `5ms`, `2min 30s`, `12mm`, `30deg`, `1.5W`, `0.5/mm`, `6GB`.
//!
//! Job files, sensor files and command-line flags share these types. Values are stored in SI units. A time, a length or
//! a power may also be a plain number in seconds, metres or watts. An angle needs its unit, because both degrees and
//! radians are common. An amount of memory needs its unit, because plain bytes are unusual.

use std::fmt;
use std::str::FromStr;

use dunkelfeld_radiometry::Number;
use serde::Deserialize;
use serde::de::{self, Deserializer, Visitor};

/// A unit: the ways to write it, and its size in SI.
type Unit = (&'static [&'static str], f64);

const DECIBELS: &[Unit] = &[(&["dB"], 1.0)];
const TIME: &[Unit] = &[
    (&["ns"], 1e-9),
    (&["us", "µs", "μs"], 1e-6),
    (&["ms"], 1e-3),
    (&["s", "sec"], 1.0),
    (&["min"], 60.0),
    (&["h"], 3600.0),
];
const LENGTH: &[Unit] =
    &[(&["nm"], 1e-9), (&["um", "µm", "μm"], 1e-6), (&["mm"], 1e-3), (&["cm"], 1e-2), (&["m"], 1.0), (&["km"], 1e3)];
const ANGLE: &[Unit] =
    &[(&["deg", "°"], std::f64::consts::PI / 180.0), (&["rad"], 1.0), (&["turn"], std::f64::consts::TAU)];
const PER_LENGTH: &[Unit] =
    &[(&["/um", "/µm", "/μm"], 1e6), (&["/mm"], 1e3), (&["/cm"], 1e2), (&["/m"], 1.0), (&["/km"], 1e-3)];
const POWER: &[Unit] = &[(&["uW", "µW", "μW"], 1e-6), (&["mW"], 1e-3), (&["W"], 1.0), (&["kW"], 1e3)];
const SPEED: &[Unit] = &[
    (&["um/s", "µm/s", "μm/s"], 1e-6),
    (&["mm/s"], 1e-3),
    (&["cm/s"], 1e-2),
    (&["m/s"], 1.0),
    (&["km/s"], 1e3),
    (&["mm/min"], 1e-3 / 60.0),
    (&["m/min"], 1.0 / 60.0),
    (&["km/h"], 1.0 / 3.6),
];
const ANGULAR_SPEED: &[Unit] = &[
    (&["deg/s", "°/s"], std::f64::consts::PI / 180.0),
    (&["rad/s"], 1.0),
    (&["turn/s"], std::f64::consts::TAU),
    (&["rpm", "turn/min"], std::f64::consts::TAU / 60.0),
];
const FREQUENCY: &[Unit] = &[(&["Hz"], 1.0), (&["kHz"], 1e3), (&["MHz"], 1e6)];
const MEMORY: &[Unit] = &[
    (&["B"], 1.0),
    (&["kB"], 1e3),
    (&["MB"], 1e6),
    (&["GB"], 1e9),
    (&["TB"], 1e12),
    (&["KiB"], 1024.0),
    (&["MiB"], 1_048_576.0),
    (&["GiB"], 1_073_741_824.0),
    (&["TiB"], 1_099_511_627_776.0),
];

const KINDS: [&[Unit]; 10] =
    [DECIBELS, TIME, LENGTH, ANGLE, PER_LENGTH, POWER, SPEED, ANGULAR_SPEED, FREQUENCY, MEMORY];

/// A number in one unit as the number in another one; `None` if the units are not known or not of one kind. A ratio of units
/// that is a whole number is exact: 1 mm are 1000 um.
pub fn converted(number: f64, from: &str, to: &str) -> Option<f64> {
    let size = |units: &[Unit], unit: &str| Some(units.iter().find(|(names, _)| names.contains(&unit))?.1);
    let (from, to) = KINDS.iter().find_map(|units| Some((size(units, from)?, size(units, to)?)))?;
    let ratio = from.max(to) / from.min(to);
    let ratio = if (ratio - ratio.round()).abs() < 1e-9 * ratio { ratio.round() } else { ratio };
    Some(if from > to { number * ratio } else { number / ratio }).filter(|number| number.is_finite())
}

/// The number at the start of a text with the unit behind it, which may be empty or unknown: `2.5` and `mm` of `"2.5mm"`.
/// `None` for a text that does not begin with a finite number.
pub fn number_and_unit(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    let sign = usize::from(text.starts_with(['+', '-']));
    let (number, unit) = text.split_at(sign + number_length(&text[sign..]));
    let number = number.parse().ok().filter(|number: &f64| number.is_finite())?;
    Some((number, unit.trim()))
}

/// A quantity that cannot be read. The message contains the problem and the correct form.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct QuantityError(String);

/// A kind of quantities: its units, its name, an example, and whether a plain number is valid.
struct Kind {
    units: &'static [Unit],
    what: &'static str,
    example: &'static str,
    plain: bool,
}

impl Visitor<'_> for Kind {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} such as \"{}\"", self.what, self.example)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<f64, E> {
        self.parse(text).map_err(E::custom)
    }

    fn visit_f64<E: de::Error>(self, v: f64) -> Result<f64, E> {
        if self.plain {
            return Ok(v);
        }
        Err(E::custom(format!("{} lacks a unit; write {} as \"{}\"", Number(v), self.what, self.example)))
    }

    fn visit_i64<E: de::Error>(self, v: i64) -> Result<f64, E> {
        self.visit_f64(v as f64)
    }
}

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $units:expr, $what:literal, $si:literal, $example:literal, plain: $plain:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Default)]
        pub struct $name(pub f64);

        impl $name {
            const KIND: Kind = Kind { units: $units, what: $what, example: $example, plain: $plain };
        }

        impl FromStr for $name {
            type Err = QuantityError;

            fn from_str(text: &str) -> Result<Self, QuantityError> {
                Self::KIND.parse(text).map(Self)
            }
        }

        impl From<$name> for f64 {
            fn from(q: $name) -> f64 {
                q.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{} {}", Number(self.0), $si)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(Self::KIND).map(Self)
            }
        }
    };
}

quantity!(
    /// A level \[dB\]; never a plain number.
    Decibels, DECIBELS, "decibels", "dB", "6dB", plain: false
);
quantity!(
    /// A time \[s\]: `ns`, `us`, `ms`, `s`, `min`, `h`, also several in a row (`1min 30s`), or a plain number of seconds.
    Time, TIME, "a time", "s", "5ms", plain: true
);
quantity!(
    /// A length \[m\]: `nm`, `um`, `mm`, `cm`, `m`, `km`, or a plain number of metres.
    Length, LENGTH, "a length", "m", "12mm", plain: true
);
quantity!(
    /// An angle \[rad\]: `deg`, `rad` or `turn`; never a plain number.
    Angle, ANGLE, "an angle", "rad", "30deg", plain: false
);
quantity!(
    /// A coefficient of attenuation [1/m]: `/um`, `/mm`, `/cm`, `/m`, `/km`, or a plain number per metre.
    PerLength, PER_LENGTH, "a coefficient", "/m", "0.5/mm", plain: true
);
quantity!(
    /// A power \[W\]: `uW`, `mW`, `W`, `kW`, or a plain number of watts.
    Power, POWER, "a power", "W", "1.5W", plain: true
);
quantity!(
    /// A speed \[m/s\]: `um/s`, `mm/s`, `cm/s`, `m/s`, `km/s`, `mm/min`, `m/min`, `km/h`, or a plain number of m/s.
    Speed, SPEED, "a speed", "m/s", "200mm/s", plain: true
);
quantity!(
    /// An angular speed \[rad/s\]: `deg/s`, `rad/s`, `turn/s` or `rpm`; never a plain number.
    AngularSpeed, ANGULAR_SPEED, "an angular speed", "rad/s", "120rpm", plain: false
);
quantity!(
    /// A frequency \[Hz\]: `Hz`, `kHz`, `MHz`, or a plain number of hertz.
    Frequency, FREQUENCY, "a frequency", "Hz", "10kHz", plain: true
);
quantity!(
    /// An amount of memory \[B\]: `B`, `kB`, `MB`, `GB`, `TB`, `KiB`, `MiB`, `GiB`, `TiB`; never a plain number.
    Memory, MEMORY, "an amount of memory", "B", "2GiB", plain: false
);

/// A factor of amplitudes: a plain number, or decibels. 6 dB are 10^(6/20).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factor(pub f64);

impl From<Factor> for f64 {
    fn from(Factor(factor): Factor) -> Self {
        factor
    }
}

impl<'de> Deserialize<'de> for Factor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "this is no factor; write a number such as 2, or decibels as \"6dB\"")]
        enum Written {
            Plain(f64),
            Decibels(Decibels),
        }
        Ok(Self(match Written::deserialize(deserializer)? {
            Written::Plain(factor) => factor,
            Written::Decibels(Decibels(level)) => 10f64.powf(level / 20.0),
        }))
    }
}

impl Memory {
    /// As a whole number of bytes; `None` below one and out of range.
    pub fn whole(self) -> Option<u64> {
        (self.0 >= 1.0 && self.0 < 1.8e19).then_some(self.0 as u64)
    }
}

impl Kind {
    /// Sums the `number unit` pairs of `text`; one sign in front counts for all.
    fn parse(&self, text: &str) -> Result<f64, QuantityError> {
        let fail =
            |problem: String| Err(QuantityError(format!("{problem}; write {} as \"{}\"", self.what, self.example)));
        let trimmed = text.trim();
        let (sign, body) = match trimmed.strip_prefix('-') {
            Some(rest) => (-1.0, rest),
            None => (1.0, trimmed.strip_prefix('+').unwrap_or(trimmed)),
        };
        let mut rest = body.trim_start();
        if rest.is_empty() {
            return fail(format!("\"{text}\" holds no number"));
        }
        let known = || self.units.iter().map(|(names, _)| names[0]).collect::<Vec<_>>().join(", ");
        let mut total = 0.0;
        let mut parts = 0;
        while !rest.is_empty() {
            let (number, tail) = rest.split_at(number_length(rest));
            let Ok(value) = number.parse::<f64>() else {
                return fail(format!("\"{rest}\" does not begin with a number"));
            };
            let tail = tail.trim_start();
            let unit_length = tail.find(|c: char| c.is_whitespace() || c.is_ascii_digit()).unwrap_or(tail.len());
            let (unit, tail) = tail.split_at(unit_length);
            rest = tail.trim_start();
            let size = match self.units.iter().find(|(names, _)| names.contains(&unit)) {
                Some((_, size)) => *size,
                None if unit.is_empty() && self.plain && parts == 0 && rest.is_empty() => 1.0,
                None if unit.is_empty() => return fail(format!("\"{text}\" lacks a unit ({})", known())),
                None => return fail(format!("unknown unit \"{unit}\" (known: {})", known())),
            };
            total += value * size;
            parts += 1;
        }
        Ok(sign * total)
    }
}

/// Length of the decimal number at the start of `text`. An `e` belongs to it only if an exponent follows.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes.iter().skip(from).take_while(|b| b.is_ascii_digit()).count();
    let mut length = digits(0);
    if bytes.get(length) == Some(&b'.') {
        length += 1 + digits(length + 1);
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        let exponent = digits(length + 1 + sign);
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_read_as_written() {
        for (text, seconds) in [
            ("5ms", 5e-3),
            ("20s", 20.0),
            ("2min", 120.0),
            ("1h 2min 3.5s", 3723.5),
            ("1min30s", 90.0),
            (" 12 µs ", 12e-6),
            ("3", 3.0),
            ("1e-3 s", 1e-3),
            ("2.5e2ms", 0.25),
            (".5s", 0.5),
            ("-4ms", -4e-3),
        ] {
            let Time(value) = text.parse().expect(text);
            assert!((value - seconds).abs() <= 1e-12 * seconds.abs(), "{text} read as {value}");
        }
        assert!((f64::from("90deg".parse::<Angle>().expect("an angle")) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert_eq!("550nm".parse::<Length>().expect("a length").0, 550.0 * 1e-9);
        assert_eq!("0.5/mm".parse::<PerLength>().expect("a coefficient").0, 500.0);
        assert_eq!("20 /cm".parse::<PerLength>().expect("a coefficient").0, 2000.0);
        assert_eq!("1.5GiB".parse::<Memory>().expect("an amount").0, 1.5 * (1u64 << 30) as f64);
        assert_eq!("512MiB".parse::<Memory>().expect("an amount").whole(), Some(512 << 20));
        assert_eq!("1.5 GB".parse::<Memory>().expect("an amount").whole(), Some(1_500_000_000));
        for size in ["0GB", "-6GB", "0.5B", "1e300GB"] {
            assert_eq!(size.parse::<Memory>().expect("an amount").whole(), None, "{size}");
        }
        assert!("6".parse::<Memory>().expect_err("no unit").to_string().contains("lacks a unit"));
        assert_eq!("1.5kW".parse::<Power>().expect("a power").0, 1500.0);
    }

    #[test]
    fn numbers_are_separated_from_units_and_converted() {
        for (text, number, unit) in [
            ("2.5mm", 2.5, "mm"),
            ("-1e-3 deg", -1e-3, "deg"),
            ("3e2W", 300.0, "W"),
            ("5e", 5.0, "e"),
            ("7", 7.0, ""),
            ("0.5/mm", 0.5, "/mm"),
            ("1.2.3", 1.2, ".3"),
        ] {
            assert_eq!(number_and_unit(text), Some((number, unit)), "{text}");
        }
        for text in ["", "mm", "inf", "NaN", "--1", "1e999", "steel 3"] {
            assert_eq!(number_and_unit(text), None, "{text}");
        }
        for (number, from, to, expected) in [
            (0.3, "mm", "um", Some(300.0)),
            (50.0, "um", "mm", Some(0.05)),
            (30.0, "\u{b5}s", "ms", Some(0.03)),
            (90.0, "deg", "turn", Some(0.25)),
            (1e308, "mm", "nm", None),
            (1.0, "mm", "ms", None),
            (1.0, "", "mm", None),
        ] {
            assert_eq!(converted(number, from, to), expected, "{number} {from} {to}");
        }
    }

    #[test]
    fn bad_quantities_are_refused_with_a_reason() {
        for (text, part) in [
            ("", "no number"),
            ("-", "no number"),
            ("ms", "does not begin with a number"),
            ("5 parsecs", "unknown unit \"parsecs\""),
            ("5ms 3", "lacks a unit"),
            ("5 3", "lacks a unit"),
            ("nan", "does not begin with a number"),
            ("1.2.3s", "unknown unit \".\""),
        ] {
            let error = text.parse::<Time>().expect_err(text).to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let error = "30".parse::<Angle>().expect_err("no unit").to_string();
        assert!(error.contains("lacks a unit (deg, rad, turn)"), "{error}");
    }
}
