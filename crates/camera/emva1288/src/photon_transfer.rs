//! The photon transfer curve: temporal variance against mean, and the lines through it.
//!
//! sigma_y^2 = K^2 sigma_d^2 + sigma_q^2 + K (mu_y - mu_y.dark)   (EMVA 1288 release 4.0 Linear, equation 15)

use std::collections::BTreeMap;

use serde::Serialize;

use crate::frame::AnalysisError;
use crate::quantity::Quantity;
use crate::temporal::{FramePair, TemporalStatistics};

/// Regressions end at this fraction of saturation.
const RANGE: f64 = 0.7;

/// One point of the curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TransferPoint {
    /// Mean grey value mu_y \[DN\].
    pub mean: f64,
    /// Standard error of the mean \[DN\].
    pub mean_error: f64,
    /// Temporal variance sigma_y^2 \[DN^2\].
    pub variance: f64,
    /// Standard error of the variance \[DN^2\].
    pub variance_error: f64,
    /// Degrees of freedom of the variance: pixels times (frames - 1).
    pub degrees_of_freedom: f64,
    /// Pixels that contribute.
    pub pixels: u64,
}

impl From<&FramePair> for TransferPoint {
    fn from(pair: &FramePair) -> Self {
        Self {
            mean: pair.mean.value,
            mean_error: pair.mean.standard_error,
            variance: pair.variance.value,
            variance_error: pair.variance.standard_error,
            degrees_of_freedom: pair.pixels as f64,
            pixels: pair.pixels,
        }
    }
}

/// A photon transfer curve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotonTransfer {
    /// The dark level.
    dark: TransferPoint,
    /// The points, by ascending mean.
    points: Vec<TransferPoint>,
}

impl PhotonTransfer {
    /// The curve of the standard: one point per level of even light, and the dark level.
    pub fn by_levels(dark: &FramePair, levels: &[FramePair]) -> Self {
        let mut points: Vec<TransferPoint> = levels.iter().map(TransferPoint::from).collect();
        points.sort_by(|a, b| a.mean.total_cmp(&b.mean));
        Self { dark: dark.into(), points }
    }

    /// The curve of one scene. Pixels whose temporal mean falls into the same interval [k, k + 1) DN form a point, with
    /// the mean of their variances. This assumes a camera with equal pixels.
    ///
    /// `keep`, if given, contains for every pixel whether it is used. `dark_value` is the grey value without light
    /// \[DN\]. It only shifts the abscissa of the fits.
    pub fn by_unit_bins(
        stack: &TemporalStatistics,
        dark_value: f64,
        keep: Option<&[bool]>,
    ) -> Result<Self, AnalysisError> {
        Self::by_bins(stack, 0.0, 1.0, dark_value, keep)
    }

    /// [`PhotonTransfer::by_unit_bins`] with intervals of another width \[DN\], one of which begins at `origin`. It is
    /// for cameras with so many grey values that few pixels share one. Means are averaged like variances, so a straight
    /// line stays one.
    ///
    /// Pixels that differ only in their noise should lie in the middle of one interval. An edge of an interval among
    /// them would separate those that happen to be bright, which vary more, from the others.
    pub fn by_bins(
        stack: &TemporalStatistics,
        origin: f64,
        width: f64,
        dark_value: f64,
        keep: Option<&[bool]>,
    ) -> Result<Self, AnalysisError> {
        let width = if width > 0.0 && width.is_finite() { width } else { 1.0 };
        if let Some(mask) = keep
            && mask.len() != stack.mean.len()
        {
            return Err(AnalysisError::Mask { got: mask.len(), pixels: stack.mean.len() });
        }
        let mut bins: BTreeMap<i64, Bin> = BTreeMap::new();
        for (i, ((&mean, &variance), &frames)) in stack.mean.iter().zip(&stack.variance).zip(&stack.counts).enumerate()
        {
            if frames > 1 && keep.and_then(|mask| mask.get(i)).copied().unwrap_or(true) {
                bins.entry(((mean - origin) / width).floor() as i64).or_default().add(mean, variance, frames);
            }
        }
        let points = bins.values().map(Bin::point).collect();
        let dark = TransferPoint {
            mean: dark_value,
            mean_error: 0.0,
            variance: 0.0,
            variance_error: 0.0,
            degrees_of_freedom: 0.0,
            pixels: 0,
        };
        Ok(Self { dark, points })
    }

    /// The same curve with additional frames without light of the same camera. All their pixels form its first point
    /// and its dark level.
    #[must_use]
    pub fn with_dark_frames(mut self, stack: &TemporalStatistics) -> Self {
        let mut dark = Bin::default();
        for ((&mean, &variance), &frames) in stack.mean.iter().zip(&stack.variance).zip(&stack.counts) {
            if frames > 1 {
                dark.add(mean, variance, frames);
            }
        }
        if dark.pixels > 0 {
            self.dark = dark.point();
            let at = self.points.partition_point(|p| p.mean < self.dark.mean);
            self.points.insert(at, self.dark);
        }
        self
    }

    /// The dark level. For a curve from one scene without dark frames it has a mean only.
    pub fn dark(&self) -> &TransferPoint {
        &self.dark
    }

    /// The points, by ascending mean.
    pub fn points(&self) -> &[TransferPoint] {
        &self.points
    }

    /// Overall system gain K: slope through the origin of sigma_y^2 - sigma_y.dark^2 against mu_y - mu_y.dark over 0-70
    /// % of saturation (equation 50), with equal weights. `saturation` is the grey value of saturation \[DN\].
    ///
    /// The standard error contains the errors of the variances and of the dark level that all points share. The
    /// function is for curves by levels. A curve from one scene has points of few pixels among others of many: use
    /// [`PhotonTransfer::line`] for it.
    pub fn gain(&self, saturation: f64) -> Result<Quantity, AnalysisError> {
        let used = self.in_range(saturation, 1)?;
        let (mut xx, mut xy, mut x_sum, mut error) = (0.0, 0.0, 0.0, 0.0);
        for p in &used {
            let x = p.mean - self.dark.mean;
            xx += x * x;
            xy += x * (p.variance - self.dark.variance);
            x_sum += x;
            error += (x * p.variance_error).powi(2);
        }
        if xx <= 0.0 {
            return Err(AnalysisError::TooFewLevels { got: 0, needed: 1 });
        }
        let dark = x_sum * self.dark.variance_error;
        Ok(Quantity {
            symbol: "K",
            name: "overall system gain",
            value: xy / xx,
            standard_error: (error + dark * dark).sqrt() / xx,
            unit: "DN/e-",
            section: "EMVA 1288 release 4.0 Linear, equation 50",
        })
    }

    /// The straight line through the curve over 0-70 % of saturation: slope K and intercept K^2 sigma_d^2 + sigma_q^2
    /// (equation 15). `saturation` is the grey value of saturation \[DN\].
    ///
    /// The weight of a point is the inverse variance of its ordinate. For nearly normal noise that variance is 2
    /// sigma^4 over the degrees of freedom. The sigma^2 in it is that of the line, not that of the point, since points
    /// that happen to be low would otherwise pull the line down. A few iterations converge.
    pub fn line(&self, saturation: f64) -> Result<LineFit, AnalysisError> {
        let used = self.in_range(saturation, 3)?;
        let mut weights: Vec<f64> = used.iter().map(|p| p.degrees_of_freedom).collect();
        let mut fit = Line::through(&used, &weights, self.dark.mean)?;
        // A line at zero or below gives no weight. A hundredth of the mean variance replaces it.
        let floor = (0.01 * used.iter().map(|p| p.variance).sum::<f64>() / used.len() as f64).max(1e-9);
        for _ in 0..8 {
            for (w, p) in weights.iter_mut().zip(&used) {
                let sigma2 = fit.at(p.mean - self.dark.mean).max(floor);
                *w = p.degrees_of_freedom / (2.0 * sigma2 * sigma2);
            }
            fit = Line::through(&used, &weights, self.dark.mean)?;
        }
        Ok(fit.finish(&used, &weights, self.dark.mean))
    }

    fn in_range(&self, saturation: f64, needed: usize) -> Result<Vec<TransferPoint>, AnalysisError> {
        let end = self.dark.mean + RANGE * (saturation - self.dark.mean);
        let used: Vec<TransferPoint> = self.points.iter().filter(|p| p.mean <= end).copied().collect();
        if used.len() < needed {
            return Err(AnalysisError::TooFewLevels { got: used.len(), needed });
        }
        Ok(used)
    }
}

/// Pixels whose means fall into one interval. Their weights are the degrees of freedom of their variances.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    pixels: u64,
    /// Number of values in the means, and degrees of freedom of the variances.
    values: f64,
    freedom: f64,
    means: f64,
    variances: f64,
    /// Sums of squared weights, alone, with the variances and with their squares.
    weights: [f64; 3],
}

impl Bin {
    fn add(&mut self, mean: f64, variance: f64, frames: u32) {
        let weight = f64::from(frames - 1);
        self.pixels += 1;
        self.values += f64::from(frames);
        self.freedom += weight;
        self.means += weight * mean;
        self.variances += weight * variance;
        let square = weight * weight;
        let terms = [square, square * variance, square * variance * variance];
        self.weights.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
    }

    fn point(&self) -> TransferPoint {
        let n = self.pixels as f64;
        let variance = self.variances / self.freedom;
        // The error comes from the spread of the pixels' variances if there are enough pixels, otherwise from the
        // formula for normal noise.
        let spread = if self.pixels >= 8 {
            let [w, wv, wvv] = self.weights;
            let squares = (wvv - 2.0 * variance * wv + variance * variance * w).max(0.0);
            (squares * n / (n - 1.0)).sqrt() / self.freedom
        } else {
            variance * (2.0 / self.freedom).sqrt()
        };
        TransferPoint {
            mean: self.means / self.freedom,
            mean_error: (variance / self.values).sqrt(),
            variance,
            variance_error: spread,
            degrees_of_freedom: self.freedom,
            pixels: self.pixels,
        }
    }
}

/// A straight line through a photon transfer curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LineFit {
    /// Slope, the overall system gain K.
    pub slope: Quantity,
    /// Variance at the dark level, K^2 sigma_d^2 + sigma_q^2.
    pub intercept: Quantity,
    /// Weighted coefficient of determination: 1 for points on the line, 0 for points that a constant fits as well.
    pub r_squared: f64,
    /// Weighted squared residuals per degree of freedom: about 1 if a straight line and normal noise explain the points.
    pub reduced_chi_squared: f64,
    /// Number of points in the fit.
    pub points: usize,
}

/// Weighted least squares, relative to the weighted mean of x, so that no cancellation occurs.
struct Line {
    slope: f64,
    intercept: f64,
    centre: f64,
    weight: f64,
    spread: f64,
}

impl Line {
    fn through(points: &[TransferPoint], weights: &[f64], dark: f64) -> Result<Self, AnalysisError> {
        let weight: f64 = weights.iter().sum();
        let mean =
            |f: &dyn Fn(&TransferPoint) -> f64| points.iter().zip(weights).map(|(p, w)| w * f(p)).sum::<f64>() / weight;
        let centre = mean(&|p| p.mean - dark);
        let height = mean(&|p| p.variance);
        let spread = mean(&|p| (p.mean - dark - centre).powi(2));
        let product = mean(&|p| (p.mean - dark - centre) * (p.variance - height));
        let usable = weight > 0.0 && weight.is_finite() && spread > 0.0;
        if !usable {
            return Err(AnalysisError::TooFewLevels { got: 1, needed: 3 });
        }
        let slope = product / spread;
        Ok(Self { slope, intercept: height - slope * centre, centre, weight, spread })
    }

    fn at(&self, x: f64) -> f64 {
        self.intercept + self.slope * x
    }

    fn finish(&self, points: &[TransferPoint], weights: &[f64], dark: f64) -> LineFit {
        let height = points.iter().zip(weights).map(|(p, w)| w * p.variance).sum::<f64>() / self.weight;
        let (mut residual, mut total) = (0.0, 0.0);
        for (p, w) in points.iter().zip(weights) {
            residual += w * (p.variance - self.at(p.mean - dark)).powi(2);
            total += w * (p.variance - height).powi(2);
        }
        let reduced = residual / (points.len() as f64 - 2.0);
        // If points scatter more than their own errors allow, the errors of the line increase.
        let scale = reduced.max(1.0).sqrt();
        LineFit {
            slope: Quantity {
                symbol: "K",
                name: "overall system gain",
                value: self.slope,
                standard_error: scale / (self.weight * self.spread).sqrt(),
                unit: "DN/e-",
                section: "EMVA 1288 release 4.0 Linear, equation 15, slope",
            },
            intercept: Quantity {
                symbol: "sigma_y.dark^2",
                name: "temporal variance without light",
                value: self.intercept,
                standard_error: scale * ((1.0 + self.centre * self.centre / self.spread) / self.weight).sqrt(),
                unit: "DN^2",
                section: "EMVA 1288 release 4.0 Linear, equation 15, intercept",
            },
            r_squared: if total > 0.0 { 1.0 - residual / total } else { 0.0 },
            reduced_chi_squared: reduced,
            points: points.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(means: &[f64], variances: &[f64], frames: u64) -> TemporalStatistics {
        TemporalStatistics {
            counts: vec![frames as u32; means.len()],
            width: means.len() as u32,
            height: 1,
            frames,
            mean: means.to_vec(),
            variance: variances.to_vec(),
        }
    }

    #[test]
    fn bins_are_one_wide_and_average() {
        let s = stack(&[5.0, 5.9, 6.0, 7.0, 7.5], &[1.0, 3.0, 9.0, 4.0, 6.0], 5);
        let curve = PhotonTransfer::by_unit_bins(&s, 0.0, None).expect("no mask");
        let got: Vec<(f64, f64, u64)> = curve.points().iter().map(|p| (p.mean, p.variance, p.pixels)).collect();
        assert_eq!(got, [(5.45, 2.0, 2), (6.0, 9.0, 1), (7.25, 5.0, 2)]);
        assert_eq!(curve.points()[0].degrees_of_freedom, 8.0);
        let masked = PhotonTransfer::by_unit_bins(&s, 0.0, Some(&[true, true, false, false, true])).expect("fits");
        assert_eq!(masked.points().len(), 2);
        let wrong = PhotonTransfer::by_unit_bins(&s, 0.0, Some(&[true]));
        assert_eq!(wrong, Err(AnalysisError::Mask { got: 1, pixels: 5 }));
    }

    #[test]
    fn points_on_a_line_give_the_line_and_the_range_ends_at_70_percent() {
        let means: Vec<f64> = (0..100).map(|k| f64::from(k) + 10.5).collect();
        // Above 70 % the variance falls, as near saturation.
        let variances: Vec<f64> = means.iter().map(|m| if *m < 80.0 { 2.0 + 0.3 * (m - 10.0) } else { 1.0 }).collect();
        let curve = PhotonTransfer::by_unit_bins(&stack(&means, &variances, 9), 10.0, None).expect("no mask");
        let fit = curve.line(110.0).expect("points");
        assert!((fit.slope.value - 0.3).abs() < 1e-12 && (fit.intercept.value - 2.0).abs() < 1e-10, "{fit:?}");
        assert!((fit.r_squared - 1.0).abs() < 1e-12);
        assert_eq!(fit.points, 70);
    }

    #[test]
    fn dark_frames_are_the_first_point_and_the_dark_level() {
        // A line of slope 0.4 from (10, 1). The few points with light scatter.
        let lit = stack(&[20.5, 30.5, 40.5], &[5.0, 9.4, 13.1], 9);
        let dark = stack(&[9.75, 10.25, 9.75, 10.25], &[0.5, 1.5, 0.5, 1.5], 9);
        let alone = PhotonTransfer::by_unit_bins(&lit, 10.0, None).expect("no mask");
        let curve = alone.clone().with_dark_frames(&dark);
        assert_eq!(curve.points().len(), 4);
        assert_eq!(curve.points()[0], *curve.dark());
        assert_eq!((curve.dark().mean, curve.dark().variance, curve.dark().pixels), (10.0, 1.0, 4));
        // The dark level fixes the intercept, which the other points do not determine well.
        let (without, with) = (alone.line(200.0).expect("points"), curve.line(200.0).expect("points"));
        assert!(with.intercept.standard_error < 0.1 * without.intercept.standard_error, "{with:?} {without:?}");
        assert!(with.slope.standard_error < without.slope.standard_error);
        assert!((with.intercept.value - 1.0).abs() < 0.1 && (with.slope.value - 0.4).abs() < 0.02, "{with:?}");
        // Frames without a variance change nothing.
        assert_eq!(alone.clone().with_dark_frames(&stack(&[10.0], &[f64::NAN], 1)), alone);
    }

    #[test]
    fn too_few_or_equal_levels_are_refused() {
        let one = PhotonTransfer::by_unit_bins(&stack(&[5.0, 5.0, 5.0], &[1.0; 3], 4), 0.0, None).expect("no mask");
        assert_eq!(one.line(100.0), Err(AnalysisError::TooFewLevels { got: 1, needed: 3 }));
        let none = PhotonTransfer::by_unit_bins(&stack(&[], &[], 4), 0.0, None).expect("no mask");
        assert_eq!(none.gain(100.0), Err(AnalysisError::TooFewLevels { got: 0, needed: 1 }));
        let zero = PhotonTransfer::by_unit_bins(&stack(&[5.0, 6.0, 7.0], &[0.0; 3], 4), 0.0, None).expect("no mask");
        assert!(zero.line(100.0).is_ok_and(|f| f.slope.value == 0.0 && f.r_squared == 0.0));
    }
}
