//! The check of a finished set: files, hashes, and labels against masks.

use crate::coco::{Coco, Segmentation};
use crate::encode::ImageLabels;
use crate::record::{FileRecord, Record};
use crate::set::{Set, read_bytes};
use dunkelfeld::{Error, InputError};
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use std::collections::BTreeMap;
use std::path::Path;

/// Findings of one kind that are listed; the others are counted.
const LISTED: usize = 20;

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Images of the set.
    pub count: u64,
    /// Images that are finished.
    pub finished: u64,
    /// Files that were read and compared with their hashes.
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

/// Checks a set: the description, the record of each image, the size and the hash of each file, the masks against the
/// records and the annotations, and the annotations of the whole set against those of the images.
///
/// # Errors
/// A folder without a set.
pub fn verify(folder: &Path, progress: &dyn Fn(u64, u64)) -> Result<Verified, Error> {
    let set = Set::read(folder)?;
    let mut found = Verified { count: set.count(), ..Verified::default() };
    let mut annotations = 0;
    for index in 0..set.count() {
        progress(index, set.count());
        if !set.is_finished(index) {
            continue;
        }
        found.finished += 1;
        match set.record(index) {
            Ok(record) if record.index == index => annotations += check_image(&set, &record, &mut found),
            Ok(record) => found.fault(format!("record {index} is that of image {}", record.index)),
            Err(e) => found.fault(one_line(&e)),
        }
    }
    progress(set.count(), set.count());
    found.annotations = annotations;
    let is_there = |name: &str| folder.join(name).exists();
    if is_there("coco.json") {
        match set.parsed::<Coco>("coco.json") {
            Ok(coco) if coco.annotations.len() as u64 != annotations => found.fault(format!(
                "coco.json has {} annotations, and the images have {annotations}",
                coco.annotations.len()
            )),
            Ok(coco) if coco.images.len() as u64 != found.finished => {
                found.fault(format!("coco.json has {} images, and {} are finished", coco.images.len(), found.finished));
            }
            Ok(_) => {}
            Err(e) => found.fault(one_line(&e)),
        }
    }
    Ok(found)
}

fn one_line(error: &Error) -> String {
    error.to_string().replace("\n  help:", "; help:")
}

/// Checks an image; gives the number of its annotations.
fn check_image(set: &Set, record: &Record, found: &mut Verified) -> u64 {
    let mut is_mask_whole = true;
    for (name, expected) in &record.files {
        found.files += 1;
        let is_safe = !name.contains("..") && !name.starts_with('/') && !name.contains('\\');
        let content = if is_safe {
            read_bytes(set.path(), name)
        } else {
            Err(InputError::new(name, "the record", "leads out of the set", "make the image again"))
        };
        let fault = match content {
            Err(e) => Some(format!("{name} {}", e.problem)),
            Ok(bytes) => (FileRecord::of(&bytes) != *expected).then(|| format!("{name} differs from its hash")),
        };
        if let Some(fault) = fault {
            is_mask_whole &= !name.starts_with("masks/");
            found.fault(fault);
        }
    }
    let labels: Result<ImageLabels, Error> = set.parsed(&format!("labels/{:06}.json", record.index));
    let labels = match labels {
        Ok(labels) => labels,
        Err(e) => {
            found.fault(one_line(&e));
            return 0;
        }
    };
    let mask = format!("masks/{:06}.png", record.index);
    if record.files.contains_key(&mask) && is_mask_whole {
        match read_gray(&set.path().join(&mask), &Limits::default()) {
            Ok(frame) => {
                check_mask(record, &labels, &mask, frame.values.data(), found);
            }
            Err(e) => found.fault(format!("{mask} {}", e.problem)),
        }
    }
    labels.annotations.len() as u64
}

fn check_mask(record: &Record, labels: &ImageLabels, name: &str, pixels: &[u16], found: &mut Verified) {
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
    for annotation in &labels.annotations {
        let Segmentation::Rle(runs) = &annotation.segmentation else { continue };
        let decoded = runs.mask().map(|rle| rle.decode());
        let [height, width] = runs.size;
        let is_same = decoded.is_ok_and(|inside| {
            (u64::from(width) * u64::from(height)) as usize == pixels.len()
                && inside.iter().zip(pixels).all(|(inside, id)| *inside == (u64::from(*id) == annotation.instance))
        });
        if !is_same {
            found.fault(format!("{name} differs from the annotation of \"{}\"", annotation.name));
        }
    }
}
