//! The drawn values of a set: one column per setting, with numbers in one unit, or with counts of texts.

use crate::quantity::Quantity;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// Maximum number of different texts of a setting that are counted separately.
const TEXTS: usize = 4096;
/// All drawn values of one setting.
#[derive(Clone, Debug, Default)]
pub(crate) struct Column {
    /// Numbers with the index of their unit.
    numbers: Vec<(f64, u16)>,
    units: Vec<String>,
    texts: BTreeMap<String, u64>,
    /// Number of texts beyond the maximum number of different ones.
    others: u64,
}

/// A column as a histogram or as bars needs it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Drawn {
    /// Numbers in one unit. The unit is empty for numbers without one.
    Numbers { values: Vec<f64>, unit: String },
    /// Texts with their counts, the most frequent first, and the number of texts that were not counted separately.
    Texts { counts: Vec<(String, u64)>, others: u64 },
}

/// The columns by the name of their setting.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draws(BTreeMap<String, Column>);

impl Draws {
    /// Adds the drawn values of an image.
    pub(crate) fn add(&mut self, drawn: &Map<String, Value>) {
        for (name, value) in drawn {
            match self.0.get_mut(name) {
                Some(column) => column.add(value),
                None => self.0.entry(name.clone()).or_default().add(value),
            }
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, Drawn)> {
        self.0.iter().map(|(name, column)| (name.as_str(), column.drawn()))
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }
}

impl Column {
    fn add(&mut self, value: &Value) {
        match value {
            Value::Number(n) => match n.as_f64().filter(|v| v.is_finite()) {
                Some(v) => self.number(v, ""),
                None => self.text(n.to_string()),
            },
            Value::String(text) => match number_with_unit(text) {
                Some(Quantity { number, unit }) => self.number(number, &unit),
                None => self.text(text.clone()),
            },
            other => self.text(other.to_string()),
        }
    }

    fn number(&mut self, v: f64, unit: &str) {
        let known = self.units.iter().position(|u| u == unit);
        let at = known.unwrap_or_else(|| {
            self.units.push(unit.into());
            self.units.len() - 1
        });
        match u16::try_from(at) {
            Ok(at) => self.numbers.push((v, at)),
            Err(_) => self.text(format!("{v}{unit}")),
        }
    }

    fn text(&mut self, text: String) {
        let has_room = self.texts.len() < TEXTS;
        match self.texts.get_mut(&text) {
            Some(count) => *count += 1,
            None if has_room => drop(self.texts.insert(text, 1)),
            None => self.others += 1,
        }
    }

    fn drawn(&self) -> Drawn {
        let is_numeric = self.texts.is_empty() && self.others == 0;
        match is_numeric.then(|| self.in_one_unit()).flatten() {
            Some((values, unit)) => Drawn::Numbers { values, unit },
            None => self.counted(),
        }
    }

    /// The numbers in the unit that most of them have. None if a unit cannot be converted.
    fn in_one_unit(&self) -> Option<(Vec<f64>, String)> {
        let mut uses = vec![0_usize; self.units.len()];
        for (_, unit) in &self.numbers {
            *uses.get_mut(usize::from(*unit))? += 1;
        }
        let (main, _) = uses.iter().enumerate().max_by_key(|(i, n)| (**n, std::cmp::Reverse(*i)))?;
        let unit = self.units.get(main)?;
        let factor = |from: &String| Quantity { number: 1.0, unit: from.clone() }.number_in(unit);
        let factors: Option<Vec<f64>> = self.units.iter().map(factor).collect();
        let factors = factors?;
        let values = self.numbers.iter().filter_map(|(v, at)| Some(v * factors.get(usize::from(*at))?)).collect();
        Some((values, unit.clone()))
    }

    fn counted(&self) -> Drawn {
        let mut all = self.texts.clone();
        for (v, at) in &self.numbers {
            let unit = self.units.get(usize::from(*at)).map_or("", String::as_str);
            *all.entry(format!("{v}{unit}")).or_default() += 1;
        }
        let mut counts: Vec<(String, u64)> = all.into_iter().collect();
        counts.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        Drawn::Texts { counts, others: self.others }
    }
}

/// A number with a unit. Names of files and other texts are none.
fn number_with_unit(text: &str) -> Option<Quantity> {
    let quantity = Quantity::of_text(text)?;
    let unit = &quantity.unit;
    let is_unit = |c: char| c.is_alphabetic() || "\u{b0}%/\u{b2}\u{b3}\u{b5}\u{b7}^\u{207b}".contains(c);
    // A point before the text separates the name of a file from its ending.
    let is_file = text.contains(&format!(".{unit}"));
    (!unit.is_empty() && !is_file && unit.chars().count() <= 8 && unit.chars().all(is_unit)).then_some(quantity)
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
    fn texts_with_a_number_and_a_unit_are_numbers() {
        let of = |number, unit: &str| Some(Quantity { number, unit: unit.into() });
        assert_eq!(number_with_unit("3.217ms"), of(3.217, "ms"));
        assert_eq!(number_with_unit("-1.5e-3 mm"), of(-1.5e-3, "mm"));
        assert_eq!(number_with_unit("2em"), of(2.0, "em"));
        assert_eq!(number_with_unit("30\u{b0}"), of(30.0, "\u{b0}"));
        for text in ["b.glb", "2.glb", "10mm_part.glb", "", "ms", "1.2.3mm", "--1m", "12", "1e", "\u{e9}1m", "-"] {
            let found = number_with_unit(text);
            assert!(found.is_none() || text == "1e", "{text}: {found:?}");
        }
    }

    #[test]
    fn units_of_a_kind_become_one() {
        let drawn = column(&[json!("900us"), json!("1.5ms"), json!("2ms")]);
        let Drawn::Numbers { values, unit } = drawn else { panic!("{drawn:?}") };
        assert_eq!(unit, "ms");
        assert!((values[0] - 0.9).abs() < 1e-12 && values[1..] == [1.5, 2.0], "{values:?}");
    }

    #[test]
    fn other_mixtures_are_texts() {
        let counts = |drawn| match drawn {
            Drawn::Texts { counts, others: 0 } => counts,
            other => panic!("{other:?}"),
        };
        assert_eq!(counts(column(&[json!("1ms"), json!("2mm")])), [("1ms".into(), 1), ("2mm".into(), 1)]);
        assert_eq!(counts(column(&[json!(1), json!("a"), json!("a")])), [("a".into(), 2), ("1".into(), 1)]);
        assert_eq!(counts(column(&[json!(true), json!(null)])), [("null".into(), 1), ("true".into(), 1)]);
    }

    #[test]
    fn many_different_texts_need_bounded_memory() {
        let values: Vec<Value> = (0..TEXTS + 5).map(|i| json!(format!("name {i}."))).collect();
        let Drawn::Texts { counts, others } = column(&values) else { panic!("texts") };
        assert_eq!((counts.len(), others), (TEXTS, 5));
    }
}
