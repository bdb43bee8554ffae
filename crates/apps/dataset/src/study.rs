//! The study file: a job in which values may be distributions, and the table `[study]` that describes the set.

use crate::cameras::change_cameras;
use crate::defect::entries;
use crate::defects::Defect;
use crate::distribution::{Fault, Named, Template};
use crate::draws::Draws;
use crate::expression::check_name;
use crate::label_entry::{LabelEntry, check};
use crate::named::NamedDraws;
use crate::stable_text::stable_text;
use dunkelfeld::{Error, Project};
use dunkelfeld_io::InputError;
use dunkelfeld_io::images::decode_image;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::job::Job;
use dunkelfeld_io::loader::Limits;
use dunkelfeld_io::toml_file::TomlFile;
use dunkelfeld_sampling::hash_u64;
use dunkelfeld_scene::Image;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use twox_hash::{XxHash3_64, XxHash3_128};

/// The largest number of images of a set.
pub const MAX_COUNT: u64 = 1_000_000;
/// Keys of a job that belong to the set.
const OWN_KEYS: [(&str, &str); 3] = [
    ("seed", "write `seed` in [study]: each image has its own"),
    ("frame", "remove it: it is the index of the image"),
    ("output", "remove it: [study.images] describes the files of a set"),
];

/// `[study]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct StudySettings {
    /// Path of a job, relative to the study, whose keys the study extends and replaces.
    job: Option<PathBuf>,
    /// The folder that relative paths refer to, relative to the study. By default that of the study.
    folder: Option<PathBuf>,
    /// Name of the set. By default that of the file.
    name: Option<String>,
    /// Number of images. Default 100.
    count: Option<u64>,
    /// Seed of all draws, samples, noise and devices. Default 0.
    seed: u64,
    /// `"one"`, `"each"`, or the number of images in a row that come from the same device. Default `"one"`.
    device: Device,
    /// So many images come first and have no defects, for training. Default 0.
    train: u64,
    /// Each draw after those gives two images: without its defects, and with them. Default false.
    pairs: bool,
    /// Name of the camera of the images.
    camera: Option<Value>,
    /// Named draws.
    draw: Table,
    /// Files of each image.
    images: ImageSettings,
    /// Files of labels.
    labels: LabelSettings,
    /// Categories of objects.
    label: Vec<LabelEntry>,
    /// Placements of objects.
    place: Vec<Table>,
    /// Defects.
    defect: Vec<Table>,
}

/// The device of an image: the pattern of its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Value")]
pub(crate) enum Device {
    /// All images are of one device.
    #[default]
    One,
    /// So many images in a row are of one device.
    Series(u64),
}

impl TryFrom<Value> for Device {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match &value {
            Value::String(text) if text == "one" => Ok(Self::One),
            Value::String(text) if text == "each" => Ok(Self::Series(1)),
            Value::Integer(n) if *n > 0 => Ok(Self::Series(*n as u64)),
            _ => Err("expected \"one\", \"each\", or the number of images of a device, from 1".into()),
        }
    }
}

/// `[study.images]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ImageSettings {
    /// The 8-bit picture, gamma 2.2. Default `"png"`.
    pub(crate) picture: PictureFormat,
    /// Quality of a JPEG, 1 to 100. Default 95.
    pub(crate) quality: u8,
    /// Linear grey values, 16 bit; a Bayer sensor gives its mosaic. Default `"none"`.
    pub(crate) linear: LinearFormat,
    /// Linear grey values without a header: rows from the top, little-endian, 16 bit. Default false.
    pub(crate) raw: bool,
    /// A second tree of the pictures, for readers of another data set. Default `"none"`.
    pub(crate) layout: Layout,
}

impl Default for ImageSettings {
    fn default() -> Self {
        let (picture, linear) = (PictureFormat::Png, LinearFormat::None);
        Self { picture, quality: 95, linear, raw: false, layout: Layout::None }
    }
}

/// A tree of pictures beside `images/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Layout {
    /// No tree.
    None,
    /// That of MVTec AD, for the detection of anomalies.
    Mvtec,
}

/// Format of the 8-bit picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PictureFormat {
    Png,
    Jpeg,
    None,
}

/// Format of the linear image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum LinearFormat {
    Png,
    Tiff,
    None,
}

/// `[study.labels]`: which labels are written.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct LabelSettings {
    /// Instance id of each pixel, 16-bit PNG. Default true.
    pub(crate) masks: bool,
    /// Category id of each pixel, 8-bit PNG. Default false.
    pub(crate) semantic: bool,
    /// Share of the pixel that its instance covers, 16-bit PNG; the samples have this number on each side of a pixel. 1
    /// means none. Default 1.
    pub(crate) coverage: u32,
    /// Depth along the axis of the camera, 16-bit PNG in units of 0.1 mm, 0 where there is none. Default false.
    pub(crate) depth: bool,
    /// Normals in the frame of the camera (x right, y down, z forward), 16-bit RGB PNG. Default false.
    pub(crate) normals: bool,
    /// Annotations in the format of COCO. Default `"rle"`.
    pub(crate) coco: Segmentation,
    /// Labels in the format of YOLO. Default `"none"`.
    pub(crate) yolo: Yolo,
    /// Camera matrices and poses in the format of BOP. Default false.
    pub(crate) bop: bool,
}

impl Default for LabelSettings {
    fn default() -> Self {
        Self {
            masks: true,
            semantic: false,
            coverage: 1,
            depth: false,
            normals: false,
            coco: Segmentation::Rle,
            yolo: Yolo::None,
            bop: false,
        }
    }
}

/// Segmentation in COCO files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Segmentation {
    /// Run-length encoding: exact.
    Rle,
    /// Outlines where an instance has no holes, otherwise run-length encoding.
    Polygon,
    /// No COCO file.
    None,
}

/// Shapes in the format of YOLO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Value")]
pub(crate) enum Yolo {
    /// No files.
    None,
    /// Boxes along the axes, with key points.
    Boxes,
    /// Outlines.
    Segments,
    /// The smallest rectangles in any direction.
    Oriented,
}

impl TryFrom<Value> for Yolo {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match (value.as_bool(), value.as_str()) {
            (Some(false), _) | (_, Some("none")) => Ok(Self::None),
            (Some(true), _) | (_, Some("boxes")) => Ok(Self::Boxes),
            (_, Some("segments")) => Ok(Self::Segments),
            (_, Some("oriented")) => Ok(Self::Oriented),
            _ => Err("expected \"boxes\", \"segments\", \"oriented\" or \"none\"".into()),
        }
    }
}

#[derive(Deserialize)]
struct StudyOnly {
    study: StudySettings,
}

/// A study: a job, what varies in it, and what a set of its images contains.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name of the study.
    pub name: String,
    /// Number of images that the study names.
    pub count: u64,
    pub(crate) seed: u64,
    pub(crate) device: Device,
    pub(crate) train: u64,
    pub(crate) pairs: bool,
    pub(crate) images: ImageSettings,
    pub(crate) labels: LabelSettings,
    pub(crate) label: Vec<LabelEntry>,
    pub(crate) place: Vec<Template>,
    pub(crate) defect: Vec<Template>,
    /// The named draws.
    draw: BTreeMap<String, Template>,
    pub(crate) camera: Option<Template>,
    /// The keys of the job, as far as the study has them.
    pub(crate) template: Template,
    /// The keys of the named job.
    base: Table,
    source: TomlFile,
    folder: PathBuf,
    job_path: PathBuf,
    hash: String,
    inputs: InputFiles,
    /// The pictures of decals, by their paths as the study has them.
    pictures: BTreeMap<String, Image>,
}

/// A job with all values drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DrawnJob {
    /// The text of the job.
    pub(crate) text: String,
    /// The name and value of each distribution of the job.
    pub(crate) drawn: BTreeMap<String, Value>,
    pub(crate) seed: u64,
    pub(crate) frame: u32,
    /// Name of the camera, where the job does not select it.
    pub(crate) camera: Option<String>,
}

impl Study {
    /// Reads a study.
    ///
    /// # Errors
    /// A file that cannot be read, unknown keys and values out of range, with their place.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let mut inputs = InputFiles::new();
        let source = TomlFile::read(path.as_ref(), Role::Job, &mut inputs)?;
        Ok(Self::from_toml(source, inputs)?)
    }

    /// A study from a text. Messages name `path`, and paths in the study are relative to its folder. The file need not
    /// exist.
    ///
    /// # Errors
    /// As [`Study::open`].
    pub fn from_text(path: impl Into<PathBuf>, text: &str) -> Result<Self, Error> {
        Ok(Self::from_toml(TomlFile::from_text(path, text), InputFiles::new())?)
    }

    fn from_toml(source: TomlFile, mut inputs: InputFiles) -> Result<Self, InputError> {
        let StudyOnly { study } = source.parse().map_err(|e| match e.place.as_str() {
            "study" => InputError::new(
                source.path(),
                "[study]",
                "the file has no table [study]",
                "write [study], or use `dunkelfeld render` for a job",
            ),
            _ => e,
        })?;
        let mut rest: Table = source.parse()?;
        rest.remove("study");
        for (key, help) in OWN_KEYS {
            if rest.contains_key(key) {
                return Err(source.error_at_key(&[key], format!("`{key}` is not for the images of a set"), help));
            }
        }
        let at = |fault: Fault, path: &[&str]| fault.in_file(&source, path);
        let template = Template::parse(Value::Table(rest)).map_err(|e| at(e, &[]))?;
        let mut draw = BTreeMap::new();
        for (name, value) in study.draw {
            let parsed = check_name(&name).and_then(|()| Template::parse(value));
            draw.insert(name.clone(), parsed.map_err(|e| at(e, &["study", "draw", &name]))?);
        }
        let camera = study.camera.map(Template::parse).transpose().map_err(|e| at(e, &["study", "camera"]))?;
        let list = |key: &str, tables: Vec<Table>| -> Result<Vec<Template>, InputError> {
            (tables.into_iter().enumerate())
                .map(|(i, table)| {
                    Template::parse(Value::Table(table)).map_err(|e| at(e, &["study", key, &i.to_string()]))
                })
                .collect()
        };
        let (place, defect) = (list("place", study.place)?, list("defect", study.defect)?);
        check(&study.label).map_err(|(i, fault)| at(fault, &["study", "label", &i.to_string()]))?;
        let count = study.count.unwrap_or(100);
        for (path, value, most) in [
            (&["study", "count"][..], count, MAX_COUNT),
            (&["study", "labels", "coverage"], u64::from(study.labels.coverage), 16),
            (&["study", "images", "quality"], u64::from(study.images.quality), 100),
        ] {
            if !(1..=most).contains(&value) {
                let problem = format!("{value} is out of range");
                return Err(source.error_at_key(path, problem, format!("write a whole number from 1 to {most}")));
            }
        }
        let own = source.path().parent().unwrap_or(Path::new(""));
        let folder = study.folder.as_ref().map_or(own.to_path_buf(), |folder| own.join(folder));
        let (base, job_path) = match &study.job {
            None => (Table::new(), folder.join(source.path().file_name().unwrap_or_default())),
            Some(job) => (base_of(&source, &folder.join(job), &mut inputs)?, folder.join(job)),
        };
        let name = name_of(&source, study.name)?;
        let job = toml::to_string(&base).unwrap_or_default();
        let text = format!("{name}\n{job}\n{}", stable_text(source.text(), &name));
        let study = Self {
            pictures: pictures_of(&source, (&defect, &draw), &folder, &mut inputs)?,
            name,
            count,
            seed: study.seed,
            device: study.device,
            train: study.train,
            pairs: study.pairs,
            images: study.images,
            labels: study.labels,
            label: study.label,
            place,
            defect,
            draw,
            camera,
            template,
            base,
            hash: format!("{:032x}", XxHash3_128::oneshot(text.as_bytes())),
            source,
            folder,
            job_path,
            inputs,
        };
        // Names of draws that do not exist are found before the first image.
        study.job(0)?;
        Ok(study)
    }

    /// The job of an image, with all values drawn.
    pub(crate) fn job(&self, index: u64) -> Result<DrawnJob, InputError> {
        let draws = self.draws(index);
        let mut drawn = BTreeMap::new();
        let mut record = |name: &str, value: &Value| drop(drawn.insert(name.to_owned(), value.clone()));
        let mut named = self.named(draws);
        let value = self.template.draw(draws, "", &mut named, &mut record).map_err(|e| self.error(e, &[]))?;
        for name in self.draw.keys() {
            named.value(name).map_err(|e| self.error(e, &["study", "draw", name]))?;
        }
        drawn.extend(named.values.iter().map(|(name, value)| (format!("draw.{name}"), value.clone())));
        let selected = self.camera.as_ref().map(|camera| {
            let chosen =
                camera.draw(draws, "camera", &mut named, &mut |n, v| drop(drawn.insert(n.to_owned(), v.clone())));
            chosen.and_then(|name| name.as_str().map(str::to_owned).ok_or_else(no_camera_name))
        });
        let selected = selected.transpose().map_err(|e| self.error(e, &["study", "camera"]))?;
        let mut table = self.base.clone();
        if let Value::Table(mut own) = value {
            if let (Some(cameras), Some(Value::Array(list))) = (own.get("camera"), table.get_mut("camera")) {
                let is_list = cameras.is_array();
                let changes = match cameras {
                    Value::Array(changes) => changes.as_slice(),
                    change => std::slice::from_ref(change),
                };
                let added = change_cameras(list, changes, is_list).map_err(|e| self.error(e, &[]))?;
                if added.is_empty() {
                    own.remove("camera");
                } else {
                    own.insert("camera".into(), Value::Array(added));
                }
            }
            if own.contains_key("budget") {
                // Limits of the job would end the images as well.
                table.remove("budget");
            }
            dunkelfeld_io::toml_file::merge(&mut table, own);
        }
        let sensor = table.entry("sensor").or_insert_with(|| Value::Table(Table::new()));
        if let Value::Table(sensor) = sensor
            && sensor.get("model").and_then(Value::as_str) != Some("none")
        {
            sensor.entry("exposure_noise").or_insert_with(|| Value::String("matched".into()));
        }
        // TOML has signed numbers.
        let device = match self.device {
            Device::One => 0,
            Device::Series(images) => draws.index / images,
        };
        let seed = hash_u64([self.seed, XxHash3_64::oneshot(b"device"), device]) >> 1;
        table.insert("seed".into(), Value::Integer(seed as i64));
        let frame = u32::try_from(draws.index).unwrap_or(u32::MAX);
        table.insert("frame".into(), Value::Integer(i64::from(frame)));
        let text = toml::to_string(&table).map_err(|e| {
            InputError::new(self.source.path(), "the study", format!("makes no job: {e}"), "check its values")
        })?;
        Ok(DrawnJob { text, drawn, seed, frame, camera: selected })
    }

    /// # Errors
    /// There is no camera of a name for an image.
    pub(crate) fn check_camera(&self, name: &str, project: &Project, index: u64) -> Result<(), InputError> {
        let names: Vec<&str> = project.scene.cameras().iter().map(|camera| camera.name.as_str()).collect();
        if names.contains(&name) {
            return Ok(());
        }
        let problem = format!("image {index}: there is no camera \"{name}\"");
        let key: &[&str] = if self.camera.is_some() { &["study", "camera"] } else { &["camera"] };
        Err(self.error(Fault::new(problem, format!("the cameras are {}", names.join(", "))), key))
    }

    /// The draws of an image. Those of a pair are the same.
    pub(crate) fn draws(&self, index: u64) -> Draws {
        let index = match index.checked_sub(self.train) {
            Some(after) if self.pairs => self.train + after / 2,
            _ => index,
        };
        Draws { seed: hash_u64([self.seed, XxHash3_64::oneshot(self.name.as_bytes())]), index }
    }

    /// Has an image the defects of its draws?
    pub(crate) fn has_defects(&self, index: u64) -> bool {
        index >= self.train && !(self.pairs && (index - self.train).is_multiple_of(2))
    }

    /// The named draws of an image, computed when they are needed.
    pub(crate) fn named(&self, draws: Draws) -> NamedDraws<'_> {
        NamedDraws::new(&self.draw, draws)
    }

    /// The picture of a decal.
    ///
    /// # Errors
    /// A name that no `choice` or `sequence` has, so that the file was not read.
    pub(crate) fn picture(&self, defect: &Defect) -> Result<Option<Image>, Fault> {
        let Defect::Decal(decal) = defect else { return Ok(None) };
        let unknown = || {
            let help = "write a path, or `choice` or `sequence` of paths, also as a draw of [study.draw]";
            Fault::new(format!("the picture \"{}\" was not read before the first image", decal.image), help)
                .below("image")
        };
        self.pictures.get(&decal.image).cloned().map(Some).ok_or_else(unknown)
    }

    /// May the images have different devices?
    pub(crate) fn has_devices(&self) -> bool {
        self.device != Device::One
    }

    /// An error about a value of the study.
    pub(crate) fn error(&self, fault: Fault, path: &[&str]) -> InputError {
        fault.in_file(&self.source, path)
    }

    /// An error about an image in an entry of a list of the study.
    pub(crate) fn image_error(&self, index: u64, list: &str, number: usize, fault: Fault) -> InputError {
        let fault = Fault { problem: format!("image {index}: {}", fault.problem), ..fault };
        self.error(fault, &["study", list, &number.to_string()])
    }

    /// Hash of all texts of the study, without what depends on its place: sets of the same hash have the same images.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// The file of the study.
    pub fn path(&self) -> &Path {
        self.source.path()
    }

    /// The text of the study.
    pub(crate) fn text(&self) -> &str {
        self.source.text()
    }

    /// The file of the study with its text.
    pub(crate) fn source(&self) -> &TomlFile {
        &self.source
    }

    /// The keys of the named job.
    pub(crate) fn base(&self) -> &Table {
        &self.base
    }

    /// The folder that relative paths of the study refer to.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file whose folder relative paths of the job refer to.
    pub(crate) fn job_path(&self) -> &Path {
        &self.job_path
    }

    /// The files of the study and of its job.
    pub fn inputs(&self) -> &InputFiles {
        &self.inputs
    }

    /// Reads the jobs and the numbers of defects of the first images, so that a distribution over a key that does not exist,
    /// or values out of range, are found before the first image.
    ///
    /// # Errors
    /// The first fault, with the study as its file.
    pub fn check_jobs(&self, count: u64) -> Result<(), Error> {
        const CHECKED: u64 = 64;
        let at = |(number, fault): (usize, Fault)| self.error(fault, &["study", "defect", &number.to_string()]);
        let entries = entries(self).map_err(at)?;
        for index in 0..count.min(CHECKED) {
            let job = self.job(index)?;
            Job::from_text(&self.job_path, job.text).map_err(|e| self.in_study(e, index))?;
            entries.iter().try_for_each(|entry| entry.check_count(self, index).map_err(at))?;
        }
        Ok(())
    }
}

/// The keys of the job of a study.
fn base_of(source: &TomlFile, path: &Path, inputs: &mut InputFiles) -> Result<Table, InputError> {
    let file = TomlFile::read(path, Role::Job, inputs).map_err(|e| {
        let problem = format!("{}: {}", path.display(), e.problem);
        source.error_at_key(&["study", "job"], problem, "name a job file")
    })?;
    let mut table: Table = file.parse()?;
    OWN_KEYS.iter().for_each(|(key, _)| drop(table.remove(*key)));
    Ok(table)
}

/// The pictures that the decals of a study name.
fn pictures_of(
    source: &TomlFile,
    (defects, draws): (&[Template], &BTreeMap<String, Template>),
    folder: &Path,
    inputs: &mut InputFiles,
) -> Result<BTreeMap<String, Image>, InputError> {
    let limits = Limits::default();
    let mut pictures = BTreeMap::new();
    for (number, defect) in defects.iter().enumerate() {
        for name in defect.texts_of("image", draws) {
            let at = |problem: String, help: &str| {
                source.error_at_key(
                    &["study", "defect", &number.to_string(), "image"],
                    format!("{name}: {problem}"),
                    help,
                )
            };
            let path = folder.join(&name);
            let bytes =
                inputs.read(&path, Role::Texture, limits.file_bytes).map_err(|e| at(e.problem(), e.help(&path)))?;
            let decoded = decode_image(&bytes, &name, &limits).map_err(|e| at(e.problem, &e.help))?;
            pictures.insert(name, decoded.image);
        }
    }
    Ok(pictures)
}

/// The name of a study, by default that of its file.
fn name_of(source: &TomlFile, name: Option<String>) -> Result<String, InputError> {
    let stem = || source.path().file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let name = name.unwrap_or_else(stem);
    if name.is_empty() || name.contains(['/', '\\', '\0']) || name == "." || name == ".." {
        let help = "write a name without slashes, which can be the name of a folder";
        return Err(source.error_at_key(&["study", "name"], format!("{name:?} is not the name of a set"), help));
    }
    Ok(name)
}

fn no_camera_name() -> Fault {
    Fault::new("not the name of a camera", "write the name of a camera, or a distribution over names")
}

#[cfg(test)]
#[path = "study_tests.rs"]
mod tests;
