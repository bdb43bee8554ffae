//! Formulas of named draws, by the crate exmex.

use crate::distribution::{Distribution, Fault, Template};
use crate::quantity::Quantity;
use exmex::{Express, FlatEx, FloatOpsFactory, MatchLiteral};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The parts of a formula.
const HELP: &str = "use + - * / ^, functions such as sin, sqrt and exp, and names of [study.draw]; a name with other characters than letters, digits and _ stands in braces, as in \"2 * {my-draw}\"";

/// Longer formulas are refused.
const LONGEST: usize = 1000;

/// The numbers of a formula: decimal, with an exponent of ten where there is one, as in `1e-5`.
#[derive(Clone, Debug)]
struct Decimal;

impl MatchLiteral for Decimal {
    fn is_literal(text: &str) -> Option<&str> {
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let whole = digits(text);
        let rest = &text[whole..];
        let parts = rest.strip_prefix('.').map_or(0, digits);
        if whole + parts == 0 {
            return None;
        }
        let end = whole + if rest.starts_with('.') { 1 + parts } else { 0 };
        let exponent = text[end..].strip_prefix(['e', 'E']).map_or(0, |rest| {
            let sign = usize::from(rest.starts_with(['+', '-']));
            match digits(&rest[sign..]) {
                0 => 0,
                count => 1 + sign + count,
            }
        });
        Some(&text[..end + exponent])
    }
}

type Parsed = FlatEx<f64, FloatOpsFactory<f64>, Decimal>;

/// A formula, which is parsed once.
#[derive(Clone, Debug)]
pub(crate) struct Formula {
    text: String,
    /// The formula, or why the text is none.
    parsed: Arc<Result<Parsed, String>>,
}

impl PartialEq for Formula {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

fn parse(text: &str) -> Result<Parsed, String> {
    if text.len() > LONGEST {
        return Err(format!("the formula has more than {LONGEST} characters"));
    }
    Parsed::parse(text).map_err(|e| format!("not a formula: {e}"))
}

impl Formula {
    /// A text that shall be a formula.
    pub(crate) fn new(text: String) -> Self {
        let parsed = Arc::new(parse(&text));
        Self { text, parsed }
    }

    fn parsed(&self) -> Result<&Parsed, Fault> {
        self.parsed.as_ref().as_ref().map_err(|problem| Fault::new(problem, HELP))
    }

    /// The value of the formula.
    ///
    /// # Errors
    /// A text that is no formula, a variable without a value, and a value that is not finite.
    pub(crate) fn evaluate(&self, mut value: impl FnMut(&str) -> Result<f64, Fault>) -> Result<f64, Fault> {
        let Self { text, .. } = self;
        let formula = self.parsed()?;
        let values: Vec<f64> = formula.var_names().iter().map(|name| value(name)).collect::<Result<_, _>>()?;
        match formula.eval(&values) {
            Ok(number) if number.is_finite() => Ok(number),
            Ok(number) => Err(Fault::new(format!("`{text}` is {number}"), "let it be finite for all draws")),
            Err(e) => Err(Fault::new(format!("`{text}` has no value: {e}"), HELP)),
        }
    }
}

/// The names of draws that formulas read in another way without braces.
pub(crate) fn names_in_braces(draws: &BTreeMap<String, Template>) -> Vec<&str> {
    draws.keys().map(String::as_str).filter(|name| !is_plain(name)).collect()
}

/// Checks a formula against the draws of its study, with [`names_in_braces`]: the name of a draw outside of braces is read as that draw, and each draw
/// of the formula has one unit.
///
/// # Errors
/// A text that is no formula, the name of a draw that the formula reads in another way, such as `e` or `my-draw`, and a draw whose values are of
/// different kinds.
pub(crate) fn check(formula: &Formula, draws: &BTreeMap<String, Template>, in_braces: &[&str]) -> Result<(), Fault> {
    if let Some(name) = in_braces.iter().find(|name| has_word(&formula.text, name)) {
        let reading = match parse(name) {
            Ok(formula) if formula.var_names().is_empty() => "is a constant in a formula",
            _ => "is not read as one name in a formula",
        };
        let problem = format!("`{name}` {reading}, and [study.draw] has a draw of this name");
        let help = format!(
            "write {{{name}}} for the draw, or rename it; names of letters, digits and _ that are no function and no constant need no braces"
        );
        return Err(Fault::new(problem, help));
    }
    for name in formula.parsed()?.var_names() {
        if let Some(template) = draws.get(name) {
            unit_of(name, template, draws)?;
        }
    }
    Ok(())
}

/// Is a name read as a variable of this name?
fn is_plain(name: &str) -> bool {
    !name.contains(['{', '}', ' ']) && parse(name).is_ok_and(|formula| formula.var_names() == [name])
}

/// Has a formula a name outside of braces, not as a part of a longer one? A name before a parenthesis is a function, and one
/// of operators alone is an operator.
fn has_word(text: &str, name: &str) -> bool {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '.');
    if !name.contains(char::is_alphanumeric) && !name.contains('_') {
        return false;
    }
    let is_function = |rest: &str| rest.trim_start().starts_with('(');
    // Texts between braces are whole names.
    let outside = text.split('{').enumerate().map(|(i, part)| match part.split_once('}') {
        Some((_, rest)) if i > 0 => rest,
        _ => part,
    });
    outside.into_iter().any(|part| {
        part.match_indices(name).any(|(at, _)| {
            let rest = &part[at + name.len()..];
            !is_part(part[..at].chars().next_back()) && !is_part(rest.chars().next()) && !is_function(rest)
        })
    })
}

/// The unit in which a draw counts in formulas: that of its first value. A plain zero has any unit.
///
/// # Errors
/// A draw whose values are of different kinds, as `"1mm"` and `"1s"`.
pub(crate) fn unit_of(name: &str, template: &Template, draws: &BTreeMap<String, Template>) -> Result<String, Fault> {
    let mut units = Vec::new();
    collect_units(template, draws, &mut BTreeSet::new(), &mut units);
    let first = units.first().cloned().unwrap_or_default();
    let one = |unit: &str| Quantity { number: 1.0, unit: unit.to_owned() };
    match units.iter().find(|unit| one(unit).number_in(&first).is_none()) {
        None => Ok(first),
        Some(other) => {
            let words = |unit: &str| if unit.is_empty() { "without a unit".into() } else { format!("in \"{unit}\"") };
            let problem = format!(
                "the draw `{name}` has values {} and {}, and a formula counts it in one unit",
                words(&first),
                words(other)
            );
            Err(Fault::new(problem, "write all values of the draw in units of one kind"))
        }
    }
}

/// The units of all values that a template may have, but those of plain zeros. `seen` are the named draws whose units are
/// among them.
fn collect_units<'a>(
    template: &'a Template,
    draws: &'a BTreeMap<String, Template>,
    seen: &mut BTreeSet<&'a str>,
    units: &mut Vec<String>,
) {
    let mut add = |unit: &str| {
        if !units.iter().any(|known| known == unit) {
            units.push(unit.to_owned());
        }
    };
    match template {
        // Words such as the name of a material have no unit.
        Template::Fixed(value) => match Quantity::of(value) {
            Some(Quantity { number, unit }) if number != 0.0 || !unit.is_empty() => add(&unit),
            _ => {}
        },
        Template::Drawn(distribution) => match distribution {
            Distribution::Uniform { low, high, unit } if unit.is_empty() && (*low, *high) == (0.0, 0.0) => {}
            Distribution::Uniform { unit, .. }
            | Distribution::LogUniform { unit, .. }
            | Distribution::Normal { unit, .. }
            | Distribution::LogNormal { unit, .. }
            | Distribution::Expression { unit, .. } => add(unit),
            Distribution::Integer { low: 0, high: 0 } => {}
            Distribution::Integer { .. } => add(""),
            Distribution::Choice { values, .. } | Distribution::Sequence { values, .. } => {
                values.iter().for_each(|value| collect_units(value, draws, seen, units));
            }
            Distribution::Named(name) => {
                if let Some(template) = draws.get(name).filter(|_| seen.insert(name)) {
                    collect_units(template, draws, seen, units);
                }
            }
        },
        Template::List(_) | Template::Table(_) => {}
    }
}

#[cfg(test)]
#[path = "expression_tests.rs"]
mod tests;
