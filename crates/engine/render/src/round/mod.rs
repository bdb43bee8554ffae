//! One round of samples on all threads.
//!
//! Threads take units of work from one queue ([`WorkQueue`]) until the round or the time is over. A unit is a level of a
//! tile, or a part of it. A tile gets a level when all of its parts are done, and after the level before it. So the samples
//! of a pixel are always the first n, also after an interruption, and no copy of the film has a part of a tile. Sums are
//! exact, so the order of the threads does not matter.
//!
//! There are two times. After the first no unit begins. At the second the paths of unfinished units are abandoned: this
//! needs a tile whose cost was not predictable.

use crate::checkpoint::{CheckpointWriter, Snapshot};
use crate::progress::{Cancel, Progress, ProgressState};
use crate::stage::Stage;
use dunkelfeld_adaptive::tile_cost::TileGrid;
use dunkelfeld_adaptive::{Affordable, Levels, WorkQueue, WorkUnit};
use dunkelfeld_film::{Film, PixelSums, Plane, Sample, TileRow};
use dunkelfeld_integrator::{ConnectionTally, Estimator, LaneUse, PixelSample, Wavefront};
use dunkelfeld_lanes::{InstructionSet, dispatch};
use dunkelfeld_scene::LightGroups;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Pixels along the side of a tile.
pub const TILE: u32 = Film::TILE;
/// Maximum number of invalid samples that are stored by name.
pub(crate) const MAX_LISTED: usize = 16;
/// Number of samples of the first batch of a thread. The size grows as long as batches are fast.
const FIRST_BATCH: usize = 16;
/// The clock and the switch are checked after each batch. If it took longer than this, the next one is smaller.
const CHECK_PAUSE: Duration = Duration::from_millis(20);
/// Pause between two reports of progress.
const REPORT_EVERY_MS: u64 = 100;

/// Sink and reference of progress reports.
pub(crate) struct ProgressReporter<'a> {
    pub(crate) sink: &'a dyn Progress,
    pub(crate) started: Instant,
    /// Limits for the fraction of progress: seconds and samples.
    pub(crate) seconds: Option<f64>,
    pub(crate) samples: Option<u64>,
    /// Expected samples until the noise is hidden. Zero before the forecast.
    expected: AtomicU64,
    taken: AtomicU64,
    last_report_ms: AtomicU64,
}

impl<'a> ProgressReporter<'a> {
    pub(crate) fn new(sink: &'a dyn Progress, started: Instant, seconds: Option<f64>, samples: Option<u64>) -> Self {
        let zero = || AtomicU64::new(0);
        Self { sink, started, seconds, samples, expected: zero(), taken: zero(), last_report_ms: zero() }
    }

    /// Sets the expected samples until the noise is hidden.
    pub(crate) fn expect(&self, samples: f64) {
        // `as` saturates.
        self.expected.store(samples as u64, Ordering::Relaxed);
    }

    /// Counts samples of an earlier process.
    pub(crate) fn resume(&self, samples: u64) {
        self.taken.store(samples, Ordering::Relaxed);
    }

    /// Adds samples, and reports if the last report is old enough.
    fn add(&self, stage: Stage, samples: u64) {
        self.taken.fetch_add(samples, Ordering::Relaxed);
        let now = self.started.elapsed().as_millis() as u64;
        let last = self.last_report_ms.load(Ordering::Relaxed);
        let due = now >= last + REPORT_EVERY_MS
            && self.last_report_ms.compare_exchange(last, now, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if due {
            self.report(stage);
        }
    }

    /// Reports now.
    pub(crate) fn report(&self, stage: Stage) {
        let elapsed = self.started.elapsed().as_secs_f64();
        let taken = self.taken.load(Ordering::Relaxed);
        let by_time = self.seconds.map_or(0.0, |s| if s > 0.0 { elapsed / s } else { 1.0 });
        let by_samples = self.samples.map_or(0.0, |n| if n > 0 { taken as f64 / n as f64 } else { 1.0 });
        let expected = self.expected.load(Ordering::Relaxed);
        let by_noise = if expected > 0 { taken as f64 / expected as f64 } else { 0.0 };
        let fraction = by_time.max(by_samples).max(by_noise).clamp(0.0, 1.0);
        let remaining = (fraction > 0.0).then(|| elapsed * (1.0 - fraction) / fraction);
        self.sink.update(&ProgressState { stage, fraction, elapsed, remaining, samples: taken });
    }
}

/// The inputs of a pass: of a round, or of its levels up to a pause.
pub(crate) struct RoundWork<'a> {
    pub(crate) estimator: &'a Estimator<'a>,
    /// The groups of lights with films of their own.
    pub(crate) light_groups: Option<&'a LightGroups>,
    /// Samples of each pixel before the round, and its target.
    pub(crate) counts: &'a Plane<u32>,
    pub(crate) target: &'a Plane<u32>,
    pub(crate) levels: Levels,
    /// The pass ends with the first level that has so many samples of the image.
    pub(crate) pause_at: u64,
    /// Longest time of a level \[s\].
    pub(crate) interval: Option<f64>,
    pub(crate) clock: Option<Clock>,
    pub(crate) cancel: &'a Cancel,
    pub(crate) stage: Stage,
    /// The checkpoint that stores the film during the round, and its further data.
    pub(crate) writer: Option<(&'a CheckpointWriter, Snapshot<'a>)>,
}

/// The end of the time of a round.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    /// Time after which no unit begins, apart from those of the first level of a render.
    pub(crate) deadline: Instant,
    /// Time at which unfinished units are abandoned, with the samples of their level.
    pub(crate) abort_at: Instant,
    /// Is the film empty?
    pub(crate) is_first: bool,
}

/// The reason for the end of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// All samples of the round are taken.
    Complete,
    /// The round has further levels.
    Pause,
    /// The time is over, or the render is cancelled.
    Stop,
}

/// The result of a pass.
#[derive(Debug, Default)]
pub(crate) struct RoundResult {
    /// `None` while there are units.
    pub(crate) end: Option<End>,
    /// Samples that reached the film.
    pub(crate) samples: u64,
    /// The first invalid samples, by pixel and index.
    pub(crate) invalid: Vec<PixelSample>,
    /// Connections through covers, of all samples that reached the film.
    pub(crate) connections: ConnectionTally,
    /// Use of the lanes by all samples.
    pub(crate) lane_use: LaneUse,
    /// Was there not enough memory? The round ended early then.
    pub(crate) out_of_memory: bool,
}

/// The levels of a tile that are not in the film.
struct PendingTile {
    /// The number of the first one.
    first: usize,
    levels: VecDeque<PartialLevel>,
}

/// The finished parts of a level of a tile.
#[derive(Default)]
struct PartialLevel {
    /// For each film, sums of the pixels with new samples. A pixel occurs once for each part.
    sums: Vec<Vec<TileSum>>,
    /// Parts that are not finished; `None` before the first.
    missing: Option<u32>,
    samples: u64,
    connections: ConnectionTally,
}

/// Largest number of pixels of a tile.
const PIXELS: u32 = TILE * TILE;
/// Number of a pixel in its tile, plus a multiple of [`PIXELS`], and its new samples.
type TileSum = (u32, PixelSums);
/// Pixels are appended by a copy of memory.
static EMPTY: [TileSum; 1] = [(0, PixelSums::EMPTY)];

/// The film during a round: rows of tiles, one lock each.
struct TileWriter<'a> {
    rows: Vec<Mutex<&'a mut TileRow>>,
    grid: TileGrid,
}

/// The reason for a tile that could not be added to the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CanvasFault {
    /// A thread that held the lock of its row has failed.
    Poisoned,
    /// There is not enough memory for its sums.
    OutOfMemory,
}

impl<'a> TileWriter<'a> {
    fn new(film: &'a mut Film, grid: TileGrid) -> Self {
        Self { rows: film.tile_rows_mut().iter_mut().map(Mutex::new).collect(), grid }
    }

    /// Adds all sums of a tile at once, from all of its units. So a copy contains all of them or none.
    fn add<'b>(&self, tile: usize, sums: impl Iterator<Item = &'b TileSum>) -> Result<(), CanvasFault> {
        let rect = self.grid.rect(tile);
        let mut row = self.rows[(rect.y0 / TILE) as usize].lock().map_err(|_| CanvasFault::Poisoned)?;
        let width = rect.x1 - rect.x0;
        let sums = sums.map(|(slot, sums)| ((slot % PIXELS % width, slot % PIXELS / width), sums));
        row.add((rect.x0 / TILE) as usize, sums).map_err(|_| CanvasFault::OutOfMemory)
    }

    /// Copies rows of pixels, with each tile as it is when finished or as it was before. A later process can continue
    /// from this film. Rows on which a thread has failed are left out.
    fn copy(&self, rows: Range<u32>, out: &mut Vec<PixelSums>) {
        for band in rows.start / TILE..rows.end.div_ceil(TILE) {
            let Ok(row) = self.rows[band as usize].lock() else { return };
            let within = |y: u32| y.clamp(rows.start, rows.end) - band * TILE;
            row.read_rows(within(band * TILE)..within((band + 1) * TILE), out);
        }
    }
}

/// The films during a round, and for each tile the levels that are not in them.
struct Canvases<'a> {
    films: Vec<TileWriter<'a>>,
    pending: Vec<Mutex<PendingTile>>,
}

impl Canvases<'_> {
    /// Adds finished units with their numbers of samples, their connections, and for each film their sums, which are those of the
    /// same pixels. Returns the samples and connections of the levels that have reached the films.
    fn add_units(
        &self,
        (units, samples): (&[WorkUnit], &[u64]),
        mut connections: ConnectionTally,
        sums: &[Vec<TileSum>],
    ) -> Result<PartialLevel, CanvasFault> {
        let mut added = PartialLevel::default();
        let mut of_units = sums[0].chunk_by(|a, b| a.0 / PIXELS == b.0 / PIXELS).peekable();
        let mut first = 0;
        for ((number, unit), &samples) in (0..).zip(units).zip(samples) {
            let mut tile = self.pending[unit.tile].lock().map_err(|_| CanvasFault::Poisoned)?;
            let index = unit.number - tile.first;
            let known = tile.levels.len().max(index + 1);
            tile.levels.resize_with(known, PartialLevel::default);
            let level = &mut tile.levels[index];
            level.missing = Some(level.missing.unwrap_or(unit.parts) - 1);
            let of_unit = of_units.next_if(|sums| sums[0].0 / PIXELS == number).unwrap_or_default();
            let mut range = first..first + of_unit.len();
            first = range.end;
            // A level that is complete needs no copy.
            if index > 0 || level.missing != Some(0) {
                level.sums.resize_with(sums.len(), Vec::new);
                for (kept, sums) in level.sums.iter_mut().zip(sums) {
                    kept.extend_from_slice(&sums[range.clone()]);
                }
                range = 0..0;
            }
            level.samples += samples;
            level.connections.add(&std::mem::take(&mut connections));
            while let Some(level) = tile.levels.pop_front_if(|level| level.missing == Some(0)) {
                for (film, sums) in sums.iter().enumerate() {
                    let of_level = level.sums.get(film).into_iter().flatten();
                    self.films[film].add(unit.tile, of_level.chain(&sums[range.clone()]))?;
                }
                range = 0..0;
                tile.first += 1;
                added.samples += level.samples;
                added.connections.add(&level.connections);
            }
        }
        Ok(added)
    }
}

/// Takes units from the queue and adds them to the films, on the threads of the current pool. The first film is that of all
/// lights. The others are those of the groups of lights.
pub(crate) fn run<'a>(
    films: impl Iterator<Item = &'a mut Film>,
    queue: &mut WorkQueue,
    work: &RoundWork<'_>,
    reporter: &ProgressReporter<'_>,
) -> RoundResult {
    let (grid, begun) = (queue.costs().grid(), queue.begun());
    let pending = |_| Mutex::new(PendingTile { first: begun, levels: VecDeque::new() });
    let canvases = Canvases {
        films: films.map(|film| TileWriter::new(film, grid)).collect(),
        pending: (0..grid.len()).map(pending).collect(),
    };
    let (desk, invalid) = (Mutex::new((queue, RoundResult::default())), Mutex::new(Vec::new()));
    let out_of_memory = AtomicBool::new(false);
    (0..rayon::current_num_threads()).into_par_iter().for_each(|_| {
        let (mut units, mut sums, mut batch) = (Vec::new(), vec![Vec::new(); canvases.films.len()], Batch::new(work));
        let next = |units: &mut Vec<WorkUnit>| {
            let is_over = work.cancel.is_cancelled() || out_of_memory.load(Ordering::Relaxed);
            let Ok(mut desk) = desk.lock() else { return false };
            let (queue, result) = &mut *desk;
            // The first thread that finds no unit, or no time for one, ends the pass.
            if !is_over && result.end.is_none() {
                result.end = take_units(work, queue, begun, units);
            }
            !is_over && result.end.is_none()
        };
        while next(&mut units) {
            let began = Instant::now();
            let Some(connections) = render_units(work, &units, grid, &mut batch, reporter, &invalid, &mut sums) else {
                // Its level is incomplete.
                if let Ok(mut desk) = desk.lock() {
                    desk.1.end = Some(End::Stop);
                }
                break;
            };
            let added = match canvases.add_units((&units, &batch.samples), connections, &sums) {
                Ok(added) => added,
                Err(fault) => {
                    out_of_memory.fetch_or(fault == CanvasFault::OutOfMemory, Ordering::Relaxed);
                    return;
                }
            };
            let Ok(mut desk) = desk.lock() else { break };
            let per_sample =
                (began.elapsed() - batch.reports).as_secs_f64() / batch.samples.iter().sum::<u64>().max(1) as f64;
            for (unit, &samples) in units.iter().zip(&batch.samples) {
                desk.0.record(unit.tile, samples, samples as f64 * per_sample);
            }
            desk.1.samples += added.samples;
            desk.1.connections.add(&added.connections);
            drop(desk);
            // Only a finished tile changes the film.
            if let Some((writer, snapshot)) = work.writer.filter(|_| added.samples > 0) {
                let mut rows = |rows: Range<u32>, out: &mut Vec<PixelSums>| canvases.films[0].copy(rows, out);
                writer.keep_if_due(snapshot, work.clock.map(|clock| clock.deadline), &mut rows);
            }
        }
        if let Ok(mut desk) = desk.lock() {
            desk.1.lane_use.add(&batch.wavefront.lane_use());
        }
    });
    let mut result = desk.into_inner().map(|(_, result)| result).unwrap_or_default();
    result.out_of_memory = out_of_memory.into_inner();
    result.invalid = invalid.into_inner().unwrap_or_default();
    result.invalid.sort_by_key(|s| (s.y, s.x, s.index));
    result
}

/// Takes the next units of a pass that began after `begun` levels. Begins a level if all units of the last one are taken.
/// Returns the reason for the end of the pass if there is no unit, or no time for one.
fn take_units(work: &RoundWork<'_>, queue: &mut WorkQueue, begun: usize, units: &mut Vec<WorkUnit>) -> Option<End> {
    let (now, threads) = (Instant::now(), rayon::current_num_threads() as f64);
    while !queue.take(units) {
        let issued = queue.issued();
        if issued >= work.pause_at && queue.begun() > begun {
            return Some(End::Pause);
        }
        let left = |clock: Clock| threads * clock.deadline.saturating_duration_since(now).as_secs_f64();
        let affordable = match work.clock.map(left).map(|seconds| queue.affordable(seconds)) {
            None => Affordable::All,
            Some(None) => Affordable::Unknown,
            Some(Some(samples)) => Affordable::Samples(samples),
        };
        let Some(next) = work.levels.after(issued, affordable) else {
            return Some(End::Complete);
        };
        // `as` saturates.
        let shown = work.interval.and_then(|seconds| queue.affordable(threads * seconds));
        queue.raise(shown.map_or(next, |samples| next.min(issued.saturating_add(samples as u64))));
    }
    // An image shows its scene if each sixteenth pixel has a sample.
    let is_preview = |clock: Clock| clock.is_first && units.iter().all(|unit| unit.number == 0);
    work.clock.is_some_and(|clock| now > clock.deadline && !is_preview(clock)).then_some(End::Stop)
}

/// Samples of units that are computed together, and their results. A thread uses one for all of its units.
struct Batch<'a> {
    set: InstructionSet,
    wavefront: Wavefront<'a>,
    at: Vec<PixelSample>,
    /// For each pixel: its number in its tile, plus [`PIXELS`] times that of the unit, and how many of the samples it has.
    /// Their indices are consecutive.
    pixels: Vec<(u32, usize)>,
    /// For each unit: its samples.
    samples: Vec<u64>,
    /// Time of the reports of progress during the units. It is not that of samples.
    reports: Duration,
    /// The samples for each film.
    found: Vec<Vec<Sample>>,
    /// Number of samples after which the clock and the switch are checked.
    size: usize,
}

impl<'a> Batch<'a> {
    fn new(work: &RoundWork<'a>) -> Self {
        let set = InstructionSet::best();
        let wavefront = Wavefront::new(work.estimator, set).with_light_groups(work.light_groups);
        Self {
            set,
            wavefront,
            at: Vec::new(),
            pixels: Vec::new(),
            samples: Vec::new(),
            reports: Duration::ZERO,
            found: vec![Vec::new(); 1 + work.light_groups.map_or(0, LightGroups::len)],
            size: FIRST_BATCH,
        }
    }

    /// Computes the samples and adds them to the sums of their pixels in each film, which are in ascending order. False if the unit was
    /// abandoned.
    fn run(
        &mut self,
        work: &RoundWork<'_>,
        reporter: &ProgressReporter<'_>,
        connections: &mut ConnectionTally,
        invalid: &Mutex<Vec<PixelSample>>,
        sums: &mut [Vec<TileSum>],
    ) -> bool {
        let began = Instant::now();
        self.wavefront.samples_by_group(&self.at, connections, &mut self.found);
        if connections.is_abandoned {
            return false;
        }
        let set = self.set;
        for (film, sums) in sums.iter_mut().enumerate() {
            let found = &self.found[film];
            let invalid = (film == 0).then_some(invalid);
            dispatch!(set, _F, _token => self.add(found, invalid, sums));
        }
        let computed = Instant::now();
        reporter.add(work.stage, self.at.len() as u64);
        let now = Instant::now();
        self.reports += now - computed;
        self.size = match computed - began > CHECK_PAUSE {
            true => (self.at.len() / 2).max(FIRST_BATCH),
            false => (2 * self.size).min(Wavefront::BATCH),
        };
        self.clear();
        !work.cancel.is_cancelled() && work.clock.is_none_or(|clock| now <= clock.abort_at)
    }

    /// Adds the samples of a film to the sums of their pixels.
    #[inline(always)]
    fn add(&self, found: &[Sample], invalid: Option<&Mutex<Vec<PixelSample>>>, sums: &mut Vec<TileSum>) {
        let mut first = 0;
        for &(slot, count) in &self.pixels {
            let (at, samples) = (&self.at[first..first + count], &found[first..first + count]);
            first += count;
            if sums.last().is_none_or(|(last, _)| *last != slot) {
                sums.extend_from_slice(&EMPTY);
            }
            let (Some((of_slot, pixel)), Some(first)) = (sums.last_mut(), at.first()) else { continue };
            *of_slot = slot;
            let before = pixel.invalid;
            pixel.add_range(first.index, samples);
            if let Some(invalid) = invalid.filter(|_| pixel.invalid != before) {
                name_invalid(invalid, at, samples);
            }
        }
    }

    fn clear(&mut self) {
        self.at.clear();
        self.pixels.clear();
    }
}

/// Renders units into the `sums` of each film, whose content is replaced: the number of a pixel is that in its tile, plus [`PIXELS`] times that
/// of the unit. Returns the attempted connections. `None` if the units were abandoned.
fn render_units(
    work: &RoundWork<'_>,
    units: &[WorkUnit],
    grid: TileGrid,
    batch: &mut Batch<'_>,
    reporter: &ProgressReporter<'_>,
    invalid: &Mutex<Vec<PixelSample>>,
    sums: &mut [Vec<TileSum>],
) -> Option<ConnectionTally> {
    sums.iter_mut().for_each(Vec::clear);
    batch.clear();
    batch.samples.clear();
    batch.reports = Duration::ZERO;
    let abandon_at = work.clock.map(|clock| clock.abort_at);
    let mut connections = ConnectionTally { abandon_at, ..ConnectionTally::default() };
    for (first, unit) in (0..).step_by(PIXELS as usize).zip(units) {
        let rect = grid.rect(unit.tile);
        let places = (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y)));
        let mut samples = 0;
        for (slot, (x, y)) in (first..).zip(places) {
            let mut indices = unit.range([x, y], [*work.counts.at(x, y), *work.target.at(x, y)]);
            samples += indices.len() as u64;
            while !indices.is_empty() {
                let count = indices.len().min(batch.size - batch.at.len());
                batch.at.extend(indices.by_ref().take(count).map(|index| PixelSample { x, y, index }));
                batch.pixels.push((slot, count));
                if batch.at.len() >= batch.size && !batch.run(work, reporter, &mut connections, invalid, sums) {
                    return None;
                }
            }
        }
        batch.samples.push(samples);
    }
    let is_complete = batch.at.is_empty() || batch.run(work, reporter, &mut connections, invalid, sums);
    is_complete.then_some(connections)
}

#[cold]
fn name_invalid(invalid: &Mutex<Vec<PixelSample>>, at: &[PixelSample], samples: &[Sample]) {
    if let Ok(mut list) = invalid.lock() {
        let found = at.iter().zip(samples).filter(|(_, sample)| !sample.is_valid()).map(|(at, _)| *at);
        let room = MAX_LISTED.saturating_sub(list.len());
        list.extend(found.take(room));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::Accumulate;
    use dunkelfeld_radiometry::Rgb;

    /// A film whose last tiles are cut off by its right and lower edge. Each pixel is visited once, at its own
    /// position.
    #[test]
    fn tiles_are_written_at_their_positions_and_copied_row_by_row() {
        let (width, height) = (2 * TILE + 5, TILE + 3);
        let grid = TileGrid::new(width, height, TILE);
        let mut film = Film::new(width, height);
        let canvas = TileWriter::new(&mut film, grid);
        let value = |x: u32, y: u32| (1 + x + 64 * y) as f32;
        for tile in 0..grid.len() {
            let rect = grid.rect(tile);
            let places = (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y)));
            let sums: Vec<TileSum> = (0..)
                .zip(places)
                .map(|(slot, (x, y))| {
                    let mut pixel = PixelSums::default();
                    pixel.add(0, &Sample { radiance: Rgb::splat(value(x, y)), ..Sample::MISS });
                    (slot, pixel)
                })
                .collect();
            canvas.add(tile, sums.iter()).expect("memory");
        }
        let rows = TILE - 2..height;
        let mut copied = Vec::new();
        canvas.copy(rows.clone(), &mut copied);
        let mut read = Vec::new();
        film.read_rows(rows, &mut read);
        assert_eq!(copied, read);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let pixel = film.pixel(x, y);
            assert_eq!((pixel.count(), pixel.mean()[0]), (1, f64::from(value(x, y))), "{x}, {y}");
        }
    }
    /// Tiles of two units during a copy: a pixel has the samples of both or of none.
    #[test]
    fn partial_tiles_are_not_visible() {
        let side = 2 * TILE;
        let grid = TileGrid::new(side, side, TILE);
        let mut film = Film::new(side, side);
        let unit: Vec<TileSum> = (0..TILE * TILE)
            .map(|slot| {
                let mut pixel = PixelSums::default();
                pixel.add(slot, &Sample::MISS);
                (slot, pixel)
            })
            .collect();
        let canvas = TileWriter::new(&mut film, grid);
        let (copies, is_done) = (AtomicU64::new(0), AtomicBool::new(false));
        let mut rounds = 0;
        let torn = std::thread::scope(|threads| {
            let copier = threads.spawn(|| {
                let (mut torn, mut copied) = (0, Vec::new());
                while !is_done.load(Ordering::Relaxed) {
                    copies.fetch_add(1, Ordering::Relaxed);
                    copied.clear();
                    canvas.copy(0..side, &mut copied);
                    torn += copied.iter().filter(|p| p.count() % 2 != 0).count();
                    let bands = copied.chunks(TILE as usize);
                    torn += bands.filter(|row| row.iter().any(|p| p.count() != row[0].count())).count();
                }
                torn
            });
            let enough = copies.load(Ordering::Relaxed) + 200;
            while copies.load(Ordering::Relaxed) < enough || rounds % grid.len() != 0 {
                canvas.add(rounds % grid.len(), unit.iter().chain(&unit)).expect("memory");
                rounds += 1;
            }
            is_done.store(true, Ordering::Relaxed);
            copier.join()
        });
        assert_eq!(torn.ok(), Some(0));
        assert!(film.sample_counts().data().iter().all(|&n| n == 2 * (rounds / grid.len()) as u32));
    }
}
