//! Ids of instances: stable over a whole set, in any order of its images.

use crate::label_entry::{KeyPoint, LabelEntry, LabelSight};
use crate::names::ObjectNames;
use crate::record::Record;
use crate::study::Study;
use dunkelfeld_integrator::PixelIds;
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
    /// Names of the key points of its objects.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) keypoints: Vec<String>,
    /// Pairs of key points that a line joins, as positions in `keypoints` from 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) skeleton: Vec<[u32; 2]>,
}

/// The largest number of key points of a category; 0 if none has any.
pub(crate) fn most_keypoints(categories: &[Category]) -> usize {
    categories.iter().map(|category| category.keypoints.len()).max().unwrap_or(0)
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
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Ids {
    pub(crate) categories: Vec<Category>,
    pub(crate) instances: Vec<Instance>,
    /// Patterns of the names of the labelled objects, with the id of the category.
    patterns: Vec<(LabelEntry, u16)>,
}

/// The name of each id in the images of a set. Ids by a hash of a name may be those of two names.
#[derive(Clone, Debug, Default)]
pub(crate) struct SetNames(BTreeMap<u16, (String, u64)>);

impl SetNames {
    /// Adds the instances of an image. Gives the problem if one has the id of another name.
    pub(crate) fn add(&mut self, record: &Record) -> Option<String> {
        for instance in &record.instances {
            let (name, index) = self.0.entry(instance.id).or_insert_with(|| (instance.name.clone(), record.index));
            if *name != instance.name {
                return Some(format!(
                    "the objects \"{name}\" of image {index} and \"{}\" of image {} have the same id {}",
                    instance.name, record.index, instance.id
                ));
            }
        }
        None
    }
}

/// The label of an object in one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ObjectLabel {
    pub(crate) instance: u16,
    pub(crate) category: u16,
    /// Is the object a defect of the image? Its category does not tell: parts may share it.
    pub(crate) is_defect: bool,
    /// Is the defect a changed object? It is a surface for all that lies on it.
    pub(crate) is_change: bool,
    pub(crate) sight: LabelSight,
    /// The surface whose place the defect has.
    pub(crate) replaces: Option<PixelIds>,
}

impl Ids {
    /// The ids of a study. `names` are the objects of its images without defects, and `slots` are the category and the name
    /// of each defect that an image may have. The ids are a function of the study, and do not depend on the number of its
    /// images.
    ///
    /// # Errors
    /// A pattern that matches no object, and more instances than ids: the number of the entry of `[[study.label]]`, and the
    /// problem.
    pub(crate) fn new(
        study: &Study,
        names: &mut ObjectNames<'_>,
        slots: &[(String, String)],
    ) -> Result<Self, (usize, String)> {
        let mut ids = Self::default();
        for (i, entry) in study.label.iter().enumerate() {
            let category = ids.category(&entry.category, false);
            if let Some(known) = ids.categories.iter_mut().find(|c| c.id == category) {
                known.keypoints = entry.keypoints.iter().map(|point| point.name.clone()).collect();
                known.skeleton.clone_from(&entry.skeleton);
            }
            for pattern in entry.objects.patterns() {
                if !names.any(|name| dunkelfeld_io::job::matches(pattern, name)) {
                    return Err((i, format!("no object is called \"{pattern}\"")));
                }
            }
            for name in names.listed().iter().filter(|name| entry.objects.match_name(name)) {
                ids.add(name, category);
            }
            ids.patterns.push((entry.clone(), category));
        }
        for (category, name) in slots {
            let category = ids.category(category, true);
            ids.add(name, category);
        }
        // Objects of rare images come last, so that a study without them keeps its ids.
        for (i, entry) in study.label.iter().enumerate() {
            let category = ids.patterns.get(i).map_or(0, |(_, category)| *category);
            for name in names.rare().iter().filter(|name| entry.objects.match_name(name)) {
                ids.add(name, category);
            }
        }
        if ids.instances.len() >= usize::from(FIRST_HASHED) {
            return Err((0, format!("{} instances are more than {FIRST_HASHED}", ids.instances.len())));
        }
        Ok(ids)
    }

    /// The id of a category. One that parts and defects share is of parts: those come first.
    fn category(&mut self, name: &str, is_defect: bool) -> u16 {
        match self.categories.iter().find(|c| c.name == name) {
            Some(category) => category.id,
            None => {
                let id = self.categories.len() as u16 + 1;
                let (keypoints, skeleton) = Default::default();
                self.categories.push(Category { id, name: name.to_owned(), is_defect, keypoints, skeleton });
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

    /// The largest number of key points of a category.
    pub(crate) fn most_keypoints(&self) -> usize {
        most_keypoints(&self.categories)
    }

    /// The number of key points of a category.
    pub(crate) fn keypoint_count(&self, category: u16) -> usize {
        self.categories.iter().find(|c| c.id == category).map_or(0, |c| c.keypoints.len())
    }

    /// The key points of an object that is no defect.
    pub(crate) fn keypoints(&self, name: &str) -> &[KeyPoint] {
        let found = self.patterns.iter().find(|(entry, _)| entry.objects.match_name(name));
        found.map_or(&[], |(entry, _)| &entry.keypoints)
    }

    /// The labels of the objects of one image, by the index of the object. Objects of the same name share a label. An
    /// object without an id of its own gets one from a hash of its name. The defects of the image are not marked as such.
    ///
    /// # Errors
    /// Two names with the same hash.
    pub(crate) fn label(&self, names: &[String]) -> Result<Vec<Option<ObjectLabel>>, String> {
        let known: BTreeMap<&str, &Instance> = self.instances.iter().map(|i| (i.name.as_str(), i)).collect();
        let mut hashed: BTreeMap<u16, &str> = BTreeMap::new();
        let label = |instance, category| ObjectLabel {
            instance,
            category,
            is_defect: false,
            is_change: false,
            sight: LabelSight::Surface,
            replaces: None,
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
