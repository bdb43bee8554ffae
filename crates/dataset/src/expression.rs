//! Formulas of named draws, by the crate exmex.

use crate::distribution::Fault;
use exmex::{Express, FlatEx};

/// Longer formulas are refused.
const LONGEST: usize = 1000;

fn parse(text: &str) -> Result<FlatEx<f64>, String> {
    if text.len() > LONGEST {
        return Err(format!("the formula has more than {LONGEST} characters"));
    }
    exmex::parse::<f64>(text).map_err(|e| format!("not a formula: {e}"))
}

/// The names of the variables of a formula.
pub(crate) fn variables(text: &str) -> Result<Vec<String>, String> {
    parse(text).map(|formula| formula.var_names().to_vec())
}

/// The value of a formula.
///
/// # Errors
/// A text that is no formula, a variable without a value, and a value that is not finite.
pub(crate) fn evaluate(text: &str, mut value: impl FnMut(&str) -> Result<f64, Fault>) -> Result<f64, Fault> {
    let help = "use + - * / ^, functions such as sin, sqrt and exp, and names of [study.draw]";
    let formula = parse(text).map_err(|problem| Fault::new(problem, help))?;
    let values: Vec<f64> = formula.var_names().iter().map(|name| value(name)).collect::<Result<_, _>>()?;
    match formula.eval(&values) {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(number) => Err(Fault::new(format!("`{text}` is {number}"), "let it be finite for all draws")),
        Err(e) => Err(Fault::new(format!("`{text}` has no value: {e}"), help)),
    }
}
