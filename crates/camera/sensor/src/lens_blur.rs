//! The image of a lens: how a film of pixels becomes the light that the pixels of a sensor receive.
//!
//! The image at a pixel is the integral of the radiance times a density t, the point spread function convolved with the square of
//! the pixel. A film has the sums of whole pixels, and their first moments if it was rendered for a lens that blurs
//! ([`PixelSums::moments`](dunkelfeld_film::PixelSums::moments)). So t is approximated by a function that is linear in each pixel
//! of the film: a weight w and a gradient g. Samples may be spread over neighbours of their pixel by a box (`spread`), which is a
//! part of the blur.
//!
//! Weights are found frequency by frequency. A film cannot tell a frequency f below the Nyquist frequency from its aliases f + n.
//! The least squares of the errors at all of them, of which those below Nyquist count most, give the three numbers of a
//! frequency: the transforms of w and of the two components of g. Then g is limited so that no part of a pixel has a negative
//! weight, and w is found again for that g. Without negative weights no dark rings surround bright points.
//!
//! Light is mirrored at the border of the film, so that the sum over the film stays. For a symmetric kernel that is a product in
//! the cosine transform.

use crate::optics::Optics;
use crate::parallel::for_rows;
use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_radiometry::Metres;
use rustdct::{DctPlanner, TransformType2And3};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// The weight of errors far above the Nyquist frequency, and the frequencies between which it falls from 1 to that [cycles per
/// pixel].
const FAR_WEIGHT: f64 = 0.03;
const MIDDLE: f64 = 0.6;
const WIDTH: f64 = 0.05;
/// Aliases to each side that count.
const ALIASES: i32 = 2;
/// Pixels to each side with a gradient.
const GRADIENTS: usize = 4;
/// Least and largest number of frequencies of a kernel. Its reach is half of them.
const SIZES: [usize; 2] = [64, 512];
/// Least and largest number of pixels to each side whose noise counts for that of a pixel. A reach holds 0.999 of it, or as much as
/// the largest one; the rest is scaled to the whole.
const NOISE_REACHES: [usize; 2] = [6, 24];
/// Radius at which the kernel of the veiling glare falls to 1/e, as a share of the smaller side of the film.
const GLARE_RADIUS: f64 = 0.25;

/// The blur of a lens for a film.
#[derive(Clone, Debug)]
pub struct LensBlur {
    /// Field heights in rising order \[pixels\], with the kernels of red, green and blue.
    fields: Vec<(f64, [Kernel; 3])>,
    /// Share of the light in the veiling glare.
    glare: f64,
}

/// Weights of the pixels around a pixel, by their distance in columns and rows.
#[derive(Clone, Debug)]
struct Kernel {
    /// Pixels to each side.
    reach: usize,
    /// Weights of the quadrant, row by row: `reach + 1` columns and rows. They sum to 1 over all quadrants.
    weights: Vec<f64>,
    /// Gradients to the right, of pixels to the right and below: [`GRADIENTS`] + 1 columns and rows. Those downward are the
    /// transpose.
    gradients: Vec<f64>,
}

impl LensBlur {
    /// The blur of a lens for an image of pixels of this pitch. `None` for a lens without blur, if the samples of the image are not
    /// spread either. That they are spread is taken back as far as possible.
    pub fn new(optics: &Optics, pitch: Metres, image: &MeanImage) -> Option<Self> {
        if !optics.blurs() && !image.is_spread {
            return None;
        }
        let spread = if image.is_spread { f64::from(MeanImage::SPREAD) } else { 0.0 };
        let working_f_number = optics.f_number() * (1.0 + optics.magnification());
        let field = |(number, height): (usize, f64)| {
            let kernels = optics.bands().wavelengths.map(|wavelength| {
                let mtf = |f: f64| optics.psf().mtf(f / pitch.0, number, working_f_number, wavelength);
                Kernel::new(mtf, spread, image.moments.is_some())
            });
            (height / pitch.0, kernels)
        };
        let fields = optics.psf().heights().into_iter().enumerate().map(field).collect();
        Some(Self { fields, glare: optics.glare() })
    }

    /// The radiance behind the lens, of the image of [`Self::new`]. Pixels that are not finite or negative stay as they are and give no light to others. Runs on
    /// the threads of the pool of the caller, if there is one.
    pub fn image(&self, image: &MeanImage) -> Plane<[f32; 3]> {
        let (mean, [width, height]) = (&image.radiance, image.size());
        let is_valid = |v: f32| (0.0..=f32::MAX).contains(&v);
        let mut behind = Plane::new(width, height, [0.0f32; 3]);
        if behind.data().is_empty() {
            return behind;
        }
        let transforms = CosineTransforms::new([width, height]);
        for channel in 0..3 {
            let mut spectrum = vec![0.0; mean.data().len()];
            for_rows(&mut spectrum, width, |y, row| {
                let light = |p: &[f32; 3]| if is_valid(p[channel]) { f64::from(p[channel]) } else { 0.0 };
                let pixels = &mean.data()[y * width as usize..];
                row.iter_mut().zip(pixels).for_each(|(to, pixel)| *to = light(pixel));
                0
            });
            transforms.forward(&mut spectrum);
            let size = [width as usize, height as usize];
            let axes = image.moments.as_ref().map(|axes| {
                [[true, false], [false, true]].map(|flips| {
                    let plane = axes[usize::from(flips[1])].data();
                    Padded::new(size, GRADIENTS, flips, |i| {
                        // No sample is farther from the mean place than the side of the pixel.
                        let (moment, most) = (plane[i][channel], mean.data()[i][channel]);
                        if is_valid(most) && moment.abs() <= most { moment } else { 0.0 }
                    })
                })
            });
            for (number, (_, kernels)) in self.fields.iter().enumerate() {
                let kernel = &kernels[channel];
                let is_last = number + 1 == self.fields.len();
                let mut light = if is_last { std::mem::take(&mut spectrum) } else { spectrum.clone() };
                kernel.multiply(&mut light, [width, height], self.glare);
                transforms.backward(&mut light);
                let taps = kernel.taps();
                for_rows(behind.data_mut(), width, |y, row| {
                    let mut gradient = vec![0.0f32; row.len()];
                    if let Some([right, down]) = &axes {
                        for &(dx, dy, g) in &taps {
                            right.add_row(&mut gradient, y, [dx, dy], g);
                            down.add_row(&mut gradient, y, [dy, dx], g);
                        }
                    }
                    for (x, pixel) in row.iter_mut().enumerate() {
                        let value = light[y * width as usize + x] + (1.0 - self.glare) * f64::from(gradient[x]);
                        pixel[channel] += (self.share(number, [x, y], [width, height]) * value) as f32;
                    }
                    0
                });
            }
        }
        for_rows(behind.data_mut(), width, |y, row| {
            let before = mean.data()[y * width as usize..].as_flattened();
            let pairs = row.as_flattened_mut().iter_mut().zip(before);
            pairs.for_each(|(behind, &mean)| *behind = if is_valid(mean) { behind.max(0.0) } else { mean });
            0
        });
        behind
    }

    /// The share of a field by its number at a pixel. Shares are linear between field heights.
    fn share(&self, number: usize, [x, y]: [usize; 2], [width, height]: [u32; 2]) -> f64 {
        if self.fields.len() == 1 {
            return 1.0;
        }
        let from_middle = |at: usize, size: u32| at as f64 + 0.5 - 0.5 * f64::from(size);
        let radius = from_middle(x, width).hypot(from_middle(y, height));
        let at = |number: usize| self.fields[number].0;
        let radius = radius.clamp(at(0), at(self.fields.len() - 1));
        let rises = number > 0 && radius <= at(number);
        let falls = number + 1 < self.fields.len() && radius > at(number);
        match (rises, falls) {
            (true, _) => ((radius - at(number - 1)) / (at(number) - at(number - 1))).max(0.0),
            (_, true) => ((at(number + 1) - radius) / (at(number + 1) - at(number))).max(0.0),
            _ => f64::from(u8::from(radius == at(number))),
        }
    }

    /// The variances behind the lens of pixels whose noise is independent of that of others. `variance` is that of their means,
    /// and `moments` twelve times that of their first moments: for independent samples the same. The first gets the square of a
    /// weight, the second a twelfth of the squares of its gradients. `shares` are those of
    /// the channels in the signal. A variance that is not finite makes those around it unknown.
    pub fn variance(&self, variance: &Plane<f32>, moments: &Plane<f32>, shares: [f64; 3]) -> Plane<f32> {
        self.of_fields([variance, moments], 1, |kernels| Squares::of_pixels(kernels, shares, 1.0 - self.glare))
    }

    /// The variances behind the lens of the means of [`Self::BLOCK`] x [`Self::BLOCK`] pixels, as [`Self::variance`]. The pixel in
    /// the top left corner of a block has that of the block, if its row and its column are multiples of that number.
    pub fn variance_of_blocks(&self, variance: &Plane<f32>, moments: &Plane<f32>, shares: [f64; 3]) -> Plane<f32> {
        let of_blocks = |kernels: &[Kernel; 3]| Squares::of_blocks(kernels, shares, 1.0 - self.glare);
        self.of_fields([variance, moments], Self::BLOCK as usize, of_blocks)
    }

    /// What a camera adds to a frame so that the noise of a render behind the lens has the spectrum and the variance that it has in
    /// front of it. The lens removes high frequencies of that noise; this noise has only those. `variance` is that of the pixels in
    /// front of the lens [e-^2]; unknown ones count as zero. `normal` gives a standard normal number for each pixel.
    pub fn restored(
        &self,
        variance: &Plane<f32>,
        shares: [f64; 3],
        normal: impl Fn(usize) -> f64 + Sync,
    ) -> Plane<f32> {
        let size = [variance.width(), variance.height()];
        let mut out = Plane::new(size[0], size[1], 0.0f32);
        if out.data().is_empty() {
            return out;
        }
        let mut drawn = vec![0.0f64; out.data().len()];
        for_rows(&mut drawn, size[0], |y, row| {
            for (x, value) in row.iter_mut().enumerate() {
                let pixel = y * size[0] as usize + x;
                let variance = f64::from(variance.data()[pixel]);
                *value = if variance.is_finite() { variance.sqrt() * normal(pixel) } else { 0.0 };
            }
            0
        });
        let transforms = CosineTransforms::new(size);
        transforms.forward(&mut drawn);
        for (number, (_, kernels)) in self.fields.iter().enumerate() {
            let mut noise = drawn.clone();
            Kernel::complement(kernels, shares, 1.0 - self.glare).multiply(&mut noise, size, 0.0);
            transforms.backward(&mut noise);
            for_rows(out.data_mut(), size[0], |y, row| {
                for (x, out) in row.iter_mut().enumerate() {
                    *out += (self.share(number, [x, y], size) * noise[y * size[0] as usize + x]) as f32;
                }
                0
            });
        }
        out
    }

    /// The variances of the pixels behind the lens together with those of [`Self::restored`]. Where the noise is even, they are
    /// those in front of the lens.
    pub fn restored_variance(&self, variance: &Plane<f32>, shares: [f64; 3]) -> Plane<f32> {
        self.of_fields([variance; 2], 1, |kernels| {
            let added = Kernel::complement(kernels, shares, 1.0 - self.glare);
            let mut squares = Squares::of_pixels(kernels, shares, 1.0 - self.glare);
            for ([dx, dy], square) in &mut squares.0 {
                square[0] += added.at(*dx, *dy)[0].powi(2) as f32;
            }
            // Both kernels together are even at the border.
            squares.1.clear();
            squares
        })
    }

    /// Pixels along the side of a block of [`Self::variance_of_blocks`].
    pub const BLOCK: u32 = 8;

    fn of_fields(&self, noise: [&Plane<f32>; 2], step: usize, squares: impl Fn(&[Kernel; 3]) -> Squares) -> Plane<f32> {
        let size = [noise[0].width(), noise[0].height()];
        let mut out = Plane::new(size[0], size[1], 0.0f32);
        if out.data().is_empty() {
            return out;
        }
        let margin = NOISE_REACHES[1] + Self::BLOCK as usize;
        let sides = size.map(|n| n as usize);
        let padded = noise.map(|plane| Padded::new(sides, margin, [false; 2], |i| plane.data()[i]));
        for (number, (_, kernels)) in self.fields.iter().enumerate() {
            let squares = squares(kernels);
            for_rows(out.data_mut(), size[0], |y, row| {
                if y % step > 0 {
                    return 0;
                }
                let mut of_field = vec![0.0f32; row.len()];
                for (distance, square) in &squares.0 {
                    for (padded, &square) in padded.iter().zip(square).filter(|(_, square)| **square > 0.0) {
                        padded.add_row(&mut of_field, y, *distance, square);
                    }
                }
                for (x, (out, of_field)) in row.iter_mut().zip(of_field).enumerate() {
                    let share = self.share(number, [x, y], size) as f32;
                    let of_field = squares.at_border([x, y], sides, noise).unwrap_or(of_field);
                    *out += if share > 0.0 { share * of_field } else { 0.0 };
                }
                0
            });
        }
        out
    }
}

impl Kernel {
    /// The kernel of an MTF over the frequency [cycles per pixel], for samples that are spread over a box of that side \[pixels\].
    /// Without moments there are no gradients.
    fn new(mtf: impl Fn(f64) -> f64, spread: f64, has_moments: bool) -> Self {
        // The frequency at which little is left determines the reach.
        let mut cutoff = 0.5;
        while cutoff > 1e-3 && mtf(cutoff) < 0.1 {
            cutoff *= 0.9;
        }
        let size = ((16.0 / cutoff) as usize).next_power_of_two().clamp(SIZES[0], SIZES[1]);
        let reach = size / 2;
        let systems: Vec<System> = (0..=reach)
            .flat_map(|y| (0..=reach).map(move |x| [x, y]))
            .map(|at| System::new(at.map(|i| i as f64 / size as f64), &mtf, spread))
            .collect();
        let gradients = vec![0.0; (GRADIENTS + 1) * (GRADIENTS + 1)];
        let mut kernel = Self { reach, weights: Vec::new(), gradients };
        if has_moments {
            let systems = &systems;
            let of = |number: usize| move |x: usize, y: usize| systems[y * (reach + 1) + x].all()[number];
            kernel.weights = back(size, of(0), [cosine; 2], reach + 1);
            kernel.gradients = back(size, of(1), [sine, cosine], GRADIENTS + 1);
            kernel.limit();
        }
        let of_axis = transform(size, &kernel.gradients, GRADIENTS + 1, [sine, cosine]);
        let weight = |x: usize, y: usize| {
            systems[y * (reach + 1) + x].weight_for([of_axis[y * (reach + 1) + x], of_axis[x * (reach + 1) + y]])
        };
        kernel.weights = back(size, weight, [cosine; 2], reach + 1);
        kernel.limit();
        let sum: f64 = kernel.quadrants().map(|(_, _, count, w)| count * w).sum();
        kernel.weights.iter_mut().for_each(|w| *w /= sum);
        kernel.gradients.iter_mut().for_each(|g| *g /= sum);
        kernel
    }

    /// The kernel whose transform squared is that of white noise less the spectrum of white noise behind kernels of red, green and
    /// blue with these shares, times a factor.
    fn complement(kernels: &[Self; 3], shares: [f64; 3], factor: f64) -> Self {
        let reach = kernels.iter().map(|k| k.reach).max().unwrap_or(0);
        let of = |side: usize, number: usize| -> Vec<f64> {
            let of_signal = |dx: usize, dy: usize| {
                let parts = kernels.iter().zip(shares);
                parts.map(|(k, share)| factor * share * k.at(dx as isize, dy as isize)[number]).sum()
            };
            (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy))).map(|(dx, dy)| of_signal(dx, dy)).collect()
        };
        let (size, side) = (2 * reach, reach + 1);
        let weights = transform(size, &of(side, 0), side, [cosine; 2]);
        let gradients = transform(size, &of(GRADIENTS + 1, 1), GRADIENTS + 1, [sine, cosine]);
        let rest = |x: usize, y: usize| {
            let [right, down] = [gradients[y * side + x], gradients[x * side + y]];
            (1.0 - weights[y * side + x].powi(2) - (right * right + down * down) / 12.0).max(0.0).sqrt()
        };
        let weights = back(size, rest, [cosine; 2], side);
        Self { reach, weights, gradients: vec![0.0; (GRADIENTS + 1) * (GRADIENTS + 1)] }
    }

    /// No part of a pixel has a negative weight.
    fn limit(&mut self) {
        self.weights.iter_mut().for_each(|w| *w = w.max(0.0));
        let side = GRADIENTS + 1;
        let limited = (0..side * side).map(|i| {
            let (x, y) = (i % side, i / side);
            let [right, down] = [self.gradients[i], self.gradients[x * side + y]];
            let most = 2.0 * self.weights[y * (self.reach + 1) + x];
            right * (most / (right.abs() + down.abs()).max(f64::MIN_POSITIVE)).min(1.0)
        });
        self.gradients = limited.collect();
    }

    /// Column and row of each weight, the number of quadrants that have it, and the weight.
    fn quadrants(&self) -> impl Iterator<Item = (usize, usize, f64, f64)> + '_ {
        let side = self.reach + 1;
        let count = |i: usize| if i == 0 { 1.0 } else { 2.0 };
        self.weights.iter().enumerate().map(move |(i, &w)| (i % side, i / side, count(i % side) * count(i / side), w))
    }

    /// The weight and the gradients of a pixel at this distance.
    fn at(&self, dx: isize, dy: isize) -> [f64; 3] {
        let (x, y, side) = (dx.unsigned_abs(), dy.unsigned_abs(), GRADIENTS + 1);
        if x > self.reach || y > self.reach {
            return [0.0; 3];
        }
        let weight = self.weights[y * (self.reach + 1) + x];
        if x >= side || y >= side {
            return [weight, 0.0, 0.0];
        }
        let of = |i: usize, d: isize| self.gradients[i] * d.signum() as f64;
        [weight, of(y * side + x, dx), of(x * side + y, dy)]
    }

    /// The gradients to the right that matter: distance in columns and rows, value.
    fn taps(&self) -> Vec<(isize, isize, f32)> {
        let reach = GRADIENTS as isize;
        let all = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
        let all = all.map(|(dx, dy)| (dx, dy, self.at(dx, dy)[1] as f32));
        all.filter(|(_, _, g)| g.abs() > 1e-5).collect()
    }

    /// Multiplies a cosine spectrum, transposed, by the transfer function of the weights, with a share of veiling glare.
    fn multiply(&self, spectrum: &mut [f64], [width, height]: [u32; 2], glare: f64) {
        let side = self.reach + 1;
        // cos(pi k d / n) for the frequencies k of an axis of n pixels.
        let table = |n: u32| -> Vec<f64> {
            let angle = |k: u32, d: usize| PI * f64::from(k) * d as f64 / f64::from(n);
            let count = |d: usize| if d == 0 { 1.0 } else { 2.0 };
            (0..n).flat_map(|k| (0..side).map(move |d| count(d) * angle(k, d).cos())).collect()
        };
        let (columns, rows) = (table(width), table(height));
        let radius = GLARE_RADIUS * f64::from(width.min(height));
        for_rows(spectrum, height, |x, line| {
            let along = &columns[x * side..(x + 1) * side];
            let of_row = |d: usize| {
                let row = &self.weights[d * side..(d + 1) * side];
                row.iter().zip(along).map(|(w, c)| w * c).sum::<f64>()
            };
            let of_rows: Vec<f64> = (0..side).map(of_row).collect();
            for (y, value) in line.iter_mut().enumerate() {
                let of_rows = of_rows.iter().zip(&rows[y * side..(y + 1) * side]);
                let core: f64 = of_rows.map(|(w, c)| w * c).sum();
                let veil = if glare > 0.0 {
                    let f = (0.5 * x as f64 / f64::from(width)).hypot(0.5 * y as f64 / f64::from(height));
                    let square = 1.0 + (2.0 * PI * radius * f).powi(2);
                    1.0 / (square * square.sqrt())
                } else {
                    0.0
                };
                *value *= (1.0 - glare) * core + glare * veil;
            }
            0
        });
    }
}

/// The normal equations of the transforms of weight and gradients at a frequency.
struct System {
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
}

impl System {
    fn new(at: [f64; 2], mtf: &impl Fn(f64) -> f64, spread: f64) -> Self {
        let mut system = Self { matrix: [[0.0; 3]; 3], right: [0.0; 3] };
        let importance = |f: f64| FAR_WEIGHT + (1.0 - FAR_WEIGHT) / (1.0 + ((f.abs() - MIDDLE) / WIDTH).exp());
        for (ax, ay) in (-ALIASES..=ALIASES).flat_map(|y| (-ALIASES..=ALIASES).map(move |x| (x, y))) {
            let [x, y] = [at[0] + f64::from(ax), at[1] + f64::from(ay)];
            let boxes = sinc(spread * x) * sinc(spread * y);
            let of_film = [sinc(x) * sinc(y), -ramp(x) * sinc(y), -sinc(x) * ramp(y)].map(|v| v * boxes);
            let wanted = sinc(x) * sinc(y) * mtf(x.hypot(y));
            let importance = importance(x) * importance(y);
            for (i, a) in of_film.iter().enumerate() {
                system.right[i] += importance * a * wanted;
                of_film.iter().enumerate().for_each(|(j, b)| system.matrix[i][j] += importance * a * b);
            }
        }
        (0..3).for_each(|i| system.matrix[i][i] += 1e-12);
        system
    }

    /// The transforms of weight, gradient to the right and gradient downward.
    fn all(&self) -> [f64; 3] {
        let (mut m, mut r) = (self.matrix, self.right);
        // The matrix is positive definite, so that elimination needs no exchange of rows.
        for i in 0..3 {
            for j in i + 1..3 {
                let factor = m[j][i] / m[i][i];
                (i..3).for_each(|k| m[j][k] -= factor * m[i][k]);
                r[j] -= factor * r[i];
            }
        }
        for i in (0..3).rev() {
            let known: f64 = (i + 1..3).map(|k| m[i][k] * r[k]).sum();
            r[i] = (r[i] - known) / m[i][i];
        }
        r
    }

    /// The transform of the weight for given gradients.
    fn weight_for(&self, [right, down]: [f64; 2]) -> f64 {
        let [all, of_right, of_down] = self.matrix[0];
        (self.right[0] - of_right * right - of_down * down) / all
    }
}

/// The transform of a box of side 1: sin(pi f) / (pi f).
fn sinc(f: f64) -> f64 {
    if f.abs() < 1e-9 { 1.0 } else { (PI * f).sin() / (PI * f) }
}

/// The integral of x sin(2 pi f x) over a box of side 1 around 0.
fn ramp(f: f64) -> f64 {
    if f.abs() < 1e-5 { PI * f / 6.0 } else { (sinc(f) - (PI * f).cos()) / (2.0 * PI * f) }
}

type Wave = fn(f64) -> f64;

fn cosine(turns: f64) -> f64 {
    (2.0 * PI * turns).cos()
}

fn sine(turns: f64) -> f64 {
    (2.0 * PI * turns).sin()
}

/// The values of a table of all frequencies of a quadrant, `size / 2 + 1` columns and rows, as a kernel with `side` columns and
/// rows of a quadrant. The waves are those of columns and rows.
fn back(size: usize, of: impl Fn(usize, usize) -> f64, [along, across]: [Wave; 2], side: usize) -> Vec<f64> {
    let half = size / 2;
    let count = |i: usize| if i == 0 || i == half { 1.0 } else { 2.0 } / size as f64;
    let wave = |w: Wave| -> Vec<f64> {
        let at = |d: usize, i: usize| count(i) * w((d * i % size) as f64 / size as f64);
        (0..side).flat_map(|d| (0..=half).map(move |i| at(d, i))).collect()
    };
    let (along, across) = (wave(along), wave(across));
    let row = |y: usize| (0..=half).map(|x| of(x, y)).collect::<Vec<f64>>();
    let rows: Vec<Vec<f64>> = (0..=half).map(row).collect();
    let of_rows: Vec<f64> =
        rows.iter().flat_map(|row| along.chunks(half + 1).map(move |wave| dot(wave, row))).collect();
    let column = |x: usize| (0..=half).map(|y| of_rows[y * side + x]).collect::<Vec<f64>>();
    let columns: Vec<Vec<f64>> = (0..side).map(column).collect();
    across.chunks(half + 1).flat_map(|wave| columns.iter().map(move |column| dot(wave, column))).collect()
}

/// The transform of a kernel with `side` columns and rows of a quadrant, at all frequencies of a quadrant: the inverse of
/// [`back`].
fn transform(size: usize, kernel: &[f64], side: usize, [along, across]: [Wave; 2]) -> Vec<f64> {
    let half = size / 2;
    let count = |d: usize| if d == 0 { 1.0 } else { 2.0 };
    let wave = |w: Wave, i: usize| -> Vec<f64> {
        (0..side).map(|d| count(d) * w((d * i % size) as f64 / size as f64)).collect()
    };
    let columns: Vec<Vec<f64>> =
        (0..=half).map(|x| kernel.chunks(side).map(|row| dot(&wave(along, x), row)).collect()).collect();
    let waves: Vec<Vec<f64>> = (0..=half).map(|y| wave(across, y)).collect();
    waves.iter().flat_map(|wave| columns.iter().map(move |column| dot(wave, column))).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The index of a pixel in a row of `size` that is mirrored at its ends, and whether it is mirrored an odd number of times.
fn mirrored(at: isize, size: usize) -> (usize, bool) {
    let at = at.rem_euclid(2 * size as isize) as usize;
    if at < size { (at, false) } else { (2 * size - 1 - at, true) }
}

/// An image with mirrored pixels around it.
struct Padded {
    values: Vec<f32>,
    width: usize,
    stride: usize,
    margin: usize,
}

impl Padded {
    /// With so many pixels on each side. `flips` says along which axes mirrored values change their sign.
    fn new([width, height]: [usize; 2], margin: usize, flips: [bool; 2], of: impl Fn(usize) -> f32 + Sync) -> Self {
        let along = |size: usize| -> Vec<_> {
            (0..size + 2 * margin).map(|i| mirrored(i as isize - margin as isize, size)).collect()
        };
        let (columns, rows) = (along(width), along(height));
        let mut values = vec![0.0; columns.len() * rows.len()];
        for_rows(&mut values, columns.len() as u32, |row, out| {
            let (y, is_below) = rows[row];
            for (out, &(x, is_beside)) in out.iter_mut().zip(&columns) {
                let value = of(y * width + x);
                *out = if (is_beside && flips[0]) != (is_below && flips[1]) { -value } else { value };
            }
            0
        });
        Self { values, width, stride: columns.len(), margin }
    }

    /// Adds the pixels at a distance from those of row `y`, times a factor.
    fn add_row(&self, to: &mut [f32], y: usize, [dx, dy]: [isize; 2], factor: f32) {
        let at = |i: usize, d: isize| (i + self.margin).saturating_add_signed(d);
        let first = at(y, dy) * self.stride + at(0, dx);
        to.iter_mut().zip(&self.values[first..first + self.width]).for_each(|(to, v)| *to += factor * v);
    }
}

/// Factors of the variances of the pixels around a pixel and of those of their moments, by distance in columns and rows; and
/// the weights and gradients that they are the squares of, which mirrored pixels add to those of their originals.
struct Squares(Vec<([isize; 2], [f32; 2])>, Vec<([isize; 2], [f64; 3])>);

impl Squares {
    /// Of a pixel. The kernel is that of a signal with these shares of red, green and blue, times a factor.
    fn of_pixels(kernels: &[Kernel; 3], shares: [f64; 3], factor: f64) -> Self {
        Self::of(kernels, shares, factor, 1)
    }

    /// Of the mean of a block, by the distance from its first pixel.
    fn of_blocks(kernels: &[Kernel; 3], shares: [f64; 3], factor: f64) -> Self {
        let Self(squares, _) = Self::of(kernels, shares, factor, LensBlur::BLOCK as isize);
        Self(squares, Vec::new())
    }

    fn of(kernels: &[Kernel; 3], shares: [f64; 3], factor: f64, side: isize) -> Self {
        let add = |a: [f64; 3], b: [f64; 3], f: f64| [a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2]];
        let squares = |[w, right, down]: [f64; 3]| [w * w, (right * right + down * down) / 12.0];
        let of_signal = |dx: isize, dy: isize| {
            kernels.iter().zip(shares).fold([0.0; 3], |sum, (k, share)| add(sum, k.at(dx, dy), share * factor))
        };
        let sum_within = |reach: usize| {
            let reach = reach as isize;
            let all = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
            all.map(|(dx, dy)| squares(of_signal(dx, dy)).iter().sum::<f64>()).sum::<f64>()
        };
        let all = sum_within(kernels.iter().map(|k| k.reach).max().unwrap_or(0));
        let [least, most] = NOISE_REACHES;
        let reach = (least..most).find(|&reach| sum_within(reach) >= 0.999 * all).unwrap_or(most);
        let scale = (all / sum_within(reach)).max(1.0).sqrt() / (side * side) as f64;
        let reach = reach as isize;
        let at = |[dx, dy]: [isize; 2]| {
            let block = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
            let sum = block.fold([0.0; 3], |sum, (x, y)| add(sum, of_signal(dx - x, dy - y), 1.0));
            sum.map(|v| v * scale)
        };
        let distances = (-reach..reach + side).flat_map(|dy| (-reach..reach + side).map(move |dx| [dx, dy]));
        let kernel: Vec<([isize; 2], [f64; 3])> = distances.map(|d| (d, at(d))).collect();
        Self(kernel.iter().map(|&(d, v)| (d, squares(v).map(|v| v as f32))).collect(), kernel)
    }

    /// The variance of a pixel at the border, where its own light and that of mirrored pixels are the same. `None` farther inside.
    fn at_border(&self, at: [usize; 2], size: [usize; 2], noise: [&Plane<f32>; 2]) -> Option<f32> {
        let ([first, _], _) = self.1.first()?;
        let reach = first.unsigned_abs();
        if (0..2).all(|axis| at[axis] >= reach && at[axis] + reach < size[axis]) {
            return None;
        }
        let mut sums: BTreeMap<(usize, usize), [f64; 3]> = BTreeMap::new();
        for &([dx, dy], [w, right, down]) in &self.1 {
            let (x, flips_x) = mirrored(at[0] as isize + dx, size[0]);
            let (y, flips_y) = mirrored(at[1] as isize + dy, size[1]);
            let sum = sums.entry((x, y)).or_default();
            let flipped = |v: f64, flips: bool| if flips { -v } else { v };
            *sum = [sum[0] + w, sum[1] + flipped(right, flips_x), sum[2] + flipped(down, flips_y)];
        }
        let of_pixel = |((x, y), [w, right, down]): ((usize, usize), [f64; 3])| {
            let [variance, moments] = noise.map(|plane| f64::from(plane.data()[y * size[0] + x]));
            w * w * variance + (right * right + down * down) / 12.0 * moments
        };
        Some(sums.into_iter().map(of_pixel).sum::<f64>() as f32)
    }
}

/// Cosine transforms of an image in both directions.
struct CosineTransforms {
    size: [u32; 2],
    along: Arc<dyn TransformType2And3<f64>>,
    across: Arc<dyn TransformType2And3<f64>>,
}

impl CosineTransforms {
    fn new(size: [u32; 2]) -> Self {
        let mut planner = DctPlanner::new();
        let [along, across] = size.map(|n| planner.plan_dct2(n as usize));
        Self { size, along, across }
    }

    /// The spectrum, transposed: its rows are columns of the image.
    fn forward(&self, image: &mut Vec<f64>) {
        let [width, height] = self.size;
        let rows = |values: &mut Vec<f64>, dct: &Arc<dyn TransformType2And3<f64>>, n: u32| {
            for_rows(values, n, |_, row| {
                dct.process_dct2_with_scratch(row, &mut vec![0.0; dct.get_scratch_len()]);
                0
            });
        };
        rows(image, &self.along, width);
        *image = transposed(image, width as usize);
        rows(image, &self.across, height);
    }

    /// The image of a spectrum of [`Self::forward`].
    fn backward(&self, spectrum: &mut Vec<f64>) {
        let [width, height] = self.size;
        let rows = |values: &mut Vec<f64>, dct: &Arc<dyn TransformType2And3<f64>>, n: u32| {
            for_rows(values, n, |_, row| {
                dct.process_dct3_with_scratch(row, &mut vec![0.0; dct.get_scratch_len()]);
                row.iter_mut().for_each(|v| *v *= 2.0 / f64::from(n));
                0
            });
        };
        rows(spectrum, &self.across, height);
        *spectrum = transposed(spectrum, height as usize);
        rows(spectrum, &self.along, width);
    }
}

/// The transpose of a matrix with rows of `width` numbers.
fn transposed(values: &[f64], width: usize) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let mut out = vec![0.0; values.len()];
    // A few rows at once, of which the cache keeps the lines.
    const ROWS: usize = 16;
    for_rows(&mut out, (height * ROWS) as u32, |block, out| {
        let first = block * ROWS;
        for y in 0..height {
            let row = &values[y * width + first..(y * width + first + ROWS).min((y + 1) * width)];
            row.iter().enumerate().for_each(|(x, v)| out[x * height + y] = *v);
        }
        0
    });
    out
}
