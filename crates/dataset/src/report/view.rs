//! A data set as the page needs it: numbers of all finished images. Records with their labels are read
//! again for the few images that are shown, so that the memory does not grow with names and files.

use super::draws::Draws;
use super::error::ReportError;
use crate::record::FORMAT;
use dunkelfeld_io::input::{InputFiles, ReadFault, Role};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The head of a set: `set.json`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Head {
    pub(crate) format: u32,
    #[serde(default)]
    pub(crate) program: String,
    #[serde(default)]
    pub(crate) study: String,
    #[serde(default)]
    pub(crate) study_hash: String,
    /// Number of images of the complete set.
    pub(crate) count: u64,
    #[serde(default)]
    pub(crate) categories: Vec<Category>,
}

/// A category of labels.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Category {
    pub(crate) id: u64,
    pub(crate) name: String,
    #[serde(default)]
    pub(crate) is_defect: bool,
}

/// One finished image: a file in `records`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Record {
    pub(crate) index: u64,
    #[serde(default)]
    drawn: Map<String, Value>,
    #[serde(default)]
    pub(crate) width: u64,
    #[serde(default)]
    pub(crate) height: u64,
    certificate: Option<Certificate>,
    matched: Option<f64>,
    #[serde(default)]
    pub(crate) instances: Vec<Label>,
    #[serde(default)]
    files: HashMap<String, Written>,
}

#[derive(Clone, Debug, Deserialize)]
struct Certificate {
    k: Option<f64>,
    hidden: Option<f64>,
    saturated: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
struct Written {
    #[serde(default)]
    bytes: u64,
}

/// A label of an image.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Label {
    pub(crate) id: u64,
    pub(crate) category: u64,
    /// Left, top, width, height [px].
    pub(crate) bbox: Option<[f64; 4]>,
    /// Number of visible pixels, and number without other objects in front.
    #[serde(default)]
    visible: f64,
    amodal: Option<f64>,
    contrast: Option<f64>,
    cnr: Option<f64>,
    size_mm: Option<f64>,
}

/// The numbers of a label in all statistics. NaN where unknown.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub(crate) visible: f32,
    pub(crate) amodal: f32,
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
#[derive(Clone, Debug)]
pub(crate) struct SetView {
    pub(crate) folder: PathBuf,
    pub(crate) head: Head,
    /// Indices of the finished images, in order.
    pub(crate) finished: Vec<u64>,
    pub(crate) draws: Draws,
    /// Labels by the id of the category.
    pub(crate) labels: BTreeMap<u64, Labels>,
    /// Number of images with one defect at least.
    pub(crate) with_defects: u64,
    /// Numbers of images by their width and height [px].
    pub(crate) sizes: BTreeMap<[u64; 2], u64>,
    /// Shares of hidden pixels, and the values of k.
    pub(crate) hidden: Vec<f64>,
    pub(crate) ks: BTreeSet<String>,
    pub(crate) matched: Vec<f64>,
    /// Shares of saturated pixels.
    pub(crate) saturated: Vec<f64>,
    /// Number of files and bytes by folder.
    pub(crate) bytes: BTreeMap<String, [u64; 2]>,
    /// Times by stage [s], of the images that have them.
    pub(crate) costs: BTreeMap<String, Vec<f64>>,
}

impl SetView {
    /// Reads `set.json`, the records and the costs of a folder. Costs and masks may be missing.
    pub(crate) fn read(folder: &Path) -> Result<Self, ReportError> {
        let path = folder.join("set.json");
        let head: Head = json(&path, "name the folder of a data set")?;
        if head.format != FORMAT {
            let problem = format!("the set has format {}, this program reads format {FORMAT}", head.format);
            return Err(ReportError::new(&path, problem, "use the version of the program that wrote the set"));
        }
        let mut view = Self {
            folder: folder.into(),
            finished: indices(&folder.join("records"))?,
            draws: Draws::default(),
            labels: head.categories.iter().map(|c| (c.id, Labels::default())).collect(),
            head,
            with_defects: 0,
            sizes: BTreeMap::new(),
            hidden: Vec::new(),
            ks: BTreeSet::new(),
            matched: Vec::new(),
            saturated: Vec::new(),
            bytes: BTreeMap::new(),
            costs: BTreeMap::new(),
        };
        for index in view.finished.clone() {
            let record = view.record(index)?;
            view.add(&record);
            view.add_cost(index)?;
        }
        Ok(view)
    }

    /// The record of a finished image.
    pub(crate) fn record(&self, index: u64) -> Result<Record, ReportError> {
        let path = self.path("records", index, "json");
        let record: Record = json(&path, HELP)?;
        match record.index == index {
            true => Ok(record),
            false => Err(ReportError::new(&path, format!("the record is of image {}", record.index), HELP)),
        }
    }

    /// The file of an image in a folder of the set.
    pub(crate) fn path(&self, folder: &str, index: u64, ending: &str) -> PathBuf {
        self.folder.join(folder).join(format!("{index:06}.{ending}"))
    }

    /// A number of finished images, evenly over the set: the first and the last one are among them.
    pub(crate) fn evenly(&self, most: usize) -> Vec<u64> {
        let (n, all) = (most.min(self.finished.len()), self.finished.len());
        let at = |i: usize| if n < 2 { 0 } else { i * (all - 1) / (n - 1) };
        (0..n).filter_map(|i| self.finished.get(at(i)).copied()).collect()
    }

    /// The position of a category in the set, which determines its colour.
    pub(crate) fn position(&self, category: u64) -> Option<usize> {
        self.head.categories.iter().position(|c| c.id == category)
    }

    fn add(&mut self, record: &Record) {
        self.draws.add(&record.drawn);
        *self.sizes.entry([record.width, record.height]).or_default() += 1;
        if let Some(certificate) = &record.certificate {
            self.hidden.extend(certificate.hidden.filter(|v| v.is_finite()));
            self.saturated.extend(certificate.saturated.filter(|v| v.is_finite()));
            self.ks.extend(certificate.k.map(|k| k.to_string()));
        }
        self.matched.extend(record.matched.filter(|v| v.is_finite()));
        for (name, written) in &record.files {
            let folder = name.split_once('/').map_or("", |(folder, _)| folder);
            let sums = match self.bytes.get_mut(folder) {
                Some(sums) => sums,
                None => self.bytes.entry(folder.into()).or_default(),
            };
            *sums = [sums[0] + 1, sums[1].saturating_add(written.bytes)];
        }
        let mut seen = BTreeSet::new();
        for label in &record.instances {
            let labels = self.labels.entry(label.category).or_default();
            labels.instances.push(Instance::new(label));
            labels.images += u64::from(seen.insert(label.category));
        }
        let has_defect = self.head.categories.iter().any(|c| c.is_defect && seen.contains(&c.id));
        self.with_defects += u64::from(has_defect);
    }

    fn add_cost(&mut self, index: u64) -> Result<(), ReportError> {
        let path = self.path("costs", index, "json");
        let Some(text) = bytes(&path)? else { return Ok(()) };
        let stages: BTreeMap<String, f64> = parsed(&path, &text, HELP)?;
        for (stage, seconds) in stages.into_iter().filter(|s| s.1.is_finite()) {
            self.costs.entry(stage).or_default().push(seconds);
        }
        Ok(())
    }
}

impl Instance {
    fn new(label: &Label) -> Self {
        let number = |v: Option<f64>| v.map_or(f32::NAN, |v| v as f32);
        Self {
            visible: label.visible as f32,
            amodal: number(label.amodal),
            contrast: number(label.contrast).abs(),
            // A label without visible pixels has no contrast.
            cnr: if label.visible > 0.0 { number(label.cnr).abs() } else { 0.0 },
            size: number(label.size_mm),
        }
    }
}

pub(crate) const HELP: &str = "delete the record of the image, and run the command again";

/// The ending of the images of a set.
pub(crate) fn image_ending(folder: &Path, index: u64) -> &'static str {
    if folder.join(format!("images/{index:06}.jpg")).is_file() { "jpg" } else { "png" }
}

/// The indices of files with a name of digits and the ending of JSON, in order. None if the folder is missing.
fn indices(folder: &Path) -> Result<Vec<u64>, ReportError> {
    let failed = |e: std::io::Error| ReportError::new(folder, e, "check the folder and its permissions");
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(failed(e)),
    };
    let mut indices = Vec::new();
    for entry in entries {
        let name = entry.map_err(failed)?.file_name();
        let stem = name.to_str().and_then(|n| n.strip_suffix(".json")).unwrap_or_default();
        // Only the name that an index has: a file with other digits would be another image.
        indices.extend(stem.parse::<u64>().ok().filter(|i| format!("{i:06}") == stem));
    }
    indices.sort_unstable();
    Ok(indices)
}

/// The longest record \[bytes\].
const MAX_TEXT: u64 = 64 << 20;

/// The content of a file. None if it is missing.
fn bytes(path: &Path) -> Result<Option<Vec<u8>>, ReportError> {
    match InputFiles::new().read(path, Role::Result, MAX_TEXT) {
        Ok(text) => Ok(Some(text)),
        Err(ReadFault::Missing) => Ok(None),
        Err(e) => Err(ReportError::new(path, e.problem(), "check the file and its permissions")),
    }
}

fn json<T: DeserializeOwned>(path: &Path, help: &str) -> Result<T, ReportError> {
    match bytes(path)? {
        Some(text) => parsed(path, &text, help),
        None => Err(ReportError::new(path, "the file is missing", help)),
    }
}

fn parsed<T: DeserializeOwned>(path: &Path, text: &[u8], help: &str) -> Result<T, ReportError> {
    serde_json::from_slice(text).map_err(|e| ReportError::new(path, format!("the JSON cannot be read: {e}"), help))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake::{self, record};
    use serde_json::json;

    #[test]
    fn a_set_without_costs_and_masks_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        fake::write(folder.path(), &[record(0), record(7)]);
        let view = SetView::read(folder.path()).expect("a set");
        assert_eq!((view.finished.as_slice(), view.draws.len(), view.costs.len()), ([0, 7].as_slice(), 3, 0));
        assert_eq!(view.labels[&1].instances.len(), 2);
        assert_eq!((view.with_defects, view.bytes["images"]), (2, [2, 246]));
    }

    #[test]
    fn broken_files_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let missing = SetView::read(folder.path()).expect_err("no set");
        assert!(missing.to_string().contains("set.json") && !missing.help.is_empty(), "{missing}");
        fake::write(folder.path(), &[record(0)]);
        fs::write(folder.path().join("records/000001.json"), "{\"index\":1,").expect("written");
        let broken = SetView::read(folder.path()).expect_err("broken");
        assert!(broken.file.ends_with("records/000001.json") && broken.problem.contains("line 1"), "{broken}");
        let mut other = record(1);
        other["index"] = json!(5);
        fs::write(folder.path().join("records/000001.json"), other.to_string()).expect("written");
        assert!(SetView::read(folder.path()).expect_err("another image").problem.contains("image 5"));
    }

    #[test]
    fn unfinished_files_and_other_names_are_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        fake::write(folder.path(), &[record(3)]);
        for name in ["000004.json.tmp", "4.json", "notes.json", "+00005.json"] {
            fs::write(folder.path().join("records").join(name), "{").expect("written");
        }
        assert_eq!(SetView::read(folder.path()).expect("a set").finished, [3]);
    }

    #[test]
    fn chosen_images_include_both_ends() {
        let folder = tempfile::tempdir().expect("a folder");
        fake::write(folder.path(), &(0..11).map(record).collect::<Vec<_>>());
        let view = SetView::read(folder.path()).expect("a set");
        assert_eq!(view.evenly(3), [0, 5, 10]);
        assert_eq!(view.evenly(1), [0]);
        assert_eq!(view.evenly(99).len(), 11);
        assert!(view.evenly(0).is_empty());
    }
}
