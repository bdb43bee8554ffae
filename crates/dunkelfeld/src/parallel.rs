//! Planes of a film, made on the threads of the current pool: a large film takes seconds to read.

use dunkelfeld_film::{Film, PixelSums, Plane, fill_gaps};
use rayon::prelude::*;

/// A film without samples.
pub(crate) fn blank_film(width: u32, height: u32) -> Film {
    let sums = rayon::iter::repeat_n(PixelSums::default(), width as usize * height as usize).collect();
    Plane::from_vec(width, height, sums).map_or_else(|| Film::new(width, height), Film::from_sums)
}

/// [`Film::mean_without_gaps`].
pub(crate) fn mean_without_gaps(film: &Film) -> Plane<[f32; 3]> {
    let known = par_map(film.pixels(), |p| p.count() > 0);
    let mean = par_map(film.pixels(), |p| p.mean().map(|v| v as f32));
    if known.data().contains(&false) { fill_gaps(&mean, &known) } else { mean }
}

/// [`Plane::map`].
pub(crate) fn par_map<T: Sync, U: Send + Clone>(plane: &Plane<T>, f: impl Fn(&T) -> U + Sync) -> Plane<U> {
    let values: Vec<U> = plane.data().par_iter().map(&f).collect();
    // The lengths agree: the plane is made of as many values as it came from.
    Plane::from_vec(plane.width(), plane.height(), values).unwrap_or_else(|| plane.map(&f))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::Sample;
    use dunkelfeld_radiometry::Rgb;

    #[test]
    fn means_are_those_of_the_film() {
        let mut film = blank_film(37, 11);
        assert_eq!(film, Film::new(37, 11));
        for pixel in (0..37 * 11).step_by(3) {
            film.add(pixel, 0, &Sample { radiance: Rgb::splat(pixel as f32), ..Sample::MISS });
        }
        assert_eq!(mean_without_gaps(&film), film.mean_without_gaps());
    }
}
