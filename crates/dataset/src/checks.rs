//! Checks of a study beside its scene: what would have no effect is an error, or a warning where it is harmless.

use crate::defect::DefectEntry;
use crate::distribution::Fault;
use crate::names::ObjectNames;
use crate::placement::Placement;
use crate::study::Study;
use dunkelfeld::{Error, Project, SensorChoice};
use dunkelfeld_io::job::{Job, LensProjection};
use dunkelfeld_scene::{Camera, Projection, Shutter};
use std::collections::BTreeSet;
use toml::Value;

/// Images whose cameras are read for warnings.
const CHECKED: u64 = 64;

/// Checks the parts of a study against each other, and against the scene of image 0.
///
/// # Errors
/// An object in two entries, a camera that does not exist, a camera matrix of a line scan.
pub(crate) fn check(study: &Study, project: &Project, names: &ObjectNames<'_>) -> Result<(), Error> {
    check_labels(study, names)?;
    check_places(study, names)?;
    check_cameras(study, project)?;
    if study.labels.bop && matches!(project.scene.shutter(), Some(Shutter::Lines(_))) {
        let fault = Fault::new(
            "BOP has a camera matrix for each image, and a line scan has none: its rows are of different times",
            "write `bop = false`; `labels/*.json` has the poses in the middle of the exposure of the middle row",
        );
        return Err(study.error(fault, &["study", "labels", "bop"]).into());
    }
    Ok(())
}

/// An object has one category and one list of key points.
fn check_labels(study: &Study, names: &ObjectNames<'_>) -> Result<(), Error> {
    for name in names.listed() {
        let mut found = study.label.iter().enumerate().filter(|(_, entry)| entry.objects.match_name(name));
        let Some((first, entry)) = found.next() else { continue };
        let differs = |other: &crate::label_entry::LabelEntry| {
            (&other.category, &other.keypoints, &other.skeleton) != (&entry.category, &entry.keypoints, &entry.skeleton)
        };
        if let Some((number, _)) = found.find(|(_, other)| differs(other)) {
            let problem = format!("the object \"{name}\" is in entry {} of [[study.label]] as well", first + 1);
            let fault =
                Fault::new(problem, "leave it in one of them: an object has one category and one set of key points");
            return Err(study.error(fault, &["study", "label", &number.to_string(), "objects"]).into());
        }
    }
    Ok(())
}

/// An object is placed once.
fn check_places(study: &Study, names: &ObjectNames<'_>) -> Result<(), Error> {
    let at = |fault: Fault, number: usize| study.error(fault, &["study", "place", &number.to_string()]);
    let mut places = Vec::new();
    for number in 0..study.place.len() {
        places.push(Placement::drawn(study, number, 0).map_err(|fault| at(fault, number))?);
    }
    for name in names.listed() {
        let mut found = (0..).zip(&places).filter(|(_, place)| place.has_object(name));
        if let (Some((first, _)), Some((number, _))) = (found.next(), found.next()) {
            let problem = format!("entry {} of [[study.place]] places the object \"{name}\" as well", first + 1);
            let fault = Fault::new(problem, "leave it in one of them").below("objects");
            return Err(at(fault, number).into());
        }
    }
    Ok(())
}

/// The cameras that any image may have, if the scene is the same in all of them.
fn check_cameras(study: &Study, project: &Project) -> Result<(), Error> {
    let Some(choice) = study.camera_choice().filter(|_| study.has_one_scene()) else { return Ok(()) };
    let cameras = project.scene.cameras();
    for value in study.alternatives_of(choice) {
        let Value::String(name) = &value else { continue };
        if !cameras.iter().any(|camera| camera.name == *name) {
            let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
            let problem = format!("there is no camera \"{name}\"");
            let fault = Fault::new(problem, format!("the cameras are {}", names.join(", ")));
            return Err(study.error(fault, study.camera_key()).into());
        }
    }
    Ok(())
}

/// The cameras of the first images that have a telecentric lens, by their own projection or by the lens of the job.
fn telecentric_cameras(study: &Study, project: &Project) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for index in 0..study.count.min(CHECKED) {
        // An image with an error is reported when it is made.
        let Ok(drawn) = study.job(index) else { continue };
        let Ok(job) = Job::from_text(study.job_path(), drawn.text) else { continue };
        let selected = drawn.camera.or_else(|| job.camera.selected.clone());
        let selected = selected.or_else(|| job.first_enabled().map(str::to_owned));
        let is_it = |camera: &&Camera| selected.as_ref().is_none_or(|name| camera.name == *name);
        let Some(camera) = project.scene.cameras().iter().find(is_it) else { continue };
        let lens = job.camera_settings(&camera.name).map_or_else(|| job.lens.clone(), |own| own.lens_or(&job.lens));
        let is_parallel = match lens.projection {
            None => !matches!(camera.projection, Projection::Perspective { .. }),
            Some(projection) => projection == LensProjection::Telecentric,
        };
        if is_parallel {
            names.insert(camera.name.clone());
        }
    }
    names
}

/// Settings of a study that have no effect and do no harm, in sentences.
pub(crate) fn warnings(
    study: &Study,
    project: &Project,
    entries: &[DefectEntry],
    names: &ObjectNames<'_>,
) -> Vec<String> {
    let mut found = Vec::new();
    if let SensorChoice::Emva { model, .. } = &project.settings.sensor
        && study.has_devices()
        && model.spec().fixed_pattern == Default::default()
        && model.spec().defects == Default::default()
    {
        found.push(
            "`device` varies, and the sensor has no fixed pattern: its DSNU, its PRNU and its defect pixels are 0, so that \
             devices differ in the seed of their noise alone"
                .to_owned(),
        );
    }
    if study.labels.coverage > 1 && !study.labels.masks {
        found.push(
            "`coverage` is the share of the instance of the mask, and the study has no masks: write `masks = true`"
                .into(),
        );
    }
    if study.labels.bop
        && let telecentric = telecentric_cameras(study, project)
        && !telecentric.is_empty()
    {
        let names: Vec<String> = telecentric.iter().map(|name| format!("\"{name}\"")).collect();
        found.push(format!(
            "`scene_camera.json` has no entry for images of {}: a telecentric lens has no camera matrix",
            names.join(", ")
        ));
    }
    for (number, entry) in study.label.iter().enumerate() {
        if let Some(name) = entry.objects.repeated() {
            found.push(format!("entry {} of [[study.label]] has \"{name}\" twice", number + 1));
        }
    }
    for number in 0..study.place.len() {
        if let Ok(place) = Placement::drawn(study, number, 0)
            && let Some(name) = place.repeated()
        {
            found.push(format!("entry {} of [[study.place]] has \"{name}\" twice, and places it once", number + 1));
        }
    }
    let scene = project.scene.bounds().map_or(f64::INFINITY, |[low, high]| low.distance(high));
    for entry in entries {
        found.extend(entry.doubts(study, scene));
        let Some((name, most, objects)) = entry.excess(study, names) else { continue };
        found.push(format!(
            "the entry \"{name}\" changes up to {most} objects of an image, and {objects} of the first images match; an \
             object changes once, and the others are not made"
        ));
    }
    found
}
