//! Joins the parts of a render of several processes, and develops the joined film.

use crate::frame::{Frame, develop_film};
use crate::memory::{MemoryAccount, MemoryStats, merge_account};
use crate::outputs::{self, OutputPaths, Written};
use crate::stats::{PartStats, Stats};
use derive_setters::Setters;
use dunkelfeld_io::checkpoint::checkpoint_size;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_render::{
    Error, JoinedParts, PartSummary, RenderSettings, Rendering, Session, Stage, lock, thread_count, written,
};
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

/// Inputs and outputs of a merge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct MergeSettings {
    /// The parts, in any order.
    pub parts: Vec<PathBuf>,
    /// Pictures, layers and statistics of the whole.
    pub outputs: OutputPaths,
    /// A checkpoint of the whole. It is again a part, for another merge or for a longer render.
    #[setters(into)]
    pub checkpoint: Option<PathBuf>,
    /// Number of threads; 0 means one per core.
    pub threads: usize,
    /// Limit of memory \[bytes\] of the merge.
    #[setters(into)]
    pub memory_limit: Option<u64>,
}

/// The result of a merge.
#[derive(Debug)]
#[non_exhaustive]
pub struct Merged {
    /// The samples of every pixel.
    pub samples: Range<u32>,
    /// The film, as if one process had rendered it.
    pub rendering: Rendering,
    /// The exposed frame.
    pub frame: Frame,
    /// The statistics, with the parts.
    pub stats: Stats,
    /// The settings of the exposure: those of the parts.
    pub settings: RenderSettings,
    /// Does the lens darken the image towards its corners?
    pub is_vignetted: bool,
}

/// Joins parts of one render ([`samples`](dunkelfeld_render::RunSettings::samples)), in any order, and writes the outputs. They are bit by bit
/// those of one process that rendered all of their samples. Neither scene nor job is needed. `started` is the start
/// time of the command.
///
/// # Errors
/// Files that are no finished parts, parts of different renders, overlaps or gaps of samples, outputs that cannot be
/// written or are parts themselves.
pub fn merge(settings: &MergeSettings, started: Instant) -> Result<Merged, Error> {
    let began = Instant::now();
    check_outputs(settings)?;
    let account = check_memory(settings)?;
    let _lock = settings.checkpoint.as_deref().map(lock).transpose()?;
    let joined = JoinedParts::read(&settings.parts)?;
    let samples = joined.samples();
    let mut shown = joined.settings();
    shown.run.threads = settings.threads;
    shown.run.samples = Some(samples.clone());
    settings.outputs.check(shown.has_sensor())?;
    if let Some(path) = &settings.checkpoint {
        joined.write_checkpoint(path)?;
    }
    let parts: Vec<PartStats> = joined.parts().iter().map(statistics).collect();
    let (is_vignetted, is_replay) = (joined.is_vignetted(), joined.is_replay());
    let session = Session::new(settings.threads)?.with_start(started);
    let rendering = joined.into_rendering(began.elapsed().as_secs_f64(), session.threads());
    let began = Instant::now();
    let frame = session.install(|| develop_film(&rendering.film, &shown))?;
    let mut stats = session.install(|| Stats::new(&rendering, &frame, &shown));
    stats.add_seconds(Stage::Expose, began.elapsed().as_secs_f64());
    if is_replay {
        stats.run.allocation = "replay".into();
    }
    stats.memory = account.map(|account| MemoryStats::new(account, &rendering.film.sums));
    stats.time.parts = Some(parts);

    let began = Instant::now();
    let written = Written { film: &rendering.film, frame: &frame, settings: &shown, is_vignetted };
    session.install(|| written.save(&settings.outputs))?;
    stats.add_seconds(Stage::Write, began.elapsed().as_secs_f64());
    stats.finish(session.elapsed());
    if let Some(path) = &settings.outputs.stats {
        outputs::save_text(path, &stats.to_json())?;
    }
    Ok(Merged { samples, rendering, frame, stats, settings: shown, is_vignetted })
}

/// Checks of the outputs before the parts are read.
fn check_outputs(settings: &MergeSettings) -> Result<(), Error> {
    let outputs = &settings.outputs;
    let mut inputs = InputFiles::new();
    settings.parts.iter().for_each(|part| inputs.add(part, Role::Part));
    // The sensor is still unknown here.
    outputs.check_beside(true, settings.checkpoint.as_deref(), &inputs)?;
    if let Some(path) = &settings.checkpoint {
        written(path, dunkelfeld_io::atomic::check_writable(path))?;
    }
    Ok(())
}

/// The account of the merge, if the first part contains its size. A file that is no part is detected when it is read.
fn check_memory(settings: &MergeSettings) -> Result<Option<MemoryAccount>, Error> {
    let Some(size) = settings.parts.first().and_then(|part| checkpoint_size(part)) else { return Ok(None) };
    let account = merge_account(size, &settings.outputs, thread_count(settings.threads));
    account.check(settings.memory_limit, 0, "merge on a machine with more memory")?;
    Ok(Some(account))
}

fn statistics(part: &PartSummary) -> PartStats {
    PartStats {
        file: part.path.display().to_string(),
        range: [part.samples.start, part.samples.end],
        samples: part.taken,
        seconds: part.seconds,
    }
}
