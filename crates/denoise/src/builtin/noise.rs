//! How noisy each pixel of the mean is, asked of its neighbourhood.
//!
//! A pixel's own variance comes from few numbers, and from the very samples that are averaged: a pixel that missed a
//! bright event has a low mean and a low variance. So half of what is believed comes from neighbours that look alike.

use super::patch::{Image, Patch};
use super::tiles::Tile;

/// Variances are pooled over squares of 7 x 7 pixels.
pub(super) const POOL_REACH: usize = 3;
/// A difference of this share of a value is no difference: rounding, and half floats in files of others.
const ROUNDING: f32 = 1e-4;

/// The variance of the mean of each pixel of a tile, in the unit of patches; never zero.
pub(super) fn variances(image: &Image<'_>, tile: &Tile) -> Vec<[f32; 3]> {
    // The estimate from the image itself looks one pixel further.
    let margin = POOL_REACH + 1;
    let patch = image.cut(tile, margin);
    let own = own_variances(image, tile, &patch);
    let mut pooled = Vec::with_capacity(tile.width * tile.height);
    for y in 0..tile.height {
        for x in 0..tile.width {
            let p = (y + margin) * patch.stride + x + margin;
            let mut sum = [0.0; 3];
            let mut total = 0.0;
            for qy in y + 1..=y + 1 + 2 * POOL_REACH {
                for qx in x + 1..=x + 1 + 2 * POOL_REACH {
                    let q = qy * patch.stride + qx;
                    let weight = patch.known[q] * likeness(patch.feature_distance(p, q));
                    total += weight;
                    for c in 0..3 {
                        sum[c] += weight * own[q][c];
                    }
                }
            }
            let floor = |c: usize| (ROUNDING * patch.color[c][p]).powi(2).max(f32::MIN_POSITIVE);
            pooled.push([0, 1, 2].map(|c| {
                let around = if total > 0.0 { sum[c] / total } else { own[p][c] };
                (0.5 * (own[p][c] + around)).max(floor(c))
            }));
        }
    }
    pooled
}

/// exp(-d), nearly, for d >= 0, and nothing at all beyond 8.
#[inline(always)]
pub(super) fn likeness(d: f32) -> f32 {
    let root = (1.0 - d * 0.125).max(0.0);
    let square = root * root;
    let fourth = square * square;
    fourth * fourth
}

impl Patch {
    /// How unlike two pixels are in their features: 0 where nothing but noise may tell them apart.
    fn feature_distance(&self, p: usize, q: usize) -> f32 {
        let term = |f: &super::patch::Feature| {
            let difference = f.values[p] - f.values[q];
            (difference * difference - f.noise[p]) * f.precision[p]
        };
        self.features.iter().map(term).sum::<f32>().max(0.0)
    }
}

/// The stated variances where there are any, and elsewhere an estimate from the image: the squared response to a mask
/// that is blind to slopes and to straight edges along rows and columns (Immerkaer 1996).
fn own_variances(image: &Image<'_>, tile: &Tile, patch: &Patch) -> Vec<[f32; 3]> {
    let (width, height) = image.size();
    let mut own = vec![[0.0; 3]; patch.stride * patch.rows];
    for (p, value) in own.iter_mut().enumerate() {
        let (column, row) = (p % patch.stride, p / patch.stride);
        let place = |start: u32, i: usize, end: u32| {
            (i64::from(start) + i as i64 - patch.margin as i64).clamp(0, i64::from(end) - 1) as u32
        };
        let stated = image.stated_variance(place(tile.x, column, width), place(tile.y, row, height));
        *value = [0, 1, 2].map(|c| stated[c].unwrap_or_else(|| from_image(patch, c, column, row)));
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
