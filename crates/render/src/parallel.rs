//! Planes of a film, computed on the threads of the current pool. A large film takes seconds to read.

use dunkelfeld_film::{Film, PixelSums, Plane, TileRow, fill_gaps};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// [`Film::map`], in parallel.
pub fn map_film<T: Send + Clone + Default>(film: &Film, f: impl Fn(&PixelSums) -> T + Sync) -> Plane<T> {
    let [plane] = map_film_to(film, |sums| [f(sums)]);
    plane
}

/// Several planes with values for the sums of each pixel, which are unpacked once.
pub fn map_film_to<T: Send + Clone + Default, const N: usize>(
    film: &Film,
    f: impl Fn(&PixelSums) -> [T; N] + Sync,
) -> [Plane<T>; N] {
    let mut planes = [(); N].map(|()| Plane::new(film.width(), film.height(), T::default()));
    let pixels = (film.width() as usize * Film::TILE as usize).max(1);
    let mut chunks = planes.each_mut().map(|plane| plane.data_mut().chunks_mut(pixels));
    let rows: Vec<_> =
        film.tile_rows().iter().map(|row| (row, chunks.each_mut().map(|c| c.next().unwrap_or_default()))).collect();
    rows.into_par_iter().for_each_init(Vec::new, |sums, (row, mut to)| {
        sums.clear();
        row.read_rows(0..row.height(), sums);
        for (pixel, sums) in sums.iter().enumerate() {
            to.iter_mut().zip(f(sums)).for_each(|(to, value)| to[pixel] = value);
        }
    });
    planes
}

/// A value for each row of tiles of a film, in their order, from the number of its first pixel and the sums of its pixels.
pub fn map_tile_rows<T: Send>(film: &Film, f: impl Fn(usize, &[PixelSums]) -> T + Sync) -> Vec<T> {
    let pixels = film.width() as usize * Film::TILE as usize;
    let of_row = |sums: &mut Vec<PixelSums>, (number, row): (usize, &TileRow)| {
        sums.clear();
        row.read_rows(0..row.height(), sums);
        f(number * pixels, sums)
    };
    film.tile_rows().par_iter().enumerate().map_init(Vec::new, of_row).collect()
}

/// [`Film::mean_without_gaps`], in parallel.
pub fn mean_without_gaps(film: &Film) -> Plane<[f32; 3]> {
    let has_gaps = AtomicBool::new(false);
    let mean = map_film(film, |p| {
        if p.count() == 0 {
            has_gaps.store(true, Ordering::Relaxed);
        }
        p.mean().map(|v| v as f32)
    });
    if has_gaps.into_inner() { fill_gaps(&mean, &map_film(film, |p| p.count() > 0)) } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::{Accumulate, Sample};
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn means_are_those_of_the_film() {
        let mut sums = vec![PixelSums::default(); 37 * 41];
        for (pixel, sums) in sums.iter_mut().enumerate().step_by(3) {
            sums.add(0, &Sample { radiance: Rgb::splat(pixel as f32), ..Sample::MISS });
        }
        let mut film = Film::new(37, 41);
        film.add_rows(0, &sums).expect("memory");
        let first_red = |first, sums: &[PixelSums]| (first, sums.len(), sums[1].mean()[0]);
        assert_eq!(
            map_tile_rows(&film, first_red),
            [(0, 592, 0.0), (592, 592, 593.0 * f64::from(u8::from(593 % 3 == 0))), (1184, 333, 1185.0)]
        );
        assert_eq!(mean_without_gaps(&film), film.mean_without_gaps());
    }
}
