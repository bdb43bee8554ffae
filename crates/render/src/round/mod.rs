//! One round of samples on all threads.
//!
//! A round is given as new samples per pixel. Threads take units of work, which are a tile or a share of a tile's
//! samples, and sum each unit separately. A tile is added to the film when all of its units are done. So the samples of
//! a pixel are always the first n, also after an interruption. Sums are exact, so the order of the threads does not
//! matter.

pub(crate) mod pass;

use crate::checkpoint::{CheckpointWriter, Snapshot};
use crate::load::{ProcessorLoad, ThreadClock};
use crate::progress::{Cancel, Progress, ProgressState};
use crate::stage::Stage;
use dunkelfeld_adaptive::tile_cost::{CostMap, TileGrid, TileRect, WorkUnit};
use dunkelfeld_film::{Film, PixelSums, Plane, Sample, TileRow};
use dunkelfeld_integrator::{ConnectionTally, Estimator, LaneUse, PixelSample, Wavefront};
use dunkelfeld_lanes::{InstructionSet, dispatch};
use rayon::prelude::*;
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
const CHECK_PAUSE: Duration = Duration::from_millis(10);
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

/// The inputs of a round.
pub(crate) struct RoundWork<'a> {
    pub(crate) estimator: &'a Estimator<'a>,
    /// Samples of each pixel before the round, and its target.
    pub(crate) counts: &'a Plane<u32>,
    pub(crate) increment: &'a Plane<u32>,
    pub(crate) units: &'a [WorkUnit],
    pub(crate) costs: &'a CostMap,
    /// Time after which no unit begins.
    pub(crate) deadline: Option<Instant>,
    /// Time at which unfinished units are abandoned, with the samples of their tiles in this round. This needs a pixel
    /// whose cost no cost map could predict.
    pub(crate) abort_at: Option<Instant>,
    pub(crate) cancel: &'a Cancel,
    pub(crate) stage: Stage,
    /// The checkpoint that stores the film during the round, and its further data.
    pub(crate) writer: Option<(&'a CheckpointWriter, Snapshot<'a>)>,
}

/// The result of a round.
#[derive(Debug, Default)]
pub(crate) struct RoundResult {
    /// For each finished tile: index, samples, thread seconds.
    pub(crate) tiles: Vec<(usize, u64, f64)>,
    /// Samples that reached the film.
    pub(crate) samples: u64,
    /// The first invalid samples, by pixel and index.
    pub(crate) invalid: Vec<PixelSample>,
    /// Connections through covers, of all samples that reached the film.
    pub(crate) connections: ConnectionTally,
    /// Use of the lanes by all samples.
    pub(crate) lane_use: LaneUse,
    /// Seconds of the threads in the units.
    pub(crate) load: ProcessorLoad,
    /// Was there not enough memory? The round ended early then.
    pub(crate) out_of_memory: bool,
}

/// An unfinished tile: the sums of its finished units.
#[derive(Default)]
struct PartialTile {
    /// Sums of the pixels with new samples, each with its number in the tile. A pixel occurs once for each unit. Empty
    /// after they are added to the film.
    sums: Vec<TileSum>,
    units_done: u32,
    seconds: f64,
    connections: ConnectionTally,
}

/// Number of a pixel in its tile, and its new samples.
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
        let sums = sums.map(|(slot, sums)| ((slot % width, slot / width), sums));
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

/// Renders a round and adds it to the film, on the threads of the current pool.
pub(crate) fn run(film: &mut Film, work: &RoundWork<'_>, reporter: &ProgressReporter<'_>) -> RoundResult {
    let grid = work.costs.grid();
    let canvas = TileWriter::new(film, grid);
    let pending: Vec<Mutex<PartialTile>> = (0..grid.len()).map(|_| Mutex::default()).collect();
    let (finished, invalid) = (Mutex::new(RoundResult::default()), Mutex::new(Vec::new()));
    let (next, out_of_memory) = (AtomicU64::new(0), AtomicBool::new(false));
    // Each thread has one long task, which takes the next unit. The most expensive units are first, as they were
    // divided.
    (0..rayon::current_num_threads()).into_par_iter().for_each(|_| {
        let (mut sums, mut load) = (Vec::new(), ProcessorLoad::default());
        let mut batch = Batch::new(work.estimator);
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed) as usize;
            let Some(unit) = work.units.get(index) else { break };
            let is_over = work.cancel.is_cancelled() || out_of_memory.load(Ordering::Relaxed);
            if is_over || work.deadline.is_some_and(|d| Instant::now() > d) {
                break;
            }
            let (began, clock) = (Instant::now(), ThreadClock::start());
            let rect = grid.rect(unit.tile);
            let Some(connections) = render_unit(work, unit, rect, &mut batch, reporter, &invalid, &mut sums) else {
                break;
            };
            load.add(clock.elapsed());
            let Ok(mut tile) = pending[unit.tile].lock() else { break };
            tile.units_done += 1;
            tile.connections.add(&connections);
            let is_finished = tile.units_done == unit.parts;
            if !is_finished {
                // A tile with a unit missing is left out as a whole.
                tile.sums.append(&mut sums);
                tile.seconds += began.elapsed().as_secs_f64();
            } else {
                let earlier = std::mem::take(&mut tile.sums);
                if let Err(fault) = canvas.add(unit.tile, earlier.iter().chain(&sums)) {
                    out_of_memory.fetch_or(fault == CanvasFault::OutOfMemory, Ordering::Relaxed);
                    break;
                }
                tile.seconds += began.elapsed().as_secs_f64();
                let Ok(mut finished) = finished.lock() else { break };
                finished.tiles.push((unit.tile, unit.samples, tile.seconds));
                finished.samples += unit.samples;
                finished.connections.add(&tile.connections);
            }
            drop(tile);
            // Only a finished tile changes the film.
            if let Some((writer, snapshot)) = work.writer.filter(|_| is_finished) {
                let mut rows = |rows: Range<u32>, out: &mut Vec<PixelSums>| canvas.copy(rows, out);
                writer.keep_if_due(snapshot, work.deadline, &mut rows);
            }
        }
        if let Ok(mut finished) = finished.lock() {
            finished.load.add(load);
            finished.lane_use.add(&batch.wavefront.lane_use());
        }
    });
    let mut result = finished.into_inner().unwrap_or_default();
    // The order in which threads finish has no effect: costs are updated in the order of the tiles.
    result.tiles.sort_by_key(|&(tile, ..)| tile);
    result.out_of_memory = out_of_memory.into_inner();
    result.invalid = invalid.into_inner().unwrap_or_default();
    result.invalid.sort_by_key(|s| (s.y, s.x, s.index));
    result
}

/// Samples of a unit that are computed together, and their results. A thread uses one for all of its units.
struct Batch<'a> {
    set: InstructionSet,
    wavefront: Wavefront<'a>,
    at: Vec<PixelSample>,
    /// For each pixel: its number in the tile and how many of the samples it has. Their indices are consecutive.
    pixels: Vec<(u32, usize)>,
    found: Vec<Sample>,
    /// Number of samples after which the clock and the switch are checked.
    size: usize,
}

impl<'a> Batch<'a> {
    fn new(estimator: &Estimator<'a>) -> Self {
        let set = InstructionSet::best();
        let wavefront = Wavefront::new(estimator, set);
        Self { set, wavefront, at: Vec::new(), pixels: Vec::new(), found: Vec::new(), size: FIRST_BATCH }
    }

    /// Computes the samples and adds them to the sums of their pixels, which are in ascending order. False if the unit was
    /// abandoned.
    fn run(
        &mut self,
        work: &RoundWork<'_>,
        reporter: &ProgressReporter<'_>,
        connections: &mut ConnectionTally,
        invalid: &Mutex<Vec<PixelSample>>,
        sums: &mut Vec<TileSum>,
    ) -> bool {
        let began = Instant::now();
        self.wavefront.samples(&self.at, connections, &mut self.found);
        if connections.is_abandoned {
            return false;
        }
        let set = self.set;
        dispatch!(set, _F, _token => self.add(invalid, sums));
        // The time of a report is not that of samples.
        let now = Instant::now();
        reporter.add(work.stage, self.at.len() as u64);
        self.size = match now - began > CHECK_PAUSE {
            true => (self.at.len() / 2).max(FIRST_BATCH),
            false => (2 * self.size).min(Wavefront::BATCH),
        };
        self.clear();
        !work.cancel.is_cancelled() && work.abort_at.is_none_or(|d| now <= d)
    }

    /// Adds the samples to the sums of their pixels.
    #[inline(always)]
    fn add(&self, invalid: &Mutex<Vec<PixelSample>>, sums: &mut Vec<TileSum>) {
        let mut first = 0;
        for &(slot, count) in &self.pixels {
            let (at, samples) = (&self.at[first..first + count], &self.found[first..first + count]);
            first += count;
            if sums.last().is_none_or(|(last, _)| *last != slot) {
                sums.extend_from_slice(&EMPTY);
            }
            let (Some((of_slot, pixel)), Some(first)) = (sums.last_mut(), at.first()) else { continue };
            *of_slot = slot;
            let before = pixel.invalid;
            pixel.add_range(first.index, samples);
            if pixel.invalid != before {
                name_invalid(invalid, at, samples);
            }
        }
    }

    fn clear(&mut self) {
        self.at.clear();
        self.pixels.clear();
    }
}

/// Renders a unit into `sums`, whose content is replaced. Returns its attempted connections. `None` if it was
/// abandoned.
fn render_unit(
    work: &RoundWork<'_>,
    unit: &WorkUnit,
    rect: TileRect,
    batch: &mut Batch<'_>,
    reporter: &ProgressReporter<'_>,
    invalid: &Mutex<Vec<PixelSample>>,
    sums: &mut Vec<TileSum>,
) -> Option<ConnectionTally> {
    sums.clear();
    let mut connections = ConnectionTally { abandon_at: work.abort_at, ..ConnectionTally::default() };
    let places = (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).map(move |x| (x, y)));
    for (slot, (x, y)) in (0..).zip(places) {
        let mut indices = unit.range(*work.counts.at(x, y), *work.increment.at(x, y));
        while !indices.is_empty() {
            let count = indices.len().min(batch.size - batch.at.len());
            batch.at.extend(indices.by_ref().take(count).map(|index| PixelSample { x, y, index }));
            batch.pixels.push((slot, count));
            if batch.at.len() >= batch.size && !batch.run(work, reporter, &mut connections, invalid, sums) {
                batch.clear();
                return None;
            }
        }
    }
    if !batch.at.is_empty() && !batch.run(work, reporter, &mut connections, invalid, sums) {
        batch.clear();
        return None;
    }
    Some(connections)
}

#[cold]
fn name_invalid(invalid: &Mutex<Vec<PixelSample>>, at: &[PixelSample], samples: &[Sample]) {
    if let Ok(mut list) = invalid.lock() {
        let found = at.iter().zip(samples).filter(|(_, sample)| !sample.is_valid()).map(|(at, _)| *at);
        let room = MAX_LISTED.saturating_sub(list.len());
        list.extend(found.take(room));
    }
}

/// The time at which units are abandoned: half the tolerated overrun past the deadline.
pub(crate) fn abort_at(deadline: Option<Instant>, seconds: Option<f64>) -> Option<Instant> {
    let grace = (0.01 * seconds?).max(0.1);
    deadline?.checked_add(Duration::try_from_secs_f64(grace).ok()?)
}

/// The time after which no unit begins.
pub(crate) fn deadline(started: Instant, seconds: Option<f64>, closing: f64) -> Option<Instant> {
    let left = (seconds? - closing).max(0.0);
    started.checked_add(Duration::try_from_secs_f64(left).ok()?)
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
