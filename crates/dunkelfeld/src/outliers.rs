//! The heaviest samples of an image: single paths that raise their pixel far above the mean of its other samples.
//!
//! Such samples are not wrong. But the image has its highest noise there, and errors of the scene or of the renderer
//! are most visible there. The statistics list them, so that they can be replayed. The image keeps them.

use dunkelfeld_film::{Film, PixelSums};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_render::CaptureRows;
use serde::Serialize;
use std::cmp::Ordering;

/// Maximum number of listed samples.
const MAX_LISTED: usize = 8;
/// Minimum number of samples of a pixel for a reliable mean of the others.
const MIN_SAMPLES: u32 = 8;

/// A sample with a large share of its pixel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeavySample {
    /// Its name as `x,y,sample`: the value of `--debug-sample`.
    pub sample: String,
    /// Its luminance [W/(m^2 sr)].
    pub luminance: f64,
    /// Its share of the light of its pixel, in (0, 1].
    pub share: f64,
    /// Increase of the pixel above the mean of the other samples [W/(m^2 sr)].
    pub lift: f64,
    /// Is it half of its pixel or more, and does it raise it by more than the mean luminance of the image?
    pub dominates: bool,
}

/// The heaviest samples, and the number of pixels that one sample dominates.
pub(crate) struct Heaviest {
    pub(crate) samples: Vec<HeavySample>,
    pub(crate) dominated: u64,
}

/// A pixel with the increase and the share of its heaviest sample.
struct Candidate {
    pixel: usize,
    index: u32,
    luminance: f64,
    share: f64,
    lift: f64,
}

/// The heavy samples of some pixels of a film.
#[derive(Default)]
pub(crate) struct HeavyPiece {
    worst: Vec<Candidate>,
    /// Increases of the pixels of which one sample is half or more.
    lifts: Vec<f64>,
    /// Sum of the luminances of all pixels.
    luminance: f64,
}

impl HeavyPiece {
    /// Adds a pixel with its number in the image.
    pub(crate) fn add(&mut self, pixel: usize, sums: &PixelSums) {
        self.luminance += luminance(sums);
        if let Some(candidate) = candidate(pixel, sums) {
            if candidate.share >= 0.5 {
                self.lifts.push(candidate.lift);
            }
            insert(&mut self.worst, candidate);
        }
    }
}

/// Computes them from all pieces of a film, in their order. The result depends only on the film, not on the process or
/// thread that took its samples.
pub(crate) fn heaviest(film: &Film, pieces: Vec<HeavyPiece>, rows: CaptureRows) -> Heaviest {
    let mean = pieces.iter().map(|piece| piece.luminance).sum::<f64>() / film.pixels().max(1) as f64;
    let dominated = pieces.iter().flat_map(|piece| &piece.lifts).filter(|lift| **lift > mean).count() as u64;
    let mut worst = Vec::with_capacity(MAX_LISTED + 1);
    pieces.into_iter().flat_map(|piece| piece.worst).for_each(|candidate| insert(&mut worst, candidate));
    let width = film.width() as usize;
    let samples = worst
        .iter()
        .map(|c| HeavySample {
            sample: format!("{},{},{}", c.pixel % width, rows.of_film((c.pixel / width) as u32), c.index),
            luminance: c.luminance,
            share: c.share,
            lift: c.lift,
            dominates: c.share >= 0.5 && c.lift > mean,
        })
        .collect();
    Heaviest { samples, dominated }
}

/// Inserts a candidate at its rank, if it is in the list.
fn insert(worst: &mut Vec<Candidate>, candidate: Candidate) {
    if worst.len() == MAX_LISTED && worst.last().is_some_and(|w| heavier(w, &candidate) == Ordering::Less) {
        return;
    }
    let place = worst.partition_point(|w| heavier(w, &candidate) == Ordering::Less);
    worst.insert(place, candidate);
    worst.truncate(MAX_LISTED);
}

/// The order of the list: the larger increase first, then the earlier pixel.
fn heavier(a: &Candidate, b: &Candidate) -> Ordering {
    b.lift.total_cmp(&a.lift).then(a.pixel.cmp(&b.pixel))
}

fn candidate(pixel: usize, sums: &PixelSums) -> Option<Candidate> {
    let n = sums.count();
    let (index, heaviest) = sums.heaviest().filter(|_| n >= MIN_SAMPLES)?;
    let (n, heaviest) = (f64::from(n), f64::from(heaviest));
    let total = luminance(sums) * n;
    let lift = (heaviest - (total - heaviest) / (n - 1.0)) / n;
    // A pixel with equal samples has no heavy sample. The rounding of luminances must not cause one.
    (lift > 1e-6 * heaviest).then_some(Candidate {
        pixel,
        index,
        luminance: heaviest,
        share: (heaviest / total).min(1.0),
        lift,
    })
}

fn luminance(sums: &PixelSums) -> f64 {
    let [r, g, b] = sums.mean();
    // The weights of `Rgb::luminance`, in f64.
    let [wr, wg, wb] =
        [Rgb::new(1.0, 0.0, 0.0), Rgb::new(0.0, 1.0, 0.0), Rgb::new(0.0, 0.0, 1.0)].map(|c| f64::from(c.luminance()));
    wr * r + wg * g + wb * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_film::{Accumulate, Sample};
    use dunkelfeld_render::parallel::fold_tile_rows;

    fn film(bright: &[(usize, u32, f32)]) -> Film {
        let mut sums = [PixelSums::default(); 12];
        for (pixel, sums) in sums.iter_mut().enumerate() {
            for index in 0..16 {
                let value = bright.iter().find(|b| (b.0, b.1) == (pixel, index)).map_or(1.0, |b| b.2);
                sums.add(index, &Sample { radiance: Rgb::splat(value), ..Sample::MISS });
            }
        }
        let mut film = Film::new(4, 3);
        film.add_rows(0, &sums).expect("memory");
        film
    }

    fn heaviest_of(film: &Film) -> Heaviest {
        heaviest(film, fold_tile_rows(film, HeavyPiece::add), CaptureRows::ALL)
    }

    #[test]
    fn outliers_are_sorted_and_have_share_and_lift() {
        let found = heaviest_of(&film(&[(5, 3, 201.0), (7, 15, 31.0), (0, 0, 9.0)]));
        let names: Vec<&str> = found.samples.iter().map(|s| s.sample.as_str()).collect();
        assert_eq!(names, ["1,1,3", "3,1,15", "0,0,0"]);
        let first = &found.samples[0];
        assert!((first.share - 201.0 / 216.0).abs() < 1e-6 && (first.lift - 200.0 / 16.0).abs() < 1e-4, "{first:?}");
        // The image's mean is (12 * 16 + 238) / 192 = 2.24. Only the first sample raises its pixel by more and is half
        // of it.
        assert_eq!(found.samples.iter().map(|s| s.dominates).collect::<Vec<_>>(), [true, false, false]);
        assert_eq!(found.dominated, 1);
    }
}
