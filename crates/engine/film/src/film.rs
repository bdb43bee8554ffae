//! The film: exact sums for every pixel of an image.

use crate::accumulator::PixelSums;
use crate::gaps::fill_gaps;
use crate::packed::{Pages, SIDE, TILE_SIDE, Tile};
use crate::plane::Plane;
use dunkelfeld_lanes::InstructionSet;
use std::ops::Range;

/// Largest width and height of a film \[pixels\].
pub const MAX_SIDE: u32 = 32_768;

/// Largest number of pixels of a film. A render of a film of that size needs tens of gigabytes.
pub const MAX_PIXELS: u64 = 1 << 27;

/// The layers that the sums of a film contain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum FilmLayers {
    /// Radiance with its variance, numbers of samples, and the mean normal, which the noise analysis needs. Albedo,
    /// depth, hits and the variances of all auxiliary layers are zero.
    Image,
    /// All layers of [`PixelSums`].
    #[default]
    All,
}

/// The numbers of the sums of a pixel that their reader needs. A part of them is read in a part of the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needed {
    /// Number of samples and mean radiance.
    Means,
    /// Those of [`FilmLayers::Image`].
    Image,
    /// All that the film has.
    All,
}

/// The memory does not suffice for the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory;

impl std::fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("there is not enough memory for the film")
    }
}

impl std::error::Error for OutOfMemory {}

/// The reason why two films could not be joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmError {
    /// The films differ in size: width and height of both.
    SizeMismatch([u32; 4]),
    /// The films differ in their layers.
    LayerMismatch,
    /// The sums do not fit into memory.
    OutOfMemory,
}

impl std::fmt::Display for FilmError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::SizeMismatch([w, h, ow, oh]) => {
                write!(f, "the films differ in size: {w} x {h} and {ow} x {oh} pixels")
            }
            Self::LayerMismatch => f.write_str("the films differ in their layers"),
            Self::OutOfMemory => OutOfMemory.fmt(f),
        }
    }
}

impl std::error::Error for FilmError {}

impl From<OutOfMemory> for FilmError {
    fn from(_: OutOfMemory) -> Self {
        Self::OutOfMemory
    }
}

/// Exact sums of the samples of an image. Films of disjoint sample sets merge to the film of their union, to the last
/// bit.
///
/// The sums are stored packed, in rows of tiles of [`Film::TILE`] pixels squared. Memory follows the size of the
/// numbers.
#[derive(Clone)]
pub struct Film {
    width: u32,
    height: u32,
    layers: FilmLayers,
    rows: Vec<TileRow>,
}

/// The sums of [`Film::TILE`] rows of pixels; fewer at the lower edge of a film.
#[derive(Clone)]
pub struct TileRow {
    width: u32,
    height: u32,
    layers: FilmLayers,
    tiles: Vec<Tile>,
    pages: Pages,
}

impl Film {
    /// Pixels along the side of a tile.
    pub const TILE: u32 = TILE_SIDE;

    /// An empty film with all layers.
    pub fn new(width: u32, height: u32) -> Self {
        Self::with_layers(width, height, FilmLayers::All)
    }

    /// An empty film with these layers.
    pub fn with_layers(width: u32, height: u32, layers: FilmLayers) -> Self {
        let row = |top: u32| TileRow {
            width,
            height: (height - top).min(TILE_SIDE),
            layers,
            tiles: vec![Tile::default(); width.div_ceil(TILE_SIDE) as usize],
            pages: Pages::default(),
        };
        let rows = if width == 0 { Vec::new() } else { (0..height).step_by(TILE_SIDE as usize).map(row).collect() };
        Self { width, height, layers, rows }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The layers that the sums contain.
    pub fn layers(&self) -> FilmLayers {
        self.layers
    }

    /// Bytes of memory that the film occupies now.
    pub fn bytes(&self) -> u64 {
        size_of::<Self>() as u64 + self.rows.iter().map(|row| row.bytes() as u64).sum::<u64>()
    }

    /// The rows of tiles, from the top.
    pub fn tile_rows(&self) -> &[TileRow] {
        &self.rows
    }

    /// A copy of some rows of tiles, as a film of its own.
    ///
    /// # Panics
    /// If the range is outside the film.
    pub fn copy_of_tile_rows(&self, rows: Range<usize>) -> Self {
        let rows = self.rows[rows].to_vec();
        Self { height: rows.iter().map(|row| row.height).sum(), rows, ..*self }
    }

    /// The rows of tiles, from the top, for additions. Each may be given to its own thread.
    pub fn tile_rows_mut(&mut self) -> &mut [TileRow] {
        &mut self.rows
    }

    /// The sums of the pixel at (x, y).
    ///
    /// # Panics
    /// If the pixel is outside the film.
    pub fn pixel(&self, x: u32, y: u32) -> PixelSums {
        assert!(x < self.width && y < self.height, "({x}, {y}) is outside {} x {}", self.width, self.height);
        let row = &self.rows[(y / TILE_SIDE) as usize];
        row.tiles[(x / TILE_SIDE) as usize].pixel(&row.pages, self.layers, slot(x % TILE_SIDE, y % TILE_SIDE))
    }

    /// The sums of all pixels, unpacked: for small films.
    pub fn sums(&self) -> Plane<PixelSums> {
        self.map(|sums| *sums)
    }

    /// Appends the sums of some rows of pixels.
    ///
    /// # Panics
    /// If a row is outside the film.
    pub fn read_rows(&self, rows: Range<u32>, out: &mut Vec<PixelSums>) {
        let mut y = rows.start;
        while y < rows.end {
            let top = y / TILE_SIDE * TILE_SIDE;
            let end = rows.end.min(top + TILE_SIDE);
            match self.rows.get((top / TILE_SIDE) as usize) {
                Some(row) => row.read_rows(y - top..end - top, out),
                None => assert_eq!(self.width, 0, "row {y} is outside the film"),
            }
            y = end;
        }
    }

    /// Adds sums to those of whole rows of pixels, from row `first` on.
    ///
    /// # Errors
    /// There is not enough memory. Some of the sums may have been added.
    ///
    /// # Panics
    /// If a row is outside the film, or if a row is incomplete.
    pub fn add_rows(&mut self, first: u32, sums: &[PixelSums]) -> Result<(), OutOfMemory> {
        let width = self.width as usize;
        assert!(width == 0 || sums.len().is_multiple_of(width), "{} sums are no whole rows", sums.len());
        // A tile is unpacked once for all of its rows.
        let (mut y, mut sums) = (first, sums);
        while width > 0 && !sums.is_empty() {
            let rows = (TILE_SIDE - y % TILE_SIDE).min((sums.len() / width) as u32);
            let (of_band, rest) = sums.split_at(rows as usize * width);
            let band = &mut self.rows[(y / TILE_SIDE) as usize];
            for (tile, left) in (0..width).step_by(TILE_SIDE as usize).enumerate() {
                let lines = (y % TILE_SIDE..).zip(of_band.chunks(width));
                let of_tile = lines.flat_map(|(y, line)| {
                    (0..).zip(&line[left..width.min(left + TILE_SIDE as usize)]).map(move |(x, sums)| ((x, y), sums))
                });
                band.add(tile, of_tile)?;
            }
            (y, sums) = (y + rows, rest);
        }
        Ok(())
    }

    /// Adds all samples of `other`. The caller must ensure that the sample sets are disjoint.
    ///
    /// # Errors
    /// The films differ in size or layers, or there is not enough memory.
    pub fn merge(&mut self, other: &Self) -> Result<(), FilmError> {
        if (self.width, self.height) != (other.width, other.height) {
            return Err(FilmError::SizeMismatch([self.width, self.height, other.width, other.height]));
        }
        if self.layers != other.layers {
            return Err(FilmError::LayerMismatch);
        }
        for (to, from) in self.rows.iter_mut().zip(&other.rows) {
            for (tile, packed) in from.tiles.iter().enumerate().filter(|(_, packed)| !packed.is_empty()) {
                let sums = packed.unpacked(&from.pages, from.layers.columns());
                to.tiles[tile].add(&mut to.pages, to.layers, sums.iter().enumerate())?;
            }
        }
        Ok(())
    }

    /// A plane with a value for the sums of each pixel.
    pub fn map<T>(&self, mut f: impl FnMut(&PixelSums) -> T) -> Plane<T> {
        let mut values = Vec::with_capacity(self.pixels());
        let mut sums = Vec::new();
        for row in &self.rows {
            sums.clear();
            row.read_rows(0..row.height, &mut sums);
            values.extend(sums.iter().map(&mut f));
        }
        Plane::of_pixels(self.width, self.height, values)
    }

    /// Mean radiance per pixel and channel [W/(m^2 sr)].
    pub fn mean(&self) -> Plane<[f32; 3]> {
        self.map(|p| p.mean().map(|v| v as f32))
    }

    /// [`Self::mean`] for display: pixels without samples have the mean of their neighbours ([`fill_gaps`]).
    pub fn mean_without_gaps(&self) -> Plane<[f32; 3]> {
        let known = self.map(|p| p.count() > 0);
        if known.data().contains(&false) { fill_gaps(&self.mean(), &known) } else { self.mean() }
    }

    /// Have samples of the film places, so that it has first moments ([`PixelSums::moments`])?
    pub fn has_moments(&self) -> bool {
        self.rows.iter().any(|row| row.tiles.iter().any(Tile::has_moments))
    }

    /// Variance of the mean per pixel and channel [(W/(m^2 sr))^2]. Infinite with samples in fewer than two batches.
    pub fn variance(&self) -> Plane<[f32; 3]> {
        self.map(|p| p.variance_of_mean().map(|v| v as f32))
    }

    /// Covariance of the mean of red and green, red and blue, green and blue per pixel [(W/(m^2 sr))^2]. Infinite with
    /// samples in fewer than two batches.
    pub fn covariance(&self) -> Plane<[f32; 3]> {
        self.map(|p| p.covariance_of_mean().map(|v| v as f32))
    }

    /// Number of samples per pixel.
    pub fn sample_counts(&self) -> Plane<u32> {
        let mut counts = Plane::new(self.width, self.height, 0);
        let (width, side) = (self.width as usize, TILE_SIDE as usize);
        for (row, counts) in self.rows.iter().zip(counts.data_mut().chunks_mut((width * side).max(1))) {
            for (tile, packed) in row.tiles.iter().enumerate().filter(|(_, packed)| !packed.is_empty()) {
                let of_tile = packed.counts(&row.pages);
                for (to, from) in counts.chunks_mut(width).zip(of_tile.chunks(side)) {
                    to.iter_mut().skip(tile * side).zip(from).for_each(|(to, from)| *to = *from);
                }
            }
        }
        counts
    }

    /// Has each pixel samples?
    pub fn has_all_pixels(&self) -> bool {
        !self.sample_counts().data().contains(&0)
    }

    /// Number of samples of the whole film.
    pub fn total_samples(&self) -> u64 {
        self.sample_counts().data().iter().map(|&n| u64::from(n)).sum()
    }

    /// Number of samples that were not finite, negative or out of range.
    pub fn invalid_samples(&self) -> u64 {
        self.map(|p| u64::from(p.invalid)).data().iter().sum()
    }
}

impl TileRow {
    /// Number of rows of pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Adds sums to those of some pixels of a tile, each with its column and row in the tile.
    ///
    /// # Errors
    /// There is not enough memory. Some of the sums may have been added.
    ///
    /// # Panics
    /// If the tile does not exist, or a pixel is outside of it.
    pub fn add<'a>(
        &mut self,
        tile: usize,
        sums: impl Iterator<Item = ((u32, u32), &'a PixelSums)>,
    ) -> Result<(), OutOfMemory> {
        let (width, height) = (self.width - TILE_SIDE * tile as u32, self.height);
        let sums = sums.map(|((x, y), sums)| {
            assert!(x < width.min(TILE_SIDE) && y < height, "({x}, {y}) is outside the tile");
            (slot(x, y), sums)
        });
        self.tiles[tile].add(&mut self.pages, self.layers, sums)
    }

    /// Adds the sums of the samples of `whole` with factors on the light of some groups: an image with other lights. The groups
    /// are given by their own rows, which have the same samples. Mean and variance are those of a render with these factors.
    ///
    /// # Errors
    /// There is not enough memory.
    ///
    /// # Panics
    /// If the rows differ in size.
    pub fn add_weighted(&mut self, whole: &Self, groups: &[(&Self, f64)]) -> Result<(), OutOfMemory> {
        let columns = self.layers.columns();
        for (number, tile) in self.tiles.iter_mut().enumerate().filter(|(i, _)| !whole.tiles[*i].is_empty()) {
            let unpacked = |row: &Self| row.tiles[number].unpacked(&row.pages, columns.min(row.layers.columns()));
            let of_groups: Vec<_> = groups.iter().map(|(row, factor)| (unpacked(row), *factor)).collect();
            let weighted: Vec<PixelSums> = (unpacked(whole).iter().enumerate())
                .map(|(slot, sums)| sums.weighted(of_groups.iter().map(|(of, factor)| (&of[slot], *factor))))
                .collect();
            tile.add(&mut self.pages, self.layers, weighted.iter().enumerate())?;
        }
        Ok(())
    }

    /// Calls `f` with column, row (counted from its first) and sums of each pixel, tile by tile. Numbers that are not needed may
    /// be zero.
    pub fn visit(&self, needed: Needed, mut f: impl FnMut(u32, u32, &PixelSums)) {
        let numbers = needed.columns().min(self.layers.columns());
        let (set, mut sums) = (InstructionSet::best(), [PixelSums::default(); SIDE]);
        for (left, packed) in (0..self.width).step_by(SIDE).zip(&self.tiles) {
            let columns = left..self.width.min(left + TILE_SIDE);
            for y in 0..self.height {
                packed.unpack_row(set, &self.pages, numbers, y as usize, &mut sums);
                columns.clone().zip(&sums).for_each(|(x, sums)| f(x, y, sums));
            }
        }
    }

    /// Appends the sums of some of its rows of pixels, counted from its first.
    ///
    /// # Panics
    /// If a row is outside of it.
    pub fn read_rows(&self, rows: Range<u32>, out: &mut Vec<PixelSums>) {
        assert!(rows.end <= self.height, "row {} is outside a row of {} pixels", rows.end, self.height);
        let (start, width) = (out.len(), self.width as usize);
        out.resize(start + rows.len() * width, PixelSums::default());
        let (set, mut sums) = (InstructionSet::best(), [PixelSums::default(); SIDE]);
        for (left, packed) in (0..width).step_by(SIDE).zip(&self.tiles) {
            let columns = SIDE.min(width - left);
            for (y, to) in rows.clone().zip(out[start..].chunks_exact_mut(width)) {
                packed.unpack_row(set, &self.pages, self.layers.columns(), y as usize, &mut sums);
                to[left..left + columns].copy_from_slice(&sums[..columns]);
            }
        }
    }

    fn bytes(&self) -> usize {
        size_of::<Self>() + self.pages.bytes() + self.tiles.iter().map(Tile::bytes).sum::<usize>()
    }
}

/// Two films are equal if their sums are equal. Their storage may differ.
impl PartialEq for Film {
    fn eq(&self, other: &Self) -> bool {
        let rows = |film: &Self, y| {
            let mut sums = Vec::new();
            film.read_rows(y..y + 1, &mut sums);
            sums
        };
        (self.width, self.height, self.layers) == (other.width, other.height, other.layers)
            && (0..self.height).all(|y| rows(self, y) == rows(other, y))
    }
}

impl std::fmt::Debug for Film {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Film({} x {}, {:?}, {} bytes)", self.width, self.height, self.layers, self.bytes())
    }
}

/// Number of a pixel in its tile.
#[inline]
fn slot(x: u32, y: u32) -> usize {
    (y * TILE_SIDE + x) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulator::{Accumulate, Sample};
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn long_and_tiny_films_work() {
        for (w, h) in [(1, 1), (16_384, 1), (1, 16_384), (17, 33)] {
            let mut film = Film::new(w, h);
            let last = (w * h - 1) as usize;
            let mut sums = vec![PixelSums::default(); last + 1];
            sums[last].add(0, &Sample { radiance: Rgb::WHITE, ..Sample::MISS });
            film.add_rows(0, &sums).expect("memory");
            assert_eq!(film.mean().data()[last], [1.0; 3]);
            assert_eq!(film.total_samples(), 1);
            assert_eq!(film.pixel(w - 1, h - 1).count(), 1);
        }
        for (w, h) in [(0, 0), (0, 5), (5, 0)] {
            let film = Film::new(w, h);
            assert!(film.mean().data().is_empty());
            film.read_rows(0..h, &mut Vec::new());
        }
    }

    /// Films whose size is no multiple of a tile: added rows are read back unchanged, and merged films contain all
    /// samples.
    #[test]
    fn rows_and_merged_films_hold_the_sums_of_their_pixels() {
        let (width, height) = (37, 21);
        let sums = |pixel: u32, indices: Range<u32>| {
            let mut sums = PixelSums::default();
            for index in indices {
                let radiance = Rgb::new(pixel as f32, index as f32, 0.1);
                sums.add(
                    index,
                    &Sample { radiance, albedo: Rgb::splat(0.25), hit: !pixel.is_multiple_of(3), ..Sample::MISS },
                );
            }
            sums
        };
        let film = |indices: Range<u32>| {
            let mut film = Film::new(width, height);
            let all: Vec<_> =
                (0..width * height).map(|pixel| sums(pixel, indices.start..indices.end + pixel % 2)).collect();
            film.add_rows(0, &all[..(5 * width) as usize]).expect("memory");
            film.add_rows(5, &all[(5 * width) as usize..]).expect("memory");
            (film, all)
        };
        let ((mut a, of_a), (b, of_b)) = (film(0..3), film(4..9));
        let mut read = Vec::new();
        a.read_rows(7..19, &mut read);
        assert_eq!(read, of_a[(7 * width) as usize..(19 * width) as usize]);
        assert_eq!(a.pixel(36, 20), of_a[36 + 20 * 37]);
        let mut visited = vec![None; (width * height) as usize];
        for (row, top) in a.tile_rows().iter().zip((0..).step_by(TILE_SIDE as usize)) {
            row.visit(Needed::All, |x, y, sums| {
                let before = visited[((top + y) * width + x) as usize].replace(*sums);
                assert_eq!(before, None, "once");
            });
        }
        assert!(visited.iter().zip(&of_a).all(|(visited, sums)| *visited == Some(*sums)));
        assert_eq!(a.sample_counts(), a.map(PixelSums::count));
        a.merge(&b).expect("alike");
        let mut both = of_a;
        both.iter_mut().zip(&of_b).for_each(|(a, b)| a.merge(b));
        let mut read = Vec::new();
        a.read_rows(0..height, &mut read);
        assert_eq!(read, both);
        let mut whole = Film::new(width, height);
        whole.add_rows(0, &both).expect("memory");
        assert_eq!(whole, a);
        assert_ne!(whole, b);
    }
}
