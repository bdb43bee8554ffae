//! One image of a set with its labels and its record.

use crate::checks::{check, warnings};
use crate::coco::Annotation;
use crate::defect::{AddedDefect, DefectEntry, add_defects, entries};
use crate::defects::PlacedDefect;
use crate::distribution::Fault;
use crate::encode;
use crate::ids::{Ids, ObjectLabel};
use crate::inputs::input_records;
use crate::keypoints::{InstancePoints, PointObject, film_points};
use crate::labels::{LabelCamera, LabelLayers, LabelObjects, LabelPlanes, PixelBox, trace_labels};
use crate::names::ObjectNames;
use crate::pinhole::{Pinhole, image_box};
use crate::placement::Placement;
use crate::pose::{poses, shape};
use crate::record::{CertificateRecord, Cost, FileRecord, InstanceRecord, PlaceRecord, Record};
use crate::set::Set;
use crate::study::{DrawnJob, LinearFormat, MAX_COUNT, PictureFormat, Study};
use crate::surface_path::Surfaces;
use crate::visibility::{Bounds, Exposed, Visibility, visibility};
use dunkelfeld::film::FilmLayers;
use dunkelfeld::guard::check_outputs;
use dunkelfeld::{
    Budget, Cancel, DenoiseMethod, Error, Project, ProjectOptions, ProjectResult, SensorChoice, Session, Silent, Stage,
};
use dunkelfeld_geometry::{DAffine3, DVec3, RigidMotion};
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_scene::{Instance, RayGenerator};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};
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
    /// Are the files those of the record, with names inside the folder of a set? A copy from another process may be damaged.
    pub fn is_whole(&self) -> bool {
        let is_inside = |name: &str| Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
        let is_same = |(name, content): &(String, Vec<u8>)| {
            is_inside(name) && self.record.files.get(name).is_some_and(|record| *record == FileRecord::of(content))
        };
        self.files.len() == self.record.files.len() && self.files.iter().all(is_same)
    }
}

/// The parts of the scene that the labels of an image need.
struct SceneParts {
    defects: Vec<AddedDefect>,
    /// The bounds of each defect in the world.
    boxes: Vec<[DVec3; 2]>,
    /// The bounds of each labelled object in the world.
    labelled: Vec<[DVec3; 2]>,
    /// The transform of each object to the world and its motion, by its index.
    poses: Vec<(DAffine3, RigidMotion)>,
    /// The hash of the shape of each object, by its index; 0 without a label. Empty if no file has models.
    shapes: Vec<u64>,
    /// The diagonal of the bounds of each object with key points, by its index.
    pointed: BTreeMap<usize, f64>,
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
        if study.labels.semantic && ids.categories.len() > usize::from(u8::MAX) {
            let problem = format!("{} categories do not fit into 8 bits", ids.categories.len());
            let fault = Fault::new(problem, "use at most 255 categories, or only `masks`");
            return Err(study.error(fault, &["study", "labels", "semantic"]).into());
        }
        if study.labels.yolo && study.images.picture == PictureFormat::None {
            let problem = "YOLO needs the pictures in `images/`, which `picture = \"none\"` leaves out";
            let fault = Fault::new(problem, "write `picture = \"png\"` in [study.images], or `yolo = false`");
            return Err(study.error(fault, &["study", "labels", "yolo"]).into());
        }
        let counts: BTreeSet<usize> = ids.categories.iter().map(|category| category.keypoints.len()).collect();
        // Rows of categories without key points, as those of defects, are filled with zeros.
        if study.labels.yolo && counts.iter().filter(|count| **count > 0).count() > 1 {
            let fault = Fault::new(
                "YOLO has one number of key points in all rows, and those of the categories differ",
                "give all categories with key points the same number, or write `yolo = false`",
            );
            return Err(study.error(fault, &["study", "labels", "yolo"]).into());
        }
        check(study, &project, &names)?;
        let warnings = warnings(study, &project, &entries, &names);
        let session = Session::new(threads)?;
        Ok(Self { study: study.clone(), project, ids, entries, session, threads, warnings })
    }

    /// Settings of the study that have no effect, in sentences.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The categories of the set.
    fn ids(&self) -> &Ids {
        &self.ids
    }

    /// Opens the folder of a set of the study for its images, and creates it with its parents if there is none. A set may
    /// grow; it never shrinks. By default it has the number of images of the study.
    ///
    /// # Errors
    /// A set of another study, of other input files or of another version of the program; a folder that contains other
    /// files, or files that the images are made from; a folder that cannot be written to.
    pub fn open_set(&self, folder: &Path, count: Option<u64>) -> Result<Set, Error> {
        let count = checked_count(&self.study, count)?;
        let mut inputs = self.project.inputs.clone();
        inputs.extend(self.study.inputs());
        check_outputs(&[("the set", folder)], &inputs)?;
        check_folder(folder, &inputs)?;
        let records = input_records(&self.study, &self.project.inputs);
        Set::start(folder, &self.study, self.ids(), records, count)
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
        let result = self.project.render_with(&Silent, cancel).map_err(|e| in_study(&self.study, e, index))?;
        if result.rendering.interrupted {
            return Ok(None);
        }
        // The sum of no stage is a positive zero.
        let stage = |stages: &[Stage]| -> f64 {
            result
                .rendering
                .stages
                .iter()
                .filter(|(stage, _)| stages.contains(stage))
                .map(|(_, s)| s)
                .fold(0.0, |sum, s| sum + s)
        };
        let render = stage(&[Stage::Training, Stage::Pilot, Stage::Refine]);
        let plan = stage(&[Stage::Plan]);
        let expose = began.elapsed().as_secs_f64() - change - render - plan;
        let made = self.label_and_encode(index, job, &parts, &result)?;
        let cost = Cost { change, render, plan, expose, total: began.elapsed().as_secs_f64(), ..made.cost };
        Ok(Some(Made { cost, ..made }))
    }

    /// Checks that the draws of an image fit, without a render.
    ///
    /// # Errors
    /// As [`Self::make`], without those of the render.
    pub fn check(&mut self, index: u64) -> Result<(), Error> {
        self.enter(index)?;
        self.project.fitted().map(drop).map_err(|e| in_study(&self.study, e, index))
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
        let mut parts = SceneParts {
            defects: Vec::new(),
            boxes: Vec::new(),
            labelled: Vec::new(),
            poses: Vec::new(),
            shapes: Vec::new(),
            pointed: BTreeMap::new(),
        };
        let changed = self.project.set_job(&job.text, |scene| {
            for (number, template) in study.place.iter().enumerate() {
                let at = |fault: Fault| {
                    let fault = Fault { problem: format!("image {index}: {}", fault.problem), ..fault };
                    study.error(fault, &["study", "place", &number.to_string()])
                };
                let mut record = BTreeMap::new();
                let name = format!("place[{number}]");
                let value = template
                    .draw(draws, &name, &mut study.named(draws), &mut |n, v| {
                        drop(record.insert(n.to_owned(), v.clone()))
                    })
                    .map_err(at)?;
                Placement::parse(value).and_then(|p| p.apply(scene, draws, &mut record)).map_err(at)?;
                drawn.append(&mut record);
            }
            parts.defects = add_defects(entries, study, scene, draws, drawn).map_err(|(number, fault)| {
                let fault = Fault { problem: format!("image {index}: {}", fault.problem), ..fault };
                study.error(fault, &["study", "defect", &number.to_string()])
            })?;
            let is_defect = |name: &String| parts.defects.iter().any(|defect| defect.placed.object == *name);
            let boxes = scene.instances.iter().filter(|i| is_defect(&i.name)).filter_map(|i| scene.bounds_of(i));
            parts.boxes = boxes.collect();
            let names: Vec<String> = scene.instances.iter().map(|i| i.name.clone()).collect();
            let labels = ids.label(&names, &parts.defects).unwrap_or_default();
            let labelled = scene.instances.iter().zip(&labels).filter(|(_, label)| label.is_some());
            parts.labelled = labelled.filter_map(|(instance, _)| scene.bounds_of(instance)).collect();
            parts.poses = scene.instances.iter().map(|instance| (instance.to_world, instance.motion)).collect();
            if study.labels.bop {
                let meshes = |i: &Instance| shape(i.meshes.iter().filter_map(|m| Some(&*scene.meshes.get(*m)?.mesh)));
                let shapes = scene.instances.iter().zip(&labels).map(|(i, label)| label.map_or(0, |_| meshes(i)));
                parts.shapes = shapes.collect();
            }
            let pointed = scene.instances.iter().enumerate().filter(|(i, object)| {
                let has_label = labels.get(*i).is_some_and(Option::is_some) && !is_defect(&object.name);
                has_label && !ids.keypoints(&object.name).is_empty()
            });
            let diagonals = pointed.filter_map(|(i, object)| Some((i, scene.bounds_of(object)?)));
            parts.pointed = diagonals.map(|(i, [low, high])| (i, low.distance(high))).collect();
            Ok(())
        });
        changed.map_err(|e| in_study(study, e, index))?;
        let cameras = self.project.scene.cameras();
        if let Some(name) = job.camera.as_ref().filter(|name| !cameras.iter().any(|camera| camera.name == **name)) {
            let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
            let problem = format!("image {index}: there is no camera \"{name}\"");
            let fault = Fault::new(problem, format!("the cameras are {}", names.join(", ")));
            return Err(study.error(fault, study.camera_key()).into());
        }
        self.project.settings.camera.clone_from(&job.camera);
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
        settings.threads = self.threads;
        let is_denoised = settings.denoise.method != DenoiseMethod::Off;
        settings.layers = if is_denoised { FilmLayers::All } else { FilmLayers::Image };
        if let Some(seconds) = seconds {
            settings.budget = Budget::default().with_seconds(seconds);
        }
    }

    fn label_and_encode(
        &self,
        index: u64,
        job: DrawnJob,
        parts: &SceneParts,
        result: &ProjectResult,
    ) -> Result<Made, Error> {
        let began = Instant::now();
        let (study, scene, settings) = (&self.study, &self.project.scene, result.settings());
        let size @ [width, height] = [settings.width, settings.height];
        let objects = self.ids.label(scene.object_names(), &parts.defects).map_err(|problem| {
            let fault = Fault::new(format!("image {index}: {problem}"), "an image has at most 65535 instances");
            study.error(fault, &["study", "label"])
        })?;
        let camera = settings.view.clone().ok_or_else(|| Error::setting("camera", "there is none", "name a camera"))?;
        let rays = scene.ray_generator(&camera, width, height)?;
        let wanted = &study.labels;
        let surfaces = result.frame.sensor.is_some() && !parts.defects.is_empty();
        let below = surfaces && parts.defects.iter().any(AddedDefect::is_change);
        let (samples, depth, normals) = (wanted.coverage, wanted.depth, wanted.normals);
        let layers = LabelLayers { samples, depth, normals, surfaces, below };
        let refined: Vec<PixelBox> = parts
            .boxes
            .iter()
            .map(|bounds| image_box(&camera, scene.shutter(), size, *bounds).unwrap_or([0, 0, width, height]))
            .collect();
        let labelled = LabelCamera { rays: &rays, pose: camera.to_world, size };
        let on_film = LabelObjects { labels: &objects, bounds: &parts.labelled, refined: &refined };
        let planes = self.session.install(|| trace_labels(scene, labelled, on_film, layers));
        let mut instances = self.instances(&planes, parts, &objects, result);
        let points = self.keypoints(parts, &objects, &rays, size);
        let label = began.elapsed().as_secs_f64();

        let began = Instant::now();
        let mut files = Vec::new();
        let name = format!("{index:06}");
        let exposed = result.frame.sensor.as_ref();
        encode::images(&mut files, &name, &study.images, &result.frame)?;
        let categories: BTreeMap<u16, u16> = instances.iter().map(|i| (i.id, i.category)).collect();
        encode::labels(&mut files, &name, wanted, &planes, &categories)?;
        let mut annotations: Vec<Annotation> =
            encode::annotations(index, wanted, &planes, &instances, &points, &self.ids);
        let file_name = files.iter().find(|(n, _)| n.starts_with("images/") || n.starts_with("linear/"));
        let file_name = file_name.map(|(n, _)| n.clone()).unwrap_or_default();
        let pinhole = Pinhole::new(&camera, scene.shutter(), size);
        let poses = poses(camera.to_world, &parts.poses, &objects, &parts.shapes, &mut instances);
        annotations.sort_by_key(|a| a.instance);
        let yolo = wanted.yolo.then(|| encode::yolo(&instances, &points, self.ids.most_keypoints(), size));
        let labels = encode::ImageLabels {
            index,
            file_name,
            width,
            height,
            annotations,
            camera: pinhole,
            poses,
            keypoints: points,
        };
        files.push((format!("labels/{name}.json"), encode::json(&labels)));
        if let Some(yolo) = yolo {
            files.push((format!("labels/{name}.txt"), yolo.into_bytes()));
        }
        let certificate = exposed.and_then(|s| s.certified.as_ref()).map(|certified| {
            let c = &certified.certificate;
            let finite = |v: f64| v.is_finite().then_some(v);
            let pixels = f64::from(width) * f64::from(height);
            CertificateRecord {
                k: c.k,
                hidden: c.hidden,
                median: finite(c.median),
                p99: finite(c.p99),
                saturated: c.saturated as f64 / pixels,
            }
        });
        let record = Record {
            index,
            study: study.hash().to_owned(),
            drawn: job.drawn.iter().map(|(name, value)| (name.clone(), json_of(value))).collect(),
            seed: job.seed,
            frame: job.frame,
            width,
            height,
            exposure: exposed.map(|s| s.exposure.time().0),
            samples: result.stats.samples,
            certificate,
            matched: exposed.and_then(|s| s.matched.as_ref()).map(|m| m.share),
            instances,
            files: files.iter().map(|(name, content)| (name.clone(), FileRecord::of(content))).collect(),
        };
        let cost = Cost { label, write: began.elapsed().as_secs_f64(), ..Cost::default() };
        Ok(Made { record, files, cost })
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
            let Some(&(to_world, motion)) = parts.poses.get(index).filter(|_| !found.contains_key(&label.instance))
            else {
                continue;
            };
            // Key points have true lengths, and vertices those of their file.
            let to_world = to_world * DAffine3::from_scale(self.project.imported_scale_of(name).recip());
            let object = PointObject { index: index as u32, to_world, motion, diagonal };
            let points = film_points(scene, rays, size, &object, self.ids.keypoints(name));
            found.insert(label.instance, InstancePoints { instance: label.instance, name: name.clone(), points });
        }
        found.into_values().collect()
    }

    /// The place of a defect in the world and in the frame of its object.
    fn place(&self, placed: &PlacedDefect, parts: &SceneParts) -> PlaceRecord {
        let object = parts.poses.get(placed.host).and_then(|(to_world, _)| {
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
        let found = bounds_of(planes);
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
                    size_mm: defect.map(|d| d.placed.extent * 1e3),
                    defect: defect.map(AddedDefect::kind),
                    matrix: None,
                })
            })
            .collect()
    }
}

/// The box and the number of pixels of each instance of a mask.
fn bounds_of(planes: &LabelPlanes) -> BTreeMap<u16, (Bounds, u64)> {
    let mut found: BTreeMap<u16, (Bounds, u64)> = BTreeMap::new();
    let width = planes.instances.width().max(1);
    let mut pixels = (0u32..).zip(planes.instances.data()).filter(|(_, id)| **id != 0);
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
