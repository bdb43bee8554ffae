//! Formulas of named draws, by the crate exmex.

use crate::distribution::{Distribution, Fault, Template};
use crate::quantity::Quantity;
use exmex::{Express, FlatEx, FloatOpsFactory, MatchLiteral};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The parts of a formula.
const HELP: &str = "use + - * / ^, functions such as sin, sqrt and exp, and names of [study.draw]";

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
    parsed: Arc<Parsed>,
}

impl PartialEq for Formula {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

impl Formula {
    /// # Errors
    /// A text that is no formula.
    pub(crate) fn new(text: String) -> Result<Self, Fault> {
        if text.len() > LONGEST {
            return Err(Fault::new(format!("the formula has more than {LONGEST} characters"), "divide it by draws"));
        }
        let parsed = Parsed::parse(&text).map_err(|e| Fault::new(format!("not a formula: {e}"), HELP))?;
        Ok(Self { text, parsed: Arc::new(parsed) })
    }

    /// The value of the formula.
    ///
    /// # Errors
    /// A variable without a value, and a value that is not finite.
    pub(crate) fn evaluate(&self, mut value: impl FnMut(&str) -> Result<f64, Fault>) -> Result<f64, Fault> {
        let Self { text, parsed } = self;
        let values: Vec<f64> = parsed.var_names().iter().map(|name| value(name)).collect::<Result<_, _>>()?;
        match parsed.eval(&values) {
            Ok(number) if number.is_finite() => Ok(number),
            Ok(number) => Err(Fault::new(format!("`{text}` is {number}"), "let it be finite for all draws")),
            Err(e) => Err(Fault::new(format!("`{text}` has no value: {e}"), HELP)),
        }
    }
}

/// # Errors
/// The name of a draw that a formula reads in another way, as `e`, which is a constant, or `my-draw`, a difference.
pub(crate) fn check_name(name: &str) -> Result<(), Fault> {
    let is_name = Parsed::parse(name).is_ok_and(|formula| formula.var_names() == [name]);
    if is_name && !name.contains(['{', '}', ' ']) {
        return Ok(());
    }
    let help = "use letters, digits and _, and no name of a function or a constant, such as `e`, `PI` or `max`";
    Err(Fault::new(format!("a formula does not read `{name}` as the name of a draw"), help))
}

/// The unit in which a draw counts in formulas: that of its first value. A plain zero has any unit.
pub(crate) fn unit_of(template: &Template, draws: &BTreeMap<String, Template>, depth: usize) -> Option<String> {
    /// Draws that refer to others.
    const DEEPEST: usize = 64;
    match template {
        // Words such as the name of a material have no unit.
        Template::Fixed(value) => Quantity::of(value).filter(|q| q.number != 0.0 || !q.unit.is_empty()).map(|q| q.unit),
        Template::Drawn(distribution) => match distribution {
            Distribution::Uniform { unit, .. }
            | Distribution::LogUniform { unit, .. }
            | Distribution::Normal { unit, .. }
            | Distribution::LogNormal { unit, .. }
            | Distribution::Expression { unit, .. } => Some(unit.clone()),
            Distribution::Integer { .. } => Some(String::new()),
            Distribution::Choice { values, .. } | Distribution::Sequence { values, .. } => {
                values.iter().find_map(|value| unit_of(value, draws, depth))
            }
            Distribution::Named(name) if depth < DEEPEST => {
                draws.get(name).and_then(|template| unit_of(template, draws, depth + 1))
            }
            Distribution::Named(_) => None,
        },
        Template::List(_) | Template::Table(_) => None,
    }
}

#[cfg(test)]
#[path = "expression_tests.rs"]
mod tests;
