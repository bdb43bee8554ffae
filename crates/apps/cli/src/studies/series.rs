//! Flags and output of commands that render a scene many times and keep the finished renders.

use crate::bar::Sink;
use crate::interrupt::cancel_on_interrupt;
use crate::outcome::{Outcome, print, say};
use crate::run_args::ViewArgs;
use dunkelfeld::{Error, Progress, ProgressState, Project, ProjectOptions, Session, Stage};
use dunkelfeld_studies::{StudyOutcome, default_folder};
use std::path::{Path, PathBuf};

/// Opens the input of a study, applies the flags, and runs the study in a folder: by default the one of its name. Prints the
/// findings and the path of the report.
pub(crate) fn run_study(
    input: &Path,
    output: Option<&Path>,
    name: &str,
    view: &ViewArgs,
    study: impl FnOnce(Project, &Path, &Session<'_>) -> Result<StudyOutcome, Error>,
) -> Result<Outcome, Error> {
    let sink = Sink::new(view.run.progress);
    sink.update(&ProgressState { stage: Stage::Load, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 });
    let options = ProjectOptions::default()
        .with_can_change(false)
        .with_threads(view.run.threads.map_or(0, usize::from))
        .with_keys(view.keys.keys());
    let mut project = Project::open_with(input, options)?;
    if view.camera.is_some() {
        project.settings.camera.clone_from(&view.camera);
    }
    let folder = output.map_or_else(|| default_folder(input, name), Path::to_path_buf);
    let cancel = cancel_on_interrupt();
    let session = Session::new(project.settings.run.threads)?.with_progress(&sink).with_cancel(&cancel);
    let outcome = study(project, &folder, &session)?;
    drop(sink);
    report(&outcome.findings, &outcome.files);
    Ok(conclude(outcome.invalid_samples, outcome.finished, outcome.interrupted))
}

/// Prints the findings and the path of the report.
pub(crate) fn report(findings: &[String], files: &[PathBuf]) {
    let mut text = findings.iter().fold(String::new(), |text, line| text + line + "\n");
    if let Some(page) = files.first() {
        text += &format!("wrote {} and {} tables and charts beside it\n", page.display(), files.len() - 1);
    }
    print(&text);
}

/// Prints the invalid samples, and how many of all renders are kept if the work was interrupted.
fn conclude(invalid_samples: u64, [done, all]: [usize; 2], interrupted: bool) -> Outcome {
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
