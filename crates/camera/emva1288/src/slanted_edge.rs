//! The MTF of a camera from an image of a slanted edge (ISO 12233:2023, e-SFR).
//!
//! 1. A straight line is fitted to the centroids of the derivative of the rows.
//! 2. Pixels are sorted by their distance from the line into bins of a quarter of a pixel: the edge spread function.
//! 3. Its differences are the line spread function, which a Tukey window limits.
//! 4. The magnitude of its Fourier transform is the MTF. The bins and the differences are boxes of a quarter of a pixel,
//!    whose sinc is divided out.

use std::f64::consts::PI;

use serde::Serialize;

use crate::frame::AnalysisError;

/// Bins per pixel.
const BINS: f64 = 4.0;
/// Angles between edge and pixels \[degrees\].
const ANGLES: std::ops::RangeInclusive<f64> = 2.0..=15.0;
/// Half the width of the windows in which rows have their centroid \[pixels\].
const CENTROID: f64 = 8.0;
/// Number of frequencies up to that of Nyquist. A finer table would have steps by noise from row to row, and its point spread
/// function negative rings.
const FREQUENCIES: u32 = 10;
/// Least number of columns and rows.
const LEAST: usize = 20;
/// Of the bright pixels, a larger share at the largest value is clipped. So is one of the dark pixels at zero.
const CLIPPED: f64 = 0.01;
/// The step of the edge must be this many times the noise of a pixel.
const CONTRAST: f64 = 5.0;

/// The MTF at a frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MtfPoint {
    /// Frequency along the normal of the edge [cycles/pixel].
    pub frequency: f64,
    /// MTF of lens and pixel together.
    pub camera: f64,
    /// Standard error of it, from the noise of the pixels.
    pub error: f64,
    /// MTF of the lens alone: without the square of the pixel, and not rising.
    pub lens: f64,
}

/// The MTF along the normal of an edge.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EdgeMtf {
    /// Angle between the edge and the nearer axis of the pixels \[degrees\].
    pub angle: f64,
    /// The edge is nearly horizontal.
    pub is_horizontal: bool,
    /// By rising frequency, up to half a cycle per pixel.
    pub points: Vec<MtfPoint>,
    /// Frequency at which the MTF of the camera is one half, and its standard error [cycles/pixel]. `None` if it is
    /// larger at all frequencies.
    pub mtf50: Option<[f64; 2]>,
}

/// The MTF from linear grey values of an edge, row by row. Noise may be reduced by a mean over frames.
///
/// # Errors
/// An image that is too small or clipped, no edge, one that is not straight, and one with an angle outside 2 to 15 degrees.
pub fn slanted_edge(width: usize, values: &[f64]) -> Result<EdgeMtf, AnalysisError> {
    let image = Upright::new(width, values)?;
    let line = image.edge()?;
    let angle = line.slope.atan().abs();
    if !ANGLES.contains(&angle.to_degrees()) {
        return Err(AnalysisError::unfit(
            format!("the edge is {:.1} degrees off the rows or columns of pixels", angle.to_degrees()),
            "tilt the edge by 2 to 15 degrees, such as 5",
        ));
    }
    let spread = image.edge_spread(&line, angle)?;
    let mut points: Vec<MtfPoint> = (1..=FREQUENCIES)
        .map(|i| {
            let frequency = 0.5 * f64::from(i) / f64::from(FREQUENCIES);
            let [camera, error] = spread.mtf(frequency);
            // Cosine and sine are the sides of the pixel along the normal.
            let pixel = sinc(frequency * angle.cos()) * sinc(frequency * angle.sin());
            MtfPoint { frequency, camera, error, lens: camera / pixel }
        })
        .collect();
    not_rising(&mut points);
    let mtf50 = mtf50(&points);
    Ok(EdgeMtf { angle: angle.to_degrees(), is_horizontal: image.is_turned, points, mtf50 })
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// The first frequency with one half, on straight lines between points.
fn mtf50(points: &[MtfPoint]) -> Option<[f64; 2]> {
    let next = points.iter().position(|p| p.camera < 0.5)?;
    let (b, start) = (points[next], MtfPoint { frequency: 0.0, camera: 1.0, error: 0.0, lens: 1.0 });
    let a = next.checked_sub(1).map_or(start, |i| points[i]);
    let slope = (b.camera - a.camera) / (b.frequency - a.frequency);
    Some([a.frequency + (0.5 - a.camera) / slope, (b.error / slope).abs()])
}

/// The least-squares sequence from 1 on that does not rise and is not negative: the mean of neighbours that do (pool
/// adjacent violators).
fn not_rising(points: &mut [MtfPoint]) {
    let mut blocks: Vec<(f64, usize)> = Vec::new();
    for p in points.iter() {
        let mut block = (p.lens, 1);
        while let Some(&(mean, count)) = blocks.last().filter(|(mean, _)| *mean < block.0) {
            let both = count + block.1;
            block = ((mean * count as f64 + block.0 * block.1 as f64) / both as f64, both);
            blocks.pop();
        }
        blocks.push(block);
    }
    let values = blocks.into_iter().flat_map(|(mean, count)| std::iter::repeat_n(mean.clamp(0.0, 1.0), count));
    points.iter_mut().zip(values).for_each(|(p, v)| p.lens = v);
}

/// An image whose edge is nearly vertical, dark on the left.
struct Upright {
    width: usize,
    height: usize,
    values: Vec<f64>,
    is_turned: bool,
    /// Grey value in the middle of the step.
    middle: f64,
}

/// The edge: x = start + slope y, at the centres of pixels.
struct Line {
    start: f64,
    slope: f64,
}

impl Upright {
    fn new(width: usize, values: &[f64]) -> Result<Self, AnalysisError> {
        let height = values.len() / width.max(1);
        if width < LEAST || height < LEAST {
            return Err(AnalysisError::unfit(
                format!("the image of {width} x {height} pixels is too small"),
                format!("use {LEAST} x {LEAST} pixels or more"),
            ));
        }
        // The step between the outer quarters.
        let step = |value: &dyn Fn(usize, usize) -> f64, length: usize, lines: usize| {
            let quarter = length / 4;
            let sum = |range: std::ops::Range<usize>| -> f64 {
                range.map(|i| (0..lines).map(|j| value(i, j)).sum::<f64>()).sum::<f64>() / (quarter * lines) as f64
            };
            sum(length - quarter..length) - sum(0..quarter)
        };
        let across = step(&|x, y| values[y * width + x], width, height);
        let down = step(&|y, x| values[y * width + x], height, width);
        let is_turned = down.abs() > across.abs();
        let (columns, rows) = if is_turned { (height, width) } else { (width, height) };
        let is_mirrored = (if is_turned { down } else { across }) < 0.0;
        let at = |i: usize| {
            let (x, y) = (i % columns, i / columns);
            let x = if is_mirrored { columns - 1 - x } else { x };
            if is_turned { values[x * width + y] } else { values[y * width + x] }
        };
        let upright: Vec<f64> = (0..values.len()).map(at).collect();
        let quarter = columns / 4;
        let sides = |from: usize| -> Vec<f64> {
            upright.chunks(columns).flat_map(|row| row[from..from + quarter].iter().copied()).collect()
        };
        let [dark, bright] = [sides(0), sides(columns - quarter)];
        check_sides(&dark, &bright)?;
        let middle = 0.5 * (mean(&dark) + mean(&bright));
        Ok(Self { width: columns, height: rows, values: upright, is_turned, middle })
    }

    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks(self.width)
    }

    /// The line through the centroids of the rows, each in a window around the line before.
    fn edge(&self) -> Result<Line, AnalysisError> {
        let no_line = || {
            AnalysisError::unfit(
                "there is no straight edge in the image",
                "use an image, or a --roi, with one straight edge from side to side, between an even dark and an even bright area",
            )
        };
        // A mean over five pixels crosses the middle.
        let crossing = |row: &[f64]| {
            row.windows(5).position(|w| mean(w) >= self.middle).map_or(0.5 * row.len() as f64, |x| x as f64 + 1.5)
        };
        let mut centres: Vec<f64> = self.rows().map(crossing).collect();
        let mut line = Line::through(&centres);
        for _ in 0..8 {
            for (y, (centre, row)) in centres.iter_mut().zip(self.rows()).enumerate() {
                let at = line.start + line.slope * y as f64;
                let (mut sum, mut moment) = (0.0, 0.0);
                for (x, pair) in row.windows(2).enumerate() {
                    let offset = x as f64 + 0.5 - at;
                    if offset.abs() < CENTROID {
                        let weight = 1.0 + (PI * offset / CENTROID).cos();
                        sum += weight * (pair[1] - pair[0]);
                        moment += weight * (pair[1] - pair[0]) * offset;
                    }
                }
                if sum <= 0.0 {
                    return Err(no_line());
                }
                *centre = at + (moment / sum).clamp(-CENTROID, CENTROID);
            }
            line = Line::through(&centres);
        }
        let squares = centres.iter().enumerate().map(|(y, c)| (c - line.start - line.slope * y as f64).powi(2));
        let scatter = (squares.sum::<f64>() / self.height as f64).sqrt();
        let last = line.start + line.slope * self.height as f64;
        let is_inside = |x: f64| (CENTROID..self.width as f64 - CENTROID).contains(&x);
        if scatter < 1.0 && is_inside(line.start) && is_inside(last) { Ok(line) } else { Err(no_line()) }
    }

    /// The edge spread function over the rows that contain whole steps of the edge from column to column.
    fn edge_spread(&self, line: &Line, angle: f64) -> Result<EdgeSpread, AnalysisError> {
        let few_rows = || {
            AnalysisError::unfit(
                format!("{} rows of pixels along the edge are too few for bins of a quarter of a pixel", self.height),
                "use a longer piece of the edge, or a larger angle",
            )
        };
        let steps = (self.height as f64 * line.slope.abs()).floor();
        let rows = (steps / line.slope.abs()).round() as usize;
        let ends = [line.start, line.start + line.slope * rows as f64];
        let left = ends[0].min(ends[1]).floor();
        let right = (self.width as f64 - 1.0 - ends[0].max(ends[1])).floor();
        let reach = (left.min(right) * angle.cos() * BINS).floor();
        if steps < 1.0 || reach < CENTROID * BINS {
            return Err(few_rows());
        }
        let mut bins = vec![Bin::default(); 2 * reach as usize];
        // Calls a function with the distance of each pixel in reach, in bins, and its value.
        let pixels = |each: &mut dyn FnMut(f64, f64)| {
            for (y, row) in self.rows().take(rows).enumerate() {
                for (x, value) in row.iter().enumerate() {
                    let distance = (x as f64 - line.start - line.slope * y as f64) * angle.cos() * BINS + reach;
                    if distance >= 0.0 && distance < 2.0 * reach {
                        each(distance, *value);
                    }
                }
            }
        };
        pixels(&mut |distance, value| {
            let bin = &mut bins[distance as usize];
            (bin.count, bin.place, bin.value) = (bin.count + 1.0, bin.place + distance, bin.value + value);
        });
        if bins.iter().any(|bin| bin.count == 0.0) {
            return Err(few_rows());
        }
        bins.iter_mut().for_each(|bin| (bin.place, bin.value) = (bin.place / bin.count, bin.value / bin.count));
        // The noise is the scatter around the straight line through the neighbours of a bin.
        let known = bins.clone();
        pixels(&mut |distance, value| {
            let i = distance as usize;
            let (a, b) = (&known[i.saturating_sub(1)], &known[(i + 1).min(known.len() - 1)]);
            let slope = (b.value - a.value) / (b.place - a.place);
            bins[i].square += (value - known[i].value - slope * (distance - known[i].place)).powi(2);
        });
        Ok(EdgeSpread { bins, middle: reach })
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Checks contrast and clipping of the dark and the bright quarter.
fn check_sides(dark: &[f64], bright: &[f64]) -> Result<(), AnalysisError> {
    let deviation = |values: &[f64]| {
        let m = mean(values);
        (values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let step = mean(bright) - mean(dark);
    if step <= CONTRAST * deviation(dark).max(deviation(bright)) {
        return Err(AnalysisError::unfit(
            format!(
                "there is no edge: the sides of the image differ by {step:.1} DN, about as much as pixels of one side"
            ),
            "use an image with an edge between an even dark and an even bright area, more light, or the mean of more frames",
        ));
    }
    let share = |values: &[f64], of: f64| values.iter().filter(|v| **v == of).count() as f64 / values.len() as f64;
    let largest = bright.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    for (side, value, values, help) in [
        ("bright", largest, bright, "expose less; an image without any noise is refused too"),
        ("dark", 0.0, dark, "raise the black level of the camera, so that its noise is not cut off at zero"),
    ] {
        let clipped = share(values, value);
        if clipped > CLIPPED {
            let problem =
                format!("{:.0} % of the {side} pixels have the value {value}: they are clipped", 100.0 * clipped);
            return Err(AnalysisError::unfit(problem, help));
        }
    }
    Ok(())
}

impl Line {
    fn through(centres: &[f64]) -> Self {
        let (slope, start) = crate::summary::line(centres.iter().enumerate().map(|(y, x)| (y as f64, *x)));
        Self { start, slope }
    }
}

/// Pixels of one distance: number, mean distance \[bins\], mean value, and sum of squares of the noise.
#[derive(Clone, Debug, Default)]
struct Bin {
    count: f64,
    place: f64,
    value: f64,
    square: f64,
}

/// The edge spread function, with the edge at `middle` \[bins\].
struct EdgeSpread {
    bins: Vec<Bin>,
    middle: f64,
}

impl EdgeSpread {
    /// The MTF at a frequency [cycles/pixel], and its standard error.
    fn mtf(&self, frequency: f64) -> [f64; 2] {
        // A Tukey window: flat in its inner half.
        let window = |place: f64| {
            let r = (place - self.middle).abs() / self.middle;
            if r < 0.5 { 1.0 } else { 0.5 + 0.5 * (2.0 * PI * (r - 0.5)).cos() }
        };
        // Real and imaginary factor of the difference between bin i and the next.
        let wave = |i: usize| {
            let place = 0.5 * (self.bins[i].place + self.bins[i + 1].place);
            let phase = -2.0 * PI * frequency / BINS * (place - self.middle);
            [phase.cos(), phase.sin()].map(|v| v * window(place))
        };
        let last = self.bins.len() - 1;
        let (mut sum, mut total) = ([0.0; 2], 0.0);
        for i in 0..last {
            let step = self.bins[i + 1].value - self.bins[i].value;
            let [re, im] = wave(i);
            sum = [sum[0] + re * step, sum[1] + im * step];
            total += step * window(0.5 * (self.bins[i].place + self.bins[i + 1].place));
        }
        let length = sum[0].hypot(sum[1]);
        // The part of the noise of each bin along the sum.
        let along = |[re, im]: [f64; 2]| (re * sum[0] + im * sum[1]) / length;
        let mut variance = 0.0;
        for (i, bin) in self.bins.iter().enumerate() {
            let before = if i > 0 { along(wave(i - 1)) } else { 0.0 };
            let after = if i < last { along(wave(i)) } else { 0.0 };
            let noise = bin.square / (bin.count - 1.0).max(1.0) / bin.count;
            variance += (before - after).powi(2) * noise;
        }
        let boxes = total * sinc(frequency / BINS).powi(2);
        [length / boxes, variance.sqrt() / boxes]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64Mcg;
    use statrs::distribution::{ChiSquared, ContinuousCDF};

    const SIDE: usize = 192;
    const ANGLE: f64 = 5.0;

    /// The MTF of a lens without aberrations and of a square pixel along the normal, for a cutoff in cycles per pixel
    /// (Goodman 2005).
    fn closed_form(frequency: f64, cutoff: f64) -> f64 {
        let (x, tilt) = ((frequency / cutoff).min(1.0), ANGLE.to_radians());
        2.0 / PI * (x.acos() - x * (1.0 - x * x).sqrt()) * sinc(frequency * tilt.cos()) * sinc(frequency * tilt.sin())
    }

    /// The image of an edge from 200 to 2000 DN: the integral of MTF(f) sin(2 pi f d) / (pi f) over all frequencies.
    fn edge(cutoff: f64) -> Vec<f64> {
        let (nodes, tilt) = (700, ANGLE.to_radians());
        let mtf: Vec<[f64; 2]> = (0..nodes)
            .map(|i| (f64::from(i) + 0.5) * cutoff / f64::from(nodes))
            .map(|f| [f, closed_form(f, cutoff) / f * cutoff / f64::from(nodes) / PI])
            .collect();
        let middle = 0.5 * SIDE as f64 + 0.3;
        let at = |i: usize| {
            let (x, y) = ((i % SIDE) as f64 - middle, (i / SIDE) as f64 - middle);
            let d = x * tilt.cos() - y * tilt.sin();
            200.0 + 1800.0 * (0.5 + mtf.iter().map(|[f, m]| m * (2.0 * PI * f * d).sin()).sum::<f64>())
        };
        (0..SIDE * SIDE).map(at).collect()
    }

    fn found(values: &[f64]) -> EdgeMtf {
        slanted_edge(SIDE, values).expect("an edge")
    }

    /// Cutoffs of f/2.8, f/8 and f/16 at 550 nm on pixels of 3.45 um. The window and the finite image cost the rest.
    #[test]
    fn the_mtf_of_diffraction_and_pixel_is_found() {
        for f_number in [2.8, 8.0, 16.0] {
            let cutoff = 3.45 / (0.55 * f_number);
            let edge = found(&edge(cutoff));
            assert!((edge.angle - ANGLE).abs() < 0.01 && !edge.is_horizontal, "{}", edge.angle);
            for p in &edge.points {
                let expected = closed_form(p.frequency, cutoff);
                assert!((p.camera - expected).abs() < 0.01, "f/{f_number}: {p:?}, expected {expected}");
            }
            assert_eq!(edge.points.last().map(|p| p.frequency), Some(0.5));
            let [frequency, _] = edge.mtf50.unwrap_or([0.5, 0.0]);
            assert!((closed_form(frequency, cutoff) - 0.5).abs() < 0.01 || frequency == 0.5, "{frequency}");
        }
    }

    /// Standard errors against the scatter over 40 images with noise. Each of the ten sums of squares is chi-squared; a
    /// correct analysis fails once in 1e9.
    #[test]
    fn standard_errors_are_those_of_the_noise() {
        const IMAGES: u32 = 40;
        let (clean, mut rng) = (edge(0.784), Pcg64Mcg::new(7));
        let truth = found(&clean);
        let noise = Normal::new(0.0, 30.0).expect("a deviation");
        let mut squares = [0.0; FREQUENCIES as usize];
        for _ in 0..IMAGES {
            let noisy: Vec<f64> = clean.iter().map(|v| v + noise.sample(&mut rng)).collect();
            for ((sum, p), t) in squares.iter_mut().zip(&found(&noisy).points).zip(&truth.points) {
                *sum += ((p.camera - t.camera) / p.error).powi(2);
            }
        }
        let chi = ChiSquared::new(f64::from(IMAGES)).expect("a freedom");
        let (low, high) = (chi.inverse_cdf(2e-11), chi.inverse_cdf(1.0 - 2e-11));
        assert!(squares.iter().all(|s| (low..high).contains(s)), "{low} to {high}: {squares:?}");
    }

    #[test]
    fn edges_in_any_direction_have_the_same_mtf() {
        let upright = edge(0.784);
        let expected = found(&upright);
        let mirrored: Vec<f64> = upright.chunks(SIDE).flat_map(|row| row.iter().rev().copied()).collect();
        let turned: Vec<f64> = (0..SIDE * SIDE).map(|i| upright[i % SIDE * SIDE + i / SIDE]).collect();
        for (image, is_horizontal) in [(mirrored, false), (turned, true)] {
            let other = found(&image);
            assert_eq!(other.is_horizontal, is_horizontal);
            let pairs = other.points.iter().zip(&expected.points);
            assert!(pairs.into_iter().all(|(a, b)| (a.camera - b.camera).abs() < 1e-6));
        }
    }

    #[test]
    fn a_table_of_a_lens_does_not_rise() {
        let mut points =
            [0.9, 1.2, 0.5, 0.4, 0.6, -0.1].map(|lens| MtfPoint { frequency: 0.1, camera: lens, error: 0.0, lens });
        not_rising(&mut points);
        assert_eq!(points.map(|p| p.lens), [1.0, 1.0, 0.5, 0.5, 0.5, 0.0]);
    }

    #[test]
    fn images_without_a_slanted_edge_are_refused() {
        let mut rng = Pcg64Mcg::new(1);
        let noise = Normal::new(0.0, 5.0).expect("a deviation");
        let mut image = |at: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            (0..64 * 64).map(|i| at((i % 64) as f64, (i / 64) as f64) + noise.sample(&mut rng)).collect()
        };
        let step = |is_bright: bool| if is_bright { 1000.0 } else { 100.0 };
        for (values, problem) in [
            (image(&|_, _| 500.0), "no edge"),
            (image(&|x, _| step(x > 32.0)), "0.0 degrees"),
            (image(&|x, y| step(x - 32.0 > 0.5 * (y - 32.0))), "26."),
            (
                image(&|x, y| step(x - 32.0 > 0.1 * (y - 32.0)).min(900.0)).iter().map(|v| v.min(890.0)).collect(),
                "clipped",
            ),
            (image(&|x, y| step(x - 32.0 > 0.1 * (y - 32.0)) - 100.0).iter().map(|v| v.max(0.0)).collect(), "value 0"),
            (image(&|x, y| step(x - 32.0 > 8.0 * (0.2 * y).sin())), "no straight edge"),
        ] {
            let error = slanted_edge(64, &values).expect_err(problem);
            assert!(error.to_string().contains(problem) && !error.help().is_empty(), "{problem}: {error}");
        }
        assert!(slanted_edge(8, &[0.0; 64]).is_err());
    }
}
