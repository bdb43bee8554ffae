//! A data set as the page needs it: numbers of all finished images. Records are read again for the few images that are
//! shown, so that the memory does not grow with names and files.

use super::draws::Draws;
use crate::price::Measured;
use crate::record::{Cost, InstanceRecord, Record};
use crate::set::{Set, cost_name};
use dunkelfeld::Error;
use std::collections::{BTreeMap, BTreeSet};

/// The numbers of a label in all statistics. NaN where unknown.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub(crate) visible: f32,
    /// Magnitude of the contrast [DN], and of the contrast-to-noise ratio.
    pub(crate) contrast: f32,
    pub(crate) cnr: f32,
    pub(crate) size: f32,
}

/// The labels of a category.
#[derive(Clone, Debug, Default)]
pub(crate) struct Labels {
    pub(crate) instances: Vec<Instance>,
    /// Number of images with one label of the category at least.
    pub(crate) images: u64,
}

/// A set of rendered images with labels: finished, or growing.
pub(crate) struct SetView<'a> {
    pub(crate) set: &'a Set,
    /// Indices of the finished images, in order.
    pub(crate) finished: Vec<u64>,
    pub(crate) draws: Draws,
    /// Labels by the position of the category.
    pub(crate) labels: Vec<Labels>,
    /// Number of images with one defect at least.
    pub(crate) with_defects: u64,
    /// Numbers of images by their width and height [px].
    pub(crate) sizes: BTreeMap<[u32; 2], u64>,
    /// Shares of hidden pixels, and the values of k.
    pub(crate) hidden: Vec<f64>,
    pub(crate) ks: BTreeSet<String>,
    pub(crate) matched: Vec<f64>,
    /// Shares of saturated pixels.
    pub(crate) saturated: Vec<f64>,
    /// Bytes of all files.
    pub(crate) bytes: u64,
    /// Times of the images that have them.
    pub(crate) costs: Vec<Cost>,
    /// Costs and noise of these images.
    pub(crate) measured: Measured,
}

impl<'a> SetView<'a> {
    /// Reads the records and the costs of a set. Costs may be missing.
    pub(crate) fn new(set: &'a Set) -> Result<Self, Error> {
        let mut view = Self {
            set,
            finished: set.finished(),
            draws: Draws::default(),
            labels: vec![Labels::default(); set.manifest().categories.len()],
            with_defects: 0,
            sizes: BTreeMap::new(),
            hidden: Vec::new(),
            ks: BTreeSet::new(),
            matched: Vec::new(),
            saturated: Vec::new(),
            bytes: 0,
            costs: Vec::new(),
            measured: Measured::default(),
        };
        for index in view.finished.clone() {
            let record = set.record(index)?;
            view.add(&record);
            if let Ok(cost) = set.parsed::<Cost>(&cost_name(index)) {
                view.costs.push(cost);
                view.measured.add(&cost, &record);
            }
        }
        Ok(view)
    }

    /// A number of finished images, evenly over the set: the first and the last one are among them.
    pub(crate) fn evenly(&self, most: usize) -> Vec<u64> {
        let (n, all) = (most.min(self.finished.len()), self.finished.len());
        let at = |i: usize| if n < 2 { 0 } else { i * (all - 1) / (n - 1) };
        (0..n).filter_map(|i| self.finished.get(at(i)).copied()).collect()
    }

    /// The position of a category in the set, which determines its colour.
    pub(crate) fn position(&self, category: u16) -> Option<usize> {
        self.set.manifest().categories.iter().position(|c| c.id == category)
    }

    /// Is the category at a position one of defects?
    pub(crate) fn is_defect(&self, position: usize) -> bool {
        self.set.manifest().categories.get(position).is_some_and(|c| c.is_defect)
    }

    fn add(&mut self, record: &Record) {
        self.draws.add(&record.drawn);
        *self.sizes.entry([record.width, record.height]).or_default() += 1;
        if let Some(certificate) = &record.certificate {
            self.hidden.push(certificate.hidden);
            self.saturated.push(certificate.saturated);
            self.ks.insert(certificate.k.to_string());
        }
        self.matched.extend(record.matched);
        self.bytes += record.files.values().map(|file| file.bytes).sum::<u64>();
        let mut seen = BTreeSet::new();
        for instance in &record.instances {
            let Some(position) = self.position(instance.category) else { continue };
            self.labels[position].instances.push(Instance::new(instance));
            self.labels[position].images += u64::from(seen.insert(position));
        }
        self.with_defects += u64::from(seen.iter().any(|position| self.is_defect(*position)));
    }
}

impl Instance {
    fn new(label: &InstanceRecord) -> Self {
        let number = |v: Option<f64>| v.map_or(f32::NAN, |v| v as f32);
        Self {
            visible: label.visible as f32,
            contrast: number(label.contrast).abs(),
            // A label without visible pixels has no contrast.
            cnr: if label.visible > 0.0 { number(label.cnr).abs() } else { 0.0 },
            size: number(label.size_mm),
        }
    }
}
