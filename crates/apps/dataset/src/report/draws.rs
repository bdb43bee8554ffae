//! The drawn values of a set: one column per setting, with numbers in one unit, or with counts of texts.

use crate::quantity::Quantity;
use serde_json::Value;
use std::collections::BTreeMap;

/// All drawn values of one setting.
#[derive(Clone, Debug, Default)]
pub(crate) struct Column {
    /// The unit of the first number. Numbers that have no value in it are texts.
    unit: Option<String>,
    numbers: Vec<f64>,
    texts: BTreeMap<String, u64>,
}

/// A column as a histogram or as bars needs it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Drawn {
    /// Numbers in one unit. The unit is empty for numbers without one.
    Numbers { values: Vec<f64>, unit: String },
    /// Texts with their counts, the most frequent first.
    Texts(Vec<(String, u64)>),
}

/// The columns by the name of their setting.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draws(BTreeMap<String, Column>);

impl Draws {
    /// Adds the drawn values of an image.
    pub(crate) fn add(&mut self, drawn: &BTreeMap<String, Value>) {
        for (name, value) in drawn {
            self.0.entry(name.clone()).or_default().add(value);
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, Drawn)> {
        self.0.iter().map(|(name, column)| (name.as_str(), column.drawn()))
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl Column {
    fn add(&mut self, value: &Value) {
        let quantity = match value {
            Value::Number(number) => number.as_f64().map(Quantity::plain),
            Value::String(text) => Quantity::of_text(text).filter(Quantity::has_known_unit),
            _ => None,
        };
        let number = quantity.and_then(|q| q.number_in(self.unit.get_or_insert_with(|| q.unit.clone())));
        match (number, value) {
            (Some(number), _) => self.numbers.push(number),
            (None, Value::String(text)) => self.count(text.clone()),
            (None, other) => self.count(other.to_string()),
        }
    }

    fn count(&mut self, text: String) {
        *self.texts.entry(text).or_default() += 1;
    }

    fn drawn(&self) -> Drawn {
        let unit = self.unit.clone().unwrap_or_default();
        if self.texts.is_empty() {
            return Drawn::Numbers { values: self.numbers.clone(), unit };
        }
        let mut all = self.clone();
        self.numbers.iter().for_each(|number| all.count(format!("{number}{unit}")));
        let mut counts: Vec<(String, u64)> = all.texts.into_iter().collect();
        counts.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        Drawn::Texts(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn column(values: &[Value]) -> Drawn {
        let mut column = Column::default();
        values.iter().for_each(|v| column.add(v));
        column.drawn()
    }

    #[test]
    fn units_of_a_kind_become_one() {
        let drawn = column(&[json!("1.5ms"), json!("900us"), json!("2ms")]);
        assert_eq!(drawn, Drawn::Numbers { values: vec![1.5, 0.9, 2.0], unit: "ms".into() });
        assert_eq!(column(&[json!(1), json!(2.5)]), Drawn::Numbers { values: vec![1.0, 2.5], unit: String::new() });
    }

    #[test]
    fn other_mixtures_are_texts() {
        let counts = |values: &[Value]| match column(values) {
            Drawn::Texts(counts) => counts,
            other => panic!("{other:?}"),
        };
        assert_eq!(counts(&[json!("1ms"), json!("2mm")]), [("1ms".into(), 1), ("2mm".into(), 1)]);
        assert_eq!(counts(&[json!(1), json!("a"), json!("a")]), [("a".into(), 2), ("1".into(), 1)]);
        assert_eq!(counts(&[json!(true), json!(null)]), [("null".into(), 1), ("true".into(), 1)]);
        assert_eq!(counts(&[json!("2.glb"), json!("10mm_part.glb")]).len(), 2);
    }
}
