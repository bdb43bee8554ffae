//! Linearity: deviations of the mean grey values from a straight line (EMVA 1288 release 4.0 Linear, section 6.7).

use serde::Serialize;

use crate::frame::AnalysisError;
use crate::summary::{Point, Summary};

/// Range of the regression, as fractions of saturation: 5 to 95 %.
const RANGE: [f64; 2] = [0.05, 0.95];
/// Least number of levels. With fewer, a line with two parameters has no meaningful deviation.
const MIN_LEVELS: usize = 4;

/// The line and the deviations from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Linearity {
    /// Slope of the line \[DN per photon\].
    pub slope: f64,
    /// Grey value of the line without light, with dark subtracted \[DN\].
    pub offset: f64,
    /// Linearity error LE: mean magnitude of the relative deviations \[%\].
    pub error: f64,
    /// Standard error of LE. A camera without any deviation has an LE of about 0.8 times this.
    pub standard_error: f64,
    /// Smallest and largest relative deviation \[%\], as in release 3.1, with standard errors.
    pub least: [f64; 2],
    /// See [`Linearity::least`].
    pub most: [f64; 2],
    /// Relative deviation of every level \[%\], in the order of the levels.
    pub deviations: Vec<f64>,
    /// Indices of the levels in the range of the regression: first, and one past the last.
    pub range: [usize; 2],
}

/// Least squares of the relative deviation: the weight of a level is one over its squared signal. `saturation` is the
/// signal there \[DN\].
pub(crate) fn linearity(summary: &Summary, saturation: f64) -> Result<Linearity, AnalysisError> {
    let signal = |p: &Point| p.mean.value - summary.dark[p.dark].mean.value;
    let first = summary.bright.iter().position(|p| signal(p) >= RANGE[0] * saturation);
    // Beyond saturation the signal falls again if longer exposures have more dark current.
    let below = summary.bright.partition_point(|p| p.photons <= summary.saturation.value);
    let end = summary.bright[..below].iter().rposition(|p| signal(p) <= RANGE[1] * saturation).map_or(0, |i| i + 1);
    let first = first.unwrap_or(end).min(end);
    let used = &summary.bright[first..end];
    if used.len() < MIN_LEVELS || used.iter().any(|p| signal(p) <= 0.0) {
        return Err(AnalysisError::unfit(
            format!("{} levels lie between 5 and 95 % of saturation, linearity needs {MIN_LEVELS}", used.len()),
            "add levels between dark and saturation; the standard requires 50",
        ));
    }
    let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in used {
        let (x, y) = (p.photons, signal(p));
        let weight = 1.0 / (y * y);
        w += weight;
        wx += weight * x;
        wy += weight * y;
        wxx += weight * x * x;
        wxy += weight * x * y;
    }
    let (mx, my) = (wx / w, wy / w);
    let width = wxx / w - mx * mx;
    // Also false if a value is NaN.
    if !(width > 1e-9 * mx * mx && width.is_finite() && mx * mx > 0.0) {
        return Err(AnalysisError::unfit(
            "the levels between 5 and 95 % of saturation do not differ in their light within the precision of the numbers",
            "correct the numbers of photons of the levels: they must be evenly spread, in photons per pixel",
        ));
    }
    let slope = (wxy / w - mx * my) / width;
    let offset = my - slope * mx;
    let at = |x: f64| offset + slope * x;
    let deviations: Vec<f64> =
        summary.bright.iter().map(|p| 100.0 * (signal(p) - at(p.photons)) / at(p.photons)).collect();
    let noise = |p: &Point| {
        let error = p.mean.error.hypot(summary.dark[p.dark].mean.error);
        100.0 * error / at(p.photons)
    };
    let inside = || deviations[first..end].iter().zip(used);
    let n = used.len() as f64;
    let ends = |a: &(&f64, &Point), b: &(&f64, &Point)| a.0.total_cmp(b.0);
    let with_error = |found: Option<(&f64, &Point)>| found.map_or([0.0; 2], |(d, p)| [*d, noise(p)]);
    Ok(Linearity {
        slope,
        offset,
        error: inside().map(|(d, _)| d.abs()).sum::<f64>() / n,
        standard_error: (inside().map(|(_, p)| noise(p).powi(2)).sum::<f64>() / n).sqrt(),
        least: with_error(inside().min_by(ends)),
        most: with_error(inside().max_by(ends)),
        deviations,
        range: [first, end],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::Estimate;

    fn curve(signals: &[f64]) -> Summary {
        let exact = |value| Estimate { value, error: 0.5 };
        let at = |photons: f64, mean: f64| Point {
            exposure: 1.0,
            photons,
            dark: 0,
            mean: exact(mean),
            variance: exact(1.0),
        };
        Summary {
            bright: signals.iter().enumerate().map(|(i, s)| at(100.0 * (i + 1) as f64, 7.0 + s)).collect(),
            dark: vec![at(0.0, 7.0)],
            used: 0,
            saturation: exact(f64::MAX),
            response: exact(1.0),
            offset: exact(0.0),
            row_variance: Estimate::default(),
            spatial: None,
            is_bound: false,
        }
    }

    /// The line fulfils both weighted normal equations. LE is the mean deviation from it.
    #[test]
    fn a_bent_curve_by_hand() {
        let s = curve(&[10.0, 22.0, 33.0, 40.0]);
        let l = linearity(&s, 50.0).expect("levels");
        // Weights 1/100, 1/484, 1/1089, 1/1600.
        let w = [1.0 / 100.0, 1.0 / 484.0, 1.0 / 1089.0, 1.0 / 1600.0];
        let (x, y) = ([100.0, 200.0, 300.0, 400.0], [10.0, 22.0, 33.0, 40.0]);
        // The line fulfils both normal equations.
        for basis in [|_: f64| 1.0, |x: f64| x] {
            let sum: f64 = (0..4).map(|i| w[i] * basis(x[i]) * (y[i] - l.offset - l.slope * x[i])).sum();
            assert!(sum.abs() < 1e-9, "{sum}");
        }
        let mean: f64 = (0..4).map(|i| (y[i] / (l.offset + l.slope * x[i]) - 1.0).abs()).sum::<f64>() * 25.0;
        assert!((l.error - mean).abs() < 1e-9 && l.least[0] < 0.0 && l.most[0] > 0.0, "{l:?}");
    }

    /// One level far brighter than the others, all levels equally bright, or levels so dim that squares are zero.
    #[test]
    fn light_that_makes_no_line_is_refused() {
        let spoil: [fn(&mut Summary); 4] = [
            |s| s.bright[3].photons = 1e308,
            |s| s.bright.iter_mut().for_each(|p| p.photons = 3.0),
            |s| s.bright.iter_mut().for_each(|p| p.photons *= 1e-300),
            |s| s.bright[1].photons = f64::NAN,
        ];
        for spoil in spoil {
            let mut s = curve(&[10.0, 22.0, 33.0, 40.0]);
            spoil(&mut s);
            let e = linearity(&s, 50.0).expect_err("no line");
            assert!(e.to_string().contains("do not differ") && e.help().contains("photons"), "{e}");
        }
    }
}
