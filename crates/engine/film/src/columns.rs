//! The columns of a packed tile: each holds one number of every pixel.
//!
//! All numbers are unsigned. Signed sums keep their order: the sign bit is flipped, so that the smallest becomes zero.
//! Numbers that follow from others are stored as differences. The samples of a batch are stored as the difference from
//! its share of all samples, the hits as misses, and the squares of z as the difference from the rest that x and y
//! leave.

use crate::accumulator::{BATCHES, PixelSums};
use crate::film::{FilmLayers, Needed};
use crate::units::UNIT_SQUARE_BITS;

/// Columns of a film with all layers.
pub(crate) const COLUMNS: usize = 47;
/// Columns of a film without the layers that only auxiliary outputs need. They come first.
const IMAGE_COLUMNS: usize = 32;
const RADIANCE: usize = 12;
/// The first column of the moments.
pub(crate) const MOMENTS: usize = 24;
/// The column of the number of samples.
pub(crate) const COUNT: usize = 12;
const _: () = assert!(RADIANCE == 3 * BATCHES, "the columns are those of four batches");

impl FilmLayers {
    /// The number of columns that a film with these layers stores, from the first on.
    pub(crate) fn columns(self) -> usize {
        match self {
            Self::Image => IMAGE_COLUMNS,
            Self::All => COLUMNS,
        }
    }
}

impl Needed {
    /// The number of columns that contain these numbers, from the first on.
    pub(crate) fn columns(self) -> usize {
        match self {
            Self::Means => COUNT + 1,
            Self::Image => IMAGE_COLUMNS,
            Self::All => COLUMNS,
        }
    }
}

/// The number of a pixel in a column.
#[inline(always)]
pub(crate) fn get(sums: &PixelSums, column: usize) -> u128 {
    match column {
        0..RADIANCE => sums.batches[column / 3].0[column % 3],
        COUNT => sums.counts.iter().map(|&count| u128::from(count)).sum(),
        13..16 => ordered_difference(share(sums, column - 12), sums.counts[column - 12].into()),
        16 => sums.invalid.into(),
        17 => (sums.heaviest_key >> 32).into(),
        // The index of the sample plus one. Zero without samples.
        18 => (!(sums.heaviest_key as u32)).wrapping_add(1).into(),
        19..21 => sums.luminance_squares.0[column - 19],
        21..24 => ordered(sums.normal[column - 21]),
        MOMENTS..30 => (sums.moments[(column - MOMENTS) / 3][column % 3] as u128) ^ SIGN_OF_SUM,
        30..32 => ordered(sums.places[column - 30]),
        32 => ordered_difference(sums.count().into(), sums.hits.into()),
        33..35 => sums.normal_squares[column - 33].into(),
        35 => ordered_difference(rest_of_normals(sums), sums.normal_squares[2]),
        36..39 => ordered(sums.albedo[column - 36]),
        39..42 => sums.albedo_squares[column - 39].into(),
        42 => ordered(sums.depth),
        43 => sums.depth_squares,
        _ => sums.first_light.0[column - 44],
    }
}

/// Inverts [`get`], for a pixel whose earlier columns are set.
#[inline(always)]
pub(crate) fn set(sums: &mut PixelSums, column: usize, value: u128) {
    match column {
        0..RADIANCE => sums.batches[column / 3].0[column % 3] = value,
        // The first batch has all samples until the values of the other batches are read.
        COUNT => sums.counts[0] = value as u32,
        13..16 => {
            let count = undo_difference(share(sums, column - 12), value) as u32;
            sums.counts[column - 12] = count;
            sums.counts[0] = sums.counts[0].wrapping_sub(count);
        }
        16 => sums.invalid = value as u32,
        17 => sums.heaviest_key = u64::from(value as u32) << 32,
        18 => sums.heaviest_key |= u64::from(!(value as u32).wrapping_sub(1)),
        19..21 => sums.luminance_squares.0[column - 19] = value,
        21..24 => sums.normal[column - 21] = signed(value),
        MOMENTS..30 => sums.moments[(column - MOMENTS) / 3][column % 3] = (value ^ SIGN_OF_SUM) as i128,
        30..32 => sums.places[column - 30] = signed(value),
        32 => sums.hits = undo_difference(sums.count().into(), value) as u32,
        33..35 => sums.normal_squares[column - 33] = value as u64,
        35 => sums.normal_squares[2] = undo_difference(rest_of_normals(sums), value),
        36..39 => sums.albedo[column - 36] = signed(value),
        39..42 => sums.albedo_squares[column - 39] = value as u64,
        42 => sums.depth = signed(value),
        43 => sums.depth_squares = value,
        _ => sums.first_light.0[column - 44] = value,
    }
}

const SIGN: u64 = 1 << 63;
const SIGN_OF_SUM: u128 = 1 << 127;

fn ordered(v: i64) -> u128 {
    u128::from(v as u64 ^ SIGN)
}

fn signed(v: u128) -> i64 {
    (v as u64 ^ SIGN) as i64
}

fn ordered_difference(whole: u64, part: u64) -> u128 {
    ordered(whole.wrapping_sub(part) as i64)
}

fn undo_difference(whole: u64, difference: u128) -> u64 {
    whole.wrapping_sub(signed(difference) as u64)
}

/// The number of samples of a batch if the samples of the pixel are the first ones.
fn share(sums: &PixelSums, batch: usize) -> u64 {
    let all: u64 = sums.counts.iter().map(|&count| u64::from(count)).sum();
    (all + (BATCHES - 1 - batch) as u64) / BATCHES as u64
}

/// The sum of the squares of z if all normals have length one: the hits less the squares of x and y.
fn rest_of_normals(sums: &PixelSums) -> u64 {
    let [x, y, _] = sums.normal_squares;
    (u64::from(sums.hits) << UNIT_SQUARE_BITS).wrapping_sub(x).wrapping_sub(y)
}

/// The column from which a column may be stored as a difference: an earlier one with often nearly the same values.
/// Green and blue use red. The red of a later batch uses the red of the first batch.
#[inline]
pub(crate) const fn reference(column: usize) -> Option<usize> {
    match column {
        3 | 6 | 9 => Some(0),
        0..RADIANCE if !column.is_multiple_of(3) => Some(column - column % 3),
        37 | 38 => Some(36),
        40 | 41 => Some(39),
        45 | 46 => Some(44),
        _ => None,
    }
}

/// A function for each column, `$f::<0>` and so on. The column is a constant in each of them, so that a loop over pixels
/// reads or writes one number of each, without a decision.
macro_rules! of_columns {
    ($f:ident) => {
        of_columns!($f; 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32 33 34 35 36 37 38 39 40 41 42 43 44 45 46)
    };
    ($f:ident; $($column:literal)*) => {
        [$($f::<$column>),*]
    };
}
pub(crate) use of_columns;

/// The sums as a film with these layers returns them.
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
    fn sums_are_restored_also_at_the_limits_of_their_types() {
        let mut some = PixelSums::default();
        for index in 3..50u32 {
            let radiance = Rgb::new(1e-3 * index as f32, 2.5, if index == 9 { f32::NAN } else { 1e12 });
            let normal = [-1.0, 0.3, index as f32 * 0.01];
            let (first_light, albedo, place) = (radiance * 0.5, Rgb::splat(0.3), [0.125, -0.25]);
            let hit = !index.is_multiple_of(3);
            some.add(index, &Sample { radiance, first_light, place, albedo, normal, depth: 2.0, hit });
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
            first_light: RadianceSum([u128::MAX, 1, 0]),
            moments: [[i128::MAX, i128::MIN, -1], [1, 0, 7]],
            places: [i64::MIN, 3],
        };
        for sums in [PixelSums::default(), some, extreme] {
            assert_eq!(stored(&sums, FilmLayers::All), sums);
            let image = stored(&sums, FilmLayers::Image);
            assert_eq!((image.batches, image.counts, image.normal), (sums.batches, sums.counts, sums.normal));
            assert_eq!((image.heaviest_key, image.invalid), (sums.heaviest_key, sums.invalid));
            assert_eq!(
                (image.luminance_squares, image.moments, image.places),
                (sums.luminance_squares, sums.moments, sums.places)
            );
            assert_eq!((image.hits, image.depth, image.albedo), (0, 0, [0; 3]));
            assert_eq!(image.first_light, RadianceSum::default());
        }
    }
}
