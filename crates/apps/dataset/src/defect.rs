//! `[[study.defect]]`: defects with drawn parameters.

use crate::defects::{Defect, DefectSpec, PlacedDefect, add_defect, has_surface};
use crate::distribution::{Distribution, Fault, Named, Template};
use crate::draws::Draws;
use crate::label_entry::{LabelSight, Names};
use crate::names::ObjectNames;
use crate::study::Study;
use dunkelfeld_scene::SceneBuilder;
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Most defects of one entry in an image.
const MOST: u32 = 1000;

/// An entry of the study, as far as it is the same in all images.
#[derive(Clone, Debug)]
pub(crate) struct DefectEntry {
    /// The number of the entry.
    number: usize,
    /// Name of draws and objects.
    name: String,
    pub(crate) category: String,
    kind: String,
    count: Template,
    /// Names or patterns of the objects.
    on: Template,
    /// The keys of the kind.
    keys: BTreeMap<String, Template>,
}

/// A defect in the scene of an image.
#[derive(Clone, Debug)]
pub(crate) struct AddedDefect {
    /// The number of its entry.
    pub(crate) entry: usize,
    /// The kind as a study has it.
    pub(crate) kind: String,
    pub(crate) placed: PlacedDefect,
}

/// Is the kind a change of an object, which adds none?
fn is_change(kind: &str) -> bool {
    ["missing", "faded", "shifted"].contains(&kind)
}

impl AddedDefect {
    /// True if the defect is a change of an object.
    pub(crate) fn is_change(&self) -> bool {
        is_change(&self.kind)
    }

    /// The places where its label is seen.
    pub(crate) fn sight(&self) -> LabelSight {
        match (self.kind.as_str(), self.placed.is_clear) {
            // A decal may cover nothing at places.
            ("shifted" | "decal", _) => LabelSight::Surface,
            ("missing" | "faded", true) => LabelSight::Behind,
            _ => LabelSight::Everywhere,
        }
    }
}

/// Adds the defects of an image to its scene: first all changes of objects, then the other defects, so that these follow an
/// object that is shifted, and are not made on one that is missing or faded in full. An object changes at most once. `drawn` receives all that
/// was drawn, and the reason why a defect is not made.
///
/// # Errors
/// The number of the entry, and the fault.
pub(crate) fn add_defects(
    entries: &[DefectEntry],
    study: &Study,
    scene: &mut SceneBuilder,
    draws: Draws,
    drawn: &mut BTreeMap<String, Value>,
) -> Result<Vec<AddedDefect>, (usize, Fault)> {
    let mut added: Vec<AddedDefect> = Vec::new();
    for is_change in [true, false] {
        for entry in entries.iter().filter(|entry| entry.is_change() == is_change) {
            entry.apply(study, scene, draws, drawn, &mut added)?;
        }
    }
    // A changed object has the label of its defect. Until here it has the name that the study gives it.
    for AddedDefect { placed, .. } in added.iter().filter(|defect| defect.is_change()) {
        if let Some(object) = scene.instances.get_mut(placed.host) {
            object.name.clone_from(&placed.object);
        }
    }
    Ok(added)
}

/// The entries of a study.
pub(crate) fn entries(study: &Study) -> Result<Vec<DefectEntry>, (usize, Fault)> {
    let mut entries: Vec<DefectEntry> = Vec::new();
    for (number, template) in study.defect.iter().enumerate() {
        let mut keys: BTreeMap<String, Template> = match template {
            Template::Table(keys) => keys.clone(),
            Template::Fixed(Value::Table(table)) => {
                table.iter().map(|(key, value)| (key.clone(), Template::Fixed(value.clone()))).collect()
            }
            _ => return Err((number, Fault::new("the entry is no table", "write [[study.defect]] and its keys"))),
        };
        let mut text = |key: &str| match keys.remove(key) {
            None => Ok(None),
            Some(Template::Fixed(Value::String(text))) if !text.is_empty() => Ok(Some(text)),
            Some(_) => Err((number, Fault::new("not a text, the same in all images", "write it in quotes").below(key))),
        };
        let lacks = |key: &str, help: &str| (number, Fault::new(format!("a defect needs the key `{key}`"), help));
        let kind = text("kind")?
            .ok_or_else(|| lacks("kind", "write `kind = \"scratch\"`, or another one of docs/datasets.md"))?;
        let category = text("category")?.unwrap_or_else(|| kind.clone());
        let mut name = text("name")?.unwrap_or_else(|| category.clone());
        if entries.iter().any(|entry| entry.name == name) {
            name = format!("{name} #{}", number + 1);
        }
        let count = keys.remove("count").unwrap_or(Template::Fixed(Value::Integer(1)));
        let on = keys.remove("on").ok_or_else(|| lacks("on", "write names or patterns of objects"))?;
        entries.push(DefectEntry { number, name, category, kind, count, on, keys });
    }
    Ok(entries)
}

impl DefectEntry {
    fn is_change(&self) -> bool {
        is_change(&self.kind)
    }

    /// The name of the draws of a defect, from 1 on.
    fn place(&self, number: u32) -> String {
        format!("defect[{}][{number}]", self.name)
    }

    /// Adds the defects of the entry to the scene of an image.
    fn apply(
        &self,
        study: &Study,
        scene: &mut SceneBuilder,
        draws: Draws,
        drawn: &mut BTreeMap<String, Value>,
        added: &mut Vec<AddedDefect>,
    ) -> Result<(), (usize, Fault)> {
        let at = |fault: Fault| (self.number, fault);
        let mut named = study.named(draws);
        let mut record = |name: &str, value: &Value| drop(drawn.insert(name.to_owned(), value.clone()));
        let count = self.number(draws, &mut named, &mut record).map_err(at)?;
        for number in 1..=count {
            let place = self.place(number);
            let (names, defect) = self.draw(&place, draws, &mut named, &mut record).map_err(at)?;
            let objects = scene.instances.iter().enumerate().filter(|(_, object)| names.match_name(&object.name));
            let on: Vec<usize> = objects.map(|(i, _)| i).collect();
            // An image may lack the objects of a defect, and then has no such defect.
            if on.is_empty() {
                continue;
            }
            let name = format!("{} {number}", self.name);
            if scene.instances.iter().any(|object| object.name == name) {
                // It would be one instance with the object.
                let problem = format!("a defect of this entry is called \"{name}\", and so is an object");
                let help = "give the entry another `name`: its defects are called by it and a number";
                return Err(at(Fault::new(problem, help).below("name")));
            }
            let is_free = |object: &usize| {
                let is_changed = added.iter().any(|d| d.is_change() && d.placed.host == *object);
                !is_changed || (!self.is_change() && has_surface(scene, *object))
            };
            let on: Vec<usize> = on.into_iter().filter(is_free).collect();
            if on.is_empty() {
                let reason = if self.is_change() {
                    "not made: each of its objects is missing, faded or shifted already"
                } else {
                    "not made: each of its objects is missing or faded in full"
                };
                record(&place, &Value::String(reason.into()));
                continue;
            }
            let mut stream = draws.stream(&format!("{place}.place"));
            let image = study.picture(&defect).map_err(at)?;
            let placed = add_defect(scene, &DefectSpec { name, on, image, defect }, &mut stream).map_err(at)?;
            added.push(AddedDefect { entry: self.number, kind: self.kind.clone(), placed });
        }
        Ok(())
    }

    /// The number of defects of an image.
    fn number(&self, draws: Draws, named: &mut dyn Named, record: &mut dyn FnMut(&str, &Value)) -> Result<u32, Fault> {
        let name = format!("defect[{}].count", self.name);
        let value = self.count.draw(draws, &name, named, record).map_err(|e| e.below("count"))?;
        let number = value.as_integer().and_then(|n| u32::try_from(n).ok()).filter(|n| *n <= MOST);
        number.ok_or_else(|| {
            let draw = match &self.count {
                Template::Drawn(Distribution::Named(draw)) => format!(", by the draw `{draw}`"),
                _ => String::new(),
            };
            let problem = format!("the number of defects \"{}\" is {value}{draw}", self.name);
            let help =
                format!("let it be a whole number from 0 to {MOST}; `round` and `floor` of an expression give one");
            Fault::new(problem, help).below("count")
        })
    }

    /// Checks the number of defects of an image.
    pub(crate) fn check_count(&self, study: &Study, index: u64) -> Result<(), (usize, Fault)> {
        let draws = study.draws(index);
        let number = self.number(draws, &mut study.named(draws), &mut |_, _| {});
        number
            .map(drop)
            .map_err(|fault| (self.number, Fault { problem: format!("image {index}: {}", fault.problem), ..fault }))
    }

    /// The objects and the values of a defect.
    fn draw(
        &self,
        place: &str,
        draws: Draws,
        named: &mut dyn Named,
        record: &mut dyn FnMut(&str, &Value),
    ) -> Result<(Names, Defect), Fault> {
        let mut value = |key: &str, template: &Template| {
            template.draw(draws, &format!("{place}.{key}"), named, record).map_err(|e| e.below(key))
        };
        let on = value("on", &self.on)?;
        let keys: Table = self
            .keys
            .iter()
            .map(|(key, template)| Ok((key.clone(), value(key, template)?)))
            .collect::<Result<_, Fault>>()?;
        let names: Names = on
            .try_into()
            .map_err(|e: toml::de::Error| Fault::new(e.message(), "write names or patterns of objects").below("on"))?;
        names.check("on")?;
        Ok((names, Defect::read(&self.kind, &keys)?))
    }

    /// Checks the entry before the first image: its keys by the draws of image 0, which may have no defect of the entry, and
    /// that an image has its objects.
    pub(crate) fn check(&self, study: &Study, names: &mut ObjectNames<'_>) -> Result<(), (usize, Fault)> {
        self.check_count(study, 0)?;
        let draws = study.draws(0);
        let drawn = self.draw(&self.place(1), draws, &mut study.named(draws), &mut |_, _| {});
        let checked = drawn.and_then(|(on, _)| {
            let patterns = self.on.texts().into_iter().chain(on.patterns().to_vec());
            names.check(patterns).map_err(|fault| fault.below("on"))
        });
        checked.map_err(|fault| (self.number, fault))
    }
}

#[cfg(test)]
#[path = "defect_tests.rs"]
mod tests;
