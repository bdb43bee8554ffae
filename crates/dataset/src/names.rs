//! Names of the objects that the images of a study have.

use crate::distribution::{Fault, Template};
use crate::study::Study;
use dunkelfeld::{Error, Project};
use dunkelfeld_io::job::Job;
use std::collections::BTreeSet;
use toml::Value;

/// Images whose objects get ids in their order.
const LISTED: u64 = 64;
/// Images that are searched for a name before it counts as missing. An object of one image in 500 is missed with a
/// probability of 0.0003.
const SEARCHED: u64 = 4096;

/// The names of the objects of a study without its defects: those of image 0, then those that the next images add. They
/// are a function of the study, and no scene is built for them.
pub(crate) struct ObjectNames<'a> {
    study: &'a Study,
    project: &'a Project,
    names: Vec<String>,
    known: BTreeSet<String>,
    /// What decides about the names, of each image before.
    variants: BTreeSet<String>,
    next: u64,
    listed: usize,
    /// Names of later images, as far as the study has them.
    rare: Vec<String>,
}

impl<'a> ObjectNames<'a> {
    /// The names of a study. `project` is its image 0.
    pub(crate) fn new(study: &'a Study, project: &'a Project) -> Self {
        let mut names = Self {
            study,
            project,
            names: Vec::new(),
            known: BTreeSet::new(),
            variants: BTreeSet::new(),
            next: 0,
            listed: 0,
            rare: Vec::new(),
        };
        names.extend(project.scene.object_names().to_vec());
        if !may_vary(&study.template) {
            names.next = SEARCHED;
        }
        while names.next < LISTED {
            names.read_next();
        }
        names.listed = names.names.len();
        if may_vary(&study.template) {
            names.add_rare();
        }
        names
    }

    /// The names of objects that the first images do not have, as far as they follow from the study without a draw: each
    /// alternative of a name, a scene or a kind, all that may be visible, and the largest numbers of copies.
    pub(crate) fn rare(&self) -> &[String] {
        &self.rare
    }

    fn add_rare(&mut self) {
        /// Alternatives that are tried.
        const MOST: usize = 256;
        let study = self.study;
        let alternatives = |value: &Template| study.alternatives_of(value);
        let count = widest(&study.template, &|value| alternatives(value).len()).clamp(1, MOST);
        for k in 0..count {
            let template = extreme(&study.template, &|value| {
                let values = alternatives(value);
                values.get(k % values.len().max(1)).cloned()
            });
            let Ok(drawn) = study.with_template(template).job(0) else { continue };
            let Ok(job) = Job::from_text(study.job_path(), drawn.text) else { continue };
            if !self.variants.insert(variant(&job)) {
                continue;
            }
            let Ok(found) = self.project.object_names_of(&job) else { continue };
            for name in found {
                if !self.known.contains(&name) && !self.rare.contains(&name) {
                    self.rare.push(name);
                }
            }
        }
    }

    /// The names that get ids in their order.
    pub(crate) fn listed(&self) -> &[String] {
        &self.names[..self.listed]
    }

    /// Is this the name of an object, as far as the names are known?
    pub(crate) fn has(&self, name: &str) -> bool {
        self.known.contains(name) || self.rare.iter().any(|rare| rare == name)
    }

    /// Has one of the images an object whose name matches?
    pub(crate) fn any(&mut self, matches: impl Fn(&str) -> bool) -> bool {
        let mut from = 0;
        loop {
            if self.names[from..].iter().any(|name| matches(name)) {
                return true;
            }
            from = self.names.len();
            if self.next >= SEARCHED {
                return false;
            }
            self.read_next();
        }
    }

    /// Has one of the images an object for each of these patterns?
    ///
    /// # Errors
    /// A pattern that matches no object.
    pub(crate) fn check(&mut self, patterns: impl IntoIterator<Item = String>) -> Result<(), Fault> {
        for pattern in patterns.into_iter().collect::<BTreeSet<_>>() {
            if !self.any(|name| dunkelfeld_io::job::matches(&pattern, name)) {
                let problem = format!("no object is called \"{pattern}\"");
                return Err(Fault::new(problem, "`dunkelfeld inspect` lists the objects"));
            }
        }
        Ok(())
    }

    fn extend(&mut self, names: Vec<String>) {
        for name in names {
            if self.known.insert(name.clone()) {
                self.names.push(name);
            }
        }
    }

    /// Adds the names of the next image. An image with an error has none here: it is reported when the image is made.
    fn read_next(&mut self) {
        let index = self.next;
        self.next += 1;
        let Ok(drawn) = self.study.job(index) else { return };
        let Ok(job) = Job::from_text(self.study.job_path(), drawn.text) else { return };
        let variant = variant(&job);
        if self.variants.contains(&variant) {
            return;
        }
        let read: Result<Vec<String>, Error> = self.project.object_names_of(&job);
        if let Ok(found) = read {
            self.extend(found);
            self.variants.insert(variant);
        }
    }
}

/// The keys of an object or a light that decide about names.
const KEYS: [&str; 7] = ["name", "kind", "visible", "instances", "grid", "enabled", "count"];

/// The values that decide about the names of the objects, changed by a function; each other one stays.
fn extreme(template: &Template, of: &dyn Fn(&Template) -> Option<Value>) -> Template {
    let replaced = |value: &Template| of(value).map_or_else(|| value.clone(), Template::Fixed);
    let Template::Table(keys) = template else { return template.clone() };
    let entry = |item: &Template| match item {
        Template::Table(entry) => {
            let entry = entry.iter().map(|(key, value)| {
                let value = match (key.as_str(), value) {
                    (_, Template::Fixed(_)) => value.clone(),
                    ("visible" | "enabled", _) => Template::Fixed(Value::Boolean(true)),
                    (key, _) if KEYS.contains(&key) => replaced(value),
                    _ => value.clone(),
                };
                (key.clone(), value)
            });
            Template::Table(entry.collect())
        }
        item => item.clone(),
    };
    let keys = keys.iter().map(|(key, value)| {
        let value = match (key.as_str(), value) {
            ("scene" | "import", _) => replaced(value),
            ("object" | "light", Template::List(items)) => Template::List(items.iter().map(entry).collect()),
            _ => value.clone(),
        };
        (key.clone(), value)
    });
    Template::Table(keys.collect())
}

/// The largest number of alternatives of the values that decide about the names of the objects.
fn widest(template: &Template, count: &dyn Fn(&Template) -> usize) -> usize {
    let most = std::cell::Cell::new(0);
    extreme(template, &|value| {
        most.set(most.get().max(count(value)));
        None
    });
    most.get()
}

/// Can the images of a study have different objects?
fn may_vary(template: &Template) -> bool {
    let is_drawn = |value: Option<&Template>| value.is_some_and(|value| !matches!(value, Template::Fixed(_)));
    let Template::Table(keys) = template else { return !matches!(template, Template::Fixed(_)) };
    is_drawn(keys.get("scene"))
        || is_drawn(keys.get("import"))
        || ["object", "light"].iter().filter_map(|key| keys.get(*key)).any(|list| match list {
            Template::Fixed(_) => false,
            Template::List(items) => items.iter().any(|item| match item {
                Template::Table(entry) => KEYS.iter().any(|key| is_drawn(entry.get(*key))),
                item => is_drawn(Some(item)),
            }),
            _ => true,
        })
}

/// The keys of a job that decide about the names of its objects.
fn variant(job: &Job) -> String {
    let objects: Vec<_> = (job.objects.iter())
        .map(|o| (&o.name, o.kind, o.visible, o.instances.len(), o.grid.map(|grid| grid.count)))
        .collect();
    let lights: Vec<_> = job.lights.iter().map(|l| (&l.name, l.kind, l.enabled, l.count)).collect();
    format!("{:?} {:?} {objects:?} {lights:?}", job.scene, job.import)
}
