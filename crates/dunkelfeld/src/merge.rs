//! Joins the parts of a render that several processes shared, and develops what they are together.

use crate::checkpoint::{Description, Earlier, State, film_rows, load, lock, text_of};
use crate::develop::{Frame, develop_film};
use crate::error::Error;
use crate::look::{Look, labels_of};
use crate::memory::{MemoryAccount, MemoryStats, merge_account};
use crate::outputs::{self, OutputPaths, Written, written};
use crate::progress::Stage;
use crate::render::{Rendering, thread_count, thread_pool};
use crate::settings::RenderSettings;
use crate::stats::{PartStats, Stats};
use dunkelfeld_adaptive::schedule::StopReason;
use dunkelfeld_adaptive::{allocation, plan};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_io::InputError;
use dunkelfeld_io::checkpoint::{CheckpointHead, checkpoint_size, write_checkpoint};
use dunkelfeld_io::input::{InputFiles, Role};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// At most so many invalid samples are remembered by name.
const MOST_NAMED: usize = 16;

/// What a merge reads and writes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MergeSettings {
    /// The parts, in any order.
    pub parts: Vec<PathBuf>,
    /// Pictures, layers and statistics of the whole.
    pub outputs: OutputPaths,
    /// A checkpoint of the whole: a part again, for another merge or to be rendered on.
    pub checkpoint: Option<PathBuf>,
    /// Threads; 0 takes as many as there are cores.
    pub threads: usize,
    /// The most memory \[bytes\] that the merge may need.
    pub memory_limit: Option<u64>,
}

/// What a merge brought together.
#[derive(Debug)]
pub struct Merged {
    /// Of every pixel these samples.
    pub samples: Range<u32>,
    /// The film, as if one process had rendered it.
    pub rendering: Rendering,
    /// The exposed frame.
    pub frame: Frame,
    /// What was achieved, and by which parts.
    pub stats: Stats,
}

/// A part without its film.
struct Part<'a> {
    path: &'a Path,
    samples: Range<u32>,
    taken: u64,
    description: Description,
    look: Look,
}

impl Part<'_> {
    fn range(&self) -> String {
        format!("{}..{}", self.samples.start, self.samples.end)
    }
}

/// The parts, by their samples, and what they are together.
struct Joined<'a> {
    parts: Vec<Part<'a>>,
    film: Film,
    numbers: [Plane<u32>; 2],
}

/// Joins parts of one render ([`RenderSettings::samples`]), in any order, and writes the outputs that are named: bit by bit
/// those of one process that rendered all of their samples. Neither scene nor job is needed; `started` is when the command
/// began.
///
/// # Errors
/// Files that are no finished parts, parts of different renders, samples that come twice or are missing in between, outputs
/// that cannot be written or are parts themselves.
pub fn merge(settings: &MergeSettings, started: Instant) -> Result<Merged, Error> {
    let began = Instant::now();
    check_outputs(settings)?;
    let account = check_memory(settings)?;
    let _lock = settings.checkpoint.as_deref().map(lock).transpose()?;
    let Joined { parts, film, numbers: [objects, materials] } = join(&settings.parts)?;
    let (Some(first), Some(last)) = (parts.first(), parts.last()) else { return Err(no_parts()) };
    let samples = first.samples.start..last.samples.end;
    let look = &first.look;
    let shown = look.settings(film.width(), film.height())?;
    settings.outputs.check(shown.has_sensor())?;
    let shown = RenderSettings { samples: Some(samples.clone()), threads: settings.threads, ..shown };

    let mut state = together(&parts);
    if let Some(path) = &settings.checkpoint {
        let (identity, look) = (first.description.identity.clone(), Some(look.clone()));
        let description = Description { identity, samples: Some(samples.clone()), look, state: state.clone() };
        store(path, &description, &film, [&objects, &materials])?;
    }
    state.stages.push((Stage::Load, began.elapsed().as_secs_f64()));
    let pool = thread_pool(settings.threads)?;
    let rendering = Rendering {
        labels: labels_of(&objects, &materials),
        stop: StopReason::Samples,
        interrupted: false,
        invalid: state.invalid(),
        connections: state.connections(),
        weights: allocation::uniform(film.width(), film.height()),
        forecast: None,
        threads: pool.current_num_threads(),
        earlier: Earlier { seconds: state.elapsed, samples: film.total_samples(), was_complete: true },
        checkpoint_fault: None,
        stages: state.stages,
        film,
    };
    let began = Instant::now();
    let frame = pool.install(|| develop_film(&rendering.film, &rendering.labels, &shown))?;
    let mut stats = pool.install(|| Stats::new(&rendering, &frame, &shown));
    stats.add_seconds(Stage::Expose, began.elapsed().as_secs_f64());
    if look.is_replay {
        stats.allocation = "replay".into();
    }
    stats.memory = account.map(|account| MemoryStats::new(account, &rendering.film));
    stats.parts = Some(parts.iter().map(statistics).collect());

    let began = Instant::now();
    let (film, labels, object_names) = (&rendering.film, &rendering.labels, &look.object_names);
    let is_vignetted = look.is_vignetted;
    let written = Written { film, labels, frame: &frame, settings: &shown, object_names, is_vignetted };
    pool.install(|| written.save(&settings.outputs))?;
    stats.add_seconds(Stage::Write, began.elapsed().as_secs_f64());
    stats.finish(started.elapsed().as_secs_f64());
    if let Some(path) = &settings.outputs.stats {
        outputs::save_text(path, &stats.to_json())?;
    }
    Ok(Merged { samples, rendering, frame, stats })
}

/// What can be said of the outputs before the parts are read.
fn check_outputs(settings: &MergeSettings) -> Result<(), Error> {
    let outputs = &settings.outputs;
    let mut inputs = InputFiles::new();
    settings.parts.iter().for_each(|part| inputs.add(part, Role::Part));
    // Whether there is a sensor is not known yet.
    outputs.check_beside(true, settings.checkpoint.as_deref(), &inputs)?;
    if let Some(path) = &settings.checkpoint {
        written(path, dunkelfeld_io::atomic::check_writable(path))?;
    }
    Ok(())
}

/// What the merge needs, if the first part says its size. A file that is none is found out when it is read.
fn check_memory(settings: &MergeSettings) -> Result<Option<MemoryAccount>, Error> {
    let Some(size) = settings.parts.first().and_then(|part| checkpoint_size(part)) else { return Ok(None) };
    let account = merge_account(size, &settings.outputs, thread_count(settings.threads));
    account.check(settings.memory_limit, 0, "merge on a machine with more memory")?;
    Ok(Some(account))
}

fn no_parts() -> Error {
    Error::setting("merge", "there are no parts", "name the files of at least one part")
}

/// Reads the parts and adds them up.
fn join(paths: &[PathBuf]) -> Result<Joined<'_>, Error> {
    let mut parts: Vec<Part<'_>> = Vec::with_capacity(paths.len());
    let mut whole: Option<(Film, [Plane<u32>; 2])> = None;
    for path in paths {
        let (description, stored) = load(path)?;
        let fault = |problem: String, help: &str| Error::from(InputError::new(path, "the part", problem, help));
        let planes = stored.objects.zip(stored.materials);
        let (Some(samples), Some(look), Some((objects, materials))) =
            (description.samples.clone(), description.look.clone(), planes)
        else {
            return Err(fault("is a whole render, not a part".into(), "merge files of `render --samples A..B`"));
        };
        if description.state.stop.is_none() {
            let help = "render it to its end, with the command that began it";
            return Err(fault(format!("(samples {}..{}) is not finished", samples.start, samples.end), help));
        }
        let most = stored.film.sample_counts().data().iter().copied().max().unwrap_or(0);
        if samples.is_empty() || samples.end > plan::MAX_SPP || most > samples.end - samples.start {
            let problem = format!("has {most} samples in a pixel and claims to be {}..{}", samples.start, samples.end);
            return Err(fault(problem, "render it again"));
        }
        if let Some(first) = parts.first() {
            let help = "merge parts of one scene with the same settings";
            let of = |difference| format!("is of another render than {}: {difference}", first.path.display());
            if let Some(difference) = first.description.identity.difference(&description.identity) {
                return Err(fault(of(difference), help));
            }
            if let Some(what) = first.look.difference(&look) {
                return Err(fault(of(format!("not the same {what}")), help));
            }
        }
        let (taken, part) = (stored.film.total_samples(), Part { path, samples, taken: 0, description, look });
        // Before anything is added up: parts that do not overlap have no more samples than can be counted.
        let meets =
            |other: &&Part<'_>| part.samples.start < other.samples.end && other.samples.start < part.samples.end;
        if let Some(other) = parts.iter().find(meets) {
            return Err(misfit(&part, "overlap with", other));
        }
        match &mut whole {
            None => whole = Some((stored.film, [objects, materials])),
            Some((film, _)) => {
                film.merge(&stored.film).map_err(|e| fault(e.to_string(), "merge parts of one size"))?;
            }
        }
        parts.push(Part { taken, ..part });
    }
    let (film, numbers) = whole.ok_or_else(no_parts)?;
    parts.sort_by_key(|p| (p.samples.start, p.samples.end));
    match parts.windows(2).find(|pair| pair[0].samples.end < pair[1].samples.start) {
        Some(pair) => Err(misfit(&pair[1], "leave a gap after", &pair[0])),
        None => Ok(Joined { parts, film, numbers }),
    }
}

/// What is wrong with the samples of a part beside those of another.
fn misfit(part: &Part<'_>, problem: &str, other: &Part<'_>) -> Error {
    let problem = format!("samples {} {problem} samples {} of {}", part.range(), other.range(), other.path.display());
    let help = "merge parts that follow upon each other, each once";
    InputError::new(part.path, "the part", problem, help).into()
}

/// The state of a render that took what all parts took.
fn together(parts: &[Part<'_>]) -> State {
    let mut all = State { stop: Some(StopReason::Samples), ..State::default() };
    for Part { description: Description { state, .. }, .. } in parts {
        all.elapsed += state.elapsed;
        for &(stage, seconds) in &state.stages {
            match all.stages.iter_mut().find(|(s, _)| *s == stage) {
                Some((_, total)) => *total += seconds,
                None => all.stages.push((stage, seconds)),
            }
        }
        for (total, n) in all.connections.iter_mut().zip(state.connections) {
            *total = total.saturating_add(n);
        }
        all.invalid.extend(&state.invalid);
    }
    all.invalid.sort_by_key(|&[x, y, index]| (y, x, index));
    all.invalid.truncate(MOST_NAMED);
    all
}

fn statistics(part: &Part<'_>) -> PartStats {
    PartStats {
        file: part.path.display().to_string(),
        range: [part.samples.start, part.samples.end],
        samples: part.taken,
        seconds: part.description.state.elapsed,
    }
}

fn store(
    path: &Path,
    description: &Description,
    film: &Film,
    [objects, materials]: [&Plane<u32>; 2],
) -> Result<(), Error> {
    let stored = text_of(description).and_then(|text| {
        let head = CheckpointHead {
            width: film.width(),
            height: film.height(),
            text: &text,
            weights: None,
            caps: None,
            target: None,
            objects: Some(objects),
            materials: Some(materials),
        };
        write_checkpoint(path, &head, &mut film_rows(film))
    });
    written(path, stored)
}
