//! The check of a finished set: files, hashes, labels against masks, and the files of the whole set against the images.

use crate::coco::{CompressedRle, Segmentation};
use crate::encode::ImageLabels;
use crate::inputs::hash_of;
use crate::record::{FileRecord, Record};
use crate::rle::runs_of_labels;
use crate::set::{MISSING, REPORT, Set, cost_name, read_bytes, record_name};
use crate::set_folder::{FOLDERS, own_path};
use dunkelfeld::Error;
use dunkelfeld_film::Plane;
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Findings of one kind that are listed; the others are counted.
const LISTED: usize = 20;

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Images of the set.
    pub count: u64,
    /// Images that are finished.
    pub finished: u64,
    /// Files that were read and compared: with their hashes, or with the images.
    pub files: u64,
    /// Annotations that were compared with the masks.
    pub annotations: u64,
    /// The faults, with their files.
    pub faults: Vec<String>,
    /// Number of faults that are not listed.
    pub more: u64,
}

impl Verified {
    /// Is the set whole?
    pub fn is_whole(&self) -> bool {
        self.faults.is_empty() && self.finished == self.count
    }

    fn fault(&mut self, text: String) {
        if self.faults.len() < LISTED {
            self.faults.push(text);
        } else {
            self.more += 1;
        }
    }
}

/// Checks a set: the study by its hash, the record of each image, the size and the hash of each file, the masks against the
/// records and the annotations, and the files of the whole set byte by byte against those that the finished images give, if
/// this version of the program made the set. A file that belongs to no image is a fault in the folders of images, such as
/// `images/`. `report.html` contains times and must only exist.
/// The files of the whole set are compared if all images are finished.
///
/// # Errors
/// A folder without a set.
pub fn verify(folder: &Path, progress: &dyn Fn(u64, u64)) -> Result<Verified, Error> {
    let set = Set::read(folder)?;
    let mut found = Verified { count: set.count(), ..Verified::default() };
    set.changed_study().into_iter().for_each(|problem| found.fault(problem));
    let other = set.other_version();
    if let Some(problem) = &other {
        // The images may have other files, also if nothing changed since they were made.
        let rest = "the files of the whole set are not compared; help: use that version";
        found.fault(format!("{} {problem}; {rest}", folder.display()));
    }
    let mut known = KnownFiles::default();
    for index in 0..set.count() {
        progress(index, set.count());
        if !set.is_finished(index) {
            known.open.insert(index);
            continue;
        }
        known.names.extend([record_name(index), cost_name(index)]);
        found.finished += 1;
        let checked = set.record(index).and_then(|record| {
            known.names.extend(record.files.keys().cloned());
            check_image(&set, &record, &mut found)
        });
        if let Err(e) = checked {
            known.open.insert(index);
            found.fault(e.in_one_line());
        }
    }
    progress(set.count(), set.count());
    known
        .foreign(set.path())
        .into_iter()
        .for_each(|name| found.fault(format!("{name} belongs to no image of the set")));
    if other.is_none() && found.finished == found.count {
        check_whole(&set, &mut found);
    }
    Ok(found)
}

/// The files that the images of a set may have.
#[derive(Default)]
struct KnownFiles {
    names: BTreeSet<String>,
    /// Images whose files are not known: they are not finished, or their record is broken.
    open: BTreeSet<u64>,
}

impl KnownFiles {
    /// The files in the folders of images that belong to none. Hidden files, and claims of images, are not meant.
    fn foreign(&self, set: &Path) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        let mut folders = FOLDERS.map(str::to_owned).to_vec();
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(set.join(&folder)).into_iter().flatten().flatten() {
                let file = entry.file_name().to_string_lossy().into_owned();
                let name = format!("{folder}/{file}");
                // The tree of MVTec AD has folders.
                if folder.starts_with("mvtec") && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                    folders.push(name);
                    continue;
                }
                let index = file.get(..6).and_then(|index| index.parse().ok());
                let is_open = index.is_some_and(|index| self.open.contains(&index)) || file.ends_with(".lock");
                if !file.starts_with('.') && !is_open && !self.names.contains(&name) {
                    found.insert(name);
                }
            }
        }
        found
    }
}

/// Compares the files of the whole set with those that the images give.
fn check_whole(set: &Set, found: &mut Verified) {
    if set.has_file(REPORT) && !set.path().join(REPORT).exists() {
        found.fault(format!("{REPORT} {MISSING}"));
    }
    let compared = set.each_file(|name, content| {
        found.files += 1;
        if let Some(problem) = difference(set.path(), name, &content) {
            found.fault(format!("{name} {problem}"));
        }
        Ok(())
    });
    if let Err(e) = compared {
        found.fault(format!("the files of the whole set cannot be compared: {}", e.in_one_line()));
    }
}

/// The difference of a file from its content, as the continuation of its name. `None` if there is none.
fn difference(set: &Path, name: &str, content: &[u8]) -> Option<String> {
    match own_path(set, name) {
        Err(e) => Some(e.problem),
        Ok(path) if !path.exists() => Some(MISSING.into()),
        Ok(path) if hash_of(&path) == Some(FileRecord::of(content).hash) => None,
        Ok(_) => Some("differs from the file that the finished images give".into()),
    }
}

/// Checks an image.
///
/// # Errors
/// Labels and a mask that cannot be read.
fn check_image(set: &Set, record: &Record, found: &mut Verified) -> Result<(), Error> {
    set.foreign(record).into_iter().for_each(|problem| found.fault(problem));
    let mut is_mask_whole = true;
    for (name, expected) in &record.files {
        found.files += 1;
        let fault = match read_bytes(set.path(), name) {
            Err(e) => e.problem,
            Ok(bytes) if FileRecord::of(&bytes) == *expected => continue,
            Ok(_) => "differs from its hash".into(),
        };
        is_mask_whole &= !name.starts_with("masks/");
        found.fault(format!("{name} {fault}"));
    }
    let cost = cost_name(record.index);
    if let Err(e) = read_bytes(set.path(), &cost) {
        found.fault(format!("{cost} {}", e.problem));
    }
    let labels: ImageLabels = set.parsed(&format!("labels/{:06}.json", record.index))?;
    let mask = format!("masks/{:06}.png", record.index);
    if record.files.contains_key(&mask) && is_mask_whole {
        check_mask(record, &labels, &mask, &read_gray(&set.path().join(&mask), &Limits::default())?.values, found);
    }
    found.annotations += labels.annotations.len() as u64;
    Ok(())
}

fn check_mask(record: &Record, labels: &ImageLabels, name: &str, plane: &Plane<u16>, found: &mut Verified) {
    let pixels = plane.data();
    let mut areas: BTreeMap<u16, u64> = BTreeMap::new();
    pixels.iter().filter(|id| **id != 0).for_each(|id| *areas.entry(*id).or_default() += 1);
    for instance in &record.instances {
        let area = areas.remove(&instance.id).unwrap_or(0);
        if area != instance.area {
            found.fault(format!("{name} has {area} pixels of \"{}\", and the record {}", instance.name, instance.area));
        }
    }
    for (id, area) in areas {
        found.fault(format!("{name} has {area} pixels of the instance {id}, which the record does not have"));
    }
    let runs = runs_of_labels(plane);
    for annotation in &labels.annotations {
        let Segmentation::Rle(found_runs) = &annotation.segmentation else { continue };
        let own = u16::try_from(annotation.instance).ok().and_then(|id| runs.get(&id));
        if own.is_none_or(|own| CompressedRle::from(own) != *found_runs) {
            found.fault(format!("{name} differs from the annotation of \"{}\"", annotation.name));
        }
    }
}
