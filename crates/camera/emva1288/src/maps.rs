//! Maps of the pixels of a camera, from the mean images of its two stacks.
//!
//! A mean image has noise of its own, which would make the pixels of a map differ more than those of the camera. So the
//! deviations of pixels, rows and columns are each scaled to the variance that the standard states for them. A simulator
//! with these maps has the DSNU and the PRNU that was measured. A pixel of a map with the noise n^2 and the spread s^2 of
//! pixels has the correlation s / sqrt(s^2 + n^2) with the pixel of the camera.

use crate::analysis::Analysis;
use crate::frame::AnalysisError;
use crate::measurement::Measurement;
use crate::stack::SpatialStack;

/// Degree of the polynomial of the flat field. A shading of cos^4 up to 30 degrees deviates from it by less than 1e-3.
const DEGREE: usize = 6;
/// The flat field is not smaller than this.
const LEAST_FLAT: f64 = 1e-3;

/// Maps of the pixels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredMaps {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Dark signal of each pixel less the mean \[e-\].
    pub dsnu: Vec<f32>,
    /// Response of each pixel over the flat field. Its mean is 1.
    pub prnu: Vec<f32>,
    /// Response over its mean, as a polynomial of degree 6: lens shading and uneven light.
    pub flat_field: Vec<f32>,
}

/// The maps of a measurement with stacks. `None` without stacks.
///
/// # Errors
/// As [`analyse`](crate::analyse), for the stacks.
pub fn measured_maps(measurement: &Measurement, analysis: &Analysis) -> Result<Option<MeasuredMaps>, AnalysisError> {
    let (measurement, _) = measurement.in_steps();
    let data = measurement.ordered()?;
    let Some((bright, dark)) = data.stacks.map(|(bright, dark)| (&bright.stack, &dark.stack)) else {
        return Ok(None);
    };
    let (gain, width) = (analysis.value("K"), dark.width as usize);
    let light = (bright.mean - dark.mean) / gain;
    let electrons = |stack: &SpatialStack| -> Vec<f64> { stack.means().map(|y| (y - stack.mean) / gain).collect() };
    let (of_bright, of_dark) = (electrons(bright), electrons(dark));
    let response: Vec<f64> = of_bright.iter().zip(&of_dark).map(|(b, d)| 1.0 + (b - d) / light).collect();
    let flat = low_frequencies(&response, width);
    let detail: Vec<f64> = response.iter().zip(&flat).map(|(r, f)| r - f).collect();

    // Variances of the parts without the noise of the mean image, in electrons.
    let true_variances = |stack: &SpatialStack, values: &[f64]| {
        let noise = stack.temporal_variance / f64::from(stack.frames) / (gain * gain);
        let n = [1.0, f64::from(stack.width), f64::from(stack.height)];
        let parts = Parts::of(values, width);
        std::array::from_fn(|i| parts.product(&parts, i) - noise / n[i])
    };
    let of_pixels: [f64; 3] = true_variances(dark, &of_dark);
    let dark_parts = Parts::of(&of_dark, width).scaled(|i, parts| {
        let measured = parts.product(parts, i);
        if measured > 0.0 { (of_pixels[i].max(0.0) / measured).sqrt() } else { 0.0 }
    });
    // The bright image of the maps, dark + light (flat + a detail), has the variance of the camera's. The noise of the
    // dark image is in both maps, with opposite signs, so that it counts: a^2 R + 2 a C + Q = 0.
    let of_pixels: [f64; 3] = true_variances(bright, &of_bright);
    let flat_parts = Parts::of(&flat, width);
    let detail_parts = Parts::of(&detail, width).scaled(|i, parts| {
        let smooth =
            light * light * flat_parts.product(&flat_parts, i) + 2.0 * light * flat_parts.product(&dark_parts, i);
        let (r, c) = (light * light * parts.product(parts, i), light * parts.product(&dark_parts, i));
        let q = dark_parts.product(&dark_parts, i) + smooth - of_pixels[i];
        if r > 0.0 { ((c * c - r * q).max(0.0).sqrt() - c).max(0.0) / r } else { 0.0 }
    });
    let narrow = |values: Vec<f64>| values.into_iter().map(|v| v as f32).collect();
    let flat: Vec<f64> = flat.into_iter().map(|f| f.max(LEAST_FLAT)).collect();
    Ok(Some(MeasuredMaps {
        width: dark.width,
        height: dark.height,
        dsnu: narrow(dark_parts.sum()),
        prnu: narrow(detail_parts.sum().iter().zip(&flat).map(|(d, f)| (1.0 + d / f).max(0.0)).collect()),
        flat_field: narrow(flat),
    }))
}

/// An image as the sum of its deviations of single pixels, row means and column means from the mean.
struct Parts {
    pixels: Vec<f64>,
    rows: Vec<f64>,
    columns: Vec<f64>,
}

impl Parts {
    fn of(values: &[f64], width: usize) -> Self {
        let height = values.len() / width;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let (mut rows, mut columns) = (vec![-mean; height], vec![-mean; width]);
        for (i, v) in values.iter().enumerate() {
            rows[i / width] += v / width as f64;
            columns[i % width] += v / height as f64;
        }
        let pixels = values.iter().enumerate().map(|(i, v)| v - mean - rows[i / width] - columns[i % width]).collect();
        Self { pixels, rows, columns }
    }

    fn all(&self) -> [&[f64]; 3] {
        [&self.pixels, &self.rows, &self.columns]
    }

    /// The covariance with part `i` of another image: of pixels, rows or columns.
    fn product(&self, other: &Self, i: usize) -> f64 {
        let freedom = [(self.rows.len() - 1) * (self.columns.len() - 1), self.rows.len() - 1, self.columns.len() - 1];
        self.all()[i].iter().zip(other.all()[i]).map(|(a, b)| a * b).sum::<f64>() / freedom[i] as f64
    }

    fn scaled(mut self, factor: impl Fn(usize, &Self) -> f64) -> Self {
        let factors: [f64; 3] = std::array::from_fn(|i| factor(i, &self));
        for (part, factor) in [&mut self.pixels, &mut self.rows, &mut self.columns].into_iter().zip(factors) {
            part.iter_mut().for_each(|v| *v *= factor);
        }
        self
    }

    fn sum(&self) -> Vec<f64> {
        let width = self.columns.len();
        self.pixels.iter().enumerate().map(|(i, v)| v + self.rows[i / width] + self.columns[i % width]).collect()
    }
}

/// The least-squares polynomial of an image, of total degree 6.
fn low_frequencies(values: &[f64], width: usize) -> Vec<f64> {
    let height = values.len() / width;
    let (along, down) = (polynomials(width), polynomials(height));
    // The polynomials are orthonormal on the grid, so each coefficient is a sum of products.
    let of_rows: Vec<Vec<f64>> = values
        .chunks(width)
        .map(|row| along.iter().map(|p| row.iter().zip(p).map(|(v, p)| v * p).sum()).collect())
        .collect();
    let coefficient = |p: usize, q: usize| of_rows.iter().zip(&down[q]).map(|(row, d)| row[p] * d).sum::<f64>();
    let terms: Vec<(usize, usize, f64)> = (0..along.len())
        .flat_map(|p| (0..down.len()).map(move |q| (p, q)))
        .filter(|(p, q)| p + q <= DEGREE)
        .map(|(p, q)| (p, q, coefficient(p, q)))
        .collect();
    let row = |y: usize| {
        let mut of_row = vec![0.0; along.len()];
        terms.iter().for_each(|&(p, q, c)| of_row[p] += c * down[q][y]);
        let along = &along;
        (0..width).map(move |x| of_row.iter().zip(along).map(|(c, p)| c * p[x]).sum::<f64>())
    };
    (0..height).flat_map(row).collect()
}

/// Polynomials of rising degree that are orthonormal on `n` equidistant points (Gram). Few points have few of them.
fn polynomials(n: usize) -> Vec<Vec<f64>> {
    let x = |i: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
    let mut all: Vec<Vec<f64>> = Vec::new();
    for _ in 0..=DEGREE.min(n / 8) {
        let mut next: Vec<f64> = match all.last() {
            None => vec![1.0; n],
            Some(last) => last.iter().enumerate().map(|(i, v)| v * x(i)).collect(),
        };
        // Twice is enough for rounding (Gram and Schmidt).
        for _ in 0..2 {
            for p in &all {
                let along: f64 = next.iter().zip(p).map(|(a, b)| a * b).sum();
                next.iter_mut().zip(p).for_each(|(v, p)| *v -= along * p);
            }
        }
        let length = next.iter().map(|v| v * v).sum::<f64>().sqrt();
        all.push(next.into_iter().map(|v| v / length).collect());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Natural shading of a lens up to 30 degrees in the corners, cos^4.
    #[test]
    fn a_shaded_image_is_its_own_flat_field() {
        let (width, height) = (160, 120);
        let shade = |i: usize| {
            let [x, y] = [(i % width) as f64 - 79.5, (i / width) as f64 - 59.5].map(|v| v / 100.0 * 0.577);
            (1.0 + x * x + y * y).powi(-2)
        };
        let image: Vec<f64> = (0..width * height).map(shade).collect();
        let fit = low_frequencies(&image, width);
        let worst = image.iter().zip(&fit).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-3, "{worst}");
        // A pattern that alternates from pixel to pixel is none of it.
        let fine: Vec<f64> =
            (0..width * height).map(|i| if (i % width + i / width) % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(low_frequencies(&fine, width).iter().all(|v| v.abs() < 1e-2));
    }

    #[test]
    fn an_image_is_the_sum_of_its_parts() {
        let image = [1.0, 5.0, 2.0, 8.0, -3.0, 0.5, 7.0, 2.0, 9.0, 4.0, 4.0, 1.0];
        let mean = image.iter().sum::<f64>() / 12.0;
        let parts = Parts::of(&image, 4);
        assert!(parts.rows.iter().sum::<f64>().abs() < 1e-12 && parts.columns.iter().sum::<f64>().abs() < 1e-12);
        assert!(parts.sum().iter().zip(image).all(|(a, b)| (a - (b - mean)).abs() < 1e-12));
    }
}
