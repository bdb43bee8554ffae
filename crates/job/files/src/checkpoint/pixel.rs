//! The sums of a pixel as bytes, and back, with a check that samples can have given them.

use dunkelfeld_film::units::{
    DEPTH_BITS, DEPTH_LIMIT_BITS, RADIANCE_BITS, RADIANCE_LIMIT_BITS, SQUARE_BITS, UNIT_BITS, UNIT_SQUARE_BITS,
};
use dunkelfeld_film::{BATCHES, PixelSums, RadianceSum, SquareSum};

/// Bytes of one pixel: little-endian, in the order of the fields of [`PixelSums`].
pub const PIXEL_BYTES: usize =
    BATCHES * 3 * 16 + BATCHES * 4 + 2 * (3 * 8 + 3 * 8) + 8 + 16 + 4 + 4 + 8 + 32 + 9 * 16 + 2 * 8;

/// Maximum number of samples of a pixel of a film.
pub const MAX_SAMPLES: u32 = 1 << 30;

/// The largest sums of albedo or normal, and of their squares, from one sample.
const UNIT: i64 = 1 << UNIT_BITS;
const UNIT_SQUARE: u64 = 1 << UNIT_SQUARE_BITS;
/// The largest depth of a sample.
const DEPTH: i64 = 1 << (DEPTH_LIMIT_BITS + DEPTH_BITS);
/// Upper bound of the radiance of a sample.
const RADIANCE: u128 = 1 << (RADIANCE_LIMIT_BITS + RADIANCE_BITS);
/// Squares of luminance are rounded down to this unit [(W/(m^2 sr))^2].
const SQUARE_UNIT: f64 = 1.0 / (1u128 << SQUARE_BITS) as f64;

/// Appends the bytes of a pixel.
pub(super) fn encode(sums: &PixelSums, out: &mut Vec<u8>) {
    sums.batches.iter().flat_map(|b| b.0).for_each(|v| out.extend(v.to_le_bytes()));
    sums.counts.iter().for_each(|v| out.extend(v.to_le_bytes()));
    sums.albedo.iter().chain(&sums.normal).chain([&sums.depth]).for_each(|v| out.extend(v.to_le_bytes()));
    sums.albedo_squares.iter().chain(&sums.normal_squares).for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(sums.depth_squares.to_le_bytes());
    [sums.hits, sums.invalid].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(sums.heaviest_key.to_le_bytes());
    sums.luminance_squares.0.iter().chain(&sums.first_light.0).for_each(|v| out.extend(v.to_le_bytes()));
    sums.moments.as_flattened().iter().for_each(|v| out.extend(v.to_le_bytes()));
    sums.places.iter().for_each(|v| out.extend(v.to_le_bytes()));
}

/// The pixel of the bytes. `None` if they are too few, or if no samples can give it. A returned pixel can be counted,
/// averaged and merged without leaving the range of its numbers.
pub(super) fn decode(mut bytes: &[u8]) -> Option<PixelSums> {
    let from = &mut bytes;
    let mut sums = PixelSums::default();
    for batch in &mut sums.batches {
        *batch = RadianceSum([radiance(from)?, radiance(from)?, radiance(from)?]);
    }
    for count in &mut sums.counts {
        *count = u32::from_le_bytes(take(from)?);
    }
    for v in sums.albedo.iter_mut().chain(&mut sums.normal).chain([&mut sums.depth]) {
        *v = i64::from_le_bytes(take(from)?);
    }
    for v in sums.albedo_squares.iter_mut().chain(&mut sums.normal_squares) {
        *v = u64::from_le_bytes(take(from)?);
    }
    sums.depth_squares = u128::from_le_bytes(take(from)?);
    sums.hits = u32::from_le_bytes(take(from)?);
    sums.invalid = u32::from_le_bytes(take(from)?);
    sums.heaviest_key = u64::from_le_bytes(take(from)?);
    sums.luminance_squares = SquareSum([radiance(from)?, radiance(from)?]);
    sums.first_light = RadianceSum([radiance(from)?, radiance(from)?, radiance(from)?]);
    for v in sums.moments.as_flattened_mut() {
        *v = i128::from_le_bytes(take(from)?);
    }
    for v in &mut sums.places {
        *v = i64::from_le_bytes(take(from)?);
    }
    is_possible(&sums).then_some(sums)
}

fn radiance(from: &mut &[u8]) -> Option<u128> {
    take(from).map(u128::from_le_bytes)
}

fn take<const N: usize>(from: &mut &[u8]) -> Option<[u8; N]> {
    let (head, tail) = from.split_first_chunk::<N>()?;
    *from = tail;
    Some(*head)
}

fn is_possible(sums: &PixelSums) -> bool {
    let count: u64 = sums.counts.iter().map(|&n| u64::from(n)).sum();
    if count > u64::from(MAX_SAMPLES) || u64::from(sums.hits) > count || u64::from(sums.invalid) > count {
        return false;
    }
    let hits = i64::from(sums.hits);
    let within = |v: i64, most: i64| v.unsigned_abs() <= hits.saturating_mul(most).unsigned_abs();
    // A product beyond the range of 128 bits is no bound: such a sum may be saturated.
    let lit = |(batch, &n): (&RadianceSum, &u32)| {
        u128::from(n).checked_mul(RADIANCE).is_none_or(|most| batch.0.iter().all(|&v| v <= most))
    };
    sums.batches.iter().zip(&sums.counts).all(lit)
        && lit((&sums.first_light, &(count as u32)))
        && sums.places.iter().all(|v| v.unsigned_abs() <= count * UNIT.unsigned_abs())
        && sums.moments.iter().all(|m| lit((&RadianceSum(m.map(i128::unsigned_abs)), &(count as u32))))
        && sums.albedo.iter().chain(&sums.normal).all(|&v| within(v, UNIT))
        && sums.albedo_squares.iter().chain(&sums.normal_squares).all(|&v| v <= u64::from(sums.hits) * UNIT_SQUARE)
        && sums.depth >= 0
        && within(sums.depth, DEPTH)
        && sums.max_luminance().is_finite()
        && sums.max_luminance() >= 0.0
        && {
            // No square is larger than that of the largest sample, which is one of them apart from rounding.
            let (sum, largest) = (sums.luminance_squares.to_f64(), f64::from(sums.max_luminance()).powi(2));
            let (least, most) = (largest * (1.0 - 1e-9) - SQUARE_UNIT, largest * count as f64 * (1.0 + 1e-9));
            (least..=most).contains(&sum)
        }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::{Accumulate, Sample};
    use dunkelfeld_radiometry::Rgb;

    /// Sums of every kind: bright, black, missed and invalid samples.
    fn pixel(samples: u32) -> PixelSums {
        let mut sums = PixelSums::default();
        for index in 0..samples {
            let v = [0.25, 0.0, 1e30, 3.5e-9, 6e13, f32::NAN][index as usize % 6];
            let hit = index % 3 != 1;
            let normal = [0.6, -0.8, 0.0];
            sums.add(
                index,
                &Sample {
                    radiance: Rgb::new(v, 0.5 * v, 2.0),
                    first_light: Rgb::new(0.5 * v, 0.0, 2.0),
                    place: [-0.25, 0.5],
                    albedo: Rgb::splat(0.7),
                    normal,
                    depth: 1.5,
                    hit,
                },
            );
        }
        sums
    }

    #[test]
    fn every_pixel_is_read_as_written() {
        for samples in [0, 1, 4, 17, 1000] {
            let mut bytes = Vec::new();
            encode(&pixel(samples), &mut bytes);
            assert_eq!(bytes.len(), PIXEL_BYTES);
            assert_eq!(decode(&bytes), Some(pixel(samples)));
            assert_eq!(decode(&bytes[1..]), None, "a byte is missing");
        }
    }

    #[test]
    fn impossible_sums_are_refused() {
        type Change = fn(&mut PixelSums);
        let cases: [Change; 14] = [
            |p| p.counts[0] = u32::MAX,
            |p| p.hits = 18,
            |p| p.invalid = 18,
            |p| p.albedo[1] = i64::MIN,
            |p| p.normal[2] = 18 << 30,
            |p| p.normal_squares[0] = 18 << 30,
            |p| p.depth = -1,
            |p| p.depth = i64::MAX,
            |p| p.heaviest_key = u64::from(f32::INFINITY.to_bits()) << 32,
            |p| p.batches[3].0[1] = 5 << 105,
            |p| p.moments[1][2] = i128::MIN,
            |p| p.places[0] = i64::MIN,
            |p| p.luminance_squares = SquareSum([0, 0]),
            |p| p.luminance_squares.0[1] = u128::MAX,
        ];
        for (i, change) in cases.into_iter().enumerate() {
            let mut sums = pixel(17);
            change(&mut sums);
            let mut bytes = Vec::new();
            encode(&sums, &mut bytes);
            assert_eq!(decode(&bytes), None, "case {i}");
        }
    }
}
