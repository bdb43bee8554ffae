//! The work of a round: units that threads take one after the other, without waiting for each other.
//!
//! A round takes the pixels from the samples that they have to a target. It goes there in *levels*. A level is a share of
//! the new samples of each pixel, rounded by a threshold of the pixel. So a level decides the number of samples of each
//! pixel, levels only grow, and a fraction of a sample per pixel is a sample in some of the pixels. Level one is the
//! target. A round without a fixed end goes on beyond it, in the same proportions.
//!
//! Each level visits all tiles in the same order, block by block, with the blocks shuffled. The threads need no plan of a
//! level beforehand: a unit of work consists of a tile and its two levels. A thread that finds all units of a level taken
//! begins the next one, while other threads still work on the last. If the time is over, the blocks without the last level
//! are spread over the image.

use std::ops::Range;

use dunkelfeld_film::{BATCHES, Plane};

use crate::plan::{COARSE_FROM, MAX_SPP, mix};
use crate::tile_cost::{CostMap, TileGrid};

/// A thread takes units of about so many seconds together. A tile that takes longer is divided.
/// This is a fifth of the shortest tolerated overrun.
const UNIT_SECONDS: f64 = 0.02;
/// And of no more than so many samples: more are not computed together.
const UNIT_SAMPLES: f64 = 4096.0;
/// A tile is expected to take at most so many seconds of a thread at a level, unless that is less than a sample per pixel.
/// Films and checkpoints contain only completed levels of a tile.
const TILE_SECONDS: f64 = 0.5;
/// Neighbouring tiles in a square of so many pixels follow one another. Their samples are computed together where each has
/// few, and rays of one region are faster.
const BLOCK: u32 = 64;

/// The samples of a pixel at a level, if it has `before` at level zero and `target` at level one. It does not fall from one
/// level to a higher one.
pub fn samples_at(level: f64, [before, target]: [u32; 2], threshold: f64) -> u32 {
    if level == 1.0 || target <= before {
        return target.max(before);
    }
    if level <= 0.0 {
        return before;
    }
    let samples = f64::from(before) + level * f64::from(target - before);
    let quantum = if samples >= COARSE_FROM { BATCHES as f64 } else { 1.0 };
    // `as` saturates.
    let rounded = ((samples / quantum + threshold).floor() * quantum).min(f64::from(MAX_SPP)) as u32;
    if level < 1.0 { rounded.clamp(before, target) } else { rounded.max(target) }
}

/// The threshold of a pixel, in [0, 1). In each tile of 16 x 16 pixels all multiples of 1/256 occur, evenly spread (ordered
/// dithering, Bayer 1973). A hash of the tile exchanges its halves, quarters and so on.
pub fn threshold(x: u32, y: u32) -> f64 {
    let hash = mix((u64::from(y / 16) << 32) | u64::from(x / 16)) as u8;
    f64::from(BAYER[(y % 16 * 16 + x % 16) as usize] ^ hash) / 256.0 + 1.0 / 512.0
}

/// The bits of column and row, alternating, the lowest first. Those of the column are their differences.
const BAYER: [u8; 256] = {
    let mut table = [0; 256];
    let mut pixel = 0;
    while pixel < 256 {
        let (x, y) = (pixel % 16, pixel / 16);
        let mut bit = 0;
        while bit < 4 {
            table[pixel] = 4 * table[pixel] + 2 * (((x ^ y) >> bit) & 1) as u8 + ((y >> bit) & 1) as u8;
            bit += 1;
        }
        pixel += 1;
    }
    table
};

/// A unit of work, which one thread does without interruption.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkUnit {
    /// The tile's number in its grid.
    pub tile: usize,
    /// The levels of the tile before and after the unit, with all of its parts.
    pub levels: [f64; 2],
    /// The number of the level in its round, from zero.
    pub number: usize,
    /// The number of this part of the tile's samples.
    pub part: u32,
    /// The number of parts.
    pub parts: u32,
}

impl WorkUnit {
    /// The sample indices of a pixel in this unit: the pixel at column `x` and row `y` of the image, with the samples before
    /// the round and the target. Over all parts and levels these ranges are disjoint and cover the samples of the round.
    pub fn range(&self, [x, y]: [u32; 2], samples: [u32; 2]) -> Range<u32> {
        let threshold = threshold(x, y);
        let [first, end] = self.levels.map(|level| samples_at(level, samples, threshold));
        // Parts of a single sample are the turn of one pixel after the other.
        let turn = (16 * y + x) % self.parts;
        let of_parts = |part: u32| u64::from(end - first) * u64::from(part) + u64::from(turn);
        let cut = |part: u32| first + (of_parts(part) / u64::from(self.parts)) as u32;
        cut(self.part)..cut(self.part + 1)
    }
}

/// The units of a round, with the measured costs of tiles, which outlive the rounds.
#[derive(Clone, Debug)]
pub struct WorkQueue {
    costs: CostMap,
    /// The tiles in the order of work.
    order: Vec<u32>,
    /// New samples of each tile at level one, and of all.
    increments: Vec<u64>,
    total: u64,
    /// Samples of the image before the round.
    before: u64,
    /// The present level and the one before it; the number of levels so far.
    levels: [f64; 2],
    begun: usize,
    /// The place in the order, and the part of its tile, of the next unit; the number of its parts.
    next: usize,
    part: u32,
    parts: u32,
}

impl WorkQueue {
    /// An empty queue of an image.
    pub fn new(grid: TileGrid) -> Self {
        let mut order: Vec<u32> = (0..grid.len() as u32).collect();
        order.sort_by_cached_key(|&tile| {
            let rect = grid.rect(tile as usize);
            (mix((u64::from(rect.y0 / BLOCK) << 32) | u64::from(rect.x0 / BLOCK)), tile)
        });
        Self {
            costs: CostMap::new(grid),
            increments: Vec::new(),
            total: 0,
            before: 0,
            levels: [0.0; 2],
            begun: 0,
            next: order.len(),
            part: 0,
            parts: 1,
            order,
        }
    }

    /// Begins a round: the samples of each pixel before it and at level one, and the samples of the image before it.
    ///
    /// # Panics
    /// If the size of a plane is not that of the image.
    pub fn begin(&mut self, [counts, target]: [&Plane<u32>; 2], before: u64) {
        let (grid, width) = (self.costs.grid(), counts.width() as usize);
        let of_tile = |tile| {
            let rect = grid.rect(tile);
            let rows = (rect.y0 as usize..rect.y1 as usize).map(|y| y * width);
            let pixels = rows.flat_map(|row| row + rect.x0 as usize..row + rect.x1 as usize);
            pixels.map(|pixel| u64::from(target.data()[pixel].saturating_sub(counts.data()[pixel]))).sum()
        };
        self.increments = (0..grid.len()).map(of_tile).collect();
        self.total = self.increments.iter().sum();
        (self.before, self.levels, self.begun) = (before, [0.0; 2], 0);
        (self.next, self.part) = (self.order.len(), 0);
    }

    /// Number of levels of the round so far.
    pub fn begun(&self) -> usize {
        self.begun
    }

    /// Samples of the image at level one.
    pub fn target(&self) -> u64 {
        self.before + self.total
    }

    /// The costs of tiles.
    pub fn costs(&self) -> &CostMap {
        &self.costs
    }

    /// Records the samples of a unit, and the seconds of its thread.
    pub fn record(&mut self, tile: usize, samples: u64, seconds: f64) {
        self.costs.record(tile, samples, seconds);
    }

    /// Samples of the image at the present level.
    pub fn issued(&self) -> u64 {
        let samples = (self.levels[1] * self.total as f64).round() as u64;
        // Only the target has all samples.
        self.before + if self.levels[1] < 1.0 { samples.min(self.total.saturating_sub(1)) } else { samples }
    }

    /// The number of samples of this round that take so many seconds of one thread. `None` if no cost has been measured.
    pub fn affordable(&self, seconds: f64) -> Option<f64> {
        let mean = self.costs.mean()?;
        let cost = |(tile, &n): (usize, &u64)| n as f64 * self.costs.per_sample(tile).unwrap_or(mean);
        let all: f64 = self.increments.iter().enumerate().map(cost).sum();
        let per_sample = if self.total > 0 { all / self.total as f64 } else { mean };
        Some(seconds.max(0.0) / per_sample)
    }

    /// Begins the next level, with so many samples of the image. It is lower where a tile would take too long.
    pub fn raise(&mut self, samples: u64) {
        let total = self.total.max(1) as f64;
        let cost = |(tile, &n): (usize, &u64)| n as f64 * self.costs.per_sample(tile).unwrap_or(0.0);
        let slowest = self.increments.iter().enumerate().map(cost).fold(0.0, f64::max);
        let a_sample_per_pixel = 256.0 * self.increments.len() as f64 / total;
        let most = self.levels[1] + (TILE_SECONDS / slowest).max(a_sample_per_pixel);
        // At the target it is one, exactly.
        let level = (samples.max(self.issued() + 1) - self.before) as f64 / total;
        self.levels = [self.levels[1], level.min(most)];
        self.begun += 1;
        (self.next, self.part) = (0, 0);
    }

    /// Replaces `units` by the next ones: as many as a thread computes together. False at the end of a level.
    pub fn take(&mut self, units: &mut Vec<WorkUnit>) -> bool {
        units.clear();
        let (mut samples, mut seconds) = (0.0, 0.0);
        while let Some(tile) = self.order.get(self.next).map(|&tile| tile as usize) {
            let increment = self.increments.get(tile).map_or(0.0, |&n| n as f64);
            let of_tile = (self.levels[1] - self.levels[0]) * increment;
            let cost = self.costs.per_sample(tile);
            if self.part == 0 {
                let parts = of_tile * cost.unwrap_or(0.0) / UNIT_SECONDS;
                self.parts = parts.min(of_tile).ceil().max(1.0) as u32;
            }
            let WorkQueue { levels, part, parts, .. } = *self;
            if increment > 0.0 {
                units.push(WorkUnit { tile, levels, number: self.begun - 1, part, parts });
            }
            self.part += 1;
            if self.part == self.parts {
                (self.next, self.part) = (self.next + 1, 0);
            }
            samples += of_tile / f64::from(parts);
            seconds += of_tile / f64::from(parts) * cost.unwrap_or(f64::INFINITY);
            if !units.is_empty() && (samples >= UNIT_SAMPLES || seconds >= 0.5 * UNIT_SECONDS) {
                break;
            }
        }
        !units.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_grow_with_the_level_and_meet_the_target() {
        for (pixel, samples) in
            [[0, 0], [0, 1], [0, 3], [4, 4], [16, 17], [30, 200], [35, 90], [7, 1001], [0, MAX_SPP]].iter().enumerate()
        {
            let threshold = threshold(pixel as u32, 3);
            let mut before = samples[0];
            for step in 0..=300 {
                let level = f64::from(step) / 100.0;
                let n = samples_at(level, *samples, threshold);
                let wanted = f64::from(samples[0]) + level * f64::from(samples[1] - samples[0]);
                let quantum = if wanted >= COARSE_FROM { 4.0 } else { 1.0 };
                assert!(
                    n >= before && (f64::from(n) - wanted).abs() <= quantum || n == MAX_SPP,
                    "{samples:?}, {level}: {n}"
                );
                assert!((step != 100 || n == samples[1]) && (step != 0 || n == samples[0]));
                assert!(level > 1.0 || n <= samples[1]);
                before = n;
            }
        }
    }

    /// At each level a tile of equal pixels has the same number of samples as the others, and so have its quarters.
    #[test]
    fn fractions_of_a_sample_are_spread_evenly() {
        for level in [1.0 / 16.0, 0.25, 0.5, 3.75] {
            for place in 0..25 {
                let (x0, y0) = (8 * (place % 5), 8 * (place / 5));
                let at = |i: u32| samples_at(level, [0, 1], threshold(x0 + i % 8, y0 + i / 8));
                assert_eq!((0..64).map(at).sum::<u32>(), (64.0 * level) as u32, "level {level}, square {place}");
            }
        }
        let first: Vec<u32> = (0..16).map(|i| (512.0 * threshold(16 * i, 0)) as u32).collect();
        assert!(first.iter().any(|n| *n != first[0]), "each tile has its own order");
    }

    #[test]
    fn parts_and_levels_share_the_samples_of_a_pixel_without_gap_or_overlap() {
        for samples in [[0, 0], [16, 17], [5, 52], [100, 1_000_103]] {
            for place in [[0, 0], [17, 3], [31, 31]] {
                let mut next = samples[0];
                for (number, levels) in [[0.0, 0.3], [0.3, 0.9], [0.9, 1.0]].into_iter().enumerate() {
                    let parts = [1, 2, 7][number];
                    for part in 0..parts {
                        let range = WorkUnit { tile: 0, levels, number, part, parts }.range(place, samples);
                        assert_eq!(range.start, next);
                        next = range.end;
                    }
                }
                assert_eq!(next, samples[1]);
            }
        }
        // Single samples are shared by the parts.
        let unit = |part| WorkUnit { tile: 0, levels: [0.0, 1.0], number: 0, part, parts: 4 };
        let samples = |part| (0..256).map(|i| unit(part).range([i % 16, i / 16], [0, 1]).len()).sum::<usize>();
        assert_eq!([0, 1, 2, 3].map(samples), [64; 4]);
    }

    /// A level that is limited by the time of its tiles is not the target, however near.
    #[test]
    fn a_round_ends_at_its_target() {
        let mut queue = WorkQueue::new(TileGrid::new(16, 16, 16));
        queue.begin([&Plane::new(16, 16, 0), &Plane::new(16, 16, 100)], 0);
        queue.record(0, 25_600, 25_600.0 * 0.5 / 25_599.9);
        queue.raise(25_600);
        assert_eq!(queue.issued(), 25_599);
        queue.raise(25_600);
        assert!(queue.issued() == 25_600 && queue.levels[1] == 1.0);
    }

    #[test]
    fn a_level_has_each_tile_once_and_expensive_tiles_in_parts() {
        let grid = TileGrid::new(64, 64, 16);
        let mut queue = WorkQueue::new(grid);
        let target = Plane::from_fn(64, 64, |x, y| 3 + u32::from((x / 16, y / 16) != (1, 1)));
        queue.begin([&Plane::new(64, 64, 3), &target], 100);
        let mut taken = Vec::new();
        assert!(!queue.take(&mut taken) && taken.is_empty());
        assert_eq!((queue.issued(), queue.affordable(1.0)), (100, None));
        queue.raise(100 + 15 * 64);
        let mut all = |queue: &mut WorkQueue| {
            let mut units = Vec::new();
            while queue.take(&mut taken) {
                units.append(&mut taken);
            }
            units
        };
        let units = all(&mut queue);
        let tiles: Vec<usize> = units.iter().map(|unit| unit.tile).collect();
        assert_eq!(tiles, (0..16).filter(|tile| *tile != 5).collect::<Vec<_>>());
        assert!(units.iter().all(|unit| unit.levels == [0.0, 0.25] && unit.number == 0 && unit.parts == 1));
        for unit in units {
            // A sample takes a millisecond, in one tile two.
            queue.record(unit.tile, 64_000, if unit.tile == 9 { 128.0 } else { 64.0 });
        }
        let affordable = queue.affordable(1.6).expect("measured");
        assert!((affordable - 1500.0).abs() < 2.0, "{affordable}");
        // The slow tile may take half a second: 250 samples of it are almost a level.
        queue.raise(100 + 15 * 256);
        assert_eq!(queue.issued(), 100 + 15 * 256);
        let units = all(&mut queue);
        let parts = |tile| units.iter().filter(|unit| unit.tile == tile).map(|unit| unit.parts).collect::<Vec<_>>();
        assert_eq!((parts(9), parts(2)), (vec![20; 20], vec![10; 10]));
        assert!(units.iter().all(|unit| unit.levels[1] == 1.0 && unit.number == 1));
        queue.raise(1_000_000);
        let levels = all(&mut queue)[0].levels;
        assert!(levels[0] == 1.0 && (levels[1] - 2.0666).abs() < 0.01, "a sample per pixel at least: {levels:?}");
    }
}
