//! The variance of each pixel of the mean, estimated from its neighbourhood.
//!
//! A pixel's own variance comes from few numbers, and from the samples that are averaged: a pixel without a bright
//! event has a low mean and a low variance. So half of the estimate comes from similar neighbours.

use fearless_simd::{Level, dispatch};

use super::lanes::{WIDTH, each, lanes, lanes_mut, maximum};
use super::patch::{Image, Patch};
use super::tiles::Tile;

/// Variances are pooled over squares of 7 x 7 pixels.
pub(super) const POOL_REACH: usize = 3;
/// A pixel brighter than its neighbours is assumed to have a standard deviation in proportion to its brightness. This
/// is the used share of the variance that follows.
const PROPORTION: f32 = 1.0;
/// Relative differences below this are rounding errors, also from half floats in files of other programs.
const ROUNDING: f32 = 1e-4;

/// The variance of the mean of each pixel of a tile, in the unit of patches. Never zero.
///
/// All instruction sets give the same bits: no operation is fused or reordered.
pub(super) fn variances(level: Level, image: &Image<'_>, tile: &Tile) -> Vec<[f32; 3]> {
    dispatch!(level, _ => variances_with(image, tile))
}

// The per-pixel functions are inlined into the code of each level.
#[inline(always)]
fn variances_with(image: &Image<'_>, tile: &Tile) -> Vec<[f32; 3]> {
    // The estimate from the image itself uses one more pixel on each side.
    let margin = POOL_REACH + 1;
    let width = tile.width.next_multiple_of(WIDTH);
    let wide = Tile { width, ..*tile };
    let patch = image.cut(&wide, margin);
    let own = own_variances(image, &wide, &patch);
    let mut pooled = Vec::with_capacity(tile.width * tile.height);
    let mut weights = vec![0.0; width];
    let mut total = vec![0.0; width];
    let mut noise = [0; 3].map(|_| vec![0.0; width]);
    let mut squares = [0; 3].map(|_| vec![0.0; width]);
    for y in 0..tile.height {
        let p = (y + margin) * patch.stride + margin;
        for sum in noise.iter_mut().chain(&mut squares).chain([&mut total]) {
            sum.fill(0.0);
        }
        for dy in 0..=2 * POOL_REACH {
            for dx in 0..=2 * POOL_REACH {
                let q = (y + 1 + dy) * patch.stride + 1 + dx;
                let weights = lanes_mut(&mut weights, 0, width);
                patch.feature_distances(p, q, weights);
                let known = lanes(&patch.known, q, width);
                each!(weights, |i, distance| known[i] * similarity_weight(distance));
                each!(lanes_mut(&mut total, 0, width), |i, sum| sum + weights[i]);
                for c in 0..3 {
                    let (own, color) = (lanes(&own[c], q, width), lanes(&patch.color[c], q, width));
                    each!(lanes_mut(&mut noise[c], 0, width), |i, sum| sum + weights[i] * own[i]);
                    let square = |i: usize| color[i] * color[i];
                    each!(lanes_mut(&mut squares[c], 0, width), |i, sum| sum + weights[i] * square(i));
                }
            }
        }
        pooled.extend((0..tile.width).map(|x| {
            let variance = |c: usize| {
                let (own, color) = (own[c][p + x], patch.color[c][p + x]);
                let (noise, square) = (noise[c][x], squares[c][x]);
                let around = if total[x] > 0.0 { noise / total[x] } else { own };
                let in_proportion = if square > 0.0 { (noise / square * color * color).min(noise) } else { 0.0 };
                let variance = 0.5 * (own + around.max(PROPORTION * in_proportion));
                variance.max((ROUNDING * color).powi(2)).max(f32::MIN_POSITIVE)
            };
            [variance(0), variance(1), variance(2)]
        }));
    }
    pooled
}

/// An approximation of exp(-d) for d >= 0. Zero beyond 8.
#[inline(always)]
pub(super) fn similarity_weight(d: f32) -> f32 {
    let root = maximum(1.0 - d * 0.125, 0.0);
    let square = root * root;
    let fourth = square * square;
    fourth * fourth
}

/// The given variances if there are any, otherwise an estimate from the image: the squared response to a mask. The mask
/// has no response to slopes and to straight edges along rows and columns (Immerkaer 1996).
fn own_variances(image: &Image<'_>, tile: &Tile, patch: &Patch) -> [Vec<f32>; 3] {
    let (width, height) = image.size();
    let mut own = [0; 3].map(|_| vec![0.0; patch.stride * patch.rows]);
    let place = |start: u32, i: usize, end: u32| {
        (i64::from(start) + i as i64 - patch.margin as i64).clamp(0, i64::from(end) - 1) as u32
    };
    for row in 0..patch.rows {
        for column in 0..patch.stride {
            let stated = image.stated_variance(place(tile.x, column, width), place(tile.y, row, height));
            for (c, (own, stated)) in own.iter_mut().zip(stated).enumerate() {
                own[row * patch.stride + column] = stated.unwrap_or_else(|| from_image(patch, c, column, row));
            }
        }
    }
    own
}

fn from_image(patch: &Patch, channel: usize, column: usize, row: usize) -> f32 {
    const MASK: [f32; 3] = [1.0, -2.0, 1.0];
    let mut response = 0.0;
    for (dy, down) in MASK.into_iter().enumerate() {
        for (dx, across) in MASK.into_iter().enumerate() {
            let x = (column + dx).saturating_sub(1).min(patch.stride - 1);
            let y = (row + dy).saturating_sub(1).min(patch.rows - 1);
            response += across * down * patch.color[channel][y * patch.stride + x];
        }
    }
    response * response / 36.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::lanes::levels;
    use crate::denoiser::{DenoiseInput, Triples};
    use dunkelfeld_film::Plane;

    const TILE: Tile = Tile { x: 0, y: 0, width: 40, height: 40 };

    fn estimated(mean: &Triples, variance: Option<&Triples>) -> Vec<[f32; 3]> {
        let image = Image::new(&DenoiseInput { variance, ..DenoiseInput::new(mean) });
        let back = image.scale().powi(-2);
        variances(Level::new(), &image, &TILE).into_iter().map(|v| v.map(|v| v * back)).collect()
    }

    #[test]
    fn wide_registers_change_no_bit() {
        // On machines without AVX2 both are the same code.
        let mean = Plane::from_fn(70, 40, |x, y| [0, 1, 2].map(|c| ((x * 37 + y * 101 + c * 7) % 23) as f32));
        let stated = mean.map(|v| v.map(|v| 0.3 * v + 1.0));
        let bits = |values: Vec<[f32; 3]>| values.into_iter().map(|v| v.map(f32::to_bits)).collect::<Vec<_>>();
        for variance in [None, Some(&stated)] {
            let image = Image::new(&DenoiseInput { variance, ..DenoiseInput::new(&mean) });
            for tile in [Tile { x: 0, y: 0, width: 64, height: 40 }, Tile { x: 64, y: 0, width: 6, height: 40 }] {
                let plain = bits(variances(Level::fallback(), &image, &tile));
                for level in levels() {
                    assert_eq!(bits(variances(level, &image, &tile)), plain, "{level:?}");
                }
            }
        }
    }

    #[test]
    fn slopes_and_upright_edges_are_no_noise() {
        let mean = Plane::from_fn(40, 40, |x, y| [x as f32 + 2.0 * y as f32, if x < 11 { 1.0 } else { 9.0 }, 5.0]);
        for (i, variance) in estimated(&mean, None).into_iter().enumerate() {
            // At the outermost pixels the mask reaches beyond the image.
            if (3..37).contains(&(i % 40)) && (3..37).contains(&(i / 40)) {
                assert!(variance.iter().all(|v| *v < 1e-3), "{variance:?} at {i}");
            }
        }
    }

    #[test]
    fn noise_is_estimated_from_an_image_without_variances() {
        // Uniform in [0, 1): variance 1/12. The mean over 1600 estimates of correlated squares has an error of a few
        // per cent.
        let mut state = 1u64;
        let mean = Plane::from_fn(40, 40, |_, _| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            [10.0 + (state >> 40) as f32 / (1u32 << 24) as f32; 3]
        });
        let estimates = estimated(&mean, None);
        let average = estimates.iter().map(|v| f64::from(v[0])).sum::<f64>() / estimates.len() as f64;
        assert!((average * 12.0 - 1.0).abs() < 0.2, "{average}, expected 1/12");
    }

    #[test]
    fn a_pixel_that_missed_an_event_learns_of_it_from_its_neighbours() {
        let mean = Plane::new(40, 40, [1.0; 3]);
        // One pixel in nine has a variance.
        let variance = Plane::from_fn(40, 40, |x, y| [if x % 3 == 0 && y % 3 == 0 { 9.0 } else { 0.0 }; 3]);
        for (i, v) in estimated(&mean, Some(&variance)).into_iter().enumerate() {
            assert!(v[0] > 0.2, "{v:?} at {i}");
        }
    }

    #[test]
    fn similarity_weight_is_exponential() {
        assert_eq!(
            (similarity_weight(0.0), similarity_weight(8.0), similarity_weight(1e9), similarity_weight(f32::INFINITY)),
            (1.0, 0.0, 0.0, 0.0)
        );
        for d in [0.1f32, 0.5, 1.0, 2.0, 4.0] {
            let (near, exact) = (similarity_weight(d), (-d).exp());
            assert!(near <= exact && near > exact - 0.05, "{near} for exp(-{d}) = {exact}");
        }
    }
}
