//! Numbers with a unit in texts, such as `"2.5mm"`, for arithmetic with distributions.

use toml::Value;

/// A number with the unit that is written behind it; the unit may be empty.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Quantity {
    pub(crate) number: f64,
    /// As written: `"mm"`, `"deg"`, `"W"`, or empty for a plain number.
    pub(crate) unit: String,
}

/// Units with their kind and the power of ten or the number of the basic unit of that kind that they count.
const UNITS: [(&str, char, f64); 24] = [
    ("nm", 'l', 1.0),
    ("um", 'l', 1e3),
    ("mm", 'l', 1e6),
    ("cm", 'l', 1e7),
    ("m", 'l', 1e9),
    ("km", 'l', 1e12),
    ("ns", 't', 1.0),
    ("us", 't', 1e3),
    ("ms", 't', 1e6),
    ("s", 't', 1e9),
    ("min", 't', 60e9),
    ("h", 't', 3600e9),
    ("uW", 'p', 1.0),
    ("mW", 'p', 1e3),
    ("W", 'p', 1e6),
    ("kW", 'p', 1e9),
    ("Hz", 'f', 1.0),
    ("kHz", 'f', 1e3),
    ("MHz", 'f', 1e6),
    ("um/s", 'v', 1.0),
    ("mm/s", 'v', 1e3),
    ("cm/s", 'v', 1e4),
    ("m/s", 'v', 1e6),
    ("km/s", 'v', 1e9),
];

impl Quantity {
    /// The number of the quantity in another unit; `None` if the units are not of one kind. A plain zero has any unit.
    pub(crate) fn number_in(&self, unit: &str) -> Option<f64> {
        if self.unit == unit || (self.unit.is_empty() && self.number == 0.0) {
            return Some(self.number);
        }
        // Both signs of the micro.
        let [from, to] = [&self.unit, unit].map(|unit| unit.replace(['\u{b5}', '\u{3bc}'], "u"));
        let find = |unit: &str| UNITS.iter().find(|(name, ..)| *name == unit);
        let (from, to) = (find(&from)?, find(&to)?);
        (from.1 == to.1).then(|| self.number * from.2 / to.2).filter(|number| number.is_finite())
    }

    /// The quantity of a number or a text; `None` for other values and for texts that do not begin with a finite number.
    pub(crate) fn of(value: &Value) -> Option<Self> {
        let plain = |number: f64| Self { number, unit: String::new() };
        match value {
            Value::Integer(i) => Some(plain(*i as f64)),
            Value::Float(f) if f.is_finite() => Some(plain(*f)),
            Value::String(text) => Self::of_text(text),
            _ => None,
        }
    }

    /// The quantity of a text.
    pub(crate) fn of_text(text: &str) -> Option<Self> {
        let text = text.trim();
        let is_number = |(i, c): (usize, char)| {
            let before = text[..i].chars().next_back();
            c.is_ascii_digit()
                || c == '.'
                || (matches!(c, '+' | '-') && matches!(before, None | Some('e' | 'E')))
                // An exponent, not the beginning of a unit.
                || (matches!(c, 'e' | 'E')
                    && text[i + 1..].starts_with(|d: char| d.is_ascii_digit() || d == '+' || d == '-'))
        };
        let end = text.char_indices().find(|&at| !is_number(at)).map_or(text.len(), |(i, _)| i);
        let number: f64 = text[..end].parse().ok()?;
        number.is_finite().then(|| Self { number, unit: text[end..].trim().to_owned() })
    }

    /// The value as a job file contains it.
    pub(crate) fn value(number: f64, unit: &str) -> Value {
        if unit.is_empty() { Value::Float(number) } else { Value::String(format!("{number}{unit}")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_separated_from_units() {
        for (text, number, unit) in [
            ("2.5mm", 2.5, "mm"),
            ("-1e-3 deg", -1e-3, "deg"),
            ("3e2W", 300.0, "W"),
            ("5e", 5.0, "e"),
            ("7", 7.0, ""),
            ("0.5/mm", 0.5, "/mm"),
            ("1eV", 1.0, "eV"),
        ] {
            assert_eq!(Quantity::of_text(text), Some(Quantity { number, unit: unit.into() }), "{text}");
        }
        for text in ["", "mm", "inf", "NaN", "--1", "1.2.3", "1e999", "steel 3"] {
            assert_eq!(Quantity::of_text(text), None, "{text}");
        }
        let in_unit = |text: &str, unit: &str| Quantity::of_text(text).expect("a quantity").number_in(unit);
        assert_eq!(in_unit("1mm", "um"), Some(1000.0));
        assert_eq!(in_unit("1e308mm", "nm"), None, "beyond the range of f64");
        assert_eq!([in_unit("30us", "ms"), in_unit("30\u{b5}s", "ms")], [Some(0.03); 2]);
        assert_eq!(in_unit("0", "W"), Some(0.0));
        assert_eq!([in_unit("1mm", "ms"), in_unit("1", "mm"), in_unit("1deg", "rad")], [None; 3]);
        assert_eq!(Quantity::value(2.5, "mm"), Value::String("2.5mm".into()));
    }
}
