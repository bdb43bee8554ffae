//! Planes of a film, computed on the threads of the current pool. A large film takes seconds to read.

use dunkelfeld_film::{Film, MeanImage, Needed, PixelSums, Plane, TileRow, fill_gaps};
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
    map_film_at(film, Needed::All, |_, _, sums| f(sums))
}

/// [`map_film_to`] for a function of column, row and the needed numbers of the sums.
pub fn map_film_at<T: Send + Clone + Default, const N: usize>(
    film: &Film,
    needed: Needed,
    f: impl Fn(u32, u32, &PixelSums) -> [T; N] + Sync,
) -> [Plane<T>; N] {
    let mut planes = [(); N].map(|()| Plane::new(film.width(), film.height(), T::default()));
    let width = film.width() as usize;
    let mut chunks = planes.each_mut().map(|plane| plane.data_mut().chunks_mut((width * Film::TILE as usize).max(1)));
    let tops = (0..film.height()).step_by(Film::TILE as usize);
    let chunks = || chunks.each_mut().map(|c| c.next().unwrap_or_default());
    let rows: Vec<_> = film.tile_rows().iter().zip(tops).zip(std::iter::repeat_with(chunks)).collect();
    rows.into_par_iter().for_each(|((row, top), mut to)| {
        row.visit(needed, |x, y, sums| {
            let pixel = y as usize * width + x as usize;
            to.iter_mut().zip(f(x, top + y, sums)).for_each(|(to, value)| to[pixel] = value);
        });
    });
    planes
}

/// A value for each row of tiles of a film, in their order: `f` adds each pixel, with its number in the image and its sums,
/// without the layers that [`Needed::Image`] leaves out.
pub fn fold_tile_rows<T: Send + Default>(film: &Film, f: impl Fn(&mut T, usize, &PixelSums) + Sync) -> Vec<T> {
    let width = film.width() as usize;
    let of_row = |(number, row): (usize, &TileRow)| {
        let (mut value, first) = (T::default(), number * width * Film::TILE as usize);
        row.visit(Needed::Image, |x, y, sums| f(&mut value, first + y as usize * width + x as usize, sums));
        value
    };
    film.tile_rows().par_iter().enumerate().map(of_row).collect()
}

/// [`Film::mean_without_gaps`], in parallel.
pub fn mean_without_gaps(film: &Film) -> Plane<[f32; 3]> {
    let has_gaps = AtomicBool::new(false);
    let [mean] = map_film_at(film, Needed::Means, |_, _, p| {
        if p.count() == 0 {
            has_gaps.store(true, Ordering::Relaxed);
        }
        [p.mean().map(|v| v as f32)]
    });
    if has_gaps.into_inner() { fill_gaps(&mean, &film.sample_counts().map(|&n| n > 0)) } else { mean }
}

/// [`mean_without_gaps`], with the moments of a film whose samples had places. Without samples a pixel has none. `is_spread`: are
/// the samples of a pixel spread over its neighbours ([`RenderedFilm::is_spread`](crate::RenderedFilm::is_spread))?
pub fn mean_image(film: &Film, is_spread: bool) -> MeanImage {
    let moments = film.has_moments().then(|| map_film_at(film, Needed::Image, |_, _, p| p.mean_moments()));
    MeanImage { radiance: mean_without_gaps(film), moments, is_spread }
}
