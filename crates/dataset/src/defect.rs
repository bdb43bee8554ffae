//! `[[study.defect]]`: defects with drawn parameters.

use crate::defects::{
    DefectKind, DefectProblem, DefectSpec, PlacedDefect, SMALLEST, add_defect, check_numbers, has_surface,
};
use crate::distribution::{Distribution, Fault, Named, Template};
use crate::draws::Draws;
use crate::label_entry::{LabelSight, Names, texts};
use crate::names::ObjectNames;
use crate::study::Study;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::names::nearest_names;
use dunkelfeld_io::quantity::{Angle, Length};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::SceneBuilder;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Value;

/// Most defects of one entry in an image.
const MOST: i64 = 1000;
/// The keys of all kinds.
const COMMON_KEYS: [&str; 5] = ["kind", "on", "name", "category", "count"];

/// The parameters of one defect, with all values drawn. Lengths are lengths \[m\], angles \[rad\].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DefectSettings {
    /// Names the draws and the objects of the entry. By default the category.
    #[serde(default)]
    #[allow(dead_code, reason = "read before the other values are drawn")]
    name: Option<String>,
    #[serde(default)]
    #[allow(dead_code, reason = "read before the other values are drawn")]
    category: Option<String>,
    kind: DefectKind,
    /// Names or patterns of the objects.
    on: Names,
    #[serde(default)]
    length: Option<Length>,
    #[serde(default)]
    width: Option<Length>,
    #[serde(default)]
    depth: Option<Length>,
    #[serde(default)]
    angle: Option<Angle>,
    #[serde(default)]
    curvature: Option<Angle>,
    #[serde(default)]
    roughness: Option<f64>,
    #[serde(default)]
    color: Option<Color>,
    #[serde(default)]
    metallic: Option<f64>,
    #[serde(default)]
    strength: Option<f64>,
    /// A direction of the world that the surface faces, within 60°.
    #[serde(default)]
    facing: Option<[f64; 3]>,
}

impl DefectSettings {
    /// Reads the values of an entry. A fault is at the key of its value.
    fn read(table: toml::Table) -> Result<Self, Fault> {
        let read = |table: toml::Table| -> Result<Self, toml::de::Error> { Value::Table(table).try_into() };
        let fault = |e: &toml::de::Error| Fault::new(e.message(), "see docs/datasets.md for the keys of defects");
        let error = match read(table.clone()) {
            Ok(settings) => return settings.on.check("on").map(|()| settings),
            Err(error) => error,
        };
        // The error does not name its key: it is the one that fails alone, beside keys that are valid.
        for (key, value) in table {
            let mut alone = toml::Table::new();
            alone.insert("kind".into(), Value::String("dust".into()));
            alone.insert("on".into(), Value::String("object".into()));
            alone.insert(key.clone(), value);
            if let Err(error) = read(alone) {
                return Err(fault(&error).below(key));
            }
        }
        Err(fault(&error))
    }
}

/// A colour: three channels, or one number for all of them.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected a colour: [r, g, b], or one number for all three")]
enum Color {
    Gray(f64),
    Channels([f64; 3]),
}

impl Color {
    fn channels(self) -> [f64; 3] {
        match self {
            Self::Gray(value) => [value; 3],
            Self::Channels(channels) => channels,
        }
    }
}

/// An entry of the study, as far as it is the same in all images.
#[derive(Clone, Debug)]
pub(crate) struct DefectEntry {
    /// The number of the entry.
    number: usize,
    /// Name of draws and objects.
    name: String,
    pub(crate) category: String,
    kind: DefectKind,
    count: Template,
    /// Most defects of an image.
    most: u32,
    rest: BTreeMap<String, Template>,
}

/// A defect in the scene of an image.
#[derive(Clone, Debug)]
pub(crate) struct AddedDefect {
    /// The number of its entry.
    pub(crate) entry: usize,
    kind: DefectKind,
    pub(crate) placed: PlacedDefect,
}

impl AddedDefect {
    /// True if the defect is a change of an object.
    pub(crate) fn is_change(&self) -> bool {
        self.kind.is_change()
    }

    /// The places where its label is seen.
    pub(crate) fn sight(&self) -> LabelSight {
        match (self.kind, self.placed.is_clear) {
            (DefectKind::Shifted, _) => LabelSight::Surface,
            (DefectKind::Missing | DefectKind::Faded, true) => LabelSight::Behind,
            _ => LabelSight::Everywhere,
        }
    }

    /// The kind as a study has it.
    pub(crate) fn kind(&self) -> String {
        format!("{:?}", self.kind).to_lowercase()
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
        for entry in entries.iter().filter(|entry| entry.kind.is_change() == is_change) {
            entry.apply(study, scene, draws, drawn, &mut added)?;
        }
    }
    // A changed object has the label of its defect. Until here it has the name that the study gives it.
    for AddedDefect { placed, .. } in added.iter().filter(|defect| defect.kind.is_change()) {
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
        let at = |fault: Fault| (number, fault);
        let rest: BTreeMap<String, Template> = match template {
            Template::Table(rest) => rest.clone(),
            Template::Fixed(Value::Table(table)) => {
                table.iter().map(|(key, value)| (key.clone(), Template::Fixed(value.clone()))).collect()
            }
            _ => return Err(at(Fault::new("the entry is no table", "write [[study.defect]] and its keys"))),
        };
        let text = |key: &str| match rest.get(key) {
            None => Ok(None),
            Some(Template::Fixed(Value::String(text))) if !text.is_empty() => Ok(Some(text.clone())),
            Some(_) => Err((number, Fault::new("not a text, the same in all images", "write it in quotes").below(key))),
        };
        let kind = text("kind")?.ok_or_else(|| {
            at(Fault::new("the entry has no `kind`", "write `kind = \"scratch\"`, or another one of docs/datasets.md"))
        })?;
        let known = check_keys(&kind, &rest).map_err(at)?;
        let category = text("category")?.unwrap_or(kind);
        let mut name = text("name")?.unwrap_or_else(|| category.clone());
        if entries.iter().any(|entry| entry.name == name) {
            name = format!("{name} #{}", number + 1);
            if let Some(other) = entries.iter().find(|entry| entry.name == name) {
                let problem = format!("the name of this entry is \"{name}\", as that of entry {}", other.number + 1);
                return Err(at(Fault::new(problem, "give each entry its own `name`")));
            }
        }
        let count = rest.get("count").cloned().unwrap_or(Template::Fixed(Value::Integer(1)));
        let most = most(&count, study, &mut BTreeMap::new()).map_err(|e| at(e.below("count")))?;
        entries.push(DefectEntry { number, name, category, kind: known, count, most: most as u32, rest });
    }
    Ok(entries)
}

fn no_object() -> Fault {
    Fault::new("no object has such a name", "`dunkelfeld inspect` lists the objects").below("on")
}

/// Refuses an unknown kind, keys that the kind does not use, which would have no effect, and the lack of a key.
fn check_keys(kind: &str, entry: &BTreeMap<String, Template>) -> Result<DefectKind, Fault> {
    let Ok(known) = Value::String(kind.into()).try_into::<DefectKind>() else {
        let list = DefectKind::NAMES.join(", ");
        let help = match nearest_names(kind, DefectKind::NAMES).first() {
            Some(near) => format!("did you mean \"{near}\"? The kinds are {list}"),
            None => format!("the kinds are {list}"),
        };
        return Err(Fault::new(format!("there is no kind \"{kind}\" of defects"), help).below("kind"));
    };
    let keys = || COMMON_KEYS.iter().chain(known.keys()).copied();
    match entry.keys().find(|key| !keys().any(|known| known == *key)) {
        None => {}
        Some(key) => {
            let help = format!("the keys of `kind = \"{kind}\"` are {}", keys().collect::<Vec<_>>().join(", "));
            let problem = format!("the kind \"{kind}\" does not use the key `{key}`");
            return Err(Fault::new(problem, help).below(key));
        }
    }
    if let Some(key) = known.required().iter().find(|key| !entry.contains_key(**key)) {
        let problem = format!("a defect with `kind = \"{kind}\"` needs the key `{key}`");
        return Err(Fault::new(problem, format!("write a length, for example `{key} = \"1mm\"`")));
    }
    if !entry.contains_key("on") {
        return Err(Fault::new("a defect needs the key `on`", "write names or patterns of objects"));
    }
    Ok(known)
}

/// The largest number of defects that a template can give. That of a formula is the largest one that is allowed. `known`
/// has the numbers of the draws that were read.
fn most<'a>(
    count: &'a Template,
    study: &'a Study,
    known: &mut BTreeMap<&'a str, Result<i64, Fault>>,
) -> Result<i64, Fault> {
    let help =
        "write a whole number, { integer = [0, 3] }, a choice of whole numbers, a draw of these, or an expression";
    let largest = match count {
        Template::Fixed(Value::Integer(n)) => *n,
        Template::Drawn(Distribution::Integer { high, .. }) => *high,
        Template::Drawn(Distribution::Choice { values, .. } | Distribution::Sequence { values, .. }) => {
            let numbers: Vec<i64> = values.iter().map(|value| most(value, study, known)).collect::<Result<_, _>>()?;
            numbers.into_iter().max().unwrap_or(0)
        }
        Template::Drawn(Distribution::Named(name)) => {
            if let Some(found) = known.get(name.as_str()) {
                return found.clone();
            }
            let Some(template) = study.named_template(name) else { return Ok(MOST) };
            // For draws that depend on themselves, which are refused elsewhere.
            known.insert(name, Ok(MOST));
            let found = most(template, study, known)
                .map_err(|fault| Fault::new(format!("in the draw `{name}`: {}", fault.problem), fault.help));
            known.insert(name, found.clone());
            found?
        }
        Template::Drawn(Distribution::Expression { unit, .. }) if unit.is_empty() => MOST,
        _ => return Err(Fault::new("the largest number of defects is not known", help)),
    };
    if (0..=MOST).contains(&largest) {
        return Ok(largest);
    }
    Err(Fault::new(format!("{largest} defects are out of range"), "write a whole number from 0 to 1000"))
}

impl DefectEntry {
    fn object_name(&self, number: u32) -> String {
        format!("{} {number}", self.name)
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
        let prefix = format!("defect[{}]", self.name);
        let mut record = |name: &str, value: &Value| drop(drawn.insert(name.to_owned(), value.clone()));
        let count = self.number(draws, &mut named, &mut record).map_err(at)?;
        for number in 1..=count {
            let place = format!("{prefix}[{number}]");
            let settings = self.settings(&place, draws, &mut named, &mut record).map_err(at)?;
            // An image may lack the objects of a defect, and then has no such defect.
            if !scene.instances.iter().any(|object| settings.on.match_name(&object.name)) {
                continue;
            }
            let is_free = |object: &usize| {
                let is_changed = added.iter().any(|d| d.kind.is_change() && d.placed.host == *object);
                !is_changed || (!self.kind.is_change() && has_surface(scene, *object))
            };
            // An object whose name is not known before the first image, as one of a number of copies by a formula.
            let name = self.object_name(number);
            if scene.instances.iter().any(|object| object.name == name) {
                return Err(at(self.same_name(&name)));
            }
            let mut spec = self.spec(settings, name, scene).map_err(at)?;
            spec.on.retain(is_free);
            if spec.on.is_empty() {
                let reason = if self.kind.is_change() {
                    "not made: each of its objects is missing, faded or shifted already"
                } else {
                    "not made: each of its objects is missing or faded in full"
                };
                record(&place, &Value::String(reason.into()));
                continue;
            }
            let mut stream = draws.stream(&format!("{place}.place"));
            let placed = add_defect(scene, &spec, &mut stream).map_err(|e| at(self.fault(e)))?;
            added.push(AddedDefect { entry: self.number, kind: self.kind, placed });
        }
        Ok(())
    }

    /// The number of defects of an image.
    fn number(&self, draws: Draws, named: &mut dyn Named, record: &mut dyn FnMut(&str, &Value)) -> Result<u32, Fault> {
        let name = format!("defect[{}].count", self.name);
        let value = self.count.draw(draws, &name, named, record).map_err(|e| e.below("count"))?;
        let number = value.as_integer().and_then(|n| u32::try_from(n).ok()).filter(|n| *n <= self.most);
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

    /// Of an entry that changes more objects than there are: its name, the largest number of changes, and the number of
    /// objects. `None` for other entries, and for a number by a formula.
    pub(crate) fn excess(&self, study: &Study, names: &ObjectNames<'_>) -> Option<(&str, u32, usize)> {
        let draws = study.draws(0);
        let place = format!("defect[{}][1]", self.name);
        let settings = self.settings(&place, draws, &mut study.named(draws), &mut |_, _| {}).ok()?;
        let objects = names.listed().iter().filter(|name| settings.on.match_name(name)).count();
        let is_more = self.kind.is_change() && i64::from(self.most) < MOST && self.most as usize > objects;
        is_more.then_some((self.name.as_str(), self.most, objects))
    }

    /// Settings of the first defect of image 0 that do no harm and have hardly a sense, in sentences: a length of more than
    /// the scene [m], and a name that is there twice.
    pub(crate) fn doubts(&self, study: &Study, scene: f64) -> Vec<String> {
        let draws = study.draws(0);
        let place = format!("defect[{}][1]", self.name);
        let Ok(settings) = self.settings(&place, draws, &mut study.named(draws), &mut |_, _| {}) else {
            return Vec::new();
        };
        let is_long = |length: &f64| *length > scene && !self.kind.is_change() && self.kind != DefectKind::Fibre;
        let length =
            settings.length.map(|length| length.0).filter(is_long).map(|length| {
                format!("a defect \"{}\" is {length} m long, and the whole scene {scene:.3} m", self.name)
            });
        let name = settings.on.repeated();
        let name = name.map(|name| format!("the entry \"{}\" of [[study.defect]] has \"{name}\" twice", self.name));
        length.into_iter().chain(name).collect()
    }

    /// Checks the number of defects of an image.
    pub(crate) fn check_count(&self, study: &Study, index: u64) -> Result<(), (usize, Fault)> {
        let draws = study.draws(index);
        let number = self.number(draws, &mut study.named(draws), &mut |_, _| {});
        number
            .map(drop)
            .map_err(|fault| (self.number, Fault { problem: format!("image {index}: {}", fault.problem), ..fault }))
    }

    /// The parameters of a defect.
    fn settings(
        &self,
        place: &str,
        draws: Draws,
        named: &mut dyn Named,
        record: &mut dyn FnMut(&str, &Value),
    ) -> Result<DefectSettings, Fault> {
        let mut table = toml::Table::new();
        for (key, template) in self.rest.iter().filter(|(key, _)| *key != "count") {
            let value = template.draw(draws, &format!("{place}.{key}"), named, record).map_err(|e| e.below(key))?;
            table.insert(key.clone(), value);
        }
        DefectSettings::read(table)
    }

    /// A defect with the name of an object would be one instance with it.
    fn same_name(&self, name: &str) -> Fault {
        let problem = format!("a defect of this entry is called \"{name}\", and so is an object");
        let own = if self.rest.contains_key("name") { "another `name`" } else { "a `name`" };
        let help =
            format!("give the entry {own}: its defects are called by it and a number, and the object keeps its name");
        let fault = Fault::new(problem, help);
        match ["name", "category", "kind"].into_iter().find(|key| self.rest.contains_key(*key)) {
            Some(key) => fault.below(key),
            None => fault,
        }
    }

    /// Checks the entry before the first image: its keys, that an image has its objects, and that no object has the name of
    /// one of its defects.
    pub(crate) fn check(&self, study: &Study, names: &mut ObjectNames<'_>) -> Result<(), (usize, Fault)> {
        self.check_count(study, 0)?;
        if let Some(name) = (1..=self.most).map(|n| self.object_name(n)).find(|name| names.has(name)) {
            return Err((self.number, self.same_name(&name)));
        }
        let draws = study.draws(0);
        let place = format!("defect[{}][1]", self.name);
        let settings = self.settings(&place, draws, &mut study.named(draws), &mut |_, _| {});
        let own = self.rest.get("on").map(|value| study.alternatives_of(value));
        let checked = settings.and_then(|settings| {
            let patterns = own.iter().flatten().flat_map(texts).chain(settings.on.patterns().to_vec());
            names.check(patterns).map_err(|fault| fault.below("on"))
        });
        checked.and_then(|()| self.check_constants()).map_err(|fault| (self.number, fault))
    }

    /// Checks the values that are the same in all images. Image 0 may have no defect of the entry.
    fn check_constants(&self) -> Result<(), Fault> {
        /// Drawn sizes are any that let the constant ones be valid \[m\].
        const LONG: f64 = 1e6;
        let mut table = toml::Table::new();
        table.insert("on".into(), Value::String("*".into()));
        for (key, template) in &self.rest {
            if let Template::Fixed(value) = template
                && key != "count"
            {
                table.insert(key.clone(), value.clone());
            }
        }
        let mut settings = DefectSettings::read(table)?;
        let length = settings.length.get_or_insert(Length(LONG)).0;
        settings.width.get_or_insert(Length(length));
        settings.depth.get_or_insert(Length(SMALLEST));
        let spec = self.values(settings, self.name.clone())?;
        check_numbers(&spec).map_err(|problem| self.fault(problem))
    }

    /// A problem of a defect, at the key of the entry that has the value at fault.
    fn fault(&self, DefectProblem { problem, help, key }: DefectProblem) -> Fault {
        let fault = Fault::new(problem, help);
        match key.filter(|key| self.rest.contains_key(*key)) {
            Some(key) => fault.below(key),
            None => fault,
        }
    }

    fn spec(&self, settings: DefectSettings, name: String, scene: &SceneBuilder) -> Result<DefectSpec, Fault> {
        let on: Vec<usize> =
            (0..scene.instances.len()).filter(|i| settings.on.match_name(&scene.instances[*i].name)).collect();
        if on.is_empty() {
            return Err(no_object());
        }
        Ok(DefectSpec { on, ..self.values(settings, name)? })
    }

    /// The values of a defect without its candidates.
    fn values(&self, settings: DefectSettings, name: String) -> Result<DefectSpec, Fault> {
        let share = |key: &str, value: Option<f64>| match value {
            Some(v) if !(0.0..=1.0).contains(&v) => {
                Err(Fault::new(format!("{v} is out of range"), "write a number from 0 to 1").below(key))
            }
            v => Ok(v),
        };
        let length = |value: Option<Length>| value.map_or(0.0, |l| l.0);
        let color = match settings.color.map(Color::channels) {
            Some(color) if !color.iter().all(|v| (0.0..=1.0).contains(v)) => {
                return Err(
                    Fault::new("not a colour", "write three numbers from 0 to 1, or one for all three").below("color")
                );
            }
            color => color.map(|[r, g, b]| Rgb::new(r as f32, g as f32, b as f32)),
        };
        Ok(DefectSpec {
            name,
            kind: settings.kind,
            on: Vec::new(),
            length: length(settings.length),
            width: length(settings.width),
            depth: length(settings.depth),
            angle: settings.angle.map(|a| a.0),
            curvature: settings.curvature.map_or(0.0, |a| a.0),
            roughness: share("roughness", settings.roughness)?,
            color,
            metallic: share("metallic", settings.metallic)?,
            strength: share("strength", settings.strength)?.unwrap_or(1.0),
            facing: settings.facing.map(DVec3::from),
        })
    }
}

#[cfg(test)]
#[path = "defect_tests.rs"]
mod tests;
