//! The columns of a packed tile: each holds one number of every pixel.
//!
//! All numbers are unsigned. Signed sums keep their order: the sign bit is flipped, so that the smallest becomes zero. Numbers
//! that are alike in neighbouring pixels or follow from others are stored as differences: the samples of a batch as those of
//! the first batch minus its own, the hits as misses.

use crate::accumulator::{BATCHES, PixelSums};
use crate::film::FilmLayers;

/// Columns of a film with all layers.
pub(crate) const COLUMNS: usize = 36;
/// Columns of a film without the layers that only auxiliary outputs need. They come first.
const IMAGE_COLUMNS: usize = 24;
const RADIANCE: usize = 12;
const _: () = assert!(RADIANCE == 3 * BATCHES, "the columns are those of four batches");

impl FilmLayers {
    /// The columns that a film with these layers stores: the first so many.
    pub(crate) fn columns(self) -> usize {
        match self {
            Self::Image => IMAGE_COLUMNS,
            Self::All => COLUMNS,
        }
    }
}

/// The number of a pixel in a column.
#[inline]
pub(crate) fn get(sums: &PixelSums, column: usize) -> u128 {
    match column {
        0..RADIANCE => sums.batches[column / 3].0[column % 3],
        12 => sums.counts[0].into(),
        13..16 => ordered_difference(sums.counts[0], sums.counts[column - 12]),
        16 => sums.invalid.into(),
        17 => (sums.heaviest_key >> 32).into(),
        // The index of the sample plus one; zero without samples.
        18 => (!(sums.heaviest_key as u32)).wrapping_add(1).into(),
        19..21 => sums.luminance_squares.0[column - 19],
        21..24 => ordered(sums.normal[column - 21]),
        24..27 => sums.normal_squares[column - 24].into(),
        27..30 => ordered(sums.albedo[column - 27]),
        30..33 => sums.albedo_squares[column - 30].into(),
        33 => ordered(sums.depth),
        34 => sums.depth_squares,
        _ => ordered_difference(sums.count(), sums.hits),
    }
}

/// Undoes [`get`], for a pixel whose earlier columns are set.
#[inline]
pub(crate) fn set(sums: &mut PixelSums, column: usize, value: u128) {
    match column {
        0..RADIANCE => sums.batches[column / 3].0[column % 3] = value,
        12 => sums.counts[0] = value as u32,
        13..16 => sums.counts[column - 12] = undo_difference(sums.counts[0], value),
        16 => sums.invalid = value as u32,
        17 => sums.heaviest_key = u64::from(value as u32) << 32,
        18 => sums.heaviest_key |= u64::from(!(value as u32).wrapping_sub(1)),
        19..21 => sums.luminance_squares.0[column - 19] = value,
        21..24 => sums.normal[column - 21] = signed(value),
        24..27 => sums.normal_squares[column - 24] = value as u64,
        27..30 => sums.albedo[column - 27] = signed(value),
        30..33 => sums.albedo_squares[column - 30] = value as u64,
        33 => sums.depth = signed(value),
        34 => sums.depth_squares = value,
        _ => sums.hits = undo_difference(sums.count(), value),
    }
}

const SIGN: u64 = 1 << 63;

fn ordered(v: i64) -> u128 {
    u128::from(v as u64 ^ SIGN)
}

fn signed(v: u128) -> i64 {
    (v as u64 ^ SIGN) as i64
}

fn ordered_difference(whole: u32, part: u32) -> u128 {
    ordered(i64::from(whole) - i64::from(part))
}

fn undo_difference(whole: u32, difference: u128) -> u32 {
    (i64::from(whole) - signed(difference)) as u32
}

/// What a film with these layers gives back of some sums.
#[cfg(test)]
pub(crate) fn stored(sums: &PixelSums, layers: FilmLayers) -> PixelSums {
    let mut back = PixelSums::default();
    (0..layers.columns()).for_each(|column| set(&mut back, column, get(sums, column)));
    back
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulator::{Accumulate, RadianceSum, Sample};
    use crate::square_sum::SquareSum;
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn sums_come_back_also_those_at_the_ends_of_their_types() {
        let mut some = PixelSums::default();
        for index in 3..50 {
            let radiance = Rgb::new(1e-3 * index as f32, 2.5, if index == 9 { f32::NAN } else { 1e12 });
            let normal = [-1.0, 0.3, index as f32 * 0.01];
            some.add(
                index,
                &Sample { radiance, albedo: Rgb::splat(0.3), normal, depth: 2.0, hit: !index.is_multiple_of(3) },
            );
        }
        let extreme = PixelSums {
            batches: [RadianceSum([u128::MAX, 0, 1]); BATCHES],
            counts: [u32::MAX / 8, 0, 7, u32::MAX / 4],
            albedo: [i64::MIN, i64::MAX, -1],
            normal: [i64::MIN, i64::MAX, 0],
            depth: i64::MAX,
            albedo_squares: [u64::MAX, 0, 1],
            normal_squares: [u64::MAX; 3],
            depth_squares: u128::MAX,
            hits: u32::MAX / 8,
            invalid: u32::MAX,
            heaviest_key: u64::MAX,
            luminance_squares: SquareSum([u128::MAX, u128::MAX - 1]),
        };
        for sums in [PixelSums::default(), some, extreme] {
            assert_eq!(stored(&sums, FilmLayers::All), sums);
            let image = stored(&sums, FilmLayers::Image);
            assert_eq!((image.batches, image.counts, image.normal), (sums.batches, sums.counts, sums.normal));
            assert_eq!((image.heaviest_key, image.invalid), (sums.heaviest_key, sums.invalid));
            assert_eq!(image.luminance_squares, sums.luminance_squares);
            assert_eq!((image.hits, image.depth, image.albedo), (0, 0, [0; 3]));
        }
    }

    #[test]
    fn a_pixel_without_samples_is_zero_but_for_signs() {
        for column in 0..COLUMNS {
            let value = get(&PixelSums::default(), column);
            assert!(value == 0 || value == u128::from(SIGN), "column {column}: {value}");
        }
    }
}
