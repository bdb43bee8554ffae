//! Relative costs of a sample per tile, estimated from measured times, and the division of a round into units of even
//! cost.
//!
//! Costs are *relative*: one is the mean cost of a sample over the image. [`crate::budget`] estimates the seconds of
//! one unit. With the two apart, a machine that slows down changes the pace but not the map.

use std::ops::Range;

use dunkelfeld_film::Plane;

/// An image divided into square tiles, row by row from the top left. Those at the right and bottom may be smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    width: u32,
    height: u32,
    tile: u32,
}

/// A rectangle of pixels: `x0 <= x < x1`, `y0 <= y < y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileRect {
    /// Left edge, inclusive.
    pub x0: u32,
    /// Top edge, inclusive.
    pub y0: u32,
    /// Right edge, exclusive.
    pub x1: u32,
    /// Bottom edge, exclusive.
    pub y1: u32,
}

impl TileRect {
    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.x1 - self.x0) * u64::from(self.y1 - self.y0)
    }
}

impl TileGrid {
    /// Tiles with `tile` pixels (at least one) on each side.
    pub fn new(width: u32, height: u32, tile: u32) -> Self {
        Self { width, height, tile: tile.max(1) }
    }

    fn columns(&self) -> usize {
        self.width.div_ceil(self.tile) as usize
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.columns() * self.height.div_ceil(self.tile) as usize
    }

    /// Returns whether the image has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pixels of tile number `index`.
    ///
    /// # Panics
    /// If there is no such tile.
    pub fn rect(&self, index: usize) -> TileRect {
        assert!(index < self.len(), "tile {index} of {}", self.len());
        let (column, row) = ((index % self.columns()) as u32, (index / self.columns()) as u32);
        let (x0, y0) = (column * self.tile, row * self.tile);
        let end = |start: u32, limit: u32| start.saturating_add(self.tile).min(limit);
        TileRect { x0, y0, x1: end(x0, self.width), y1: end(y0, self.height) }
    }
}

/// Relative cost of a sample in each tile.
#[derive(Clone, Debug, PartialEq)]
pub struct CostMap {
    grid: TileGrid,
    /// Observations per tile, with older rounds discounted.
    observed: Vec<Observed>,
    /// Per tile: samples of its busiest pixel in the round that was divided last.
    busiest: Vec<u32>,
}

/// Observations of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Observed {
    cost: f64,
    samples: f64,
    /// Samples of the busiest pixels of the rounds.
    busiest: f64,
}

/// Each tile has this many imaginary samples at mean cost beside the real ones. So a tile with few observations counts
/// as an average one.
const PRIOR_SAMPLES: f64 = 16.0;

/// At least this many old samples count in full beside new ones.
const MIN_KEPT: f64 = 64.0;

impl CostMap {
    /// A map without observations: every tile has cost one.
    pub fn new(grid: TileGrid) -> Self {
        Self { observed: vec![Observed::default(); grid.len()], busiest: vec![0; grid.len()], grid }
    }

    /// The tiles.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }

    /// Relative cost of one sample in tile number `index`. One for a tile that does not exist.
    pub fn per_sample(&self, index: usize) -> f64 {
        let o = self.observed.get(index).copied().unwrap_or_default();
        (PRIOR_SAMPLES + o.cost) / (PRIOR_SAMPLES + o.samples)
    }

    /// The factor by which the samples of a tile may cost more than before because its busiest pixel gets more of them.
    /// In the worst case the whole observed cost came from that pixel.
    fn concentrated(&self, tile: usize, samples: u64, most: u32) -> f64 {
        let o = self.observed[tile];
        let before = (o.busiest + 1.0) / (o.samples + self.grid.rect(tile).pixels() as f64);
        // A difference of one sample is not significant.
        let now = f64::from(most.saturating_sub(1)) / samples as f64;
        (now / before).max(1.0)
    }

    /// Updates the map from a round: index, samples and thread seconds of each tile that took part.
    ///
    /// Only the ratios between tiles of the same round are used. Entries that are not positive and finite are ignored.
    pub fn record(&mut self, round: &[(usize, u64, f64)]) {
        let usable = |&&(tile, samples, seconds): &&(usize, u64, f64)| {
            tile < self.observed.len() && samples > 0 && seconds > 0.0 && seconds.is_finite()
        };
        let used: Vec<_> = round.iter().filter(usable).copied().collect();
        let expected: f64 = used.iter().map(|&(tile, n, _)| self.per_sample(tile) * n as f64).sum();
        let seconds: f64 = used.iter().map(|&(_, _, s)| s).sum();
        let scale = expected / seconds;
        for (tile, samples, seconds) in used {
            let (busiest, o) = (f64::from(self.busiest[tile]), &mut self.observed[tile]);
            // Old samples count at most a quarter of the new ones. The samples of a tile move from pixel to pixel, and
            // their next cost resembles their last cost. A few new samples do not replace all old ones.
            let keep = ((0.25 * samples as f64).max(MIN_KEPT) / o.samples.max(1.0)).min(1.0);
            o.cost = o.cost * keep + seconds * scale;
            o.samples = o.samples * keep + samples as f64;
            o.busiest = o.busiest * keep + busiest.min(samples as f64);
        }
    }

    /// Divides the new samples of a round (see [`crate::plan::increment`]) into units of work for `threads` threads.
    /// The most expensive come first, so that each free thread takes the next (longest processing time first, Graham
    /// 1969).
    ///
    /// A tile that would delay the end is divided into parts, each with a share of the samples of *every* pixel in it.
    /// So a pixel with very many samples is spread over several threads too. Tiles without new samples give no unit. If
    /// the busiest pixel of a tile gets a larger share of its samples than before, the tile counts as more expensive by
    /// that factor until it has been measured.
    ///
    /// # Panics
    /// If the plane's size is not that of the grid.
    pub fn cut(&mut self, increment: &Plane<u32>, threads: usize) -> Vec<WorkUnit> {
        let size = (increment.width(), increment.height());
        assert_eq!(size, (self.grid.width, self.grid.height), "increment and tiles differ in size");
        let tiles: Vec<(usize, u64, u32, f64, f64)> = (0..self.grid.len())
            .map(|tile| {
                let (samples, most) = count(increment, self.grid.rect(tile));
                self.busiest[tile] = most;
                let factor = if samples > 0 { self.concentrated(tile, samples, most) } else { 1.0 };
                (tile, samples, most, self.per_sample(tile) * samples as f64, factor)
            })
            .filter(|&(_, samples, ..)| samples > 0)
            .collect();
        let whole: f64 = tiles.iter().map(|t| t.3 * t.4).sum();
        let largest = whole / (threads.max(1) * UNITS_PER_THREAD) as f64;
        let mut units = Vec::with_capacity(tiles.len());
        for (tile, samples, most, cost, factor) in tiles {
            // No more parts than samples of the busiest pixel: further parts would be empty.
            let parts = ((factor * cost / largest).ceil() as u32).clamp(1, most);
            let cost = cost / f64::from(parts);
            let unit = |part| WorkUnit { tile, part, parts, samples, cost, upper_cost: factor * cost };
            units.extend((0..parts).map(unit));
        }
        // A stable sort: equal costs keep the order of the tiles.
        units.sort_by(|a, b| b.upper_cost.total_cmp(&a.upper_cost));
        units
    }
}

/// Least number of units per thread in a round, if it can be divided. The last thread then finishes late by a few per
/// cent at most.
const UNITS_PER_THREAD: usize = 24;

/// New samples in a rectangle: their sum, and the largest number of a pixel.
fn count(increment: &Plane<u32>, rect: TileRect) -> (u64, u32) {
    let width = increment.width() as usize;
    let rows = (rect.y0..rect.y1).map(|y| {
        let row = y as usize * width;
        &increment.data()[row + rect.x0 as usize..row + rect.x1 as usize]
    });
    rows.flatten().fold((0, 0), |(sum, most), &n| (sum + u64::from(n), most.max(n)))
}

/// A unit of work of a round, which one thread does without interruption.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkUnit {
    /// The tile's number in its grid.
    pub tile: usize,
    /// The number of this part of the tile's samples.
    pub part: u32,
    /// The number of parts of the tile.
    pub parts: u32,
    /// New samples of the whole tile, all parts together.
    pub samples: u64,
    /// Expected cost of this part, in samples of mean cost.
    pub cost: f64,
    /// Cost of this part in the worst case, in which the busiest pixel causes the whole cost of its tile. Never less
    /// than [`Self::cost`].
    pub upper_cost: f64,
}

impl WorkUnit {
    /// This part's sample indices of a pixel whose new samples begin at `first` and are `count`. Over all parts these
    /// ranges are disjoint and cover the new samples.
    pub fn range(&self, first: u32, count: u32) -> Range<u32> {
        let cut = |part: u32| first + (u64::from(count) * u64::from(part) / u64::from(self.parts)) as u32;
        cut(self.part)..cut(self.part + 1)
    }
}

/// The time until all units are done if each free thread takes the next, in samples of mean cost.
pub fn makespan(units: &[WorkUnit], threads: usize) -> f64 {
    span(units, threads, |unit| unit.cost)
}

/// The same with the worst-case cost of the units.
pub fn upper_makespan(units: &[WorkUnit], threads: usize) -> f64 {
    span(units, threads, |unit| unit.upper_cost)
}

fn span(units: &[WorkUnit], threads: usize, cost: impl Fn(&WorkUnit) -> f64) -> f64 {
    let mut busy = vec![0.0f64; threads.max(1)];
    for unit in units {
        if let Some(first_free) = busy.iter_mut().min_by(|a, b| a.total_cmp(b)) {
            *first_free += cost(unit);
        }
    }
    busy.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_pixel_once() {
        for (w, h, t) in [(64, 64, 16), (65, 33, 16), (1, 1, 16), (16_384, 1, 32), (5, 7, 1), (3, 3, 0), (0, 5, 8)] {
            let grid = TileGrid::new(w, h, t);
            let mut seen = Plane::new(w, h, 0u8);
            for i in 0..grid.len() {
                let r = grid.rect(i);
                assert!(r.pixels() > 0);
                for y in r.y0..r.y1 {
                    for x in r.x0..r.x1 {
                        seen.data_mut()[(y * w + x) as usize] += 1;
                    }
                }
            }
            assert!(seen.data().iter().all(|&n| n == 1), "{w} x {h} in tiles of {t}");
            assert_eq!(grid.is_empty(), w == 0);
        }
    }

    #[test]
    fn relative_costs_are_estimated_at_any_speed() {
        // Tile 1 costs four times tile 0. The machine halves its speed between rounds. The ratio must not change.
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        for pace in [1e-6, 1e-6, 2e-6, 8e-6] {
            map.record(&[(0, 100_000, 100_000.0 * pace), (1, 100_000, 400_000.0 * pace)]);
        }
        let ratio = map.per_sample(1) / map.per_sample(0);
        assert!((ratio - 4.0).abs() < 0.01, "ratio {ratio}");
        assert!((map.per_sample(0) + map.per_sample(1) - 2.0).abs() < 0.01, "the mean stays one");
    }

    #[test]
    fn the_cost_of_a_tile_follows_its_expensive_pixels() {
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        map.record(&[(0, 100_000, 0.1), (1, 100_000, 0.1)]);
        for _ in 0..5 {
            map.record(&[(0, 2000, 2e-3), (1, 1000, 1.0)]);
        }
        let ratio = map.per_sample(1) / map.per_sample(0);
        assert!((300.0..=1100.0).contains(&ratio), "a thousand times dearer of late, known as {ratio}");
    }

    #[test]
    fn a_pixel_of_growing_share_is_assumed_expensive_until_measured() {
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        let even = Plane::new(32, 16, 40);
        let cost_of = |units: &[WorkUnit]| upper_makespan(units, 1);
        assert!((cost_of(&map.cut(&even, 1)) / 20_480.0 - 1.0).abs() < 1e-9, "nothing is said of an even round");
        map.record(&[(0, 10_240, 1.0), (1, 10_240, 1.0)]);
        let one = Plane::from_fn(32, 16, |x, y| if (x, y) == (20, 3) { 1000 } else { 0 });
        // The pixel had a 256th of the samples.
        let upper_cost = cost_of(&map.cut(&one, 1));
        assert!((upper_cost / 256_000.0 - 1.0).abs() < 0.05, "{upper_cost}");
        for _ in 0..3 {
            map.cut(&one, 1);
            map.record(&[(0, 1000, 0.1), (1, 1000, 0.1)]);
        }
        let known = cost_of(&map.cut(&one, 1));
        assert!((known / 1000.0 - 1.0).abs() < 0.3, "{known}");
        let single = Plane::from_fn(32, 16, |x, y| u32::from((x, y) == (4, 4)));
        assert!(cost_of(&map.cut(&single, 1)) < 2.0, "a single sample is no concentration");
    }

    #[test]
    fn few_samples_count_little_and_bad_clocks_nothing() {
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        map.record(&[(0, 1000, 1e-3), (1, 1, 1e-4)]);
        assert!(map.per_sample(1) < 10.0, "one dear sample among sixteen imagined ones");
        let before = map.clone();
        map.record(&[(0, 10, f64::NAN), (1, 10, -1.0), (0, 0, 1.0), (7, 10, 1.0), (1, 3, f64::INFINITY)]);
        map.record(&[]);
        assert_eq!(map, before);
        assert_eq!(map.per_sample(99), 1.0);
    }

    #[test]
    fn parts_share_each_pixels_samples_without_gap_or_overlap() {
        for parts in [1, 2, 3, 7, 48] {
            for (first, count) in [(0, 0), (16, 1), (5, 47), (100, 1_000_003)] {
                let mut next = first;
                for part in 0..parts {
                    let r =
                        WorkUnit { tile: 0, part, parts, samples: 0, cost: 0.0, upper_cost: 0.0 }.range(first, count);
                    assert_eq!(r.start, next);
                    next = r.end;
                }
                assert_eq!(next, first + count);
            }
        }
    }

    #[test]
    fn units_contain_the_whole_round_in_order_of_cost_and_end_together() {
        // One pixel with a hundred times the samples of all others together, in a tile that is expensive as well.
        let grid = TileGrid::new(128, 128, 16);
        let mut map = CostMap::new(grid);
        map.record(&(0..grid.len()).map(|i| (i, 256, if i == 9 { 1e-2 } else { 1e-4 })).collect::<Vec<_>>());
        let increment = Plane::from_fn(128, 128, |x, y| if (x, y) == (20, 20) { 1_638_400 } else { 1 });
        for threads in [1, 2, 7] {
            let units = map.cut(&increment, threads);
            assert!(units.windows(2).all(|w| w[0].upper_cost >= w[1].upper_cost));
            let mut parts_of = vec![0; grid.len()];
            units.iter().for_each(|u| parts_of[u.tile] += 1);
            assert!(units.iter().all(|u| parts_of[u.tile] == u.parts));
            assert!(parts_of.iter().all(|&p| p > 0), "every tile has samples");
            let whole: f64 = units.iter().map(|u| u.upper_cost).sum();
            let ideal = whole / threads as f64;
            let end = upper_makespan(&units, threads);
            assert!(end >= ideal * (1.0 - 1e-12) && end <= 1.05 * ideal, "{threads} threads: {end} against {ideal}");
        }
    }

    #[test]
    fn rounds_smaller_than_the_image_are_cut_too() {
        let mut map = CostMap::new(TileGrid::new(64, 64, 16));
        let sparse = Plane::from_fn(64, 64, |x, y| u32::from((x, y) == (40, 3)));
        let units = map.cut(&sparse, 2);
        assert_eq!(units.len(), 1);
        assert_eq!((units[0].tile, units[0].parts, units[0].samples), (2, 1, 1));
        assert!(map.cut(&Plane::new(64, 64, 0), 2).is_empty());
        assert_eq!(makespan(&[], 2), 0.0);
    }
}
