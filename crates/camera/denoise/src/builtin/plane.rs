//! A plane fitted to the pixels around a pixel. It gives the value at the centre if brightness changes along the image.
//!
//! A mean of pixels on one side of a slope, or on the flank of a highlight, is biased to that side. A weighted
//! least-squares fit of value, horizontal slope and vertical slope is not (local linear regression, Cleveland 1979).
//! Unnecessary slopes are reduced by a small penalty (Hoerl and Kennard 1970), and if noise alone would tilt the plane
//! as much.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use super::lanes::{EIGHT, lanes, lanes_mut, read8};

/// Distances per pixel: the unit of distance is five pixels, about the middle of the reach.
const UNIT: f32 = 1.0 / 5.0;
/// Penalty on squared slopes: that of this number of pixels without slope at a distance of one unit.
const RIDGE: f32 = 0.3;
/// A squared correction of this many times its variance from noise is applied by half.
const SHRINKAGE: f32 = 2.0;

/// Weighted sums over the pixels around each pixel of a tile.
pub(super) struct Moments {
    width: usize,
    /// Sums over the pixels in one row of the neighbourhood, for all rows of the tile: weights, weights times the
    /// horizontal distance, and weights times its square. Then, per channel, weight times colour, and this times the
    /// distance.
    line: [Vec<f32>; LINE],
    /// The same sums of all rows, with the vertical distance: 1, u, v, uu, uv, vv; then 1, u, v per channel.
    all: [Vec<f32>; ALL],
}

const LINE: usize = 9;
const ALL: usize = 15;

impl Moments {
    /// Moments of `height` rows with `width` numbers each, a multiple of eight.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let zeros = || vec![0.0f32; width * height];
        Self { width, line: [0; LINE].map(|_| zeros()), all: [0; ALL].map(|_| zeros()) }
    }

    /// Adds pixels to each pixel of a row. `weights` are those of the pixels `across` to the right of it, whose colours
    /// start at `q`.
    #[inline(always)]
    pub(super) fn add<S: Simd>(
        &mut self,
        simd: S,
        row: usize,
        weights: &[f32],
        across: f32,
        color: &[Vec<f32>; 3],
        q: usize,
    ) {
        let (n, start) = (self.width, row * self.width);
        let u = f32x8::splat(simd, UNIT * across);
        let uu = u * u;
        let weights = lanes(weights, 0, n);
        let [red, green, blue] = color;
        let (red, green, blue) = (lanes(red, q, n), lanes(green, q, n), lanes(blue, q, n));
        let line = self.line.each_mut().map(|sums| lanes_mut(sums, start, n));
        let mut at = 0;
        while at + EIGHT <= n {
            let w = read8(simd, weights, at);
            let [r, g, b] = [w * read8(simd, red, at), w * read8(simd, green, at), w * read8(simd, blue, at)];
            let terms = [w, w * u, w * uu, r, r * u, g, g * u, b, b * u];
            for k in 0..LINE {
                let sums = &mut line[k][at..at + EIGHT];
                (f32x8::from_slice(simd, sums) + terms[k]).store_slice(sums);
            }
            at += EIGHT;
        }
    }

    /// Adds the current line to the sums. Its pixels lie `down` rows below.
    #[inline(always)]
    pub(super) fn close_line(&mut self, down: f32) {
        let v = UNIT * down;
        // The sum of a line, the sum of all rows to which it is added, and its power of v.
        const WAYS: [(usize, usize, i32); ALL] = [
            (0, 0, 0),
            (1, 1, 0),
            (0, 2, 1),
            (2, 3, 0),
            (1, 4, 1),
            (0, 5, 2),
            (3, 6, 0),
            (4, 7, 0),
            (3, 8, 1),
            (5, 9, 0),
            (6, 10, 0),
            (5, 11, 1),
            (7, 12, 0),
            (8, 13, 0),
            (7, 14, 1),
        ];
        for (from, to, power) in WAYS {
            let factor = v.powi(power);
            for (sum, part) in self.all[to].iter_mut().zip(&self.line[from]) {
                *sum += factor * part;
            }
        }
        for part in &mut self.line {
            part.fill(0.0);
        }
    }

    /// The value of the plane at a pixel, with its colour and variance per channel. The colour itself if nothing was
    /// added.
    #[inline(always)]
    pub(super) fn value(&self, x: usize, y: usize, pixel: [(f32, f32); 3]) -> [f32; 3] {
        let at = |k: usize| self.all[k][y * self.width + x];
        let total = at(0);
        if total <= 0.0 {
            return pixel.map(|p| p.0);
        }
        let (u, v) = (at(1) / total, at(2) / total);
        // Covariances of positions times the total weight. The penalty keeps their matrix invertible.
        let (uu, uv, vv) = (at(3) - u * u * total + RIDGE, at(4) - u * v * total, at(5) - v * v * total + RIDGE);
        let determinant = uu * vv - uv * uv;
        // The centre of the weights is not at the pixel. The error of the mean is the slopes times that distance.
        let (du, dv) = ((vv * u - uv * v) / determinant, (uu * v - uv * u) / determinant);
        let mut means = [0.0; 3];
        let mut corrections = [0.0; 3];
        let (mut square, mut noise) = (0.0, 0.0);
        for c in 0..3 {
            let [sum, su, sv] = [at(6 + 3 * c), at(7 + 3 * c), at(8 + 3 * c)];
            means[c] = sum / total;
            corrections[c] = du * (su - u * sum) + dv * (sv - v * sum);
            square += corrections[c] * corrections[c];
            noise += pixel[c].1 * (du * u + dv * v);
        }
        let reliability = if square > 0.0 { square / (square + SHRINKAGE * noise) } else { 0.0 };
        for (mean, correction) in means.iter_mut().zip(corrections) {
            // The correction is limited, since a plane that falls below zero or rises to twice the mean has too large a
            // slope.
            *mean -= (reliability * correction).max(-mean.abs()).min(mean.abs());
        }
        means
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::Fallback;

    /// The value at a pixel that uses only pixels to the right of it and below, up to eight away, with the given
    /// colours.
    fn of_one_side(colour: impl Fn(f32, f32) -> f32, variance: f32) -> f32 {
        let mut moments = Moments::new(EIGHT, 1);
        for down in 0..=8 {
            for across in 0..=8 {
                let value = colour(across as f32, down as f32);
                let colors = [0; 3].map(|_| vec![value; EIGHT]);
                moments.add(Fallback::new(), 0, &[1.0; EIGHT], across as f32, &colors, 0);
            }
            moments.close_line(down as f32);
        }
        moments.value(0, 0, [(colour(0.0, 0.0), variance); 3])[1]
    }

    #[test]
    fn a_slope_with_pixels_on_one_side_has_almost_no_bias() {
        let slope = |across: f32, down: f32| 20.0 + across - 2.0 * down;
        let value = of_one_side(slope, 1e-6);
        // The mean is 16. Squared distances from the middle add up to 81 * 60 / 9 * UNIT^2 = 21.6 in either direction.
        // So the penalty removes 0.3 / 21.9 of the correction from 16 to 20.
        let expected = 20.0 - 4.0 * 0.3 / 21.9;
        assert!((value - expected).abs() < 1e-3, "{value}, expected {expected}");
    }

    #[test]
    fn where_noise_tilts_as_much_the_mean_stays() {
        let value = of_one_side(|across, _| 20.0 + 0.01 * across, 1e4);
        assert!((value - 20.04).abs() < 1e-3, "{value}, expected the mean, 20.04");
    }
}
