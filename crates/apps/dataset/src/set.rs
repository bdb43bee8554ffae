//! The folder of a set: its description, the claims of images, and the files of the whole set.

use crate::coco::{Category as CocoCategory, Coco, Image, Info};
use crate::encode::{ImageLabels, json};
use crate::ids::{Category, Ids, most_keypoints};
use crate::inputs::{InputRecord, changed_input};
use crate::make::Made;
use crate::pose::Pose;
use crate::record::{Cost, FORMAT, Record};
use crate::report::{SetView, page};
use crate::resolved::resolved_study;
use crate::set_folder::{enter, own_path};
use crate::stable_text::text_hash;
use crate::study::{MAX_COUNT, PictureFormat, Segmentation, Study, Yolo};
use dunkelfeld::Error;
use dunkelfeld::outputs::written;
use dunkelfeld_io::InputError;
use dunkelfeld_io::atomic::write_atomically;
use dunkelfeld_io::input::{InputFiles, ReadFault, Role};
use dunkelfeld_io::lock::TargetLock;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The page of a set, which contains times.
pub(crate) const REPORT: &str = "report.html";
/// The longest file of a set that is read back as text \[bytes\].
const MAX_TEXT: u64 = 1 << 30;

/// The description of a set, `set.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    pub(crate) format: u32,
    /// The version of the program: other versions may give other images.
    pub(crate) program: String,
    pub(crate) study: String,
    pub(crate) study_hash: String,
    /// XXH3 of the keys of `study.toml` without `folder`, which depends on its place.
    pub(crate) study_text: String,
    /// The files that the images are made from.
    pub(crate) inputs: Vec<InputRecord>,
    /// The files of the whole set.
    pub(crate) files: Vec<String>,
    pub(crate) count: u64,
    pub(crate) categories: Vec<Category>,
}

/// The part of `set.json` that all formats have.
#[derive(Deserialize)]
struct Head {
    format: u32,
}

/// The folder of a set.
#[derive(Clone, Debug)]
pub struct Set {
    path: PathBuf,
    manifest: Manifest,
}

fn program() -> String {
    concat!("dunkelfeld ", env!("CARGO_PKG_VERSION")).into()
}

/// The message about a set of another version.
fn other_program(before: &str) -> String {
    format!("holds a set of {before}, and this is {}", program())
}

impl Set {
    /// The problem of a set of another version of the program.
    pub(crate) fn other_version(&self) -> Option<String> {
        (self.manifest.program != program()).then(|| other_program(&self.manifest.program))
    }

    /// Opens the folder of a set of a study for its images, and creates it with its parents if there is none. A set may
    /// grow; it never shrinks.
    ///
    /// # Errors
    /// A set of another study, of other input files or of another version of the program; a folder that contains other
    /// files; a folder that cannot be written to.
    pub(crate) fn start(
        path: &Path,
        study: &Study,
        ids: &Ids,
        inputs: Vec<InputRecord>,
        count: u64,
    ) -> Result<Self, Error> {
        // Two processes may start the same set.
        let _lock = enter(path)?;
        let manifest = Manifest {
            format: FORMAT,
            program: program(),
            study: study.name.clone(),
            study_hash: study.hash().to_owned(),
            study_text: text_hash(study.text(), &study.name),
            inputs,
            files: files_of(study),
            count,
            categories: ids.categories.clone(),
        };
        let mut set = Self { path: path.into(), manifest };
        match Self::read(path) {
            // Nothing was made: the study may have been corrected.
            Ok(before) if before.is_idle() => {}
            Ok(before) => set.continues(&before)?,
            Err(Error::Input(e)) if e.problem == MISSING => set.check_new()?,
            Err(e) => return Err(e),
        }
        put(path, "set.json", &json(&set.manifest))?;
        let text = resolved_study(study, path, set.manifest.inputs.len() > 1);
        put(path, "study.toml", text.as_bytes())?;
        for folder in ["records", "costs", "labels"] {
            let folder = own_path(path, folder)?;
            written(&folder, fs::create_dir_all(&folder))?;
        }
        Ok(set)
    }

    fn refusal(&self, problem: impl Into<String>, help: &str) -> Error {
        Error::Output { file: self.path.clone(), problem: problem.into(), help: help.into() }
    }

    /// Has the set no image, and does no process make one?
    fn is_idle(&self) -> bool {
        let files = fs::read_dir(self.path.join("records")).into_iter().flatten().flatten();
        let is_claimed = |file: fs::DirEntry| {
            let path = file.path();
            let is_lock = path.extension().is_some_and(|ending| ending == "lock");
            is_lock && matches!(TargetLock::try_acquire(&path.with_extension("")), Ok(None))
        };
        self.finished().is_empty() && !files.into_iter().any(is_claimed)
    }

    /// Takes the number of images of the set that was there before, if that is larger.
    ///
    /// # Errors
    /// The images of that set are not those of this one.
    fn continues(&mut self, before: &Self) -> Result<(), Error> {
        let (before, now) = (&before.manifest, &self.manifest);
        if before.program != now.program {
            let problem = other_program(&before.program);
            return Err(self.refusal(problem, "name another folder, or use that version"));
        }
        if before.study_hash != now.study_hash {
            let problem = format!("holds a set of another study, or of \"{}\" before a change", before.study);
            return Err(self.refusal(problem, "name another folder for the changed study"));
        }
        if let Some(change) = changed_input(&before.inputs, &now.inputs) {
            let problem = format!("holds images that were made from another \"{change}\", or without it");
            return Err(self.refusal(problem, "restore the file, or name another folder for the new images"));
        }
        self.manifest.count = now.count.max(before.count);
        Ok(())
    }

    /// # Errors
    /// The folder contains files that are not of a set.
    fn check_new(&self) -> Result<(), Error> {
        let entries = fs::read_dir(&self.path).map_err(|e| self.refusal(e.to_string(), "name another folder"))?;
        let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
        if names.into_iter().any(|name| !name.starts_with("set.json") && !name.starts_with('.')) {
            return Err(self.refusal("is not empty, and holds no set", "name a new folder"));
        }
        Ok(())
    }

    /// Opens a set that exists.
    ///
    /// # Errors
    /// A folder without a set, a set of another format, a description that is broken.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = read_text(path, "set.json")?;
        let file = path.join("set.json");
        let fault = |problem: String| InputError::new(&file, "the whole file", problem, "make the set again");
        let broken = |e: serde_json::Error| fault(format!("describes no set: {e}"));
        let Head { format } = serde_json::from_str(&text).map_err(broken)?;
        if format != FORMAT {
            let age = if format < FORMAT { "an older" } else { "a newer" };
            let problem = format!("is of format {format}, of {age} version; this program reads format {FORMAT}");
            let help = "use the version that made the set, or make the set again in another folder";
            return Err(InputError::new(&file, "format", problem, help).into());
        }
        let manifest: Manifest = serde_json::from_str(&text).map_err(broken)?;
        if !(1..=MAX_COUNT).contains(&manifest.count) {
            return Err(fault(format!("has a count of {}, which no set has", manifest.count)).into());
        }
        Ok(Self { path: path.into(), manifest })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of images that the set shall have.
    pub fn count(&self) -> u64 {
        self.manifest.count
    }

    /// Is an image finished?
    pub fn is_finished(&self, index: u64) -> bool {
        own_path(&self.path, &record_name(index)).is_ok_and(|path| path.is_file())
    }

    /// Claims an image: `None` if it is finished, or if another process or thread makes it. A claim ends with its process.
    ///
    /// # Errors
    /// A claim that cannot be written.
    pub fn claim(&self, index: u64) -> Result<Option<Claim>, Error> {
        if self.is_finished(index) {
            return Ok(None);
        }
        let lock = TargetLock::try_acquire(&own_path(&self.path, &record_name(index))?)?;
        Ok(lock.filter(|_| !self.is_finished(index)).map(|lock| Claim { index, _lock: lock }))
    }

    /// Writes the files of an image, and its record last: an image with a record is whole. Gives the record, and the cost
    /// with the time of the files.
    ///
    /// # Errors
    /// Those of the file system. Files without a record are replaced by the next attempt.
    pub fn commit(&self, claim: Claim, made: Made) -> Result<(Record, Cost), Error> {
        let written = self.write(made);
        drop(claim);
        written
    }

    /// As [`Set::commit`], also for an image that another process has claimed, which may stall. Each file is replaced as a
    /// whole. So this is for images that are the same from each process: those without a budget by time.
    ///
    /// # Errors
    /// An image of another study, an index outside of the set, and those of the file system.
    pub fn write(&self, made: Made) -> Result<(Record, Cost), Error> {
        let (index, count) = (made.record.index, self.count());
        if let Some(problem) = self.foreign(&made.record) {
            return Err(Error::setting("image", problem, "make it by a worker of the study of this set"));
        }
        if index >= count {
            let problem = format!("there is no image {index}: the set has {count}, counted from 0");
            return Err(Error::setting("index", problem, "open the set with a larger count"));
        }
        let began = Instant::now();
        let Made { record, files, mut cost } = made;
        for (name, content) in &files {
            put(&self.path, name, content)?;
        }
        let seconds = began.elapsed().as_secs_f64();
        cost.write += seconds;
        cost.total += seconds;
        put(&self.path, &cost_name(index), &json(&cost))?;
        put(&self.path, &record_name(index), &json(&record))?;
        Ok((record, cost))
    }

    /// The record of a finished image.
    ///
    /// # Errors
    /// A record that is missing or broken.
    pub fn record(&self, index: u64) -> Result<Record, Error> {
        let name = record_name(index);
        let record: Record = self.parsed(&name)?;
        if record.index == index {
            return Ok(record);
        }
        let problem = format!("is that of image {}", record.index);
        Err(InputError::new(self.path.join(name), "the record", problem, "delete the file, and make the image again")
            .into())
    }

    /// A file of the set as JSON.
    pub(crate) fn parsed<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, Error> {
        let text = read_text(&self.path, name)?;
        serde_json::from_str(&text).map_err(|e| {
            let help = "delete the file and run the same command, which makes the image again";
            InputError::new(self.path.join(name), "the whole file", format!("is broken: {e}"), help).into()
        })
    }

    /// Indices of the images without a record.
    pub fn missing(&self) -> Vec<u64> {
        let finished: BTreeSet<u64> = self.finished().into_iter().collect();
        (0..self.count()).filter(|index| !finished.contains(index)).collect()
    }

    /// Indices of the finished images, in ascending order.
    pub(crate) fn finished(&self) -> Vec<u64> {
        finished_in(&self.path, self.count())
    }

    /// Writes the files of the whole set from those of its finished images: `records.jsonl`, `coco.json`, `data.yaml`,
    /// `scene_camera.json`, `scene_gt.json` and `report.html`, as far as the study has them. Another process
    /// that does the same writes the same files.
    ///
    /// # Errors
    /// Records that are broken, and those of the file system.
    pub fn assemble(&self) -> Result<(), Error> {
        self.each_file(|name, content| put(&self.path, name, &content))?;
        if self.has_file(REPORT) {
            put(&self.path, REPORT, page(&SetView::new(self)?)?.as_bytes())?;
        }
        Ok(())
    }

    /// Has `study.toml` changed since the program wrote it, other than by its place? In a sentence.
    pub(crate) fn changed_study(&self) -> Option<String> {
        let text = read_text(&self.path, "study.toml");
        let is_same = text.is_ok_and(|text| text_hash(&text, &self.manifest.study) == self.manifest.study_text);
        (!is_same).then(|| "study.toml is missing, or was changed: it differs from the study of the set".into())
    }

    /// The problem of a record of another study.
    pub(crate) fn foreign(&self, record: &Record) -> Option<String> {
        let is_foreign = record.study != self.manifest.study_hash;
        is_foreign.then(|| format!("image {} is of another study than \"{}\"", record.index, self.manifest.study))
    }

    /// The description.
    pub(crate) fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Has the whole set a file of this name?
    pub(crate) fn has_file(&self, name: &str) -> bool {
        self.manifest.files.iter().any(|file| file == name)
    }

    /// Gives the name and the content of each file of the whole set but `report.html`, which contains times. They are a
    /// function of the finished images.
    ///
    /// # Errors
    /// Records, labels and images that are broken, and those of `visit`.
    pub(crate) fn each_file(&self, mut visit: impl FnMut(&str, Vec<u8>) -> Result<(), Error>) -> Result<(), Error> {
        let finished = self.finished();
        let mut records = Vec::new();
        for index in &finished {
            records.extend(json(&self.record(*index)?));
        }
        visit("records.jsonl", records)?;
        if ["coco.json", "scene_gt.json"].iter().any(|name| self.has_file(name)) {
            let Annotations { coco, cameras, poses } = self.annotations(&finished)?;
            let files =
                [("coco.json", json(&coco)), ("scene_camera.json", json(&cameras)), ("scene_gt.json", json(&poses))];
            for (name, content) in files.into_iter().filter(|(name, _)| self.has_file(name)) {
                visit(name, content)?;
            }
        }
        if self.has_file("data.yaml") {
            let names = self.manifest.categories.iter().map(|c| c.name.as_str());
            let keypoints = most_keypoints(&self.manifest.categories);
            let text = crate::yolo::data_yaml(names, keypoints);
            visit("data.yaml", text.into_bytes())?;
        }
        Ok(())
    }

    /// The annotations of images, in the formats of COCO and BOP.
    fn annotations(&self, finished: &[u64]) -> Result<Annotations, Error> {
        let mut coco = Coco {
            info: Info {
                description: self.manifest.study.clone(),
                version: self.manifest.study_hash.clone(),
                contributor: self.manifest.program.clone(),
                ..Info::default()
            },
            ..Coco::default()
        };
        coco.categories = (self.manifest.categories.iter())
            .map(|c| CocoCategory {
                id: u32::from(c.id),
                name: c.name.clone(),
                supercategory: if c.is_defect { "defect" } else { "object" }.into(),
                keypoints: (!c.keypoints.is_empty()).then(|| c.keypoints.clone()),
                skeleton: (!c.keypoints.is_empty()).then(|| c.skeleton.clone()),
            })
            .collect();
        let (mut cameras, mut poses) = (BTreeMap::new(), BTreeMap::new());
        // The models in the order of the images, from 1.
        let mut models: Vec<Pose> = Vec::new();
        for index in finished {
            let labels: ImageLabels = self.parsed(&format!("labels/{index:06}.json"))?;
            let ImageLabels { file_name, width, height, annotations, camera, poses: objects, .. } = labels;
            coco.images.push(Image { id: *index, file_name, width, height });
            for mut annotation in annotations {
                annotation.id = coco.annotations.len() as u64 + 1;
                coco.annotations.push(annotation);
            }
            if let Some(camera) = camera {
                let entry = json!({
                    "cam_K": camera.k, "depth_scale": 0.1, "cam_R_w2c": camera.r, "cam_t_w2c": camera.t,
                    "distortion": camera.distortion,
                });
                cameras.insert(index.to_string(), entry);
            }
            let objects: Vec<serde_json::Value> = (objects.iter())
                .map(|p| {
                    let known = models.iter().position(|model| p.has_model_of(model));
                    if known.is_none() {
                        models.push(p.clone());
                    }
                    let (r, t, model) = (p.r, p.t, known.map_or(models.len(), |position| position + 1));
                    json!({ "obj_id": model, "instance": p.instance, "cam_R_m2c": r, "cam_t_m2c": t, "scale": p.scale })
                })
                .collect();
            poses.insert(index.to_string(), objects);
        }
        Ok(Annotations { coco, cameras, poses })
    }
}

/// The annotations of images.
struct Annotations {
    coco: Coco,
    /// Cameras of BOP by the index of the image.
    cameras: BTreeMap<String, serde_json::Value>,
    /// Poses of BOP by the index of the image.
    poses: BTreeMap<String, Vec<serde_json::Value>>,
}

/// The files of the whole set that a study has.
fn files_of(study: &Study) -> Vec<String> {
    let (labels, has_picture) = (&study.labels, study.images.picture != PictureFormat::None);
    let files = [
        ("records.jsonl", true),
        ("coco.json", labels.coco != Segmentation::None),
        ("scene_camera.json", labels.bop),
        ("scene_gt.json", labels.bop),
        ("data.yaml", labels.yolo != Yolo::None),
        (REPORT, has_picture),
    ];
    files.iter().filter(|(_, is_wanted)| *is_wanted).map(|(name, _)| (*name).to_owned()).collect()
}

/// The claim of an image, until it is dropped.
#[derive(Debug)]
pub struct Claim {
    /// Index of the image.
    pub index: u64,
    _lock: TargetLock,
}

/// Indices of the images of a folder that have a record, in ascending order.
fn finished_in(path: &Path, count: u64) -> Vec<u64> {
    let files = fs::read_dir(path.join("records")).into_iter().flatten().flatten();
    let index = |file: fs::DirEntry| -> Option<u64> {
        let index = file.file_name().to_str()?.strip_suffix(".json")?.parse().ok().filter(|index| *index < count)?;
        path.join(record_name(index)).is_file().then_some(index)
    };
    files.filter_map(index).collect::<BTreeSet<_>>().into_iter().collect()
}

pub(crate) fn record_name(index: u64) -> String {
    format!("records/{index:06}.json")
}

pub(crate) fn cost_name(index: u64) -> String {
    format!("costs/{index:06}.json")
}

/// The problem of a file that does not exist.
pub(crate) const MISSING: &str = "does not exist";

fn read_text(folder: &Path, name: &str) -> Result<String, Error> {
    let bytes = read_bytes(folder, name)?;
    let path = folder.join(name);
    let text = String::from_utf8(bytes);
    Ok(text.map_err(|_| InputError::new(path, "the whole file", "is not UTF-8 text", "make the image again"))?)
}

/// The content of a file of a set.
pub(crate) fn read_bytes(folder: &Path, name: &str) -> Result<Vec<u8>, InputError> {
    let path = own_path(folder, name)?;
    InputFiles::new().read(&path, Role::Result, MAX_TEXT).map_err(|fault| match fault {
        ReadFault::Missing => InputError::of_file(
            &path,
            MISSING,
            "remove the record of its image, and run `dunkelfeld dataset` with the study",
        ),
        other => InputError::of_file(&path, other.problem(), "check the permissions, or make the set again"),
    })
}

/// Writes a file of a set, and follows no link.
fn put(folder: &Path, name: &str, content: &[u8]) -> Result<(), Error> {
    let path = own_path(folder, name)?;
    let parent = path.parent().map_or(Ok(()), fs::create_dir_all);
    written(&path, parent.and_then(|()| write_atomically(&path, |file| file.write_all(content))))
}
