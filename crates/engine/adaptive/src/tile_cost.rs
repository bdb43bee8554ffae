//! The tiles of an image, and the measured cost of a sample in each of them.

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

/// Each tile has this many imaginary samples at mean cost beside the real ones. So a tile with few observations counts
/// as an average one.
const PRIOR_SAMPLES: f64 = 16.0;

/// At least this many old samples count in full beside new ones.
const MIN_KEPT: f64 = 64.0;

/// Measured cost of a sample in each tile.
#[derive(Clone, Debug, PartialEq)]
pub struct CostMap {
    grid: TileGrid,
    /// Per tile, with older observations discounted.
    tiles: Vec<Observed>,
    /// Their sum.
    all: Observed,
}

/// Seconds of one thread, and the samples that took them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Observed {
    seconds: f64,
    samples: f64,
}

impl CostMap {
    /// A map without observations.
    pub fn new(grid: TileGrid) -> Self {
        Self { tiles: vec![Observed::default(); grid.len()], all: Observed::default(), grid }
    }

    /// The tiles.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }

    /// Mean seconds of one thread for a sample; `None` before the first observation.
    pub fn mean(&self) -> Option<f64> {
        (self.all.samples > 0.0).then(|| self.all.seconds / self.all.samples)
    }

    /// Seconds of one thread for a sample in tile number `tile`; `None` before the first observation of any tile.
    pub fn per_sample(&self, tile: usize) -> Option<f64> {
        let (mean, tile) = (self.mean()?, self.tiles.get(tile).copied().unwrap_or_default());
        Some((PRIOR_SAMPLES * mean + tile.seconds) / (PRIOR_SAMPLES + tile.samples))
    }

    /// Adds an observation: samples of a tile, and the seconds of the thread that computed them. Seconds that are not
    /// positive and finite are ignored.
    pub fn record(&mut self, tile: usize, samples: u64, seconds: f64) {
        let Some(observed) = self.tiles.get_mut(tile).filter(|_| samples > 0 && seconds > 0.0 && seconds.is_finite())
        else {
            return;
        };
        // Old samples count at most as much as the new ones: the samples of a tile move from pixel to pixel, the machine
        // becomes slower, and the next cost resembles the last one.
        let before = *observed;
        let keep = ((samples as f64).max(MIN_KEPT) / before.samples.max(1.0)).min(1.0);
        observed.seconds = before.seconds * keep + seconds;
        observed.samples = before.samples * keep + samples as f64;
        self.all.seconds = (self.all.seconds + observed.seconds - before.seconds).max(0.0);
        self.all.samples += observed.samples - before.samples;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::Plane;

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
    fn costs_are_those_of_the_last_observations() {
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        assert_eq!((map.mean(), map.per_sample(0)), (None, None));
        // Tile 1 costs four times tile 0. The machine becomes eight times slower.
        for pace in [1e-6, 1e-6, 2e-6, 8e-6, 8e-6, 8e-6, 8e-6] {
            map.record(0, 100_000, 100_000.0 * pace);
            map.record(1, 100_000, 400_000.0 * pace);
        }
        let cost = |tile| map.per_sample(tile).expect("observed");
        assert!((cost(1) / cost(0) - 4.0).abs() < 0.01, "{} over {}", cost(1), cost(0));
        assert!((7e-6..8.01e-6).contains(&cost(0)), "{}", cost(0));
        assert!((map.mean().expect("observed") / (0.5 * (cost(0) + cost(1))) - 1.0).abs() < 0.01);
    }

    #[test]
    fn few_samples_count_little_and_bad_clocks_nothing() {
        let mut map = CostMap::new(TileGrid::new(32, 16, 16));
        map.record(0, 1000, 1e-3);
        map.record(1, 1, 1e-4);
        assert!(map.per_sample(1).expect("observed") < 10e-6, "one dear sample among sixteen imagined ones");
        let before = map.clone();
        for (tile, samples, seconds) in
            [(0, 10, f64::NAN), (1, 10, -1.0), (0, 0, 1.0), (7, 10, 1.0), (1, 3, f64::INFINITY)]
        {
            map.record(tile, samples, seconds);
        }
        assert_eq!(map, before);
        assert_eq!(map.per_sample(99), map.mean());
    }
}
