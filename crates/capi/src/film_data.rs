//! The content of a film handle.

use crate::handles::Handles;
use dunkelfeld::{ProjectResult, SavedFilm, Session};

/// A rendered film. Nothing changes it.
#[derive(Debug)]
pub(crate) struct FilmData {
    pub(crate) saved: SavedFilm,
    pub(crate) material_names: Vec<String>,
    /// The statistics as JSON; empty for a film from a file.
    pub(crate) stats: String,
    pub(crate) is_interrupted: bool,
}

pub(crate) static FILMS: Handles<FilmData> = Handles::new("film");

impl FilmData {
    pub(crate) fn new(result: ProjectResult, material_names: Vec<String>) -> Self {
        let (stats, is_interrupted) = (result.stats.to_json(), result.rendering.interrupted);
        Self { saved: result.into_saved_film(), material_names, stats, is_interrupted }
    }

    pub(crate) fn of_saved(saved: SavedFilm, stats: String) -> Self {
        Self { saved, material_names: Vec::new(), stats, is_interrupted: false }
    }

    /// Runs work on the number of threads of the render.
    pub(crate) fn compute<T: Send>(&self, work: impl FnOnce(&SavedFilm) -> T + Send) -> Result<T, dunkelfeld::Error> {
        Ok(Session::new(self.saved.settings.threads)?.install(|| work(&self.saved)))
    }
}
