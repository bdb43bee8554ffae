//! Estimate of the memory of a film before it is allocated.

use crate::film::{Film, FilmLayers};
use crate::packed::TILE_SIDE;
use crate::units::{DEPTH_BITS, RADIANCE_BITS, SQUARE_BITS, UNIT_BITS, UNIT_SQUARE_BITS};

/// Assumptions on the average tile of an image: a radiance of 4 W/(m^2 sr) in its brightest pixel, and a depth of 4 m.
const RADIANCE: f64 = 4.0;
const DEPTH: f64 = 4.0;
/// Bytes of a tile beside its pages: widths, bases and page numbers.
const TILE_OVERHEAD: u64 = 2560;
/// Bytes of a row of tiles that are allocated for future pages.
const ROW_OVERHEAD: u64 = 1 << 14;

impl Film {
    /// Expected bytes of a film once its pixels have `mean_spp` samples on average, with or without moments of the radiance
    /// ([`PixelSums::moments`](crate::PixelSums::moments)).
    ///
    /// An estimate: pixels are assumed to have up to twice the mean, a radiance of up to 4 W/(m^2 sr), saturated
    /// colours and no neighbours with the same sums. Brighter images need up to 12 bytes more per pixel for each factor
    /// of 256. Gray and uniform regions need less.
    pub fn expected_bytes(width: u32, height: u32, layers: FilmLayers, has_moments: bool, mean_spp: f64) -> u64 {
        let samples = (2.0 * mean_spp).clamp(1.0, f64::from(1u32 << 30));
        let bytes = |largest: f64| (largest.log2().max(0.0) / 8.0).ceil() as u64;
        let unit = |bits: i32| f64::from(bits).exp2();
        let radiance = 12 * bytes(RADIANCE * samples / 4.0 * unit(RADIANCE_BITS));
        let first_light = 3 * bytes(RADIANCE * samples * unit(RADIANCE_BITS));
        let moments = if has_moments { 6 * bytes(RADIANCE * samples * unit(RADIANCE_BITS)) } else { 0 };
        let counts = bytes(samples);
        let heaviest = 4 + bytes(samples);
        let squares = bytes(RADIANCE * RADIANCE * samples * unit(SQUARE_BITS));
        let units = 3 * bytes(2.0 * samples * unit(UNIT_BITS));
        let unit_squares = 3 * bytes(samples * unit(UNIT_SQUARE_BITS));
        let image = radiance + moments + counts + heaviest + squares + units;
        let depth = bytes(DEPTH * samples * unit(DEPTH_BITS))
            + bytes(DEPTH * DEPTH * samples * unit(2 * DEPTH_BITS))
            + bytes(samples);
        let per_pixel = match layers {
            FilmLayers::Image => image,
            // For normals of length one, the squares of z leave only a rounding error to store.
            FilmLayers::All => {
                image + units + unit_squares + unit_squares * 2 / 3 + bytes(samples) + depth + first_light
            }
        };
        let tiles = u64::from(width.div_ceil(TILE_SIDE)) * u64::from(height.div_ceil(TILE_SIDE));
        let rows = u64::from(height.div_ceil(TILE_SIDE));
        tiles
            .saturating_mul(per_pixel * u64::from(TILE_SIDE * TILE_SIDE) + TILE_OVERHEAD)
            .saturating_add(rows * ROW_OVERHEAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulator::{Accumulate, PixelSums, Sample};
    use dunkelfeld_radiometry::Rgb;

    /// Coloured noise in which no two pixels are alike: the film needs at most the expected bytes, and not much less.
    /// It needs at most 128 bytes per pixel without the layers of auxiliary outputs, 216 with all, and 54 more with moments.
    #[test]
    fn films_need_the_expected_memory() {
        for ((layers, spp), has_moments) in [
            (FilmLayers::Image, 8u32),
            (FilmLayers::All, 8),
            (FilmLayers::Image, 64),
            (FilmLayers::All, 300),
            (FilmLayers::Image, 500),
            (FilmLayers::All, 500),
        ]
        .into_iter()
        .flat_map(|case| [(case, false), (case, true)])
        {
            let (width, height) = (96, 64);
            let mut film = Film::with_layers(width, height, layers);
            let mut state = 1u32;
            let mut random = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1u32 << 24) as f32
            };
            for y in 0..height {
                let row: Vec<PixelSums> = (0..width)
                    .map(|_| {
                        let mut sums = PixelSums::default();
                        for index in 0..spp {
                            let radiance = Rgb::new(random(), random(), random());
                            let normal = [random(), -random(), random() + 0.1];
                            let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt();
                            let normal = normal.map(|v| v / length);
                            let albedo = Rgb::new(random(), random(), random());
                            let (first_light, depth, hit) = (radiance * 0.8, random(), random() > 0.3);
                            let place = if has_moments { [random() - 0.5, random() - 0.5] } else { [0.0; 2] };
                            sums.add(index, &Sample { radiance, first_light, place, albedo, normal, depth, hit });
                        }
                        sums
                    })
                    .collect();
                film.add_rows(y, &row).expect("memory");
            }
            let expected = Film::expected_bytes(width, height, layers, has_moments, f64::from(spp));
            let ratio = film.bytes() as f64 / expected as f64;
            assert!((0.7..=1.0).contains(&ratio), "{layers:?}, {spp}: {} of {expected} bytes", film.bytes());
            let per_pixel = film.bytes() as f64 / f64::from(width * height);
            let most = if layers == FilmLayers::Image { 128.0 } else { 216.0 } + if has_moments { 54.0 } else { 0.0 };
            assert!(per_pixel <= most, "{layers:?}, {spp}: {per_pixel} bytes per pixel");
        }
    }
}
