//! The named draws of one image, computed when they are needed.

use crate::distribution::{Fault, Named, Template, no_number};
use crate::draws::Draws;
use crate::expression::unit_of;
use crate::quantity::Quantity;
use std::collections::BTreeMap;
use toml::Value;

/// The longest chain of named draws.
const DEEPEST: usize = 64;

/// The named draws of one image.
pub(crate) struct NamedDraws<'a> {
    templates: &'a BTreeMap<String, Template>,
    draws: Draws,
    pub(crate) values: BTreeMap<String, Value>,
    /// Draws that wait for others.
    pending: Vec<String>,
}

impl<'a> NamedDraws<'a> {
    /// The draws of an image, of which none has a value yet.
    pub(crate) fn new(templates: &'a BTreeMap<String, Template>, draws: Draws) -> Self {
        Self { templates, draws, values: BTreeMap::new(), pending: Vec::new() }
    }
}

impl Named for NamedDraws<'_> {
    fn value(&mut self, name: &str) -> Result<Value, Fault> {
        if let Some(value) = self.values.get(name) {
            return Ok(value.clone());
        }
        let Some(template) = self.templates.get(name) else {
            let names: Vec<&str> = self.templates.keys().map(String::as_str).collect();
            let help = match names.as_slice() {
                [] => "add it to [study.draw]".to_owned(),
                _ => format!("the draws of [study.draw] are {}", names.join(", ")),
            };
            return Err(Fault::new(format!("there is no draw `{name}`"), help));
        };
        if self.pending.len() >= DEEPEST {
            let problem = format!("more than {DEEPEST} draws wait for each other");
            return Err(Fault::new(problem, "shorten the chain of draws"));
        }
        if self.pending.iter().any(|pending| pending == name) {
            let problem = format!("the draw `{name}` depends on itself");
            return Err(Fault::new(problem, "let one of the draws not refer to the others"));
        }
        self.pending.push(name.to_owned());
        let drawn = template.draw(self.draws, &format!("draw.{name}"), self, &mut |_, _| {});
        self.pending.pop();
        let value = drawn.map_err(|fault| in_draw(fault, name))?;
        self.values.insert(name.to_owned(), value.clone());
        Ok(value)
    }

    /// In the unit of the draw, which is the same in all images.
    fn number(&mut self, name: &str) -> Result<f64, Fault> {
        let value = self.value(name)?;
        let quantity = Quantity::of(&value).ok_or_else(|| no_number(name, &value))?;
        let template = self.templates.get(name);
        let unit = template.and_then(|template| unit_of(template, self.templates, 0)).unwrap_or_default();
        quantity.number_in(&unit).ok_or_else(|| {
            let problem = format!("the draw `{name}` is {value}, and a formula counts it in \"{unit}\"");
            Fault::new(problem, "write all values of the draw in units of one kind")
        })
    }
}

/// A fault inside of a draw, for the key that refers to it: with the name of the draw that has the fault.
fn in_draw(fault: Fault, name: &str) -> Fault {
    let is_named = fault.problem.contains(" draw `");
    let problem = if is_named { fault.problem } else { format!("in the draw `{name}`: {}", fault.problem) };
    Fault { path: Vec::new(), problem, help: fault.help }
}
