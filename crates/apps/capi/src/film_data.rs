//! The content of a film handle.

use crate::handles::Handles;
use dunkelfeld::io::InputRole;
use dunkelfeld::{InputFiles, ProjectResult, SavedFilm, Session};
use std::path::PathBuf;

/// A rendered film. Nothing changes it.
#[derive(Debug)]
pub(crate) struct FilmData {
    pub(crate) saved: SavedFilm,
    /// The statistics as JSON; empty for a film from a file.
    pub(crate) stats: String,
    pub(crate) is_interrupted: bool,
    /// The files that it was made from. No output replaces them.
    pub(crate) inputs: InputFiles,
}

pub(crate) static FILMS: Handles<FilmData> = Handles::new("film");

impl FilmData {
    pub(crate) fn new(result: ProjectResult) -> Self {
        let (stats, is_interrupted) = (result.stats.to_json(), result.rendering.interrupted);
        let inputs = result.inputs().clone();
        Self { saved: result.into_saved_film(), stats, is_interrupted, inputs }
    }

    /// A film of files.
    pub(crate) fn of_saved(saved: SavedFilm, stats: String, files: &[PathBuf]) -> Self {
        let mut inputs = InputFiles::new();
        files.iter().for_each(|file| inputs.add(file, InputRole::Checkpoint));
        Self { saved, stats, is_interrupted: false, inputs }
    }

    /// Runs work on the number of threads of the render.
    pub(crate) fn compute<T: Send>(&self, work: impl FnOnce(&SavedFilm) -> T + Send) -> Result<T, dunkelfeld::Error> {
        Ok(Session::new(self.saved.settings.run.threads)?.install(|| work(&self.saved)))
    }
}
