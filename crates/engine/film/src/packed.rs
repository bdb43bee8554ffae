//! Storage of tiles of sums in as few bytes as their values need.
//!
//! A tile has 16 x 16 pixels and one column for each number of a pixel ([`crate::columns`]). A column is stored as the
//! difference from a base value (frame of reference), in as many bytes as the largest difference of the tile needs. In
//! tiles where that needs fewer bytes, the colour channels are stored as differences from red: those of gray surfaces
//! under white light. The bytes of one significance of all pixels form a page. A column that is the same in all pixels
//! needs no page. A column that outgrows its bytes gets another page, and its other pages stay at their place. Nothing
//! is rounded, no sum has a limit, and memory follows the size of the numbers. An unpacked sum of radiance has 16
//! bytes, and usually needs six or seven.

use crate::accumulator::PixelSums;
use crate::columns::{COLUMNS, COUNT, MOMENTS, get, of_columns, reference, set};
use crate::film::{FilmLayers, OutOfMemory};
use dunkelfeld_lanes::{InstructionSet, dispatch};

/// Pixels along the side of a tile.
pub(crate) const TILE_SIDE: u32 = 16;
pub(crate) const SIDE: usize = TILE_SIDE as usize;
const PIXELS: usize = SIDE * SIDE;
/// Bytes of one significance of all pixels of a tile.
type Page = [u8; PIXELS];
/// Pages per allocation.
const CHUNK: usize = 64;
/// Updates of fewer pixels of a tile than this are made pixel by pixel.
const FEW_PIXELS: usize = 24;

/// The memory of the pages of some tiles. Pages never move, so that growing tiles leave no holes of odd sizes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pages {
    chunks: Vec<Vec<Page>>,
    used: usize,
    free: Vec<u32>,
}

impl Pages {
    fn take(&mut self) -> Result<u32, OutOfMemory> {
        if let Some(page) = self.free.pop() {
            return Ok(page);
        }
        if self.used == CHUNK * self.chunks.len() {
            let mut chunk = Vec::new();
            chunk.try_reserve_exact(CHUNK).map_err(|_| OutOfMemory)?;
            chunk.resize(CHUNK, [0; PIXELS]);
            self.chunks.try_reserve(1).map_err(|_| OutOfMemory)?;
            self.chunks.push(chunk);
        }
        let page = u32::try_from(self.used).map_err(|_| OutOfMemory)?;
        self.used += 1;
        Ok(page)
    }

    #[inline]
    fn get(&self, page: u32) -> &Page {
        &self.chunks[page as usize / CHUNK][page as usize % CHUNK]
    }

    #[inline]
    fn get_mut(&mut self, page: u32) -> &mut Page {
        &mut self.chunks[page as usize / CHUNK][page as usize % CHUNK]
    }

    /// Bytes of memory, including those allocated for future pages.
    pub(crate) fn bytes(&self) -> usize {
        self.chunks.len() * CHUNK * PIXELS + 4 * self.free.capacity()
    }
}

/// The sums of a tile's pixels. Its pages belong to one [`Pages`], which all calls must use.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    /// Bytes of each column.
    widths: [u8; COLUMNS],
    /// Columns whose base is not zero, one bit each, and these bases in their order.
    has_base: u64,
    bases: Vec<u128>,
    /// Columns that are differences from their [`reference`], one bit each.
    has_reference: u64,
    /// The pages of all columns in their order, from the least significant.
    pages: Vec<u32>,
}

impl Default for Tile {
    fn default() -> Self {
        Self { widths: [0; COLUMNS], has_base: 0, bases: Vec::new(), has_reference: 0, pages: Vec::new() }
    }
}

impl Tile {
    /// Returns whether no pixel has samples. The signed columns of a tile with samples have a base.
    pub(crate) fn is_empty(&self) -> bool {
        self.has_base == 0 && self.pages.is_empty()
    }

    /// Have the moments of the pixels values that differ? Those without places are all zero.
    pub(crate) fn has_moments(&self) -> bool {
        self.widths[MOMENTS..MOMENTS + 6].iter().any(|&width| width > 0)
    }

    /// Bytes of memory beside the pages.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + 16 * self.bases.capacity() + 4 * self.pages.capacity()
    }

    /// Adds sums to those of some pixels, each with its number in the tile.
    pub(crate) fn add<'a>(
        &mut self,
        pages: &mut Pages,
        layers: FilmLayers,
        sums: impl Iterator<Item = (usize, &'a PixelSums)>,
    ) -> Result<(), OutOfMemory> {
        let mut sums: Vec<_> = sums.collect();
        if sums.len() < FEW_PIXELS {
            let mut has_room = |(slot, sums_of_pixel): &(usize, &PixelSums)| {
                let mut pixel = self.pixel(pages, layers, *slot);
                pixel.merge(sums_of_pixel);
                self.replace(pages, layers, *slot, &pixel)
            };
            let added = sums.iter().take_while(|sums| has_room(sums)).count();
            sums.drain(..added);
            if sums.is_empty() {
                return Ok(());
            }
        }
        // Each unit of a tile has its pixels in order.
        if !sums.is_sorted_by_key(|(slot, _)| *slot) {
            sums.sort_by_key(|(slot, _)| *slot);
        }
        let mut sums = sums.into_iter().peekable();
        let set = InstructionSet::best();
        let mut numbers = Numbers::new(layers);
        let mut pixels = [PixelSums::default(); SIDE];
        for row in 0..SIDE {
            self.unpack_row(set, pages, layers.columns(), row, &mut pixels);
            while let Some((slot, of_pixel)) = sums.next_if(|(slot, _)| slot / SIDE == row) {
                pixels[slot % SIDE].merge(of_pixel);
            }
            numbers.set_row(row, &pixels);
        }
        dispatch!(set, _F, _token => self.pack(pages, &numbers))
    }

    /// The sums of one pixel.
    pub(crate) fn pixel(&self, pages: &Pages, layers: FilmLayers, slot: usize) -> PixelSums {
        if self.is_empty() {
            return PixelSums::default();
        }
        let mut sums = PixelSums::default();
        let (mut own, mut bases) = (self.pages.iter(), self.bases.iter());
        for column in 0..layers.columns() {
            let mut value = self.base(column, &mut bases);
            for shift in 0..self.widths[column] {
                let byte = own.next().map_or(0, |&page| pages.get(page)[slot]);
                value = value.wrapping_add(u128::from(byte) << (8 * shift));
            }
            let reference = self.reference(column).map(|r| get(&sums, r));
            set(&mut sums, column, undo_difference(reference, value));
        }
        sums
    }

    /// Stores one pixel if its columns have room for it. Otherwise returns false and changes nothing.
    fn replace(&self, pages: &mut Pages, layers: FilmLayers, slot: usize, sums: &PixelSums) -> bool {
        let mut values = [0u128; COLUMNS];
        let mut bases = self.bases.iter();
        for (column, value) in values.iter_mut().enumerate().take(layers.columns()) {
            let number = difference(self.reference(column).map(|r| get(sums, r)), get(sums, column));
            *value = number.wrapping_sub(self.base(column, &mut bases));
            if bytes_of(*value) > self.widths[column] {
                return false;
            }
        }
        let mut own = self.pages.iter();
        for (column, value) in values.iter().enumerate().take(layers.columns()) {
            for shift in 0..self.widths[column] {
                if let Some(&page) = own.next() {
                    pages.get_mut(page)[slot] = (value >> (8 * shift)) as u8;
                }
            }
        }
        true
    }

    #[inline]
    fn base(&self, column: usize, bases: &mut std::slice::Iter<'_, u128>) -> u128 {
        if self.has_base >> column & 1 == 0 { 0 } else { bases.next().copied().unwrap_or(0) }
    }

    /// The column from which a column is stored as a difference.
    #[inline]
    fn reference(&self, column: usize) -> Option<usize> {
        if self.has_reference >> column & 1 == 0 { None } else { reference(column) }
    }

    /// The number of samples of each pixel, row by row: one column, which is not a difference from another one.
    pub(crate) fn counts(&self, pages: &Pages) -> [u32; PIXELS] {
        let before = |widths: &[u8]| widths.iter().map(|&width| usize::from(width)).sum();
        let earlier = (self.has_base & ((1 << COUNT) - 1)).count_ones() as usize;
        let base = self.base(COUNT, &mut self.bases[earlier..].iter());
        let mut counts = [base as u32; PIXELS];
        let own = self.pages.iter().skip(before(&self.widths[..COUNT])).take(self.widths[COUNT].into());
        for (shift, &page) in own.enumerate() {
            let bytes = counts.iter_mut().zip(pages.get(page));
            bytes.for_each(|(count, &byte)| {
                *count = count.wrapping_add(u32::from(byte).unbounded_shl(8 * shift as u32))
            });
        }
        counts
    }

    /// The sums of all pixels, row by row. Numbers beyond the first columns are zero.
    pub(crate) fn unpacked(&self, pages: &Pages, columns: usize) -> Vec<PixelSums> {
        let mut pixels = [PixelSums::default(); SIDE];
        let mut all = Vec::with_capacity(PIXELS);
        for row in 0..SIDE {
            self.unpack_row(InstructionSet::best(), pages, columns, row, &mut pixels);
            all.extend_from_slice(&pixels);
        }
        all
    }

    /// Replaces `out` by the sums of the pixels of a row. Numbers beyond the first columns are zero.
    pub(crate) fn unpack_row(
        &self,
        set: InstructionSet,
        pages: &Pages,
        columns: usize,
        row: usize,
        out: &mut [PixelSums; SIDE],
    ) {
        *out = [PixelSums::default(); SIDE];
        if !self.is_empty() {
            dispatch!(set, _F, _token => self.unpack_columns(pages, columns, row, out));
        }
    }

    #[inline(always)]
    fn unpack_columns(&self, pages: &Pages, columns: usize, row: usize, out: &mut [PixelSums; SIDE]) {
        let (mut own, mut bases) = (self.pages.iter(), self.bases.iter());
        for (column, set_column) in SET_COLUMN.iter().enumerate().take(columns) {
            let base = self.base(column, &mut bases);
            let width = self.widths[column];
            let low = row_of_pages(pages, &mut own, width.min(8), row);
            let high = if width > 8 { row_of_pages(pages, &mut own, width - 8, row) } else { [0; SIDE] };
            set_column(out, &[low, high], base, self.reference(column).is_some());
        }
    }

    /// Replaces the contents by numbers. Without enough memory nothing changes.
    #[inline(always)]
    fn pack(&mut self, pages: &mut Pages, numbers: &Numbers) -> Result<(), OutOfMemory> {
        let columns = numbers.columns.len();
        let mut packed = Self::default();
        let mut bases = [0; COLUMNS];
        let mut ranges = [(0, 0); COLUMNS];
        for (column, base) in bases.iter_mut().enumerate().take(columns) {
            let (mut low, mut high) = numbers.range(column);
            ranges[column] = (low, high);
            if let Some(reference) = reference(column).filter(|_| high != low) {
                let differences = numbers.range_of_differences(column, reference, &ranges);
                if bytes_of(differences.1 - differences.0) < bytes_of(high - low) {
                    (low, high) = differences;
                    packed.has_reference |= 1 << column;
                }
            }
            // A base needs as many bytes as a sixteenth of a page.
            if bytes_of(high - low) < bytes_of(high) {
                *base = low;
                packed.has_base |= u64::from(low != 0) << column;
            }
            packed.widths[column] = bytes_of(high - *base);
        }
        let needed: usize = packed.widths.iter().map(|&width| usize::from(width)).sum();
        packed.bases.try_reserve_exact(packed.has_base.count_ones() as usize).map_err(|_| OutOfMemory)?;
        packed.bases.extend(bases.iter().filter(|&&base| base != 0));
        packed.pages.try_reserve_exact(needed).map_err(|_| OutOfMemory)?;
        packed.pages.extend(self.pages.iter().take(needed));
        while packed.pages.len() < needed {
            match pages.take() {
                Ok(page) => packed.pages.push(page),
                Err(e) => {
                    pages.free.extend(packed.pages.drain(self.pages.len()..));
                    return Err(e);
                }
            }
        }
        pages.free.extend(self.pages.iter().skip(needed));
        let mut own = packed.pages.iter();
        let mut values = [[0; PIXELS]; 2];
        for (column, base) in bases.into_iter().enumerate().take(columns) {
            let width = packed.widths[column];
            numbers.values(column, packed.reference(column), base, width > 8, &mut values);
            for (shift, &page) in (0..width).zip(&mut own) {
                let half = &values[usize::from(shift / 8)];
                for (byte, v) in pages.get_mut(page).iter_mut().zip(half) {
                    *byte = (v >> (8 * (shift % 8))) as u8;
                }
            }
        }
        *self = packed;
        Ok(())
    }
}

/// The lower and the upper 64 bits of the numbers of a column.
type Halves<const N: usize> = [[u64; N]; 2];

/// Numbers of a row from as many of their pages, from the least significant.
#[inline(always)]
fn row_of_pages(pages: &Pages, own: &mut std::slice::Iter<'_, u32>, width: u8, row: usize) -> [u64; SIDE] {
    let mut numbers = [0; SIDE];
    for (shift, &page) in (0..width).zip(own) {
        let mut bytes = [0; SIDE];
        bytes.copy_from_slice(&pages.get(page)[row * SIDE..][..SIDE]);
        for i in 0..SIDE {
            numbers[i] |= u64::from(bytes[i]) << (8 * shift % 64);
        }
    }
    numbers
}

/// The numbers of a tile, column by column. The compiler can compute with many halves at once.
struct Numbers {
    columns: Vec<Halves<PIXELS>>,
    /// Columns with numbers of more than 64 bits, one bit each.
    wide: u64,
}

impl Numbers {
    fn new(layers: FilmLayers) -> Self {
        Self { columns: vec![[[0; PIXELS]; 2]; layers.columns()], wide: 0 }
    }

    fn set_row(&mut self, row: usize, sums: &[PixelSums; SIDE]) {
        for (column, (halves, get_column)) in self.columns.iter_mut().zip(GET_COLUMN).enumerate() {
            let [low, high] = halves.each_mut().map(|half| &mut half[row * SIDE..][..SIDE]);
            get_column(sums, low, high);
            let bits = high.iter().fold(0, |bits, high| bits | high);
            self.wide |= u64::from(bits != 0) << column;
        }
    }

    fn number(&self, column: usize, slot: usize) -> u128 {
        let [low, high] = &self.columns[column];
        u128::from(high[slot]) << 64 | u128::from(low[slot])
    }

    fn is_wide(&self, column: usize) -> bool {
        self.wide >> column & 1 != 0
    }

    /// The smallest and the largest number of a column.
    #[inline(always)]
    fn range(&self, column: usize) -> (u128, u128) {
        if self.is_wide(column) {
            return range_of((0..PIXELS).map(|slot| self.number(column, slot)));
        }
        let (mut low, mut high) = (u64::MAX, 0);
        for &number in &self.columns[column][0] {
            (low, high) = (low.min(number), high.max(number));
        }
        (low.into(), high.into())
    }

    /// The smallest and the largest difference of the numbers of a column from those of another one.
    #[inline(always)]
    fn range_of_differences(&self, column: usize, reference: usize, ranges: &[(u128, u128); COLUMNS]) -> (u128, u128) {
        let [of_column, of_reference] = [ranges[column], ranges[reference]];
        let most = of_column.1.saturating_sub(of_reference.0).max(of_reference.1.saturating_sub(of_column.0));
        if self.is_wide(column) || self.is_wide(reference) || most > i64::MAX as u128 {
            let difference = |slot| difference(Some(self.number(reference, slot)), self.number(column, slot));
            return range_of((0..PIXELS).map(difference));
        }
        let (mut low, mut high) = (i64::MAX, i64::MIN);
        for (number, reference) in self.columns[column][0].iter().zip(&self.columns[reference][0]) {
            let difference = number.wrapping_sub(*reference) as i64;
            (low, high) = (low.min(difference), high.max(difference));
        }
        (low as u128 ^ SIGN, high as u128 ^ SIGN)
    }

    /// The numbers of a column, or their differences from another one, less a base. The upper halves are zero unless they are needed.
    #[inline(always)]
    fn values(&self, column: usize, reference: Option<usize>, base: u128, is_wide: bool, to: &mut Halves<PIXELS>) {
        if is_wide {
            let [low, high] = to;
            for (slot, (low, high)) in low.iter_mut().zip(high).enumerate() {
                let number = difference(reference.map(|r| self.number(r, slot)), self.number(column, slot)) - base;
                (*low, *high) = (number as u64, (number >> 64) as u64);
            }
            return;
        }
        let [numbers, _] = &self.columns[column];
        match reference {
            None => {
                for (to, number) in to[0].iter_mut().zip(numbers) {
                    *to = number.wrapping_sub(base as u64);
                }
            }
            Some(reference) => {
                let [references, _] = &self.columns[reference];
                for slot in 0..PIXELS {
                    to[0][slot] = numbers[slot].wrapping_sub(references[slot]).wrapping_sub(base as u64);
                }
            }
        }
    }
}

/// The smallest and the largest of some numbers.
fn range_of(numbers: impl Iterator<Item = u128>) -> (u128, u128) {
    numbers.fold((u128::MAX, 0), |(low, high), number| (low.min(number), high.max(number)))
}

/// Reads the numbers of a column.
type GetColumn = fn(&[PixelSums; SIDE], &mut [u64], &mut [u64]);
/// Sets the numbers of a column from halves, base and whether they are differences.
type SetColumn = fn(&mut [PixelSums; SIDE], &Halves<SIDE>, u128, bool);

const GET_COLUMN: [GetColumn; COLUMNS] = of_columns!(get_column);
const SET_COLUMN: [SetColumn; COLUMNS] = of_columns!(set_column);

fn get_column<const COLUMN: usize>(sums: &[PixelSums; SIDE], low: &mut [u64], high: &mut [u64]) {
    for ((sums, low), high) in sums.iter().zip(low).zip(high) {
        let number = get(sums, COLUMN);
        (*low, *high) = (number as u64, (number >> 64) as u64);
    }
}

/// Sets the numbers of a column from their distances to a base. The columns before it are set.
fn set_column<const COLUMN: usize>(
    sums: &mut [PixelSums; SIDE],
    halves: &Halves<SIDE>,
    base: u128,
    is_difference: bool,
) {
    let values = halves[0]
        .iter()
        .zip(&halves[1])
        .map(|(&low, &high)| (u128::from(high) << 64 | u128::from(low)).wrapping_add(base));
    let pixels = sums.iter_mut().zip(values);
    match reference(COLUMN) {
        Some(reference) if is_difference => {
            pixels.for_each(|(p, value)| set(p, COLUMN, undo_difference(Some(get(p, reference)), value)));
        }
        _ => pixels.for_each(|(p, value)| set(p, COLUMN, value)),
    }
}

const SIGN: u128 = 1 << 127;

/// The signed difference of a number from that of a reference, in the order of unsigned numbers: zero is 2^127. Without
/// a reference, the number. Differences beyond 127 bits wrap around, and [`undo_difference`] still restores them.
#[inline]
fn difference(reference: Option<u128>, number: u128) -> u128 {
    reference.map_or(number, |reference| number.wrapping_sub(reference) ^ SIGN)
}

/// Inverts [`difference`].
#[inline]
fn undo_difference(reference: Option<u128>, difference: u128) -> u128 {
    reference.map_or(difference, |reference| (difference ^ SIGN).wrapping_add(reference))
}

/// Bytes that a number needs.
#[inline]
fn bytes_of(value: u128) -> u8 {
    (128 - value.leading_zeros()).div_ceil(8) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulator::{Accumulate, Sample};
    use crate::columns::stored;
    use dunkelfeld_radiometry::Rgb;

    fn pixel(seed: u32, samples: u32) -> PixelSums {
        let mut sums = PixelSums::default();
        for index in 0..samples {
            let h = (seed ^ index.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b) >> 8;
            let value = h as f32 * 10f32.powi((h % 17) as i32 - 12);
            let normal = [0.6, -0.8, (h % 100) as f32 / 100.0];
            let albedo = Rgb::new(0.5, (h % 7) as f32 / 7.0, 1.0);
            sums.add(
                index,
                &Sample {
                    radiance: Rgb::splat(value),
                    first_light: Rgb::splat(0.5 * value),
                    place: [0.5, -(h as f32) * 1e-8],
                    albedo,
                    normal,
                    depth: 1.5,
                    hit: !h.is_multiple_of(3),
                },
            );
        }
        sums
    }

    /// Updates of few and of many pixels, with sums that grow over twenty orders of magnitude.
    #[test]
    fn a_tile_contains_its_samples_and_reuses_its_pages() {
        for layers in [FilmLayers::All, FilmLayers::Image] {
            let (mut tile, mut pages, mut truth) =
                (Tile::default(), Pages::default(), vec![PixelSums::default(); PIXELS]);
            for round in 0..40u32 {
                let step = [1, 3, 100, 256][round as usize % 4];
                let updates: Vec<(usize, PixelSums)> = (0..PIXELS)
                    .skip(round as usize % 5)
                    .step_by(step)
                    .map(|slot| (slot, pixel(round * 1000 + slot as u32, round % 6)))
                    .collect();
                updates.iter().for_each(|(slot, sums)| truth[*slot].merge(sums));
                tile.add(&mut pages, layers, updates.iter().map(|(slot, sums)| (*slot, sums))).expect("memory");
                let all = tile.unpacked(&pages, layers.columns());
                for slot in 0..PIXELS {
                    assert_eq!(all[slot], stored(&truth[slot], layers), "round {round}, pixel {slot}");
                    assert_eq!(tile.pixel(&pages, layers, slot), all[slot]);
                }
                let mut distinct = tile.pages.clone();
                distinct.extend(&pages.free);
                distinct.sort_unstable();
                distinct.dedup();
                assert_eq!(distinct.len(), pages.used, "a page is used once or free");
            }
        }
    }

    /// Noise in red alone, in gray and in colours: green and blue take pages in tiles where they differ from red.
    #[test]
    fn gray_pixels_need_a_third_of_the_pages_of_coloured_ones() {
        let radiance_pages = |weights: [Rgb; 3]| {
            let (mut tile, mut pages) = (Tile::default(), Pages::default());
            let noise = |h: u32| (h.wrapping_mul(0x85eb_ca6b) >> 8) as f32 * 2f32.powi(-24);
            let all: Vec<PixelSums> = (0..PIXELS as u32)
                .map(|slot| {
                    let mut sums = PixelSums::default();
                    for index in 0..4 {
                        let h = [3, 5, 7].map(|c| noise((12 * slot + 3 * index + c).wrapping_mul(0x9e37_79b9)));
                        let radiance = weights[0] * h[0] + weights[1] * h[1] + weights[2] * h[2];
                        sums.add(index, &Sample { radiance, ..Sample::MISS });
                    }
                    sums
                })
                .collect();
            tile.add(&mut pages, FilmLayers::Image, all.iter().enumerate()).expect("memory");
            let back = tile.unpacked(&pages, FilmLayers::Image.columns());
            assert_eq!(back, all);
            (0..PIXELS).for_each(|slot| assert_eq!(tile.pixel(&pages, FilmLayers::Image, slot), all[slot]));
            tile.widths[..12].iter().map(|&width| usize::from(width)).sum::<usize>()
        };
        let (red, green, blue) = (Rgb::new(1.0, 0.0, 0.0), Rgb::new(0.0, 1.0, 0.0), Rgb::new(0.0, 0.0, 1.0));
        let coloured = radiance_pages([red, green, blue]);
        assert_eq!(coloured, 12 * 6);
        assert_eq!(radiance_pages([red, Rgb::BLACK, Rgb::BLACK]), coloured / 3);
        assert_eq!(radiance_pages([Rgb::splat(1.0), Rgb::BLACK, Rgb::BLACK]), coloured / 3);
    }
}
