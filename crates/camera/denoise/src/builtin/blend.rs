//! The shares of the average and of the unbiased mean in the result, from the estimated error of the average.
//!
//! The error of the mean is its variance. The error of the average follows from its distance to the mean. Without
//! error, its squared distance would be the variance of the mean. The excess is the error of the average. The blend of
//! the two weights each by its inverse error (Graybill and Deal 1959).

use super::patch::Image;
use super::tiles::Tile;
use crate::denoiser::Triples;

/// The error of the average is estimated in squares of 5 x 5 pixels.
const REGION_REACH: usize = 2;
/// The average of a region has an error above this mean of squared differences, in units of the variance. At 2 the
/// errors of the average and of the mean are equal.
const REGION_LIMIT: f32 = 2.0;
/// Limit of a single pixel: four standard deviations, squared.
const PIXEL_LIMIT: f32 = 16.0;

/// The blend of a tile, in the unit of the input.
pub(super) fn blended(image: &Image<'_>, variance: &Triples, averages: &Triples, tile: &Tile) -> Vec<[f32; 3]> {
    let patch = image.cut_mean(tile, REGION_REACH);
    let variance = image.cut_plane(variance, tile, REGION_REACH);
    let average = image.cut_plane(averages, tile, REGION_REACH);
    // Squared difference and variance of each pixel, summed over the channels. Pixels with a filled mean have no
    // weight.
    let squares: Vec<[f32; 2]> = (0..patch.known.len())
        .map(|p| {
            let square = |c: usize| (average[c][p] - patch.color[c][p]).powi(2);
            let sums = [(0..3).map(square).sum(), (0..3).map(|c| variance[c][p]).sum()];
            if patch.known[p] > 0.0 { sums } else { [0.0; 2] }
        })
        .collect();
    let back = 1.0 / image.scale();
    let mut blend = Vec::with_capacity(tile.width * tile.height);
    for y in 0..tile.height {
        for x in 0..tile.width {
            let p = (y + REGION_REACH) * patch.stride + x + REGION_REACH;
            let mut region = [0.0f32; 2];
            for row in y..=y + 2 * REGION_REACH {
                for [square, noise] in &squares[row * patch.stride + x..][..=2 * REGION_REACH] {
                    region[0] += square;
                    region[1] += noise;
                }
            }
            let share = share(squares[p], region);
            blend.push([0, 1, 2].map(|c| {
                let (mean, average) = (patch.color[c][p], average[c][p]);
                ((mean + share * (average - mean)) * back).clamp(f32::MIN, f32::MAX)
            }));
        }
    }
    blend
}

/// The share of the average, from squared differences and variances of a pixel and of its region.
fn share(pixel: [f32; 2], region: [f32; 2]) -> f32 {
    let excess = |[square, noise]: [f32; 2], limit: f32| if noise > 0.0 { square / noise - limit } else { 0.0 };
    1.0 / (1.0 + excess(pixel, PIXEL_LIMIT).max(excess(region, REGION_LIMIT)).max(0.0))
}
