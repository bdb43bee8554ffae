//! The mean over pixels that may well be of one kind: weighted by how alike their features and their surroundings are.
//!
//! Non-local means (Buades 2005) in the form that Rousselle et al. (2012, 2013) gave it for renders: of a squared
//! difference of two pixels that much is taken away which their noise alone would make, and the rest is counted in units
//! of that noise.

use super::noise::likeness;
use super::patch::{Image, Patch};
use super::tiles::Tile;
use crate::denoiser::Triples;

/// Pixels are compared with those of a square of (2 * 8 + 1)^2.
const REACH: usize = 8;
/// Colours are compared over squares of 3 x 3 pixels.
const AROUND: usize = 1;
/// The margin of a tile.
const MARGIN: usize = REACH + AROUND;

/// What is made of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Average {
    /// The weighted mean, in the unit of patches.
    pub(super) color: [f32; 3],
    /// The share that the pixel itself has in it.
    pub(super) own_share: f32,
}

/// The averages of a tile. `variance` is that of the mean, in the unit of patches.
pub(super) fn averages(image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<Average> {
    let patch = image.cut(tile, MARGIN);
    let variance = image.cut_plane(variance, tile, MARGIN);
    let mut work = Work::new(tile);
    let reach = REACH as isize;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let offset = dy * patch.stride as isize + dx;
            work.add(&patch, &variance, offset);
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
    /// Sums over three neighbours of such rows, the last three of them.
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

    /// Adds to each pixel the one that lies `offset` further in the patch.
    fn add(&mut self, patch: &Patch, variance: &[Vec<f32>; 3], offset: isize) {
        for row in 0..self.height + 2 * AROUND {
            // The row above the tile is row 0 here.
            let p = (row + MARGIN - AROUND) * patch.stride + MARGIN - AROUND;
            color_distances(&mut self.row, &patch.color, variance, p, p.wrapping_add_signed(offset));
            let triple = &mut self.triples[row % 3];
            for ((sum, left), (middle, right)) in
                triple.iter_mut().zip(&self.row).zip(self.row[1..].iter().zip(&self.row[2..]))
            {
                *sum = left + middle + right;
            }
            if row >= 2 * AROUND {
                self.add_row(patch, row - 2 * AROUND, offset);
            }
        }
    }

    fn add_row(&mut self, patch: &Patch, row: usize, offset: isize) {
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
        let [a, b, c] = &self.triples;
        let (a, b, c) = (&a[..width], &b[..width], &c[..width]);
        let known = &patch.known[q..q + width];
        for (i, d) in self.distances.iter_mut().enumerate() {
            // Nine pixels of three channels.
            let color = (a[i] + b[i] + c[i]) * (1.0 / 27.0);
            *d = if offset == 0 { known[i] } else { known[i] * likeness(d.max(0.0) + color.max(0.0)) };
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

    fn finish(self, patch: &Patch) -> Vec<Average> {
        let average = |i: usize| {
            let p = (i / self.width + MARGIN) * patch.stride + i % self.width + MARGIN;
            let weight = self.weights[i];
            if weight > 0.0 {
                Average { color: [0, 1, 2].map(|c| self.sums[c][i] / weight), own_share: patch.known[p] / weight }
            } else {
                Average { color: [0, 1, 2].map(|c| patch.color[c][p]), own_share: 1.0 }
            }
        };
        (0..self.width * self.height).map(average).collect()
    }
}

/// Sums over the channels of the squared difference of two pixels, less what noise explains, over that noise.
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
