//! Statistics of renders with different seeds: variance per pixel, its means over the image, and their standard errors.

use crate::report::estimate::Estimate;
use dunkelfeld::film::Plane;

/// The mean of planes of one size, pixel by pixel.
pub(super) fn mean_plane(planes: &[Plane<f32>]) -> Option<Plane<f64>> {
    let first = planes.first()?;
    let mut sum = first.map(|&v| f64::from(v));
    for plane in &planes[1..] {
        sum.data_mut().iter_mut().zip(plane.data()).for_each(|(s, v)| *s += f64::from(*v));
    }
    let n = planes.len() as f64;
    sum.data_mut().iter_mut().for_each(|s| *s /= n);
    Some(sum)
}

/// Squared deviations from the mean, plane by plane. All variances below are computed from them.
pub(super) struct Deviations {
    squares: Vec<Plane<f64>>,
}

impl Deviations {
    /// `None` with fewer than three planes: the variance would have no standard error.
    pub(super) fn of(planes: &[Plane<f32>]) -> Option<Self> {
        let mean = mean_plane(planes)?;
        let square = |plane: &Plane<f32>| {
            let data = plane.data().iter().zip(mean.data()).map(|(v, m)| (f64::from(*v) - m).powi(2)).collect();
            Plane::from_vec(plane.width(), plane.height(), data)
        };
        let squares = planes.iter().map(square).collect::<Option<Vec<_>>>()?;
        (squares.len() >= 3).then_some(Self { squares })
    }

    fn count(&self) -> f64 {
        self.squares.len() as f64
    }

    /// Sample variance of each pixel.
    pub(super) fn variance(&self) -> Plane<f64> {
        self.variance_without(None)
    }

    /// Sample variance of each pixel without one of the planes. Without plane i of N, the sum of squares decreases by
    /// `N / (N - 1) d_i^2` (Welford 1962).
    fn variance_without(&self, left_out: Option<usize>) -> Plane<f64> {
        let n = self.count();
        let mut sum = self.squares[0].map(|_| 0.0);
        for (i, plane) in self.squares.iter().enumerate() {
            let factor = if left_out == Some(i) { 1.0 - n / (n - 1.0) } else { 1.0 };
            sum.data_mut().iter_mut().zip(plane.data()).for_each(|(s, d)| *s += factor * d);
        }
        let freedom = if left_out.is_some() { n - 2.0 } else { n - 1.0 };
        sum.data_mut().iter_mut().for_each(|s| *s = (*s / freedom).max(0.0));
        sum
    }

    /// A function of the variances, with its standard error from leaving out one plane at a time (the jackknife of
    /// Tukey 1958).
    pub(super) fn jackknife(&self, f: impl Fn(&Plane<f64>) -> f64) -> Estimate {
        let n = self.count();
        let without: Vec<f64> = (0..self.squares.len()).map(|i| f(&self.variance_without(Some(i)))).collect();
        let centre = without.iter().sum::<f64>() / n;
        let spread: f64 = without.iter().map(|v| (v - centre).powi(2)).sum();
        Estimate { value: f(&self.variance()), error: ((n - 1.0) / n * spread).sqrt() }
    }
}

/// The mean of a plane over the included pixels, NaN if there are none.
pub(super) fn masked_mean(plane: &Plane<f64>, counts: &[bool]) -> f64 {
    let (mut sum, mut n) = (0.0, 0u64);
    for (v, _) in plane.data().iter().zip(counts).filter(|(_, c)| **c) {
        sum += v;
        n += 1;
    }
    sum / n as f64
}

/// Side of the window that variances are pooled over.
pub(super) const POOL: u32 = 7;

/// The mean over a window of [`POOL`] x [`POOL`] pixels, cut at the borders. A variance from N renders has the relative
/// standard error `sqrt(2 / (N - 1))`. That of 49 pixels is seven times smaller.
pub(super) fn pooled(plane: &Plane<f64>) -> Plane<f64> {
    let (width, height, reach) = (plane.width(), plane.height(), POOL / 2);
    let window = |at: u32, size: u32| (at.saturating_sub(reach), (at + reach + 1).min(size));
    let rows = Plane::from_fn(width, height, |x, y| {
        let (from, to) = window(x, width);
        (from..to).map(|i| plane.at(i, y)).sum::<f64>() / f64::from(to - from)
    });
    Plane::from_fn(width, height, |x, y| {
        let (from, to) = window(y, height);
        (from..to).map(|i| rows.at(x, i)).sum::<f64>() / f64::from(to - from)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::estimate::mean;
    use dunkelfeld_sampling::keyed_stream;
    use rand_core::Rng;

    fn plane(values: &[f32]) -> Plane<f32> {
        Plane::from_vec(values.len() as u32, 1, values.to_vec()).expect("one row")
    }

    /// Sums of twelve uniform numbers minus six: variance one.
    fn noise(seed: u64, pixels: u32, sigma: f32) -> Plane<f32> {
        let mut rng = keyed_stream(seed, 0, 0, 0);
        let mut one = || (0..12).map(|_| rng.next_u32() as f32 / u32::MAX as f32).sum::<f32>() - 6.0;
        Plane::from_fn(pixels, 1, |_, _| sigma * one())
    }

    #[test]
    fn the_spread_of_three_numbers_is_the_one_of_the_textbook() {
        let planes = [plane(&[1.0, 5.0]), plane(&[2.0, 5.0]), plane(&[6.0, 5.0])];
        let deviations = Deviations::of(&planes).expect("three");
        // Mean 3, squares 4 + 1 + 9 over 2.
        assert_eq!(deviations.variance().data(), [7.0, 0.0]);
        // Without the last: 1 and 2, variance one half.
        let without = deviations.variance_without(Some(2));
        assert!((without.data()[0] - 0.5).abs() < 1e-12, "{without:?}");
        assert!(Deviations::of(&planes[..2]).is_none());
        assert!(Deviations::of(&[]).is_none());
    }

    #[test]
    fn the_jackknife_states_the_error_that_repetition_shows() {
        // 400 repetitions of 8 seeds at 20 pixels of variance 4: the variance of the estimate is 2 sigma^4 / (7 * 20)
        // (normal numbers; the sum of twelve uniform ones has an excess kurtosis of -0.1, 5 % less for 8 numbers).
        let runs: Vec<Estimate> = (0..400)
            .map(|run| {
                let planes: Vec<_> = (0..8).map(|i| noise(1000 + 8 * run + i, 20, 2.0)).collect();
                Deviations::of(&planes).expect("eight").jackknife(|v| masked_mean(v, &[true; 20]))
            })
            .collect();
        let values: Vec<f64> = runs.iter().map(|e| e.value).collect();
        let truth = mean(&values);
        // Five standard errors: false alarm 6e-7.
        assert!((truth.value - 4.0).abs() < 5.0 * truth.error, "{truth:?}");
        let shown = truth.error * 20.0;
        let stated = (runs.iter().map(|e| e.error.powi(2)).sum::<f64>() / 400.0).sqrt();
        // The spread of 400 runs has a standard error of 3.5 %, the estimated errors one of 4 %. The jackknife of a
        // variance is a few per cent too large. A quarter is more than five times their sum.
        assert!((stated / shown - 1.0).abs() < 0.25, "stated {stated}, shown {shown}");
    }

    #[test]
    fn pooling_keeps_the_mean_of_a_large_flat_and_spreads_a_peak() {
        let flat = pooled(&Plane::new(20, 10, 3.0));
        assert!(flat.data().iter().all(|v| (v - 3.0f64).abs() < 1e-12));
        let peak = pooled(&Plane::from_fn(20, 20, |x, y| if (x, y) == (10, 10) { 49.0 } else { 0.0 }));
        assert!((peak.at(7, 13) - 1.0).abs() < 1e-12 && *peak.at(6, 10) == 0.0);
        // At the corner the window is 4 x 4.
        let corner = pooled(&Plane::from_fn(20, 20, |x, y| if x + y == 0 { 16.0 } else { 0.0 }));
        assert!((corner.at(0, 0) - 1.0).abs() < 1e-12);
    }
}
