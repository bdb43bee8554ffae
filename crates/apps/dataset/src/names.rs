//! Names of the objects that the images of a study have.

use crate::distribution::{Fault, Template};
use crate::study::Study;
use dunkelfeld::Project;
use dunkelfeld_io::job::{Job, matches};
use std::collections::BTreeSet;

/// Images that are searched for a name before it counts as missing.
const SEARCHED: u64 = 64;

/// The names of the objects of a study without its defects: those of image 0, and those that the next images add, which are
/// read when a name is not found. No scene is built for them.
pub(crate) struct ObjectNames<'a> {
    study: &'a Study,
    project: &'a Project,
    names: Vec<String>,
    known: BTreeSet<String>,
    next: u64,
}

impl<'a> ObjectNames<'a> {
    /// The names of a study. `project` is its image 0.
    pub(crate) fn new(study: &'a Study, project: &'a Project) -> Self {
        let mut names = Self { study, project, names: Vec::new(), known: BTreeSet::new(), next: 1 };
        names.extend(project.scene.object_names().to_vec());
        names
    }

    /// The names that are known.
    pub(crate) fn listed(&self) -> &[String] {
        &self.names
    }

    /// Has one of the images an object for each of these patterns? The name of an object of the study counts, also if the
    /// first images do not have it.
    ///
    /// # Errors
    /// A pattern that matches no object.
    pub(crate) fn check(&mut self, patterns: impl IntoIterator<Item = String>) -> Result<(), Fault> {
        for pattern in patterns.into_iter().collect::<BTreeSet<_>>() {
            if !self.any(&pattern) && !self.is_named(&pattern) {
                let problem = format!("no object is called \"{pattern}\"");
                return Err(Fault::new(problem, "`dunkelfeld inspect` lists the objects"));
            }
        }
        Ok(())
    }

    /// Has one of the first images an object whose name matches?
    fn any(&mut self, pattern: &str) -> bool {
        let mut from = 0;
        loop {
            if self.names[from..].iter().any(|name| matches(pattern, name)) {
                return true;
            }
            from = self.names.len();
            if self.next >= SEARCHED {
                return false;
            }
            self.read_next();
        }
    }

    /// Does an entry of `[[object]]` or `[[light]]` name an object so in some images?
    fn is_named(&self, pattern: &str) -> bool {
        let Template::Table(keys) = &self.study.template else { return false };
        let entries = ["object", "light"].iter().filter_map(|key| match keys.get(*key) {
            Some(Template::List(entries)) => Some(entries),
            _ => None,
        });
        let names = entries.flatten().filter_map(|entry| match entry {
            Template::Table(entry) => entry.get("name"),
            _ => None,
        });
        names.flat_map(Template::texts).any(|name| matches(pattern, &name))
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
        if let Ok(found) = self.project.object_names_of(&job) {
            self.extend(found);
        }
    }
}
