//! Commands on files.

use crate::arguments::{MemoryArgument, checked_threads, threads_of};
use crate::errors::{Failure, setting};
use crate::film::Film;
use crate::inputs::absolute;
use dunkelfeld::commands::{MergeSettings, STATIONS, Station};
use dunkelfeld::{InputFiles, SavedFilm};
use dunkelfeld_io::input::Role;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Runs a command line, whose first argument is the name of the program, and gives its exit code.
#[pyfunction]
pub(crate) fn run_command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| dunkelfeld_cli::run(arguments))
}

/// Joins parts of one render (checkpoints with disjoint samples): bit by bit the film of one process. `checkpoint` is the
/// path of a file for the whole, which is again a part. `memory` limits the memory: bytes, or a text such as "6GB".
#[pyfunction]
#[pyo3(signature = (paths, threads=0, *, checkpoint=None, memory=None))]
pub(crate) fn merge(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    #[pyo3(from_py_with = threads_of)] threads: usize,
    checkpoint: Option<PathBuf>,
    memory: Option<MemoryArgument>,
) -> Result<Film, Failure> {
    if paths.is_empty() {
        return Err(setting("paths", "there are no parts", "name at least one checkpoint"));
    }
    let threads = checked_threads(Some(threads))?.unwrap_or(0);
    let memory = memory.map(MemoryArgument::bytes).transpose()?;
    let mut inputs = InputFiles::new();
    paths.iter().for_each(|path| inputs.add(path, Role::Part));
    checkpoint.iter().for_each(|path| inputs.add(path, Role::Checkpoint));
    let inputs = absolute(&inputs);
    let merged = py.detach(|| {
        let settings = MergeSettings::default().with_parts(paths).with_threads(threads).with_checkpoint(checkpoint);
        let settings = settings.with_memory_limit(memory);
        dunkelfeld::commands::merge(&settings, Instant::now())
    })?;
    let stats = merged.stats.to_json();
    let saved = SavedFilm { film: merged.rendering.film, settings: merged.settings, is_vignetted: merged.is_vignetted };
    Ok(Film { saved: Arc::new(saved), stats, interrupted: false, inputs: inputs.into() })
}

/// The text of a first job for a scene file, as `dunkelfeld init` writes it: active lines render the scene, and the names of all
/// objects, materials, lights and cameras stand in lines that a `#` switches off. `station` adds camera, lens and lights of a
/// preset station (see `stations()`). `folder` is the folder that the job will be in, by default the current one: the path
/// of the scene is as a job there needs it. Nothing is written.
#[pyfunction]
#[pyo3(signature = (path, station=None, *, folder=None))]
pub(crate) fn init_job(
    py: Python<'_>,
    path: PathBuf,
    station: Option<&str>,
    folder: Option<PathBuf>,
) -> Result<String, Failure> {
    let station = station.map(Station::named).transpose()?;
    let job = folder.unwrap_or_default().join("job.toml");
    Ok(py.detach(|| dunkelfeld::commands::init_text(&path, station, &job))?)
}

/// Names of the preset stations: camera, lens, film and lights of inspection cells.
#[pyfunction]
pub(crate) fn stations() -> Vec<&'static str> {
    STATIONS.iter().map(|station| station.name).collect()
}

/// The text of the job of a preset station with a stand-in part, as `dunkelfeld init --station` writes it.
#[pyfunction]
pub(crate) fn station_job(name: &str) -> Result<String, Failure> {
    Ok(Station::named(name)?.job())
}
