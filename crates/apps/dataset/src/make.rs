//! One image of a set with its labels and its record.

use crate::checks::{check, warnings};
use crate::coco::Annotation;
use crate::defect::{AddedDefect, DefectEntry, add_defects, entries};
use crate::defects::PlacedDefect;
use crate::distribution::Fault;
use crate::encode::{self, Files};
use crate::ids::{Ids, ObjectLabel};
use crate::inputs::{InputRecord, input_records};
use crate::keypoints::{InstancePoints, PointObject, film_points};
use crate::labels::{LabelCamera, LabelLayers, LabelObjects, LabelPlanes, PixelBox, trace_labels};
use crate::layout::{TreeImage, add_tree};
use crate::names::ObjectNames;
use crate::pinhole::{Pinhole, image_box};
use crate::placement::Placement;
use crate::pose::{poses, shape};
use crate::record::{CaptureRecord, Cost, FileRecord, InstanceRecord, PlaceRecord, Record};
use crate::set::Set;
use crate::study::{DrawnJob, Layout, LinearFormat, MAX_COUNT, Study, Yolo};
use crate::surface_path::Surfaces;
use crate::visibility::{Bounds, Exposed, Visibility, visibility};
use dunkelfeld::film::FilmLayers;
use dunkelfeld::guard::check_outputs;
use dunkelfeld::{
    Budget, Cancel, DenoiseMethod, Error, Project, ProjectOptions, ProjectResult, SensorChoice, Session, Silent, Stage,
};
use dunkelfeld_film::Plane;
use dunkelfeld_geometry::{DAffine3, DVec3};
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_scene::{Camera, Instance, RayGenerator, SceneBuilder};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use toml::Value;

/// Makes images of a study. The scene is loaded once; each image builds only the parts again that differ.
pub struct Worker {
    study: Arc<Study>,
    project: Project,
    ids: Ids,
    entries: Vec<DefectEntry>,
    session: Session<'static>,
    threads: usize,
    warnings: Vec<String>,
}

/// An image, before its files are written.
#[derive(Clone, Debug)]
pub struct Made {
    /// The record, which contains the hashes of the files.
    pub record: Record,
    /// The files by their names in the folder of the set.
    pub files: Vec<(String, Vec<u8>)>,
    /// The time it took.
    pub cost: Cost,
}

impl Made {
    /// Are the files those of the record? A copy from another process may be damaged.
    pub fn is_whole(&self) -> bool {
        let is_same = |(name, content): &(String, Vec<u8>)| {
            self.record.files.get(name).is_some_and(|record| *record == FileRecord::of(content))
        };
        self.files.len() == self.record.files.len() && self.files.iter().all(is_same)
    }
}

/// The images that a run makes.
pub struct Start {
    /// The set, which is open for them.
    pub set: Set,
    /// Number of images that the run shall make or find.
    pub wanted: u64,
    /// Those that are not finished, in ascending order.
    pub missing: Vec<u64>,
}

/// The parts of the scene that the labels of an image need.
#[derive(Default)]
struct SceneParts {
    defects: Vec<AddedDefect>,
    /// The bounds of each defect in the world.
    boxes: Vec<[DVec3; 2]>,
    /// The bounds of each labelled object in the world.
    labelled: Vec<[DVec3; 2]>,
    /// The transform of each object to the world, by its index.
    poses: Vec<DAffine3>,
    /// The hash of the shape of each object, by its index; 0 without a label. Empty if no file has models.
    shapes: Vec<u64>,
    /// The diagonal of the bounds of each object with key points, by its index.
    pointed: BTreeMap<usize, f64>,
}

impl SceneParts {
    /// `shapes` are those of the objects without defects, for files with models: a defect makes no other model.
    fn new(scene: &SceneBuilder, ids: &Ids, defects: Vec<AddedDefect>, shapes: Option<&[u64]>) -> Self {
        let names: Vec<String> = scene.instances.iter().map(|i| i.name.clone()).collect();
        let labels = ids.label(&names, &defects).unwrap_or_default();
        let is_defect = |name: &String| defects.iter().any(|defect| defect.placed.object == *name);
        let mut parts = Self::default();
        for (i, object) in scene.instances.iter().enumerate() {
            let label = labels.get(i).copied().flatten();
            let (bounds, is_defect) = (scene.bounds_of(object), is_defect(&object.name));
            parts.poses.push(object.to_world);
            parts.boxes.extend(bounds.filter(|_| is_defect));
            parts.labelled.extend(bounds.filter(|_| label.is_some()));
            if let Some(shapes) = shapes {
                let own = || shapes.get(i).copied().unwrap_or_else(|| shape_of(scene, object));
                parts.shapes.push(label.map_or(0, |_| own()));
            }
            if let Some([low, high]) = bounds
                && label.is_some()
                && !is_defect
                && !ids.keypoints(&object.name).is_empty()
            {
                parts.pointed.insert(i, low.distance(high));
            }
        }
        Self { defects, ..parts }
    }
}

/// The pictures of an image, and their records: that of the first, and those of captures by name.
struct Images {
    record: CaptureRecord,
    captures: BTreeMap<String, CaptureRecord>,
    files: Files,
}

/// The labels of an image.
struct Labelled {
    camera: Camera,
    /// By the index of the object.
    objects: Vec<Option<ObjectLabel>>,
    planes: LabelPlanes,
    instances: Vec<InstanceRecord>,
    points: Vec<InstancePoints>,
}

impl Worker {
    /// Loads the scene of a study. `threads` is the number of threads of each image, also of the build of its scene; 0 means
    /// one per core.
    ///
    /// # Errors
    /// A job or scene that cannot be opened, labels and defects that match no object.
    pub fn open(study: &Arc<Study>, threads: usize) -> Result<Self, Error> {
        let job = study.job(0)?;
        let options = ProjectOptions::default().with_threads(threads);
        let project =
            Project::from_text_with(study.job_path(), &job.text, options).map_err(|e| in_study(study, e, 0))?;
        let at = |(number, fault): (usize, Fault)| study.error(fault, &["study", "defect", &number.to_string()]);
        let entries = entries(study).map_err(at)?;
        let mut names = ObjectNames::new(study, &project);
        entries.iter().try_for_each(|entry| entry.check(study, &mut names).map_err(at))?;
        Placement::check(study, &mut names)
            .map_err(|(number, fault)| study.error(fault, &["study", "place", &number.to_string()]))?;
        let ids = Ids::new(study, &mut names, &entries)
            .map_err(|(number, fault)| study.error(fault, &["study", "label", &number.to_string()]))?;
        check(study, &project, &names, &ids)?;
        let warnings = warnings(study, &project);
        let session = Session::new(threads)?;
        Ok(Self { study: study.clone(), project, ids, entries, session, threads, warnings })
    }

    /// Settings of the study that have no effect, in sentences.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Opens the folder of a set of the study for its images, and creates it with its parents if there is none. A set may
    /// grow; it never shrinks. By default it has the number of images of the study.
    ///
    /// # Errors
    /// A set of another study, of other input files or of another version of the program; a folder that contains other
    /// files, or files that the images are made from; a folder that cannot be written to.
    pub fn open_set(&self, folder: &Path, count: Option<u64>) -> Result<Set, Error> {
        let count = checked_count(&self.study, count)?;
        Set::start(folder, &self.study, &self.ids, self.inputs_of(folder)?, count)
    }

    /// Opens the folder of a set, as [`Self::open_set`], to make the images `indices`, by default all. If the set has no image
    /// yet, the draws of the first one are checked before the folder is made.
    ///
    /// # Errors
    /// As [`Self::open_set`] and [`Self::make`], and an index that the set does not have.
    pub fn start(&mut self, folder: &Path, count: Option<u64>, indices: Option<&[u64]>) -> Result<Start, Error> {
        let count = checked_count(&self.study, count)?;
        let wanted: BTreeSet<u64> = indices.map_or_else(|| (0..count).collect(), |all| all.iter().copied().collect());
        if let Some(index) = wanted.last().filter(|index| **index >= count) {
            let problem = format!("there is no image {index}: the set has {count}, counted from 0");
            return Err(Error::setting("index", problem, "use a smaller index, or a larger count"));
        }
        // The scene of the first image may read other files.
        let inputs = self.inputs_of(folder)?;
        let is_empty = Set::read(folder).map_or(true, |set| set.finished().is_empty());
        if let Some(first) = wanted.first().filter(|_| is_empty) {
            self.enter(*first)?;
            self.project.fitted().map_err(|e| in_study(&self.study, e, *first))?;
        }
        let set = Set::start(folder, &self.study, &self.ids, inputs, count)?;
        let done: BTreeSet<u64> = set.finished().into_iter().collect();
        Ok(Start { set, wanted: wanted.len() as u64, missing: wanted.difference(&done).copied().collect() })
    }

    /// The input files of a set, which are not in its folder.
    fn inputs_of(&self, folder: &Path) -> Result<Vec<InputRecord>, Error> {
        let mut inputs = self.project.inputs.clone();
        inputs.extend(self.study.inputs());
        check_outputs(&[("the set", folder)], &inputs)?;
        check_folder(folder, &inputs)?;
        Ok(input_records(&self.study, &self.project.inputs))
    }

    /// The files that the images are made from.
    pub fn project(&self) -> &Project {
        &self.project
    }

    /// Makes an image: the same bytes alone, in any order, with any number of threads. `seconds` replaces the budget of the
    /// job by a time, with which the image depends on the speed of the machine. `None` if it was cancelled.
    ///
    /// # Errors
    /// Values that the scene refuses, a placement that is impossible, and the errors of a render.
    pub fn make(&mut self, index: u64, seconds: Option<f64>, cancel: &Cancel) -> Result<Option<Made>, Error> {
        if index >= MAX_COUNT {
            let problem = format!("there is no image {index}");
            return Err(Error::setting("index", problem, format!("a set has at most {MAX_COUNT} images, from 0")));
        }
        let began = Instant::now();
        let (job, parts) = self.enter(index)?;
        let change = began.elapsed().as_secs_f64();
        self.choose_settings(seconds);
        let (mut first, mut captures, mut files) = (None, BTreeMap::new(), Vec::new());
        let each = &mut |capture: Option<&str>, result: ProjectResult| {
            let name = capture.map_or_else(|| format!("{index:06}"), |capture| format!("{index:06}-{capture}"));
            encode::images(&mut files, &name, &self.study.images, &result.frame)?;
            let pixels = f64::from(result.settings().width) * f64::from(result.settings().height);
            let record = CaptureRecord::new(&result.frame, pixels);
            if let Some(capture) = capture {
                captures.insert(capture.to_owned(), record.clone());
            }
            first.get_or_insert((result, record));
            Ok(())
        };
        let rendered = self.project.render_captures(&Silent, cancel, each);
        rendered.map_err(|e| in_study(&self.study, e, index))?;
        let Some((result, record)) = first.filter(|(result, _)| !result.rendering.interrupted) else { return Ok(None) };
        // The sum of no stage is a positive zero.
        let stage = |all: &[Stage]| -> f64 {
            let seconds = result.rendering.stages.iter().filter(|(stage, _)| all.contains(stage)).map(|(_, s)| s);
            seconds.fold(0.0, |sum, s| sum + s)
        };
        let render = stage(&[Stage::Training, Stage::Pilot, Stage::Refine]);
        let plan = stage(&[Stage::Plan]);
        let expose = began.elapsed().as_secs_f64() - change - render - plan;
        let labelled = self.label(index, &parts, &result)?;
        let label = began.elapsed().as_secs_f64() - change - render - plan - expose;
        let images = Images { record, captures, files };
        let (record, files) = self.encode(index, job, &parts, (&result, images), labelled)?;
        let total = began.elapsed().as_secs_f64();
        let write = total - change - render - plan - expose - label;
        Ok(Some(Made { record, files, cost: Cost { change, render, plan, expose, label, write, total } }))
    }

    /// Draws the job of an image, and changes the scene to it.
    fn enter(&mut self, index: u64) -> Result<(DrawnJob, SceneParts), Error> {
        let mut job = self.study.job(index)?;
        let parts = self.change_scene(index, &mut job)?;
        self.check_sensor(index)?;
        Ok((job, parts))
    }

    /// Changes the scene to that of an image.
    fn change_scene(&mut self, index: u64, job: &mut DrawnJob) -> Result<SceneParts, Error> {
        let (study, entries, ids) = (&self.study, &self.entries, &self.ids);
        let draws = study.draws(index);
        let drawn = &mut job.drawn;
        let mut parts = SceneParts::default();
        let changed = self.project.set_job(&job.text, |scene| {
            for number in 0..study.place.len() {
                let at = |fault| study.image_error(index, "place", number, fault);
                let mut record = BTreeMap::new();
                let placement = Placement::drawn(study, number, index, &mut record).map_err(at)?;
                placement.apply(scene, draws, &mut record).map_err(at)?;
                drawn.append(&mut record);
            }
            let entries = if study.has_defects(index) { entries.as_slice() } else { &[] };
            let shapes: Option<Vec<u64>> =
                study.labels.bop.then(|| scene.instances.iter().map(|object| shape_of(scene, object)).collect());
            let defects = add_defects(entries, study, scene, draws, drawn)
                .map_err(|(number, fault)| study.image_error(index, "defect", number, fault))?;
            parts = SceneParts::new(scene, ids, defects, shapes.as_deref());
            Ok(())
        });
        changed.map_err(|e| in_study(study, e, index))?;
        if let Some(name) = &job.camera {
            study.check_camera(name, &self.project, index)?;
        }
        // Captures are of one camera as well.
        let first = self.project.defined_cameras().into_iter().next();
        let first = first.filter(|_| !self.project.capture_names(None).is_empty());
        self.project.settings.camera = job.camera.clone().or(first);
        Ok(parts)
    }

    /// Grey values are those of a sensor.
    fn check_sensor(&self, index: u64) -> Result<(), Error> {
        let images = &self.study.images;
        let key = if images.raw { "raw" } else { "linear" };
        let has_values = images.raw || images.linear != LinearFormat::None;
        if !has_values || matches!(self.project.settings.sensor, SensorChoice::Emva { .. }) {
            return Ok(());
        }
        let problem = format!("image {index}: there is no sensor, so there are no grey values");
        let fault = Fault::new(problem, "let each image have a sensor, or remove this key");
        Err(self.study.error(fault, &["study", "images", key]).into())
    }

    fn choose_settings(&mut self, seconds: Option<f64>) {
        let settings = &mut self.project.settings;
        settings.run.threads = self.threads;
        let is_denoised = settings.denoise.method != DenoiseMethod::Off;
        settings.run.layers = if is_denoised { FilmLayers::All } else { FilmLayers::Image };
        if let Some(seconds) = seconds {
            settings.budget = Budget::default().with_seconds(seconds);
        }
    }

    fn label(&self, index: u64, parts: &SceneParts, result: &ProjectResult) -> Result<Labelled, Error> {
        let (study, scene, settings) = (&self.study, &self.project.scene, result.settings());
        let size @ [width, height] = [settings.width, settings.height];
        let objects = self.ids.label(scene.object_names(), &parts.defects).map_err(|problem| {
            let fault = Fault::new(format!("image {index}: {problem}"), "an image has at most 65535 instances");
            study.error(fault, &["study", "label"])
        })?;
        let camera =
            settings.run.view.clone().ok_or_else(|| Error::setting("camera", "there is none", "name a camera"))?;
        let rays = scene.ray_generator(&camera, width, height)?;
        let surfaces = result.frame.sensor.is_some() && !parts.defects.is_empty();
        let layers = LabelLayers {
            samples: study.labels.coverage,
            depth: study.labels.depth,
            normals: study.labels.normals,
            surfaces,
            below: surfaces && parts.defects.iter().any(AddedDefect::is_change),
        };
        let box_of = |bounds| image_box(&camera, scene.shutter(), size, bounds).unwrap_or([0, 0, width, height]);
        let refined: Vec<PixelBox> = parts.boxes.iter().copied().map(box_of).collect();
        let labelled = LabelCamera { rays: &rays, pose: camera.to_world, size };
        let on_film = LabelObjects { labels: &objects, bounds: &parts.labelled, refined: &refined };
        let planes = self.session.install(|| trace_labels(scene, labelled, on_film, layers));
        let instances = self.instances(&planes, parts, &objects, result);
        let points = self.keypoints(parts, &objects, &rays, size);
        Ok(Labelled { camera, objects, planes, instances, points })
    }

    /// The record and the files of an image.
    fn encode(
        &self,
        index: u64,
        job: DrawnJob,
        parts: &SceneParts,
        (result, images): (&ProjectResult, Images),
        labelled: Labelled,
    ) -> Result<(Record, Files), Error> {
        let Images { record: CaptureRecord { exposure, certificate, matched }, captures, mut files } = images;
        let Labelled { camera, objects, planes, mut instances, points } = labelled;
        let (study, wanted) = (&self.study, &self.study.labels);
        let size @ [width, height] = [result.settings().width, result.settings().height];
        let name = format!("{index:06}");
        let categories: BTreeMap<u16, u16> = instances.iter().map(|i| (i.id, i.category)).collect();
        encode::labels(&mut files, &name, wanted, &planes, &categories)?;
        let mut annotations: Vec<Annotation> =
            encode::annotations(index, wanted, &planes, &instances, &points, &self.ids);
        annotations.sort_by_key(|a| a.instance);
        let count = self.ids.most_keypoints();
        let yolo = (wanted.yolo != Yolo::None)
            .then(|| encode::yolo(wanted.yolo, &planes.instances, &instances, &points, count));
        if study.images.layout == Layout::Mvtec {
            let image = TreeImage {
                index,
                is_training: index < study.train,
                is_defective: !parts.defects.is_empty(),
                instances: &instances,
                mask: &planes.instances,
            };
            add_tree(&mut files, &image, &self.ids)?;
        }
        let file_name = files.iter().find(|(n, _)| n.starts_with("images/") || n.starts_with("linear/"));
        let labels = encode::ImageLabels {
            index,
            file_name: file_name.map(|(n, _)| n.clone()).unwrap_or_default(),
            width,
            height,
            annotations,
            camera: Pinhole::new(&camera, self.project.scene.shutter(), size),
            poses: poses(camera.to_world, &parts.poses, &objects, &parts.shapes, &mut instances),
            keypoints: points,
        };
        files.push((format!("labels/{name}.json"), encode::json(&labels)));
        // Readers find the labels by the name of the picture.
        let pictures: Vec<String> = (files.iter())
            .filter_map(|(file, _)| file.strip_prefix("images/")?.rsplit_once('.').map(|(stem, _)| stem.to_owned()))
            .collect();
        files.extend(yolo.into_iter().flat_map(|yolo| {
            pictures.iter().map(move |stem| (format!("labels/{stem}.txt"), yolo.clone().into_bytes()))
        }));
        let record = Record {
            index,
            study: study.hash().to_owned(),
            drawn: job.drawn.iter().map(|(name, value)| (name.clone(), json_of(value))).collect(),
            seed: job.seed,
            frame: job.frame,
            width,
            height,
            exposure,
            samples: result.stats.sampling.samples,
            certificate,
            matched,
            captures,
            instances,
            files: files.iter().map(|(name, content)| (name.clone(), FileRecord::of(content))).collect(),
        };
        Ok((record, files))
    }

    /// The key points of the objects of an image, by instance. Of objects with one name the first counts.
    fn keypoints(
        &self,
        parts: &SceneParts,
        objects: &[Option<ObjectLabel>],
        rays: &RayGenerator,
        size: [u32; 2],
    ) -> Vec<InstancePoints> {
        let scene = &self.project.scene;
        let mut found: BTreeMap<u16, InstancePoints> = BTreeMap::new();
        for (&index, &diagonal) in &parts.pointed {
            let (Some(Some(label)), Some(name)) = (objects.get(index), scene.object_names().get(index)) else {
                continue;
            };
            let Some(&to_world) = parts.poses.get(index).filter(|_| !found.contains_key(&label.instance)) else {
                continue;
            };
            // Key points have true lengths, and vertices those of their file.
            let to_world = to_world * DAffine3::from_scale(self.project.imported_scale_of(name).recip());
            let object = PointObject { index: index as u32, to_world, diagonal };
            let points = film_points(scene, rays, size, &object, self.ids.keypoints(name));
            found.insert(label.instance, InstancePoints { instance: label.instance, name: name.clone(), points });
        }
        found.into_values().collect()
    }

    /// The place of a defect in the world and in the frame of its object.
    fn place(&self, placed: &PlacedDefect, parts: &SceneParts) -> PlaceRecord {
        let object = parts.poses.get(placed.host).and_then(|to_world| {
            let to_world = *to_world * DAffine3::from_scale(self.project.imported_scale_of(&placed.on).recip());
            let position = to_world.inverse().transform_point3(placed.at);
            position.is_finite().then(|| position.to_array())
        });
        PlaceRecord {
            on: placed.on.clone(),
            world: placed.at.to_array(),
            object,
            normal: placed.normal.to_array(),
            angle_deg: placed.angle.map(f64::to_degrees),
        }
    }

    fn instances(
        &self,
        planes: &LabelPlanes,
        parts: &SceneParts,
        objects: &[Option<ObjectLabel>],
        result: &ProjectResult,
    ) -> Vec<InstanceRecord> {
        let names = self.project.scene.object_names();
        let mut known: BTreeMap<u16, (ObjectLabel, &str)> = BTreeMap::new();
        for (label, name) in objects.iter().zip(names) {
            if let Some(label) = label {
                known.entry(label.instance).or_insert((*label, name));
            }
        }
        let found = bounds_of(&planes.instances);
        let exposed = result.frame.sensor.as_ref().map(|sensor| Exposed {
            electrons: &sensor.electrons,
            ratios: sensor.certified.as_ref().map(|certified| &certified.ratios),
            model: &sensor.model,
            time: sensor.exposure.time(),
        });
        // A changed object is a surface like any other.
        let is_added = |id: u16| known.get(&id).is_some_and(|(label, _)| label.is_defect && !label.is_change);
        // A defect outside of the film has no area.
        let mut areas = planes.areas.clone();
        for (id, _) in known.iter().filter(|(_, (label, _))| label.is_defect) {
            areas.entry(*id).or_default();
        }
        (areas.iter())
            .filter_map(|(id, area)| {
                let (label, name) = known.get(id)?;
                let (bounds, pixels) = found.get(id).copied().map_or((None, 0), |(b, n)| (Some(b), n));
                let seen = bounds.zip(exposed.as_ref()).and_then(|(bounds, exposed)| {
                    let surfaces = planes.surfaces.as_ref().filter(|_| label.is_defect);
                    let surfaces = surfaces.map(|all| Surfaces { all, below: planes.below.as_ref() });
                    let is_other = |other| other != *id && is_added(other);
                    visibility(exposed, &planes.instances, *id, bounds, is_other, surfaces)
                });
                let known = seen.filter(Visibility::is_known);
                let defect = parts.defects.iter().find(|d| d.placed.object == *name);
                Some(InstanceRecord {
                    place: defect.map(|d| self.place(&d.placed, parts)),
                    id: *id,
                    name: (*name).to_owned(),
                    category: label.category,
                    bbox: bounds.map_or([0; 4], |b| [b.from[0], b.from[1], b.to[0] - b.from[0], b.to[1] - b.from[1]]),
                    area: pixels,
                    visible: area.visible,
                    amodal: area.amodal,
                    contrast: known.map(|v| v.contrast),
                    contrast_error: seen.and_then(|v| v.error),
                    cnr: known.and_then(|v| v.cnr),
                    cnr_error: known.and_then(|v| v.cnr_error),
                    size_mm: defect.map(|d| d.placed.extent * 1e3),
                    defect: defect.map(|d| d.kind.clone()),
                    matrix: None,
                })
            })
            .collect()
    }
}

/// The hash of the shape of an object.
fn shape_of(scene: &SceneBuilder, object: &Instance) -> u64 {
    shape(object.meshes.iter().filter_map(|m| Some(&*scene.meshes.get(*m)?.mesh)))
}

/// The box and the number of pixels of each instance of a mask.
pub(crate) fn bounds_of(mask: &Plane<u16>) -> BTreeMap<u16, (Bounds, u64)> {
    let mut found: BTreeMap<u16, (Bounds, u64)> = BTreeMap::new();
    let width = mask.width().max(1);
    let mut pixels = (0u32..).zip(mask.data()).filter(|(_, id)| **id != 0);
    pixels.by_ref().for_each(|(i, id)| {
        let (x, y) = (i % width, i / width);
        let (bounds, count) = found.entry(*id).or_insert((Bounds { from: [x, y], to: [x + 1, y + 1] }, 0));
        bounds.from = [bounds.from[0].min(x), bounds.from[1].min(y)];
        bounds.to = [bounds.to[0].max(x + 1), bounds.to[1].max(y + 1)];
        *count += 1;
    });
    found
}

/// A value of TOML as JSON.
pub(crate) fn json_of(value: &Value) -> serde_json::Value {
    serde_json::to_value(value).unwrap_or(serde_json::Value::Null)
}

/// An error of an image, as one of the study.
pub(crate) fn in_study(study: &Study, error: Error, index: u64) -> Error {
    match error {
        Error::Input(e)
            if e.file == study.job_path() && e.source_span.as_ref().is_none_or(|s| s.text != study.text()) =>
        {
            Error::Input(study.in_study(e, index))
        }
        other => other,
    }
}

/// The number of images of a set, by default that of its study.
pub(crate) fn checked_count(study: &Study, count: Option<u64>) -> Result<u64, Error> {
    let count = count.unwrap_or(study.count);
    if (1..=MAX_COUNT).contains(&count) {
        return Ok(count);
    }
    Err(Error::setting("count", format!("{count} is out of range"), "write a number of images from 1 to 1000000"))
}

/// A set must not be in a folder that contains files that it is made from.
fn check_folder(folder: &Path, inputs: &InputFiles) -> Result<(), Error> {
    match inputs.find_within(folder) {
        None => Ok(()),
        Some(input) => Err(Error::Output {
            file: folder.into(),
            problem: format!("holds {}, {} that this run reads", input.identity.path().display(), input.role.name()),
            help: "name another folder with -o".into(),
        }),
    }
}
