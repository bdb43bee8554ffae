//! Checks of a study beside its scene: what would have no effect is an error, or a warning where it is harmless.

use crate::distribution::Fault;
use crate::ids::Ids;
use crate::label_entry::LabelEntry;
use crate::layout::is_kind;
use crate::names::ObjectNames;
use crate::study::{Layout, PictureFormat, Study, Yolo};
use dunkelfeld::{Error, Project, SensorChoice};
use dunkelfeld_scene::Shutter;
use std::collections::BTreeSet;

/// Checks the parts of a study against each other, and against the scene of image 0.
///
/// # Errors
/// An object in two entries, and labels that the images cannot have.
pub(crate) fn check(study: &Study, project: &Project, names: &ObjectNames<'_>, ids: &Ids) -> Result<(), Error> {
    check_labels(study, names)?;
    check_images(study, ids)?;
    let labels = &study.labels;
    let is_line_scan = matches!(project.scene.shutter(), Some(Shutter::Lines(_)));
    if let Some(Shutter::Lines(lines)) = project.scene.shutter()
        && lines.in_turn > 1
    {
        let fault = Fault::new("labels are those of all lines, and a capture has some", "remove `alternate`");
        return Err(study.error(fault, &["line_scan", "alternate"]).into());
    }
    let camera = project.defined_cameras().first().filter(|_| study.camera.is_none()).cloned();
    if camera.is_some() && project.capture_names(camera.as_deref()).len() < project.capture_names(None).len() {
        let fault =
            Fault::new("labels are of one camera, and the captures of several", "select one by `camera` in [study]");
        return Err(study.error(fault, &["capture"]).into());
    }
    let pointed = study.label.iter().position(|entry| !entry.keypoints.is_empty());
    if let Some(number) = pointed.filter(|_| is_line_scan) {
        let fault = Fault::new("the rows of a line scan are of different times", "remove `keypoints`");
        return Err(study.error(fault, &["study", "label", &number.to_string(), "keypoints"]).into());
    }
    // Rows of categories without key points, as those of defects, are filled with zeros.
    let counts: BTreeSet<usize> = ids.categories.iter().map(|c| c.keypoints.len()).filter(|count| *count > 0).collect();
    for (key, is_wrong, problem, help) in [
        (
            "bop",
            labels.bop && is_line_scan,
            "BOP has a camera matrix for each image, and a line scan has none: its rows are of different times",
            "write `bop = false`; `labels/*.json` has the poses in the middle of the exposure of the middle row",
        ),
        (
            "semantic",
            labels.semantic && ids.categories.len() > usize::from(u8::MAX),
            "more than 255 categories do not fit into 8 bits",
            "use at most 255 categories, or only `masks`",
        ),
        (
            "yolo",
            labels.yolo != Yolo::None && study.images.picture == PictureFormat::None,
            "YOLO needs the pictures in `images/`, which `picture = \"none\"` leaves out",
            "write `picture = \"png\"` in [study.images], or `yolo = \"none\"`",
        ),
        (
            "yolo",
            labels.yolo == Yolo::Boxes && counts.len() > 1,
            "YOLO has one number of key points in all rows, and those of the categories differ",
            "give all categories with key points the same number, or write `yolo = \"none\"`",
        ),
        (
            "yolo",
            matches!(labels.yolo, Yolo::Segments | Yolo::Oriented) && !counts.is_empty(),
            "YOLO has key points in rows with boxes only",
            "remove `keypoints`, or write `yolo = \"boxes\"`",
        ),
    ] {
        if is_wrong {
            return Err(study.error(Fault::new(problem, help), &["study", "labels", key]).into());
        }
    }
    Ok(())
}

/// Pairs need defects, and the tree of MVTec AD needs what its readers expect.
fn check_images(study: &Study, ids: &Ids) -> Result<(), Error> {
    let at = |path: &[&str], problem: &str, help: &str| Err(study.error(Fault::new(problem, help), path).into());
    if study.pairs && ids.kinds().next().is_none() {
        return at(
            &["study", "pairs"],
            "the images of a pair differ in defects, and there is no [[study.defect]]",
            "remove the key",
        );
    }
    if study.images.layout == Layout::None {
        return Ok(());
    }
    let layout = ["study", "images", "layout"];
    if study.images.picture != PictureFormat::Png {
        return at(&layout, "readers of MVTec AD need PNG files", "write `picture = \"png\"`");
    }
    if study.train == 0 {
        return at(&layout, "MVTec AD needs images for training", "write their number as `train` in [study]");
    }
    match ids.kinds().find(|kind| !is_kind(kind)) {
        None => Ok(()),
        Some(kind) => {
            let problem = format!("the category \"{kind}\" of a defect is no name of a folder of MVTec AD");
            let help =
                "use letters, digits, `_` and `-`, and not \"good\" or \"combined\", as `category` of the defect";
            at(&layout, &problem, help)
        }
    }
}

/// An object has one category and one list of key points.
fn check_labels(study: &Study, names: &ObjectNames<'_>) -> Result<(), Error> {
    for name in names.listed() {
        let mut found = study.label.iter().enumerate().filter(|(_, entry)| entry.objects.match_name(name));
        let Some((first, entry)) = found.next() else { continue };
        let differs = |other: &LabelEntry| {
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

/// Settings of a study that have no effect and do no harm, in sentences.
pub(crate) fn warnings(study: &Study, project: &Project) -> Vec<String> {
    let has_pattern = match &project.settings.sensor {
        SensorChoice::Emva { model, .. } => {
            model.spec().fixed_pattern != Default::default() || model.spec().defects != Default::default()
        }
        _ => true,
    };
    if !study.has_devices() || has_pattern {
        return Vec::new();
    }
    let warning = "`device` varies, and the sensor has no fixed pattern: its DSNU, its PRNU and its defect pixels are 0, so \
        that devices differ in the seed of their noise alone";
    vec![warning.into()]
}
