//! Flags and output of commands that render a scene many times and keep the finished renders.

use crate::outcome::{Outcome, print, say};
use crate::run_args::ViewArgs;
use dunkelfeld::{DefaultPath, Error, Project, ProjectOptions};
use std::path::{Path, PathBuf};

/// Opens the project of a command that renders a scene many times, with its flags.
pub(crate) fn open(input: &Path, args: &ViewArgs) -> Result<Project, Error> {
    let options = ProjectOptions::default()
        .with_can_change(false)
        .with_threads(args.run.threads.map_or(0, usize::from))
        .with_keys(args.keys.keys());
    let mut project = Project::open_with(input, options)?;
    if args.camera.is_some() {
        project.settings.camera.clone_from(&args.camera);
    }
    Ok(project)
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
