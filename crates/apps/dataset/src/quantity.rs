//! Numbers with a unit in texts, such as `"2.5mm"`, for arithmetic with distributions.

use dunkelfeld_io::quantity::{converted, number_and_unit};
use toml::Value;

/// A number with the unit that is written behind it; the unit may be empty.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Quantity {
    pub(crate) number: f64,
    /// As written: `"mm"`, `"deg"`, `"W"`, or empty for a plain number.
    pub(crate) unit: String,
}

impl Quantity {
    /// A number without a unit.
    pub(crate) fn plain(number: f64) -> Self {
        Self { number, unit: String::new() }
    }

    /// The number of the quantity in another unit; `None` if the units are not of one kind. A plain zero has any unit.
    pub(crate) fn number_in(&self, unit: &str) -> Option<f64> {
        if self.unit == unit || (self.unit.is_empty() && self.number == 0.0) {
            return Some(self.number);
        }
        converted(self.number, &self.unit, unit)
    }

    /// Is the unit one that a job may have?
    pub(crate) fn has_known_unit(&self) -> bool {
        converted(1.0, &self.unit, &self.unit).is_some()
    }

    /// The quantity of a number or a text; `None` for other values and for texts that do not begin with a finite number.
    pub(crate) fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Integer(i) => Some(Self::plain(*i as f64)),
            Value::Float(f) if f.is_finite() => Some(Self::plain(*f)),
            Value::String(text) => Self::of_text(text),
            _ => None,
        }
    }

    /// The quantity of a text.
    pub(crate) fn of_text(text: &str) -> Option<Self> {
        number_and_unit(text).map(|(number, unit)| Self { number, unit: unit.to_owned() })
    }

    /// The value as a job file contains it.
    pub(crate) fn value(number: f64, unit: &str) -> Value {
        if unit.is_empty() { Value::Float(number) } else { Value::String(format!("{number}{unit}")) }
    }
}
