//! Weighted averages of similar pixels. The weights follow from the similarity of their features and of their
//! neighbourhoods.
//!
//! The method is non-local means (Buades 2005) in the form of Rousselle et al. (2012, 2013) for renders. The expected
//! difference from noise is subtracted from the squared difference of two pixels, and the rest is divided by the
//! variance of that noise. The result is no mean, but the value at the pixel of a plane that is fitted to the pixels
//! around it (`plane`).

use fearless_simd::{Level, Simd, dispatch};

use super::lanes::{WIDTH, each, lanes, lanes_mut, maximum, minimum};
use super::noise::similarity_weight;
use super::patch::{Image, Patch};
use super::plane::Moments;
use super::tiles::Tile;
use crate::denoiser::Triples;

/// Largest distance of compared pixels. They form a disc. This and the bandwidth have the least error against a reference.
const REACH: usize = 8;
/// A squared difference of colour has distance one if it is this many times its variance.
const BANDWIDTH: f32 = 2.0;
/// Largest ratio of the variance of a pixel to that of the pixel to which it is compared. With it, a very uncertain
/// pixel is not similar to all others.
const MAX_VARIANCE_RATIO: f32 = 100.0;
/// Share of a weight that comes from the neighbours of both pixels. A pixel with a large error is similar to none, but
/// its neighbours are similar to others.
const NEIGHBOUR_SHARE: f32 = 0.15;
/// Sum of the mask for colour differences: squares of 3 x 3 pixels with weights 1 2 1, 2 8 2, 1 2 1.
const MASK: f32 = 20.0;
/// The mask reaches one pixel, and the weights of neighbours one more.
const AROUND: usize = 2;
/// The margin of a tile.
const MARGIN: usize = REACH + AROUND;

/// The averages of a tile. All values are in the unit of patches. `variance` is that of the mean.
///
/// All instruction sets give the same bits: no operation is fused or reordered.
pub(super) fn averages(level: Level, image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    dispatch!(level, simd => averages_with(simd, image, variance, tile))
}

// The per-pixel functions are inlined into the code of each level.
#[inline(always)]
fn averages_with<S: Simd>(simd: S, image: &Image<'_>, variance: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    // All rows have the length of the longest. The results at their ends are not used.
    let width = (tile.width + 2 * AROUND).next_multiple_of(WIDTH);
    let wide = Tile { width, ..*tile };
    let patch = image.cut(&wide, MARGIN);
    let variance = image.cut_plane(variance, &wide, MARGIN);
    let mut moments = Moments::new(width, tile.height);
    let mut work = Work::new(width);
    let reach = REACH as isize;
    let corner = MARGIN * patch.stride + MARGIN;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            // The weight decreases towards the rim, so that a bright pixel leaves no visible square.
            let spatial_weight = 1.0 - (dx * dx + dy * dy) as f32 / ((reach + 1) * (reach + 1)) as f32;
            if spatial_weight <= 0.0 {
                continue;
            }
            let offset = dy * patch.stride as isize + dx;
            // Row 0 here is the row two above the tile.
            for row in 0..tile.height + 2 * AROUND {
                let p = corner + row * patch.stride - AROUND * (patch.stride + 1);
                work.compare_colors(row, &patch.color, &variance, p, p.wrapping_add_signed(offset));
                if row >= 2 * AROUND {
                    let y = row - 2 * AROUND;
                    let p = corner + y * patch.stride;
                    let q = p.wrapping_add_signed(offset);
                    work.weigh(row, &patch, p, q, spatial_weight);
                    moments.add(simd, y, &work.weights, dx as f32, &patch.color, q);
                }
            }
        }
        moments.close_line(dy as f32);
    }
    let mut averages = Vec::with_capacity(tile.width * tile.height);
    for y in 0..tile.height {
        for x in 0..tile.width {
            let p = corner + y * patch.stride + x;
            let pixel = [0, 1, 2].map(|c| (patch.color[c][p], variance[c][p]));
            averages.push(moments.value(x, y, pixel));
        }
    }
    averages
}

/// Buffers for a few rows of one offset at a time.
struct Work {
    width: usize,
    /// Colour distances of a row, from two pixels left of the tile on.
    distances: Vec<f32>,
    /// For the last three such rows: sums over three neighbours, weighted 1 2 1 and 1 4 1.
    outer: [Vec<f32>; 3],
    inner: [Vec<f32>; 3],
    /// Similarities of colours of the last three rows, from one pixel left of the tile on.
    alike: [Vec<f32>; 3],
    /// Distances in features of a row, replaced by its weights.
    weights: Vec<f32>,
}

impl Work {
    fn new(width: usize) -> Self {
        let zeros = |n: usize| vec![0.0f32; n];
        let rows = |n: usize| [0; 3].map(|_| zeros(n));
        // Sums over three neighbours at the end of a row need two more values.
        let (outer, inner, alike) = (rows(width), rows(width), rows(width + 2));
        Self { width, distances: zeros(width + 2), outer, inner, alike, weights: zeros(width) }
    }

    /// Adds one row of colours. `alike` then contains the row before it.
    #[inline(always)]
    fn compare_colors(&mut self, row: usize, color: &[Vec<f32>; 3], variance: &[Vec<f32>; 3], p: usize, q: usize) {
        let n = self.width;
        color_distances(lanes_mut(&mut self.distances, 0, n), color, variance, p, q);
        let (left, middle) = (lanes(&self.distances, 0, n), lanes(&self.distances, 1, n));
        let right = lanes(&self.distances, 2, n);
        let inner = lanes_mut(&mut self.inner[row % 3], 0, n);
        each!(inner, |i, _| left[i] + 4.0 * middle[i] + right[i]);
        each!(lanes_mut(&mut self.outer[row % 3], 0, n), |i, _| left[i] + 2.0 * middle[i] + right[i]);
        let (above, below) = (lanes(&self.outer[(row + 1) % 3], 0, n), lanes(&self.outer[row % 3], 0, n));
        let middle = lanes(&self.inner[(row + 2) % 3], 0, n);
        each!(lanes_mut(&mut self.alike[row % 3], 0, n), |i, _| {
            // The distance is the mean of three channels.
            let distance = (above[i] + 2.0 * middle[i] + below[i]) * (1.0 / (3.0 * MASK * BANDWIDTH));
            similarity_weight(maximum(distance, 0.0))
        });
    }

    /// The weights, at most `spatial_weight`, of the pixels from `q` on for those from `p` on.
    #[inline(always)]
    fn weigh(&mut self, row: usize, patch: &Patch, p: usize, q: usize, spatial_weight: f32) {
        let n = self.width;
        let known = lanes(&patch.known, q, n);
        let weights = lanes_mut(&mut self.weights, 0, n);
        if p == q {
            each!(weights, |i, _| known[i]);
            return;
        }
        patch.feature_distances(p, q, weights);
        let (above, middle, below) = (&self.alike[(row + 1) % 3], &self.alike[(row + 2) % 3], &self.alike[row % 3]);
        // Nine neighbours, a b c, d e f, g h j. They are single variables, since compilers cannot derive the lengths of
        // slices in arrays.
        let (a, b, c) = (lanes(above, 0, n), lanes(above, 1, n), lanes(above, 2, n));
        let (d, e, f) = (lanes(middle, 0, n), lanes(middle, 1, n), lanes(middle, 2, n));
        let (g, h, j) = (lanes(below, 0, n), lanes(below, 1, n), lanes(below, 2, n));
        each!(weights, |i, distance| {
            let corners = a[i] + c[i] + g[i] + j[i];
            let sides = b[i] + d[i] + f[i] + h[i];
            let own = e[i];
            let around = (corners + 2.0 * sides + 4.0 * own) * (1.0 / 16.0);
            spatial_weight * known[i] * similarity_weight(distance) * (own + NEIGHBOUR_SHARE * (around - own))
        });
    }
}

/// Sums over the channels: the squared difference of two pixels less the expected difference from noise, over the
/// variance of that noise.
#[inline(always)]
fn color_distances(row: &mut [f32], color: &[Vec<f32>; 3], variance: &[Vec<f32>; 3], p: usize, q: usize) {
    let n = row.len();
    row.fill(0.0);
    for (color, variance) in color.iter().zip(variance) {
        let (here, there) = (lanes(color, p, n), lanes(color, q, n));
        let (noise, noise_there) = (lanes(variance, p, n), lanes(variance, q, n));
        each!(row, |i, sum| {
            let difference = here[i] - there[i];
            let explained = noise[i] + minimum(noise[i], noise_there[i]);
            let unit = noise[i] + minimum(noise_there[i], MAX_VARIANCE_RATIO * noise[i]);
            sum + (difference * difference - explained) / unit
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::lanes::levels;
    use crate::denoiser::DenoiseInput;
    use dunkelfeld_film::Plane;

    #[test]
    fn no_instruction_set_changes_a_bit() {
        let mean = Plane::from_fn(70, 40, |x, y| [0, 1, 2].map(|c| ((x * 37 + y * 101 + c * 7) % 23) as f32));
        let variance = mean.map(|v| v.map(|v| 0.3 * v + 1.0));
        let image = Image::new(&DenoiseInput { albedo: Some(&variance), ..DenoiseInput::new(&mean) });
        for tile in [Tile { x: 0, y: 0, width: 64, height: 40 }, Tile { x: 64, y: 0, width: 6, height: 40 }] {
            let bits = |values: Vec<[f32; 3]>| values.into_iter().map(|v| v.map(f32::to_bits)).collect::<Vec<_>>();
            let plain = bits(averages(Level::fallback(), &image, &variance, &tile));
            for level in levels() {
                assert_eq!(bits(averages(level, &image, &variance, &tile)), plain, "{level:?}");
            }
        }
    }
}
