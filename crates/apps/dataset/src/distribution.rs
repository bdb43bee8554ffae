//! Distributions: what a study may write in place of a value.

use crate::draws::Draws;
use crate::expression::Formula;
use crate::label_entry::texts;
use crate::quantity::Quantity;
use dunkelfeld_io::InputError;
use dunkelfeld_io::toml_file::TomlFile;
use serde::de::DeserializeOwned;
use statrs::distribution::{ContinuousCDF, Normal};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// The keys that make an inline table a distribution.
pub(crate) const KINDS: [&str; 9] =
    ["uniform", "integer", "log_uniform", "normal", "log_normal", "choice", "sequence", "draw", "expression"];

/// A fault in a study: the path of the key below the value that was read, the problem, the help.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) path: Vec<String>,
    pub(crate) problem: String,
    pub(crate) help: String,
}

impl Fault {
    pub(crate) fn new(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self { path: Vec::new(), problem: problem.into(), help: help.into() }
    }

    /// The fault as an error of a study. The path is that of the value that was read; that of the fault is below it.
    pub(crate) fn in_file(self, source: &TomlFile, path: &[&str]) -> InputError {
        let mut keys: Vec<&str> = path.to_vec();
        keys.extend(self.path.iter().map(String::as_str));
        let mut error = source.error_at_key(&keys, self.problem, self.help);
        match keys.as_slice() {
            ["study", table @ ("draw" | "images" | "labels"), key, ..] => {
                error.place = format!("[study.{table}] {key}");
            }
            ["study", list @ ("label" | "place" | "defect"), number, rest @ ..] => {
                let number = number.parse::<usize>().map_or(1, |number| number + 1);
                let key = rest.first().map_or_else(String::new, |key| format!(", {key}"));
                error.place = format!("[[study.{list}]] {number}{key}");
            }
            _ => {}
        }
        error
    }

    /// The same fault, seen from one level higher.
    pub(crate) fn below(mut self, key: impl Into<String>) -> Self {
        self.path.insert(0, key.into());
        self
    }
}

/// A value of a job, parts of which are drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Template {
    /// The same in all images.
    Fixed(Value),
    List(Vec<Self>),
    Table(BTreeMap<String, Self>),
    Drawn(Distribution),
}

/// A distribution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Distribution {
    /// Uniform in [low, high).
    Uniform { low: f64, high: f64, unit: String },
    /// Each whole number from low to high with the same probability.
    Integer { low: i64, high: i64 },
    /// The logarithm is uniform.
    LogUniform { low: f64, high: f64, unit: String },
    /// Normal, restricted to [min, max].
    Normal { mean: f64, deviation: f64, min: f64, max: f64, unit: String },
    /// The logarithm is normal about that of the median, with a standard deviation of ln(factor).
    LogNormal { median: f64, factor: f64, min: f64, max: f64, unit: String },
    /// One of the values, by weights.
    Choice { values: Vec<Template>, weights: Vec<f64> },
    /// The values in turn, each for some images.
    Sequence { values: Vec<Template>, repeat: u64 },
    /// The value of a named draw.
    Named(String),
    /// A formula of named draws, whose value has the unit.
    Expression { formula: Formula, unit: String },
}

/// The values of named draws.
pub(crate) trait Named {
    /// The value of a draw.
    fn value(&mut self, name: &str) -> Result<Value, Fault>;

    /// The number of a draw in a formula.
    fn number(&mut self, name: &str) -> Result<f64, Fault> {
        let value = self.value(name)?;
        Quantity::of(&value).map(|quantity| quantity.number).ok_or_else(|| no_number(name, &value))
    }
}

/// Reads a table with all values drawn. A fault is at the key of its value.
pub(crate) fn read<T: DeserializeOwned>(keys: &Table) -> Result<T, Fault> {
    let text = toml::to_string(keys).map_err(|e| Fault::new(e.to_string(), "check its values"))?;
    let file = TomlFile::from_text("", text);
    file.parse().map_err(|e| {
        let path = e.source_span.and_then(|span| file.path_at(&span.range)).unwrap_or_default();
        Fault { path, problem: e.problem, help: e.help }
    })
}

impl Template {
    /// Reads a value of a study.
    pub(crate) fn parse(value: Value) -> Result<Self, Fault> {
        match value {
            Value::Array(items) => {
                let items = items.into_iter().enumerate();
                let list: Vec<Self> = items
                    .map(|(i, item)| Self::parse(item).map_err(|e| e.below(i.to_string())))
                    .collect::<Result<_, _>>()?;
                let fixed: Option<Vec<Value>> = list.iter().map(Self::fixed).collect();
                Ok(fixed.map_or(Self::List(list), |values| Self::Fixed(Value::Array(values))))
            }
            Value::Table(table) => match table.keys().find(|key| KINDS.contains(&key.as_str())).cloned() {
                Some(kind) => Distribution::parse(&kind, table).map(Self::Drawn),
                None => {
                    let entries = table.into_iter();
                    let map: BTreeMap<String, Self> = entries
                        .map(|(key, value)| Ok((key.clone(), Self::parse(value).map_err(|e| e.below(key))?)))
                        .collect::<Result<_, Fault>>()?;
                    let fixed: Option<Table> = map.iter().map(|(k, v)| Some((k.clone(), v.fixed()?))).collect();
                    Ok(fixed.map_or(Self::Table(map), |table| Self::Fixed(Value::Table(table))))
                }
            },
            other => Ok(Self::Fixed(other)),
        }
    }

    /// The texts that the value may have, as far as they are known without a draw.
    pub(crate) fn texts(&self) -> Vec<String> {
        match self {
            Self::Fixed(value) => texts(value),
            Self::List(items)
            | Self::Drawn(Distribution::Choice { values: items, .. } | Distribution::Sequence { values: items, .. }) => {
                items.iter().flat_map(Self::texts).collect()
            }
            Self::Table(_) | Self::Drawn(_) => Vec::new(),
        }
    }

    /// The texts of a key of a table, as [`Self::texts`], also those of a named draw.
    pub(crate) fn texts_of(&self, key: &str, draws: &BTreeMap<String, Self>) -> Vec<String> {
        match self {
            Self::Table(keys) => match keys.get(key) {
                Some(Self::Drawn(Distribution::Named(name))) => draws.get(name).map_or_else(Vec::new, Self::texts),
                other => other.map_or_else(Vec::new, Self::texts),
            },
            Self::Fixed(Value::Table(keys)) => keys.get(key).map_or_else(Vec::new, texts),
            _ => Vec::new(),
        }
    }

    fn fixed(&self) -> Option<Value> {
        match self {
            Self::Fixed(value) => Some(value.clone()),
            _ => None,
        }
    }

    /// The value for an image. `name` is the name of the value; that of a drawn part is longer by its place. `drawn`
    /// receives the name and the value of each distribution.
    pub(crate) fn draw(
        &self,
        draws: Draws,
        name: &str,
        named: &mut dyn Named,
        drawn: &mut dyn FnMut(&str, &Value),
    ) -> Result<Value, Fault> {
        match self {
            Self::Fixed(value) => Ok(value.clone()),
            Self::List(items) => {
                let mut labels: Vec<String> = Vec::new();
                for (i, item) in items.iter().enumerate() {
                    let label = label(item, i);
                    let same = labels.iter().filter(|other| other.split(" #").next() == Some(label.as_str())).count();
                    labels.push(if same > 0 { format!("{label} #{}", same + 1) } else { label });
                }
                let items = items.iter().enumerate().map(|(i, item)| {
                    let name = format!("{name}[{}]", labels[i]);
                    item.draw(draws, &name, named, drawn).map_err(|e| e.below(i.to_string()))
                });
                Ok(Value::Array(items.collect::<Result<_, _>>()?))
            }
            Self::Table(entries) => {
                let entries = entries.iter().map(|(key, value)| {
                    let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                    Ok((key.clone(), value.draw(draws, &name, named, drawn).map_err(|e| e.below(key))?))
                });
                Ok(Value::Table(entries.collect::<Result<_, Fault>>()?))
            }
            Self::Drawn(distribution) => {
                let value = distribution.draw(draws, name, named, drawn)?;
                drawn(name, &value);
                Ok(value)
            }
        }
    }
}

/// The name of an item of a list in the names of draws: that of an entry such as `[[object]]`, or its number. So entries
/// can be added before it and do not change its draws.
fn label(item: &Template, number: usize) -> String {
    let name = match item {
        Template::Table(entries) => entries.get("name").and_then(Template::fixed),
        Template::Fixed(Value::Table(entries)) => entries.get("name").cloned(),
        _ => None,
    };
    name.as_ref().and_then(Value::as_str).map_or_else(|| number.to_string(), str::to_owned)
}

impl Distribution {
    fn parse(kind: &str, mut table: Table) -> Result<Self, Fault> {
        let main = table.remove(kind).unwrap_or(Value::Boolean(false));
        let allowed: &[&str] = match kind {
            "normal" | "log_normal" => &["min", "max"],
            "choice" => &["weights"],
            "sequence" => &["repeat"],
            "expression" => &["unit"],
            _ => &[],
        };
        if let Some(other) = table.keys().find(|key| !allowed.contains(&key.as_str())) {
            let help = if allowed.is_empty() {
                format!("`{kind}` stands alone")
            } else {
                format!("beside `{kind}` there may be {}", allowed.join(" and "))
            };
            return Err(Fault::new(format!("unknown key `{other}` of a distribution"), help).below(other));
        }
        match kind {
            "uniform" | "integer" | "log_uniform" => Self::range(kind, &main).map_err(|e| e.below(kind)),
            "normal" | "log_normal" => Self::bell(kind, &main, &table),
            "choice" | "sequence" => Self::list(kind, main, table),
            "draw" => match main {
                Value::String(name) => Ok(Self::Named(name)),
                _ => {
                    Err(Fault::new("not the name of a draw", "write the name of an entry of [study.draw]").below(kind))
                }
            },
            _ => {
                let Value::String(text) = main else {
                    return Err(Fault::new("not a formula", "write it in quotes, as in \"2 * load + 1\"").below(kind));
                };
                let unit = match table.remove("unit") {
                    None => String::new(),
                    Some(Value::String(unit)) => unit,
                    Some(_) => return Err(Fault::new("not a unit", "write it in quotes, as in \"mm\"").below("unit")),
                };
                Ok(Self::Expression { formula: Formula::new(text).map_err(|e| e.below(kind))?, unit })
            }
        }
    }

    /// A distribution between two ends.
    fn range(kind: &str, main: &Value) -> Result<Self, Fault> {
        let [low, high] = pair(main, kind)?;
        let (low, high, unit) = (low.number, high.number, low.unit);
        if !(high - low).is_finite() {
            return Err(Fault::new("the range is wider than numbers reach", "write smaller numbers"));
        }
        if low > high {
            let problem = format!("the lower end {low} is above the upper end {high}");
            return Err(Fault::new(problem, "write the lower end first"));
        }
        let is_whole = |number: f64| number.fract() == 0.0 && number.abs() < 9e15;
        match kind {
            "uniform" => Ok(Self::Uniform { low, high, unit }),
            "integer" if unit.is_empty() && is_whole(low) && is_whole(high) => {
                Ok(Self::Integer { low: low as i64, high: high as i64 })
            }
            "integer" => Err(Fault::new("the ends are no whole numbers", "write two whole numbers")),
            _ if low > 0.0 => Ok(Self::LogUniform { low, high, unit }),
            _ => Err(Fault::new(format!("the lower end {low} is not above zero"), "write a number above zero")),
        }
    }

    /// A distribution about a mean or median.
    fn bell(kind: &str, main: &Value, table: &Table) -> Result<Self, Fault> {
        if kind == "normal" {
            let [mean, deviation] = pair(main, kind).map_err(|e| e.below(kind))?;
            let (mean, deviation, unit) = (mean.number, deviation.number, mean.unit);
            if deviation <= 0.0 {
                let problem = format!("the standard deviation {deviation} is not above zero");
                return Err(Fault::new(problem, "write a number above zero").below(kind));
            }
            let (min, max) = limits(table, &unit)?;
            check_mass(mean, deviation, min, max)?;
            return Ok(Self::Normal { mean, deviation, min, max, unit });
        }
        let items = main.as_array().filter(|items| items.len() == 2);
        let quantities = items.and_then(|items| Some((Quantity::of(&items[0])?, Quantity::of(&items[1])?)));
        let is_fit = |(m, f): &(Quantity, Quantity)| m.number > 0.0 && f.number > 1.0 && f.unit.is_empty();
        let Some((Quantity { number: median, unit }, factor)) = quantities.filter(is_fit) else {
            let help =
                "write [median, factor]: 68 % of the values are within this factor of the median, as in [\"2mm\", 1.5]";
            return Err(Fault::new("not a median above zero and a factor above 1", help).below(kind));
        };
        let factor = factor.number;
        let (min, max) = limits(table, &unit)?;
        check_mass(median.ln(), factor.ln(), min.max(0.0).ln(), max.ln())?;
        Ok(Self::LogNormal { median, factor, min, max, unit })
    }

    /// A distribution over a list of values.
    fn list(kind: &str, main: Value, mut table: Table) -> Result<Self, Fault> {
        let Value::Array(items) = main else {
            return Err(Fault::new("not a list of values", "write the values in brackets").below(kind));
        };
        if items.is_empty() {
            return Err(Fault::new("the list is empty", "write at least one value").below(kind));
        }
        let values: Vec<Template> = (items.into_iter().enumerate())
            .map(|(i, item)| Template::parse(item).map_err(|e| e.below(i.to_string()).below(kind)))
            .collect::<Result<_, _>>()?;
        if kind == "choice" {
            let weights = weights(table.remove("weights"), values.len()).map_err(|e| e.below("weights"))?;
            return Ok(Self::Choice { values, weights });
        }
        match table.remove("repeat") {
            None => Ok(Self::Sequence { values, repeat: 1 }),
            Some(Value::Integer(n)) if n > 0 => Ok(Self::Sequence { values, repeat: n as u64 }),
            Some(_) => Err(Fault::new("not a whole number from 1", "write `repeat = 10`").below("repeat")),
        }
    }

    fn draw(
        &self,
        draws: Draws,
        name: &str,
        named: &mut dyn Named,
        drawn: &mut dyn FnMut(&str, &Value),
    ) -> Result<Value, Fault> {
        Ok(match self {
            Self::Uniform { low, high, unit } => {
                Quantity::value((low + (high - low) * draws.uniform(name)).clamp(*low, *high), unit)
            }
            Self::Integer { low, high } => {
                let count = (high - low + 1) as f64;
                Value::Integer((low + (draws.uniform(name) * count) as i64).min(*high))
            }
            Self::LogUniform { low, high, unit } => {
                let log = low.ln() + (high / low).ln() * draws.uniform(name);
                Quantity::value(log.exp().clamp(*low, *high), unit)
            }
            Self::Normal { mean, deviation, min, max, unit } => {
                let z = truncated(draws.uniform(name), (min - mean) / deviation, (max - mean) / deviation);
                Quantity::value((mean + deviation * z).clamp(*min, *max), unit)
            }
            Self::LogNormal { median, factor, min, max, unit } => {
                let (m, s) = (median.ln(), factor.ln());
                let z = truncated(draws.uniform(name), (min.max(0.0).ln() - m) / s, (max.ln() - m) / s);
                Quantity::value((m + s * z).exp().clamp(*min, *max), unit)
            }
            Self::Choice { values, weights } => {
                let at = draws.uniform(name) * weights.iter().sum::<f64>();
                let mut sum = 0.0;
                let chosen = weights.iter().position(|w| {
                    sum += w;
                    at < sum
                });
                // Rounding can leave the sum below the last limit.
                let last = weights.iter().rposition(|w| *w > 0.0).unwrap_or(0);
                let chosen = chosen.unwrap_or(last).min(values.len() - 1);
                values[chosen].draw(draws, &format!("{name}.choice[{chosen}]"), named, drawn)?
            }
            Self::Sequence { values, repeat } => {
                let at = (draws.index / repeat % values.len() as u64) as usize;
                values[at].draw(draws, &format!("{name}.sequence[{at}]"), named, drawn)?
            }
            Self::Named(draw) => named.value(draw).map_err(|e| e.below("draw"))?,
            Self::Expression { formula, unit } => {
                let number = formula.evaluate(|variable| named.number(variable)).map_err(|e| e.below("expression"))?;
                match whole(number) {
                    Some(whole) if unit.is_empty() => Value::Integer(whole),
                    _ => Quantity::value(number, unit),
                }
            }
        })
    }
}

/// The fault of a draw in a formula that is no number.
pub(crate) fn no_number(name: &str, value: &Value) -> Fault {
    Fault::new(format!("`{name}` is no number: {value}"), "use a numeric draw")
}

/// A number without a fraction, as an integer. Keys with numbers take integers as well. From 2^53 on, neighbours of f64
/// differ by more than 1.
fn whole(number: f64) -> Option<i64> {
    (number.fract() == 0.0 && number.abs() < 2f64.powi(53)).then_some(number as i64)
}

/// The quantile of a standard normal distribution restricted to [low, high]. The tail with more precision is used.
fn truncated(u: f64, low: f64, high: f64) -> f64 {
    let normal = Normal::standard();
    if low > 0.0 {
        return -truncated(1.0 - u, -high, -low);
    }
    let (a, b) = (normal.cdf(low), normal.cdf(high));
    normal.inverse_cdf((a + (b - a) * u).clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON)).clamp(low, high)
}

/// Two quantities of a list, of one kind, in one unit.
fn pair(value: &Value, kind: &str) -> Result<[Quantity; 2], Fault> {
    let help = format!("write two values of one kind, as in {{ {kind} = [\"1mm\", \"5mm\"] }}");
    let items = value.as_array().filter(|items| items.len() == 2);
    let Some((a, b)) = items.and_then(|items| Some((Quantity::of(&items[0])?, Quantity::of(&items[1])?))) else {
        return Err(Fault::new("not a list of two finite numbers or quantities", help));
    };
    // A plain zero takes the unit of the other value.
    let unit = if a.unit.is_empty() && a.number == 0.0 { &b.unit } else { &a.unit };
    match (a.number_in(unit), b.number_in(unit)) {
        (Some(low), Some(high)) => Ok([low, high].map(|number| Quantity { number, unit: unit.clone() })),
        _ => Err(Fault::new(format!("the units \"{}\" and \"{}\" differ", a.unit, b.unit), help)),
    }
}

/// The limits of a truncated distribution, in its unit.
fn limits(table: &Table, unit: &str) -> Result<(f64, f64), Fault> {
    let limit = |key: &str, none: f64| match table.get(key) {
        None => Ok(none),
        Some(value) => Quantity::of(value).and_then(|q| q.number_in(unit)).ok_or_else(|| {
            Fault::new(format!("not a finite quantity in \"{unit}\""), "use a unit of the same kind").below(key)
        }),
    };
    let (min, max) = (limit("min", f64::NEG_INFINITY)?, limit("max", f64::INFINITY)?);
    if min < max {
        return Ok((min, max));
    }
    Err(Fault::new(format!("`min` {min} is not below `max` {max}"), "leave room between them").below("max"))
}

/// The limits must contain enough of the distribution for a draw with the precision of f64.
fn check_mass(mean: f64, deviation: f64, min: f64, max: f64) -> Result<(), Fault> {
    const LEAST: f64 = 1e-9;
    let normal = Normal::standard();
    let (low, high) = ((min - mean) / deviation, (max - mean) / deviation);
    let mass = if low > 0.0 { normal.cdf(-low) - normal.cdf(-high) } else { normal.cdf(high) - normal.cdf(low) };
    if mass >= LEAST {
        return Ok(());
    }
    Err(Fault::new("`min` and `max` leave less than 1e-9 of the distribution", "move them toward the mean"))
}

fn weights(value: Option<Value>, count: usize) -> Result<Vec<f64>, Fault> {
    let Some(value) = value else { return Ok(vec![1.0; count]) };
    let numbers = value.as_array().map(|items| items.iter().map(plain_number).collect::<Option<Vec<f64>>>());
    let Some(Some(weights)) = numbers else {
        return Err(Fault::new("not a list of numbers", "write one number for each value"));
    };
    if weights.len() != count {
        return Err(Fault::new(format!("{} weights for {count} values", weights.len()), "write one for each value"));
    }
    if weights.iter().any(|w| !(w.is_finite() && *w >= 0.0))
        || weights.iter().all(|w| *w == 0.0)
        || weights.iter().sum::<f64>().is_infinite()
    {
        return Err(Fault::new("the weights are not all from 0 up with a sum above 0", "write numbers from 0 up"));
    }
    Ok(weights)
}

fn plain_number(value: &Value) -> Option<f64> {
    Quantity::of(value).filter(|q| q.unit.is_empty() && !value.is_str()).map(|q| q.number)
}

#[cfg(test)]
#[path = "distribution_tests.rs"]
mod tests;
