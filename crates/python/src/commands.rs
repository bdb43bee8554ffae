//! Commands on files.

use crate::arguments::checked_threads;
use crate::errors::{Failure, setting};
use crate::film::Film;
use dunkelfeld::{MergeSettings, SavedFilm};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Joins parts of one render (checkpoints with disjoint samples): bit by bit the film of one process. `checkpoint` is the
/// path of a file for the whole, which is again a part.
#[pyfunction]
#[pyo3(signature = (paths, threads=0, *, checkpoint=None))]
pub(crate) fn merge(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    threads: usize,
    checkpoint: Option<PathBuf>,
) -> Result<Film, Failure> {
    if paths.is_empty() {
        return Err(setting("paths", "there are no parts", "name at least one checkpoint"));
    }
    let threads = checked_threads(Some(threads))?.unwrap_or(0);
    let merged = py.detach(|| {
        let settings = MergeSettings::default().with_parts(paths).with_threads(threads).with_checkpoint(checkpoint);
        dunkelfeld::merge(&settings, Instant::now())
    })?;
    let stats = merged.stats.to_json();
    let saved = SavedFilm { film: merged.rendering.film, settings: merged.settings, is_vignetted: merged.is_vignetted };
    Ok(Film { saved: Arc::new(saved), material_names: Arc::default(), stats, interrupted: false })
}
