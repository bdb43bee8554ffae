//! Ids of instances: stable over a whole set, in any order of its images.

use crate::study::{LabelEntry, Study};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use twox_hash::XxHash3_64;

/// The first id of objects that only some images have.
const FIRST_HASHED: u16 = 40_000;

/// A category of labels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Category {
    /// From 1 on, in the order of the study.
    pub(crate) id: u16,
    pub(crate) name: String,
    pub(crate) is_defect: bool,
}

/// An instance of a category.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Instance {
    /// From 1 on; 0 is the background.
    pub(crate) id: u16,
    /// Name of the object.
    pub(crate) name: String,
    /// Id of the category.
    pub(crate) category: u16,
}

/// The categories and instances of a set.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Ids {
    pub(crate) categories: Vec<Category>,
    pub(crate) instances: Vec<Instance>,
    /// Patterns of the names of the labelled objects, with the id of the category.
    patterns: Vec<(LabelEntry, u16)>,
}

/// The label of an object in one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ObjectLabel {
    pub(crate) instance: u16,
    pub(crate) category: u16,
    pub(crate) is_defect: bool,
}

impl Ids {
    /// The ids of a study. `names` are the objects of its first image without defects, and `slots` are the category and the
    /// name of each defect that an image may have.
    ///
    /// # Errors
    /// A pattern that matches no object, and more instances than ids: the number of the entry of `[[study.label]]`, and the
    /// problem.
    pub(crate) fn new(study: &Study, names: &[String], slots: &[(String, String)]) -> Result<Self, (usize, String)> {
        let mut ids = Self::default();
        for (i, entry) in study.label.iter().enumerate() {
            let category = ids.category(&entry.category, false);
            let matching: Vec<&String> = names.iter().filter(|name| entry.objects.match_name(name)).collect();
            let is_matched = |pattern: &String| names.iter().any(|n| dunkelfeld_io::job::matches(pattern, n));
            if let Some(pattern) = entry.objects.patterns().iter().find(|pattern| !is_matched(pattern)) {
                return Err((i, format!("no object is called \"{pattern}\"")));
            }
            for name in matching {
                ids.add(name, category);
            }
            ids.patterns.push((entry.clone(), category));
        }
        for (category, name) in slots {
            let category = ids.category(category, true);
            ids.add(name, category);
        }
        if ids.instances.len() >= usize::from(FIRST_HASHED) {
            return Err((0, format!("{} instances are more than {FIRST_HASHED}", ids.instances.len())));
        }
        Ok(ids)
    }

    fn category(&mut self, name: &str, is_defect: bool) -> u16 {
        match self.categories.iter_mut().find(|c| c.name == name) {
            Some(category) => {
                category.is_defect |= is_defect;
                category.id
            }
            None => {
                let id = self.categories.len() as u16 + 1;
                self.categories.push(Category { id, name: name.to_owned(), is_defect });
                id
            }
        }
    }

    /// The first category of an object is that of its label.
    fn add(&mut self, name: &str, category: u16) {
        if !self.instances.iter().any(|instance| instance.name == name) {
            let id = u16::try_from(self.instances.len() + 1).unwrap_or(u16::MAX);
            self.instances.push(Instance { id, name: name.to_owned(), category });
        }
    }

    /// The labels of the objects of one image, by the index of the object. Objects of the same name share a label. An
    /// object that the first image does not have gets an id from a hash of its name.
    ///
    /// # Errors
    /// Two names with the same hash.
    pub(crate) fn label(&self, names: &[String]) -> Result<Vec<Option<ObjectLabel>>, String> {
        let known: BTreeMap<&str, &Instance> = self.instances.iter().map(|i| (i.name.as_str(), i)).collect();
        let mut hashed: BTreeMap<u16, &str> = BTreeMap::new();
        let label = |instance, category: u16| {
            let found = self.categories.get(usize::from(category).saturating_sub(1));
            ObjectLabel { instance, category, is_defect: found.is_some_and(|c| c.is_defect) }
        };
        (names.iter())
            .map(|name| {
                if let Some(instance) = known.get(name.as_str()) {
                    return Ok(Some(label(instance.id, instance.category)));
                }
                let Some((_, category)) = self.patterns.iter().find(|(entry, _)| entry.objects.match_name(name)) else {
                    return Ok(None);
                };
                let range = u64::from(u16::MAX - FIRST_HASHED);
                let id = FIRST_HASHED + (XxHash3_64::oneshot(name.as_bytes()) % range) as u16;
                match hashed.insert(id, name) {
                    Some(other) if other != name => Err(format!("\"{name}\" and \"{other}\" have the same id {id}")),
                    _ => Ok(Some(label(id, *category))),
                }
            })
            .collect()
    }
}
