//! Names of the objects that the images of a study have.

use crate::distribution::Template;
use crate::study::Study;
use dunkelfeld::{Error, Project};
use dunkelfeld_io::job::Job;
use std::collections::BTreeSet;

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
        };
        names.extend(project.scene.object_names().to_vec());
        if !may_vary(&study.template) {
            names.next = SEARCHED;
        }
        while names.next < LISTED {
            names.read_next();
        }
        names.listed = names.names.len();
        names
    }

    /// The names that get ids in their order.
    pub(crate) fn listed(&self) -> &[String] {
        &self.names[..self.listed]
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

/// Can the images of a study have different objects?
fn may_vary(template: &Template) -> bool {
    const KEYS: [&str; 7] = ["name", "kind", "visible", "instances", "grid", "enabled", "count"];
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
