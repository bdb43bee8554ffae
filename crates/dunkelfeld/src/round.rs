//! One round of samples on all threads.
//!
//! A round is given as new samples per pixel. Threads take units of work (a tile, or a share of a tile's samples), add
//! them up apart, and a tile goes onto the film only when all of its units are done: whatever happens, the samples of a
//! pixel are always the first n. Sums are exact, so it does not matter who finishes first.

use crate::checkpoint::{Keeper, Moment};
use crate::progress::{Cancel, Progress, ProgressState, Stage};
use dunkelfeld_adaptive::cost::{CostMap, TileGrid, TileRect, WorkUnit};
use dunkelfeld_film::{Accumulate, Film, PixelSums, Plane};
use dunkelfeld_integrator::{ConnectionTally, Estimator, PixelSample};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Pixels along the side of a tile.
pub(crate) const TILE: u32 = 16;
/// At most so many invalid samples are remembered by name.
const MOST_NAMED: usize = 16;
/// Samples between two looks at the clock and the switch.
const CHECK_EVERY: u32 = 64;
/// Pause between two reports of progress.
const REPORT_EVERY_MS: u64 = 100;

/// Where progress reports go, and what they are measured against.
pub(crate) struct Reporter<'a> {
    pub(crate) sink: &'a dyn Progress,
    pub(crate) started: Instant,
    /// Limits that progress is a fraction of: seconds and samples.
    pub(crate) seconds: Option<f64>,
    pub(crate) samples: Option<u64>,
    /// Samples after which the image is expected to be good enough; zero as long as nobody expects that.
    expected: AtomicU64,
    taken: AtomicU64,
    last_report_ms: AtomicU64,
}

impl<'a> Reporter<'a> {
    pub(crate) fn new(sink: &'a dyn Progress, started: Instant, seconds: Option<f64>, samples: Option<u64>) -> Self {
        let zero = || AtomicU64::new(0);
        Self { sink, started, seconds, samples, expected: zero(), taken: zero(), last_report_ms: zero() }
    }

    /// The image is expected to be good enough after so many samples.
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

/// What a round needs.
pub(crate) struct RoundWork<'a> {
    pub(crate) estimator: &'a Estimator<'a>,
    /// Samples that each pixel has, and that it is to get.
    pub(crate) counts: &'a Plane<u32>,
    pub(crate) increment: &'a Plane<u32>,
    pub(crate) units: &'a [WorkUnit],
    pub(crate) costs: &'a CostMap,
    /// Units that have not begun by now are left out.
    pub(crate) deadline: Option<Instant>,
    /// Units that are not done by now are given up, and their tiles' samples of this round with them: it takes a pixel that
    /// costs more than any map could foresee.
    pub(crate) give_up: Option<Instant>,
    pub(crate) cancel: &'a Cancel,
    pub(crate) stage: Stage,
    /// Who stores the film on the way, and what belongs to it.
    pub(crate) keeper: Option<(&'a Keeper, Moment<'a>)>,
}

/// What a round brought.
#[derive(Debug, Default)]
pub(crate) struct RoundResult {
    /// Per tile that was finished: index, samples, thread seconds.
    pub(crate) tiles: Vec<(usize, u64, f64)>,
    /// Samples that reached the film.
    pub(crate) samples: u64,
    /// The first invalid samples, by pixel and index.
    pub(crate) invalid: Vec<PixelSample>,
    /// Connections through covers, of all samples that reached the film.
    pub(crate) connections: ConnectionTally,
}

/// A tile on its way: the sums of its finished units.
#[derive(Default)]
struct Pending {
    /// Sums of pixels with new samples, each with its number in the tile; a pixel comes once for each unit.
    sums: Vec<(u32, PixelSums)>,
    units_done: u32,
    seconds: f64,
    connections: ConnectionTally,
}

/// Renders a round onto the film, on the threads of the current pool.
pub(crate) fn run(film: &mut Film, work: &RoundWork<'_>, reporter: &Reporter<'_>) -> RoundResult {
    let grid = work.costs.grid();
    let mut parts = vec![(0u32, 0u64); grid.len()];
    work.units.iter().for_each(|u| parts[u.tile] = (u.parts, u.samples));
    let pending: Vec<Mutex<Pending>> = (0..grid.len()).map(|_| Mutex::default()).collect();
    let invalid = Mutex::new(Vec::new());
    let next = AtomicU64::new(0);
    let film_before: &Film = film;
    // One long-lived task per thread that takes the next unit: the dearest first, as they were cut.
    (0..rayon::current_num_threads()).into_par_iter().for_each(|_| {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed) as usize;
            let Some(unit) = work.units.get(index) else { break };
            if work.cancel.is_cancelled() || work.deadline.is_some_and(|d| Instant::now() > d) {
                break;
            }
            let began = Instant::now();
            let rect = grid.rect(unit.tile);
            let Some((sums, connections)) = render_unit(work, unit, rect, reporter, &invalid) else { break };
            let Ok(mut tile) = pending[unit.tile].lock() else { break };
            if tile.sums.is_empty() {
                tile.sums = sums;
            } else {
                tile.sums.extend(sums);
            }
            tile.units_done += 1;
            tile.connections.add(&connections);
            tile.seconds += began.elapsed().as_secs_f64();
            drop(tile);
            if let Some((keeper, moment)) = work.keeper {
                let mut rows = |rows: Range<u32>, out: &mut Vec<PixelSums>| {
                    rows_so_far(film_before, grid, &pending, &parts, rows, out);
                };
                keeper.keep_if_due(moment, work.deadline, &mut rows);
            }
        }
    });

    let mut result = RoundResult { invalid: invalid.into_inner().unwrap_or_default(), ..RoundResult::default() };
    // A tile with a unit missing is left out as a whole.
    let finished: Vec<Option<Pending>> = pending
        .into_iter()
        .zip(&parts)
        .map(|(tile, &(parts, _))| tile.into_inner().ok().filter(|t| parts > 0 && t.units_done == parts))
        .collect();
    for (index, (tile, (_, samples))) in finished.iter().zip(parts).enumerate() {
        if let Some(tile) = tile {
            result.tiles.push((index, samples, tile.seconds));
            result.samples += samples;
            result.connections.add(&tile.connections);
        }
    }
    // Onto the film, one row of tiles a task: no two tasks touch the same pixel.
    let width = film.width() as usize;
    let columns = film.width().div_ceil(TILE) as usize;
    film.pixels_mut().data_mut().par_chunks_mut(width * TILE as usize).enumerate().for_each(|(tile_row, pixels)| {
        let tiles = finished.iter().enumerate().skip(tile_row * columns).take(columns);
        for (index, tile) in tiles.filter_map(|(i, t)| t.as_ref().map(|t| (i, t))) {
            let rect = grid.rect(index);
            let tile_width = (rect.x1 - rect.x0) as usize;
            for (slot, sums) in &tile.sums {
                let slot = *slot as usize;
                pixels[slot / tile_width * width + rect.x0 as usize + slot % tile_width].merge(sums);
            }
        }
    });
    result.invalid.sort_by_key(|s| (s.y, s.x, s.index));
    result
}

/// Some rows of the film with all tiles that are finished on them: a film that a later process can go on from.
fn rows_so_far(
    film: &Film,
    grid: TileGrid,
    pending: &[Mutex<Pending>],
    parts: &[(u32, u64)],
    rows: Range<u32>,
    out: &mut Vec<PixelSums>,
) {
    let width = film.width() as usize;
    let first = rows.start as usize * width;
    out.extend(&film.pixels().data()[first..rows.end as usize * width]);
    for (index, (tile, &(parts, _))) in pending.iter().zip(parts).enumerate() {
        let rect = grid.rect(index);
        if rect.y0 >= rows.end || rect.y1 <= rows.start {
            continue;
        }
        let Ok(tile) = tile.lock() else { continue };
        if parts == 0 || tile.units_done != parts {
            continue;
        }
        for (slot, sums) in &tile.sums {
            let (dx, dy) = (slot % (rect.x1 - rect.x0), slot / (rect.x1 - rect.x0));
            if rows.contains(&(rect.y0 + dy)) {
                out[(rect.y0 + dy) as usize * width + (rect.x0 + dx) as usize - first].merge(sums);
            }
        }
    }
}

/// The sums of one unit, and the connections that it sought; `None` if it was cut short.
fn render_unit(
    work: &RoundWork<'_>,
    unit: &WorkUnit,
    rect: TileRect,
    reporter: &Reporter<'_>,
    invalid: &Mutex<Vec<PixelSample>>,
) -> Option<(Vec<(u32, PixelSums)>, ConnectionTally)> {
    let mut sums = Vec::new();
    let mut connections = ConnectionTally::default();
    let mut unreported = 0u32;
    let mut slot = 0u32;
    for y in rect.y0..rect.y1 {
        for x in rect.x0..rect.x1 {
            let indices = unit.range(*work.counts.at(x, y), *work.increment.at(x, y));
            let has_samples = !indices.is_empty();
            let mut pixel = PixelSums::default();
            for index in indices {
                let at = PixelSample { x, y, index };
                let sample = work.estimator.sample_counting(at, &mut connections);
                if !sample.is_valid() {
                    name_invalid(invalid, at);
                }
                pixel.add(index, &sample);
                unreported += 1;
                if unreported == CHECK_EVERY {
                    reporter.add(work.stage, u64::from(unreported));
                    unreported = 0;
                    if work.cancel.is_cancelled() || work.give_up.is_some_and(|d| Instant::now() > d) {
                        return None;
                    }
                }
            }
            if has_samples {
                sums.push((slot, pixel));
            }
            slot += 1;
        }
    }
    reporter.add(work.stage, u64::from(unreported));
    Some((sums, connections))
}

#[cold]
fn name_invalid(invalid: &Mutex<Vec<PixelSample>>, at: PixelSample) {
    if let Ok(mut list) = invalid.lock()
        && list.len() < MOST_NAMED
    {
        list.push(at);
    }
}

/// The moment at which units are given up: half the tolerated overrun past the deadline.
pub(crate) fn give_up(deadline: Option<Instant>, seconds: Option<f64>) -> Option<Instant> {
    let grace = (0.01 * seconds?).max(0.1);
    deadline?.checked_add(Duration::try_from_secs_f64(grace).ok()?)
}

/// The moment at which units are no longer begun.
pub(crate) fn deadline(started: Instant, seconds: Option<f64>, closing: f64) -> Option<Instant> {
    let left = (seconds? - closing).max(0.0);
    started.checked_add(Duration::try_from_secs_f64(left).ok()?)
}
