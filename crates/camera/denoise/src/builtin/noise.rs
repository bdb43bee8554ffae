//! Rare bright samples and the variance of each pixel of the mean, estimated from its neighbourhood.
//!
//! A pixel's own variance comes from few numbers, and from the samples that are averaged: a pixel without a bright
//! event has a low mean and a low variance. So half of the estimate comes from similar neighbours.
//!
//! A rare bright sample would make all pixels of its window similar to its pixel, and the window visible. So the light
//! that neither the neighbours nor the variance of its pixel support is spread over the neighbours first. The weights
//! of neighbours decrease with their distance, so that no window has a visible edge.

use fearless_simd::{Level, dispatch};

use super::lanes::{WIDTH, each, lanes, lanes_mut, maximum};
use super::patch::{Image, Patch};
use super::tiles::Tile;
use crate::denoiser::Triples;

/// Largest distance of the neighbours, two standard deviations of their weights.
const POOL_REACH: usize = 8;
/// The estimate from the image itself uses one more pixel on each side.
const MARGIN: usize = POOL_REACH + 1;
/// Light above the mean of the neighbours by this number of their standard deviations is not supported by them.
const UNSUPPORTED: f32 = 3.0;
/// The least sum of weights of neighbours that can support a pixel.
const LEAST_NEIGHBOURS: f32 = 3.0;
/// Relative differences below this are rounding errors, also from half floats in files of other programs.
const ROUNDING: f32 = 1e-4;

/// The supported share of the light of each pixel of a tile, the same for all channels. It is 1 for all pixels but those
/// with rare bright samples.
///
/// All instruction sets give the same bits: no operation is fused or reordered. This holds for [`estimates`] too.
pub(super) fn supported_shares(level: Level, image: &Image<'_>, tile: &Tile) -> Vec<[f32; 3]> {
    dispatch!(level, _ => supported_shares_with(image, tile))
}

/// The mean of each pixel of a tile with unsupported light spread over its neighbours, and the variance of the mean, both
/// in the unit of patches. A variance is never zero.
pub(super) fn estimates(level: Level, image: &Image<'_>, shares: &Triples, tile: &Tile) -> Vec<[[f32; 3]; 2]> {
    dispatch!(level, _ => estimates_with(image, shares, tile))
}

// The per-pixel functions are inlined into the code of each level.
#[inline(always)]
fn supported_shares_with(image: &Image<'_>, tile: &Tile) -> Vec<[f32; 3]> {
    let patch = image.cut(&widened(tile), MARGIN);
    let own = own_variances(image, &widened(tile), &patch);
    let sum = |planes: &[Vec<f32>; 3], p: usize| planes.iter().map(|plane| plane[p]).sum::<f32>();
    let brightness: Vec<f32> = (0..patch.known.len()).map(|p| sum(&patch.color, p)).collect();
    let squares = brightness.iter().map(|v| v * v).collect();
    pooled(&patch, tile, &[brightness, squares], false, |p, total, [mean, square]| {
        let brightness = sum(&patch.color, p);
        let deviation = (square - mean * mean).max(0.0).sqrt();
        // The deviation of the sum of channels that vary together, as those of white light.
        let own = own.iter().map(|plane| plane[p].sqrt()).sum::<f32>();
        let limit = (mean + UNSUPPORTED * deviation).max(brightness - own).max(0.0);
        [if brightness > limit && total > LEAST_NEIGHBOURS { limit / brightness } else { 1.0 }; 3]
    })
}

#[inline(always)]
fn estimates_with(image: &Image<'_>, shares: &Triples, tile: &Tile) -> Vec<[[f32; 3]; 2]> {
    let patch = image.cut(&widened(tile), MARGIN);
    let [share, ..] = image.cut_plane(shares, &widened(tile), MARGIN);
    let own = own_variances(image, &widened(tile), &patch);
    let plane = |f: &dyn Fn(usize, usize) -> f32, c: usize| (0..share.len()).map(|p| f(c, p)).collect::<Vec<f32>>();
    let excess = |c: usize, p: usize| patch.color[c][p] * (1.0 - share[p]);
    let noise = |c: usize, p: usize| own[c][p] * share[p] * share[p];
    let square = |c: usize, p: usize| (patch.color[c][p] * share[p]) * (patch.color[c][p] * share[p]);
    let planes: [Vec<f32>; 9] = std::array::from_fn(|k| match k {
        0..3 => plane(&excess, k),
        3..6 => plane(&noise, k - 3),
        _ => plane(&square, k - 6),
    });
    pooled(&patch, tile, &planes, true, |p, total, around| {
        let estimate = |c: usize| {
            let supported = patch.color[c][p] * share[p];
            if total <= 0.0 {
                return (supported, noise(c, p));
            }
            let (excess, around, squares) = (around[c], around[3 + c], around[6 + c]);
            // A pixel brighter than its neighbours is assumed to have a standard deviation in proportion to its
            // brightness.
            let in_proportion = if squares > 0.0 { (around / squares * square(c, p)).min(total * around) } else { 0.0 };
            (supported + excess, 0.5 * (noise(c, p) + around.max(in_proportion)))
        };
        let [r, g, b] = [0, 1, 2].map(estimate);
        let floor = |(color, variance): (f32, f32)| variance.max((ROUNDING * color).powi(2)).max(f32::MIN_POSITIVE);
        [[r.0, g.0, b.0], [floor(r), floor(g), floor(b)]]
    })
}

/// The tile with rows of a length that needs no slower loop for a rest.
fn widened(tile: &Tile) -> Tile {
    Tile { width: tile.width.next_multiple_of(WIDTH), ..*tile }
}

/// For each pixel of a tile, a result from its place in the patch, and from the sum of the weights of its neighbours and
/// their weighted means of the planes. The weights follow from features and distance; `with_self` includes the pixel.
#[inline(always)]
fn pooled<T, const N: usize>(
    patch: &Patch,
    tile: &Tile,
    planes: &[Vec<f32>; N],
    with_self: bool,
    result: impl Fn(usize, f32, [f32; N]) -> T,
) -> Vec<T> {
    let width = patch.stride - 2 * MARGIN;
    let mut results = Vec::with_capacity(tile.width * tile.height);
    let (mut weights, mut total) = (vec![0.0; width], vec![0.0; width]);
    let mut sums = [0; N].map(|_| vec![0.0; width]);
    let reach = POOL_REACH as isize;
    for y in 0..tile.height {
        let p = (y + MARGIN) * patch.stride + MARGIN;
        sums.iter_mut().chain([&mut total]).for_each(|sum| sum.fill(0.0));
        for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
            let square = dx * dx + dy * dy;
            if square > reach * reach || (square == 0 && !with_self) {
                continue;
            }
            let near = similarity_weight(2.0 * square as f32 / (reach * reach) as f32);
            let q = p.wrapping_add_signed(dy * patch.stride as isize + dx);
            let weights = lanes_mut(&mut weights, 0, width);
            patch.feature_distances(p, q, weights);
            let known = lanes(&patch.known, q, width);
            each!(weights, |i, distance| near * known[i] * similarity_weight(distance));
            each!(lanes_mut(&mut total, 0, width), |i, sum| sum + weights[i]);
            for (sum, plane) in sums.iter_mut().zip(planes) {
                let plane = lanes(plane, q, width);
                each!(lanes_mut(sum, 0, width), |i, sum| sum + weights[i] * plane[i]);
            }
        }
        for x in 0..tile.width {
            let mean = |k: usize| if total[x] > 0.0 { sums[k][x] / total[x] } else { 0.0 };
            results.push(result(p + x, total[x], std::array::from_fn(mean)));
        }
    }
    results
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
    use crate::denoiser::DenoiseInput;
    use dunkelfeld_film::Plane;

    const TILE: Tile = Tile { x: 0, y: 0, width: 40, height: 40 };

    fn estimated(mean: &Triples, variance: Option<&Triples>) -> Vec<[f32; 3]> {
        let image = Image::new(&DenoiseInput { variance, ..DenoiseInput::new(mean) });
        let back = image.scale().powi(-2);
        let shares = mean.map(|_| [1.0; 3]);
        estimates(Level::new(), &image, &shares, &TILE).into_iter().map(|[_, v]| v.map(|v| v * back)).collect()
    }

    #[test]
    fn wide_registers_change_no_bit() {
        // On machines without AVX2 both are the same code.
        let mean = Plane::from_fn(70, 40, |x, y| [0, 1, 2].map(|c| ((x * 37 + y * 101 + c * 7) % 23) as f32));
        let stated = mean.map(|v| v.map(|v| 0.3 * v + 1.0));
        let shares = mean.map(|v| [0.5 + v[0] / 50.0; 3]);
        for variance in [None, Some(&stated)] {
            let image = Image::new(&DenoiseInput { variance, ..DenoiseInput::new(&mean) });
            for tile in [Tile { x: 0, y: 0, width: 64, height: 40 }, Tile { x: 64, y: 0, width: 6, height: 40 }] {
                let results =
                    |level| (supported_shares(level, &image, &tile), estimates(level, &image, &shares, &tile));
                let plain = results(Level::fallback());
                for level in levels() {
                    assert_eq!(results(level), plain, "{level:?}");
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

    /// A bright pixel of one event in four batches has no support. The same pixel with a small variance is detail, and so
    /// is one of several.
    #[test]
    fn light_without_support_is_spread() {
        let image_of = |step: u32, variance: f32| {
            let is_bright = move |x: u32, y: u32| x % step == 20 % step && y % step == 20 % step;
            let mean = Plane::from_fn(40, 40, |x, y| [if is_bright(x, y) { 100.0 } else { 1.0 }; 3]);
            let variance = Plane::from_fn(40, 40, |x, y| [if is_bright(x, y) { variance } else { 0.01 }; 3]);
            let image = Image::new(&DenoiseInput { variance: Some(&variance), ..DenoiseInput::new(&mean) });
            let shares = supported_shares(Level::new(), &image, &TILE);
            let plane = Plane::from_fn(40, 40, |x, y| shares[(y * 40 + x) as usize]);
            let means = estimates(Level::new(), &image, &plane, &TILE);
            let light = means.iter().map(|[mean, _]| mean[0]).sum::<f32>() / image.scale();
            (shares[20 * 40 + 20][0], light)
        };
        let (share, light) = image_of(40, 1e4);
        assert!((share - 0.01).abs() < 1e-3, "{share}");
        // 1600 pixels of 1 and one of 99 more, all of which stays.
        assert!((light - 1699.0).abs() < 1.0, "{light}");
        assert!(image_of(40, 1.0).0 > 0.98);
        assert_eq!(image_of(2, 1e4).0, 1.0);
    }
}
