//! A tile and its neighbourhood, channel by channel, with finite values in a safe range.

use std::borrow::Cow;

use dunkelfeld_film::{Plane, fill_gaps};

use super::lanes::{each, lanes, maximum};
use super::tiles::Tile;
use crate::denoiser::{DenoiseInput, Triples};

/// The largest magnitude, after scaling to a mean of about 1. With it, squares and their sums stay finite.
const LARGEST: f32 = 1e12;
/// Tolerances of feature differences: albedo and normal absolute, depth relative.
const TOLERANCE: [f32; 3] = [0.04, 0.02, 0.005];
/// Share of a feature's squared slope that is added to the tolerance. Along an edge, pixels contain slightly different
/// parts of both sides, and are similar nevertheless.
const SLOPE: f32 = 0.4;
/// Upper bound of the precision of a feature. With it, the product with a squared difference of features stays finite.
const SHARPEST: f32 = 1e12;

/// A whole input image, in a unit in which its mean is about 1, and with finite values only.
pub(super) struct Image<'a> {
    input: DenoiseInput<'a>,
    mean: Cow<'a, Triples>,
    /// The scaled value is the value times this power of two.
    scale: f32,
}

/// One feature of a patch.
pub(super) struct Feature {
    pub(super) values: Vec<f32>,
    /// The inverse of the tolerated squared difference.
    pub(super) precision: Vec<f32>,
}

/// A tile with a margin on all sides. Outside the image the margin repeats the nearest pixel, with `known` 0.
pub(super) struct Patch {
    /// Length of a row, margins included.
    pub(super) stride: usize,
    /// Number of rows, margins included.
    pub(super) rows: usize,
    /// Width of the margin.
    pub(super) margin: usize,
    /// Mean radiance in the unit of [`Image`], per channel.
    pub(super) color: [Vec<f32>; 3],
    /// 1 if the image has a finite mean at the pixel, otherwise 0.
    pub(super) known: Vec<f32>,
    /// Those of albedo, normal and depth that were given.
    pub(super) features: Vec<Feature>,
    /// The expected distance in features from noise alone: the sum over them of noise times precision.
    pub(super) explained: Vec<f32>,
}

impl<'a> Image<'a> {
    /// Takes an input that was checked ([`DenoiseInput::check`]).
    pub(super) fn new(input: &DenoiseInput<'a>) -> Self {
        let known = input.mean.map(|v| v.iter().all(|v| v.is_finite()));
        let mean = if known.data().contains(&false) {
            let zeroed = input.mean.map(|v| if v.iter().all(|v| v.is_finite()) { *v } else { [0.0; 3] });
            Cow::Owned(fill_gaps(&zeroed, &known))
        } else {
            Cow::Borrowed(input.mean)
        };
        let total: f64 = mean.data().iter().flatten().map(|v| f64::from(v.abs())).sum();
        let average = total / (3 * mean.data().len()).max(1) as f64;
        let exponent = if average > 0.0 { -average.log2().round().clamp(-100.0, 100.0) } else { 0.0 };
        Self { input: *input, mean, scale: exponent.exp2() as f32 }
    }

    /// The same image with another mean, given in the unit of patches.
    pub(super) fn with_mean(&self, mean: &Triples) -> Self {
        let back = 1.0 / self.scale;
        Self { mean: Cow::Owned(mean.map(|v| v.map(|v| v * back))), ..*self }
    }

    /// The factor from values to the unit of patches.
    pub(super) fn scale(&self) -> f32 {
        self.scale
    }

    /// Width and height.
    pub(super) fn size(&self) -> (u32, u32) {
        (self.mean.width(), self.mean.height())
    }

    /// The variance of the mean of a pixel from the input, in the unit of patches. `None` for channels without a valid
    /// variance.
    pub(super) fn stated_variance(&self, x: u32, y: u32) -> [Option<f32>; 3] {
        let Some(variance) = self.input.variance else { return [None; 3] };
        variance.at(x, y).map(|v| {
            let scaled = f64::from(v) * f64::from(self.scale).powi(2);
            (v.is_finite() && v >= 0.0).then_some((scaled as f32).min(LARGEST))
        })
    }

    /// Copies the tile and `margin` pixels around it.
    pub(super) fn cut(&self, tile: &Tile, margin: usize) -> Patch {
        let mut patch = self.cut_mean(tile, margin);
        let frame = Frame::new(self.size(), tile, margin);
        let (features, explained) = (&mut patch.features, &mut patch.explained);
        let triples =
            [(self.input.albedo, self.input.albedo_variance), (self.input.normal, self.input.normal_variance)];
        for ((values, variance), tolerance) in triples.into_iter().zip(TOLERANCE) {
            let Some(values) = values else { continue };
            let values = frame.channels(values, |v| finite(v).clamp(-10.0, 10.0));
            let variance = variance.map(|plane| frame.channels(plane, |v| finite(v).clamp(0.0, 10.0)));
            for (c, values) in values.into_iter().enumerate() {
                let variance = variance.as_ref().map(|v| v[c].as_slice());
                // Three channels together have the weight of one depth.
                features.push(Feature::new(&frame, values, variance, |_| tolerance, 1.0 / 3.0, explained));
            }
        }
        if let Some(depth) = self.input.depth {
            let values = frame.collect(depth, |z| finite(*z).clamp(0.0, LARGEST));
            let variance = self.input.depth_variance;
            let variance = variance.map(|plane| frame.collect(plane, |v| finite(*v).clamp(0.0, LARGEST)));
            features.push(Feature::new(&frame, values, variance.as_deref(), |z| TOLERANCE[2] * z, 1.0, explained));
        }
        patch
    }

    /// The same without features.
    pub(super) fn cut_mean(&self, tile: &Tile, margin: usize) -> Patch {
        let frame = Frame::new(self.size(), tile, margin);
        let color = frame.channels(&self.mean, |v| (v * self.scale).clamp(-LARGEST, LARGEST));
        let known = frame.marks(self.input.mean, |v| v.iter().all(|v| v.is_finite()));
        let explained = vec![0.0; known.len()];
        Patch { stride: frame.stride, rows: frame.rows, margin, color, known, features: Vec::new(), explained }
    }

    /// Copies the same part of another plane of triples of the image, channel by channel.
    pub(super) fn cut_plane(&self, plane: &Triples, tile: &Tile, margin: usize) -> [Vec<f32>; 3] {
        Frame::new(self.size(), tile, margin).channels(plane, |v| v)
    }
}

impl Patch {
    /// Distances in features between the pixels from `p` on and those from `q` on, pairwise. A distance is 0 if noise
    /// alone may explain it.
    #[inline(always)]
    pub(super) fn feature_distances(&self, p: usize, q: usize, distances: &mut [f32]) {
        let n = distances.len();
        let explained = lanes(&self.explained, p, n);
        each!(distances, |i, _| -explained[i]);
        for feature in &self.features {
            let (here, there) = (lanes(&feature.values, p, n), lanes(&feature.values, q, n));
            let precision = lanes(&feature.precision, p, n);
            each!(distances, |i, sum| {
                let difference = here[i] - there[i];
                sum + difference * difference * precision[i]
            });
        }
        each!(distances, |i, sum| maximum(sum, 0.0));
    }
}

impl Feature {
    /// Adds to `explained` the part of distances in this feature that noise explains.
    fn new(
        frame: &Frame,
        values: Vec<f32>,
        variance: Option<&[f32]>,
        tolerance: impl Fn(f32) -> f32,
        weight: f32,
        explained: &mut [f32],
    ) -> Self {
        let (stride, last) = (frame.stride, frame.rows - 1);
        let mut precision = Vec::with_capacity(values.len());
        for y in 0..frame.rows {
            for x in 0..stride {
                let at = |x: usize, y: usize| values[y * stride + x];
                let across = (at((x + 1).min(stride - 1), y) - at(x.saturating_sub(1), y)) / 2.0;
                let down = (at(x, (y + 1).min(last)) - at(x, y.saturating_sub(1))) / 2.0;
                let slope = SLOPE * (across * across + down * down);
                let both = variance.map_or(0.0, |v| 2.0 * v[y * stride + x]);
                let tolerated = tolerance(at(x, y)).powi(2).max(slope).max(both);
                let inverse = (weight / tolerated).min(SHARPEST);
                explained[y * stride + x] += both * inverse;
                precision.push(inverse);
            }
        }
        Self { values, precision }
    }
}

/// The pixels of an image in a patch.
struct Frame {
    size: (u32, u32),
    corner: (i64, i64),
    stride: usize,
    rows: usize,
}

impl Frame {
    fn new(size: (u32, u32), tile: &Tile, margin: usize) -> Self {
        let corner = (i64::from(tile.x) - margin as i64, i64::from(tile.y) - margin as i64);
        Self { size, corner, stride: tile.width + 2 * margin, rows: tile.height + 2 * margin }
    }

    /// One number per pixel of the patch, from the nearest pixel of the image.
    fn collect<T>(&self, plane: &Plane<T>, f: impl Fn(&T) -> f32) -> Vec<f32> {
        let mut values = Vec::with_capacity(self.stride * self.rows);
        let (width, height) = (self.size.0 as usize, i64::from(self.size.1));
        let (first, left, right) = self.columns();
        for row in 0..self.rows as i64 {
            let y = (self.corner.1 + row).clamp(0, height - 1) as usize;
            let source = &plane.data()[y * width..][..width];
            let inside = &source[first..first + self.stride - left - right];
            values.extend(std::iter::repeat_n(f(&source[0]), left));
            values.extend(inside.iter().map(&f));
            values.extend(std::iter::repeat_n(f(&source[width - 1]), right));
        }
        values
    }

    fn channels(&self, plane: &Plane<[f32; 3]>, f: impl Fn(f32) -> f32) -> [Vec<f32>; 3] {
        [0, 1, 2].map(|c| self.collect(plane, |v| f(v[c])))
    }

    /// The first column of the image in the patch, and the numbers of columns of the patch to the left and right of the
    /// image.
    fn columns(&self) -> (usize, usize, usize) {
        let (start, end) = (self.corner.0, self.corner.0 + self.stride as i64);
        let outside = (end - i64::from(self.size.0)).max(0);
        (start.max(0) as usize, (-start).max(0) as usize, outside as usize)
    }

    /// 1 if `known` is true for a pixel, 0 otherwise and outside the image.
    fn marks(&self, plane: &Plane<[f32; 3]>, known: impl Fn(&[f32; 3]) -> bool) -> Vec<f32> {
        let mut marks = self.collect(plane, |v| if known(v) { 1.0 } else { 0.0 });
        let (_, left, right) = self.columns();
        for (row, marks) in marks.chunks_mut(self.stride).enumerate() {
            if (0..i64::from(self.size.1)).contains(&(self.corner.1 + row as i64)) {
                marks[..left].fill(0.0);
                marks[self.stride - right..].fill(0.0);
            } else {
                marks.fill(0.0);
            }
        }
        marks
    }
}

fn finite(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}
