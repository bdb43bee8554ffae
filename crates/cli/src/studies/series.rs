//! Flags and output of commands that render a scene many times and keep the finished renders.

use crate::commands::render::sensor_options;
use crate::outcome::{Outcome, print, say};
use crate::run_args::ViewArgs;
use crate::values::ExposureChoice;
use dunkelfeld::{DefaultPath, Error, Project};
use dunkelfeld_studies::ViewOptions;
use std::path::PathBuf;

/// Applies the flags of commands that render a scene many times to its project.
pub(crate) fn apply_view(args: &ViewArgs, project: &mut Project) -> Result<(), Error> {
    if let Some(note) = args.exposure.and_then(ExposureChoice::note) {
        say(&note);
    }
    let has_sensor = project.settings.has_sensor();
    let (sensor, exposure) = sensor_options(args.sensor.as_deref(), args.exposure, has_sensor)?;
    let options = ViewOptions::default()
        .with_width(args.width)
        .with_height(args.height)
        .with_camera(args.camera.clone())
        .with_sensor(sensor)
        .with_exposure(exposure)
        .with_seed(args.seed)
        .with_memory(args.memory.memory)
        .with_threads(args.run.threads.map(usize::from));
    options.apply(project)
}

/// Prints the findings and the path of the report.
pub(crate) fn report(findings: &[String], files: &[PathBuf]) {
    let mut text = findings.iter().fold(String::new(), |text, line| text + line + "\n");
    if let Some(page) = files.first() {
        text += &format!("wrote {} and {} tables and charts beside it\n", page.display(), files.len() - 1);
    }
    print(&text);
}

/// The default folder of the results, with a note if it is not the usual one.
pub(crate) fn noted(folder: DefaultPath) -> PathBuf {
    if let Some(reason) = folder.reason {
        say(&format!("note: {reason}"));
    }
    folder.path
}

/// Prints the invalid samples, and how many of all renders are kept if the work was interrupted.
pub(crate) fn conclude(invalid_samples: u64, [done, all]: [usize; 2], interrupted: bool) -> Outcome {
    if invalid_samples > 0 {
        say(&format!(
            "flagged: {invalid_samples} samples were not finite, negative or out of range; they count as black"
        ));
    }
    if interrupted && done < all {
        say(&format!("interrupted: {done} of {all} renders are stored; the same command continues from there"));
        return Outcome::Interrupted;
    }
    if invalid_samples > 0 { Outcome::Flagged } else { Outcome::Done }
}
