//! The mean over pixels that may well be of one kind: weighted by how alike their features and their surroundings are.
//!
//! Non-local means (Buades 2005) in the form that Rousselle et al. (2012, 2013) gave it for renders: of a squared
//! difference of two pixels that much is taken away which their noise alone would make, and the rest is counted in units
//! of that noise.

use super::noise::likeness;
use super::patch::{Image, Patch};
use super::tiles::Tile;
use crate::denoiser::Triples;

/// Pixels are compared with those up to this far away, in a circle.
const REACH: usize = 8;
/// How many times its variance a squared difference of colour must be to count as one.
const BANDWIDTH: f32 = 1.8;
/// Colours are compared over squares of 3 x 3 pixels, of which those nearer count more: 1 2 1, 2 4 2, 1 2 1.
const AROUND: usize = 1;
/// The margin of a tile.
const MARGIN: usize = REACH + AROUND;

/// The averages of a tile. All is in the unit of patches; `variance` is that of the mean.
#[allow(unsafe_code, reason = "to enter what is compiled for more than every machine has")]
pub(super) fn averages(image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: this machine has AVX2, as was just found.
        return unsafe { averages_avx2(image, variance, tile) };
    }
    averages_anywhere(image, variance, tile)
}

/// The same bits with registers twice as wide: no operation is fused or reordered.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn averages_avx2(image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    averages_anywhere(image, variance, tile)
}

// What works on pixels is inlined into both.
#[inline(always)]
fn averages_anywhere(image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    let patch = image.cut(tile, MARGIN);
    let variance = image.cut_plane(variance, tile, MARGIN);
    let mut work = Work::new(tile);
    let reach = REACH as isize;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            // Fading towards the rim, so that a bright pixel leaves no square behind.
            let nearness = 1.0 - (dx * dx + dy * dy) as f32 / ((reach + 1) * (reach + 1)) as f32;
            if nearness > 0.0 {
                work.add(&patch, &variance, dy * patch.stride as isize + dx, nearness);
            }
        }
    }
    work.finish(&patch)
}

/// Sums over offsets, and room for one row at a time.
struct Work {
    width: usize,
    height: usize,
    sums: [Vec<f32>; 3],
    weights: Vec<f32>,
    /// Colour distances of a row, one pixel more on either side.
    row: Vec<f32>,
    /// Sums over three neighbours in such rows, of the last three of them.
    triples: [Vec<f32>; 3],
    /// Distances, then weights, of a row.
    distances: Vec<f32>,
}

impl Work {
    fn new(tile: &Tile) -> Self {
        let (width, height) = (tile.width, tile.height);
        let zeros = |n: usize| vec![0.0f32; n];
        Self {
            width,
            height,
            sums: [0; 3].map(|_| zeros(width * height)),
            weights: zeros(width * height),
            row: zeros(width + 2 * AROUND),
            triples: [0; 3].map(|_| zeros(width)),
            distances: zeros(width),
        }
    }

    /// Adds to each pixel the one that lies `offset` further in the patch, with a weight of at most `nearness`.
    #[inline(always)]
    fn add(&mut self, patch: &Patch, variance: &[Vec<f32>; 3], offset: isize, nearness: f32) {
        for row in 0..self.height + 2 * AROUND {
            // The row above the tile is row 0 here.
            let p = (row + MARGIN - AROUND) * patch.stride + MARGIN - AROUND;
            color_distances(&mut self.row, &patch.color, variance, p, p.wrapping_add_signed(offset));
            let triple = &mut self.triples[row % 3];
            for ((sum, left), (middle, right)) in
                triple.iter_mut().zip(&self.row).zip(self.row[1..].iter().zip(&self.row[2..]))
            {
                *sum = left + 2.0 * middle + right;
            }
            if row >= 2 * AROUND {
                self.add_row(patch, row - 2 * AROUND, offset, nearness);
            }
        }
    }

    #[inline(always)]
    fn add_row(&mut self, patch: &Patch, row: usize, offset: isize, nearness: f32) {
        let width = self.width;
        let p = (row + MARGIN) * patch.stride + MARGIN;
        let q = p.wrapping_add_signed(offset);
        self.distances.fill(0.0);
        for feature in &patch.features {
            let here = &feature.values[p..p + width];
            let there = &feature.values[q..q + width];
            let (noise, precision) = (&feature.noise[p..p + width], &feature.precision[p..p + width]);
            for (i, d) in self.distances.iter_mut().enumerate() {
                let difference = here[i] - there[i];
                *d += (difference * difference - noise[i]) * precision[i];
            }
        }
        let [above, middle, below] = [row, row + 1, row + 2].map(|r| &self.triples[r % 3][..width]);
        let known = &patch.known[q..q + width];
        for (i, d) in self.distances.iter_mut().enumerate() {
            // The mask adds up to 16, for each of three channels.
            let color = (above[i] + 2.0 * middle[i] + below[i]) * (1.0 / (48.0 * BANDWIDTH));
            *d = if offset == 0 { known[i] } else { nearness * known[i] * likeness(d.max(0.0) + color.max(0.0)) };
        }
        let start = row * width;
        for (sum, values) in self.sums.iter_mut().zip(&patch.color) {
            let values = &values[q..q + width];
            let sum = &mut sum[start..start + width];
            for i in 0..width {
                sum[i] += self.distances[i] * values[i];
            }
        }
        for (sum, weight) in self.weights[start..start + width].iter_mut().zip(&self.distances) {
            *sum += weight;
        }
    }

    fn finish(self, patch: &Patch) -> Vec<[f32; 3]> {
        let average = |i: usize| {
            let p = (i / self.width + MARGIN) * patch.stride + i % self.width + MARGIN;
            let weight = self.weights[i];
            [0, 1, 2].map(|c| if weight > 0.0 { self.sums[c][i] / weight } else { patch.color[c][p] })
        };
        (0..self.width * self.height).map(average).collect()
    }
}

/// Sums over the channels of the squared difference of two pixels, less what noise explains, over that noise.
#[inline(always)]
fn color_distances(row: &mut [f32], color: &[Vec<f32>; 3], variance: &[Vec<f32>; 3], p: usize, q: usize) {
    let n = row.len();
    row.fill(0.0);
    for (color, variance) in color.iter().zip(variance) {
        let (here, there) = (&color[p..p + n], &color[q..q + n]);
        let (noise, noise_there) = (&variance[p..p + n], &variance[q..q + n]);
        for (i, d) in row.iter_mut().enumerate() {
            let difference = here[i] - there[i];
            let explained = noise[i] + noise[i].min(noise_there[i]);
            *d += (difference * difference - explained) / (noise[i] + noise_there[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::denoiser::DenoiseInput;
    use dunkelfeld_film::Plane;

    #[test]
    fn wide_registers_change_no_bit() {
        // On machines that have none both are the same code.
        let mean = Plane::from_fn(70, 40, |x, y| [0, 1, 2].map(|c| ((x * 37 + y * 101 + c * 7) % 23) as f32));
        let variance = mean.map(|v| v.map(|v| 0.3 * v + 1.0));
        let image = Image::new(&DenoiseInput { albedo: Some(&variance), ..DenoiseInput::new(&mean) });
        for tile in [Tile { x: 0, y: 0, width: 64, height: 40 }, Tile { x: 64, y: 0, width: 6, height: 40 }] {
            assert_eq!(averages(&image, &variance, &tile), averages_anywhere(&image, &variance, &tile));
        }
    }
}
