//! Ids of categories, which are those of the set, and of instances, which are those of an image.

use crate::defect::{AddedDefect, DefectEntry};
use crate::distribution::Fault;
use crate::label_entry::{KeyPoint, LabelEntry, LabelSight};
use crate::names::ObjectNames;
use crate::study::Study;
use dunkelfeld_integrator::PixelIds;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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

/// The categories of a set, and the entries that give them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Ids {
    pub(crate) categories: Vec<Category>,
    /// The entries of `[[study.label]]`, each with the id of its category.
    labels: Vec<(LabelEntry, u16)>,
    /// The id of the category of each entry of `[[study.defect]]`.
    defects: Vec<u16>,
}

/// The label of an object in one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ObjectLabel {
    /// Id of the instance in the image, from 1 on; 0 is the background.
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
    /// The categories of a study: those of its labels, then those of its defects. They do not depend on its images.
    ///
    /// # Errors
    /// A pattern that matches no object: the number of the entry of `[[study.label]]`, and the fault.
    pub(crate) fn new(
        study: &Study,
        names: &mut ObjectNames<'_>,
        defects: &[DefectEntry],
    ) -> Result<Self, (usize, Fault)> {
        let mut ids = Self::default();
        for (i, entry) in study.label.iter().enumerate() {
            let category = ids.category(&entry.category, false);
            if let Some(known) = ids.categories.iter_mut().find(|c| c.id == category) {
                known.keypoints = entry.keypoints.iter().map(|point| point.name.clone()).collect();
                known.skeleton.clone_from(&entry.skeleton);
            }
            names.check(entry.objects.patterns().to_vec()).map_err(|fault| (i, fault.below("objects")))?;
            ids.labels.push((entry.clone(), category));
        }
        ids.defects = defects.iter().map(|entry| ids.category(&entry.category, true)).collect();
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

    /// The name of a category.
    pub(crate) fn name_of(&self, category: u16) -> Option<&str> {
        self.categories.iter().find(|c| c.id == category).map(|c| c.name.as_str())
    }

    /// The names of the categories of defects, also of those that objects have as well, by the entries of defects.
    pub(crate) fn kinds(&self) -> impl Iterator<Item = &str> {
        self.defects.iter().filter_map(|id| self.name_of(*id))
    }

    /// The largest number of key points of a category.
    pub(crate) fn most_keypoints(&self) -> usize {
        most_keypoints(&self.categories)
    }

    /// The number of key points of a category.
    pub(crate) fn keypoint_count(&self, category: u16) -> usize {
        self.categories.iter().find(|c| c.id == category).map_or(0, |c| c.keypoints.len())
    }

    /// The entry of `[[study.label]]` of an object that is no defect.
    fn entry_of(&self, name: &str) -> Option<usize> {
        self.labels.iter().position(|(entry, _)| entry.objects.match_name(name))
    }

    /// The key points of an object that is no defect.
    pub(crate) fn keypoints(&self, name: &str) -> &[KeyPoint] {
        self.entry_of(name).map_or(&[], |entry| &self.labels[entry].0.keypoints)
    }

    /// The labels of the objects of one image, by the index of the object. Objects of the same name share a label. Instances
    /// are counted from 1: objects in the order of their entries, then defects in the order of theirs.
    ///
    /// # Errors
    /// More instances than ids.
    pub(crate) fn label(&self, names: &[String], defects: &[AddedDefect]) -> Result<Vec<Option<ObjectLabel>>, String> {
        let of_name: BTreeMap<&str, usize> =
            defects.iter().enumerate().map(|(k, defect)| (defect.placed.object.as_str(), k)).collect();
        let mut order = Vec::new();
        for (i, name) in names.iter().enumerate() {
            match of_name.get(name.as_str()) {
                Some(&k) => order.push((true, defects[k].entry, k, i)),
                None => order.extend(self.entry_of(name).map(|entry| (false, entry, i, i))),
            }
        }
        order.sort_unstable();
        let mut instances: BTreeMap<&str, u16> = BTreeMap::new();
        let mut labels = vec![None; names.len()];
        for (is_defect, entry, k, i) in order {
            let next = instances.len() + 1;
            let instance = match instances.get(names[i].as_str()) {
                Some(instance) => *instance,
                None => u16::try_from(next).map_err(|_| format!("{next} labelled objects are too many"))?,
            };
            instances.insert(&names[i], instance);
            let defect = is_defect.then(|| &defects[k]);
            let replaces = defect.and_then(|defect| {
                let placed = &defect.placed;
                placed.replaces.map(|material| PixelIds::new(placed.host as u32, material as u32))
            });
            labels[i] = Some(ObjectLabel {
                instance,
                category: if is_defect { self.defects[entry] } else { self.labels[entry].1 },
                is_defect,
                is_change: defect.is_some_and(AddedDefect::is_change),
                sight: defect.map_or(LabelSight::Surface, AddedDefect::sight),
                replaces,
            });
        }
        Ok(labels)
    }
}
