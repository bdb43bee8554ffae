//! Statements of Kludt et al. about the noise of rendered pictures, and their test with these renders.

use super::analysis::PictureSeries;
use dunkelfeld_emva1288::TransferPoint;
use dunkelfeld_report::words::rounded;

/// A rise or a fall of a curve counts from this number of standard errors on. Among some hundred pairs of groups,
/// chance alone gives one with a probability below 1e-4.
const SIGNIFICANT: f64 = 5.0;
/// Number of groups of a curve in the search for rises and falls.
const GROUPS: usize = 24;
/// Two images count as similar from this rank correlation on.
const ALIKE: f64 = 0.5;
/// Variance that the paper calls practically free of noise \[DN^2\].
const QUIET: f64 = 2.0;
/// "Almost": this share of the curve is below it.
const ALMOST: f64 = 0.9;

/// Result of the comparison of a finding with the measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Same,
    /// Confirmed in some of the series.
    Partly,
    Different,
}

impl Verdict {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Same => "confirmed",
            Self::Partly => "confirmed in part of the series",
            Self::Different => "not confirmed",
        }
    }

    fn from_outcomes(all: &[bool]) -> Option<Self> {
        let n = all.iter().filter(|v| **v).count();
        match n {
            _ if all.is_empty() => None,
            0 => Some(Self::Different),
            n if n == all.len() => Some(Self::Same),
            _ => Some(Self::Partly),
        }
    }
}

/// A statement of the paper, paraphrased, and its measurement here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Finding {
    pub(super) claim: &'static str,
    /// The place in the paper.
    pub(super) place: &'static str,
    pub(super) here: String,
    pub(super) verdict: Verdict,
}

/// All statements that the series can test.
pub(super) fn findings(all: &[PictureSeries]) -> Vec<Finding> {
    let mut found = of_samples(all);
    found.extend(of_curves(all));
    found.extend(of_edges(all));
    found
}

/// A finding from the outcome of each series or pair; `None` without an outcome.
fn finding(claim: &'static str, place: &'static str, here: String, outcomes: Vec<bool>) -> Option<Finding> {
    Some(Finding { claim, place, here, verdict: Verdict::from_outcomes(&outcomes)? })
}

/// A text for each series.
fn each(all: &[PictureSeries], text: impl Fn(&PictureSeries) -> String) -> String {
    all.iter().map(|s| format!("{}: {}", name(s), text(s))).collect::<Vec<_>>().join("; ")
}

/// The outcomes. A series without one, because a number is unknown or constant, is left out.
fn judged(all: &[PictureSeries], outcome: impl Fn(&PictureSeries) -> Option<bool>) -> Vec<bool> {
    all.iter().filter_map(outcome).collect()
}

fn known(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

fn mean(s: &PictureSeries) -> f64 {
    s.mean_variance[0]
}

fn varies(s: &PictureSeries) -> bool {
    mean(s) > 0.0
}

/// The temporal variance with more samples and with the denoiser.
fn of_samples(all: &[PictureSeries]) -> Vec<Finding> {
    let [off, on] = [false, true].map(|d| all.iter().filter(|s| s.is_denoised == d).collect::<Vec<_>>());
    let steps = [&off, &on].into_iter().flat_map(|s| s.windows(2)).filter(|w| varies(w[0]));
    let fewer = steps.map(|w| mean(w[1]) < mean(w[0])).collect();
    let here = each(all, |s| format!("{} DN\u{b2}", rounded(mean(s))));
    let samples = finding("more samples per pixel leave less temporal variance", "figure 5", here, fewer);
    let pairs: Vec<_> =
        off.iter().filter(|a| varies(a)).filter_map(|a| Some((*a, *on.iter().find(|b| b.spp == a.spp)?))).collect();
    let factor =
        |(a, b): &(&PictureSeries, &PictureSeries)| format!("{} spp: {} times less", a.spp, rounded(mean(a) / mean(b)));
    let here = pairs.iter().map(factor).collect::<Vec<_>>().join("; ");
    let lower = pairs.iter().map(|(a, b)| mean(b) < mean(a)).collect();
    let denoiser = finding("the denoiser lowers the temporal variance", "figure 5", here, lower);
    samples.into_iter().chain(denoiser).collect()
}

/// The shape of the curves.
fn of_curves(all: &[PictureSeries]) -> Vec<Finding> {
    let linear = finding(
        "the photon transfer curves are not linear",
        "figure 6",
        each(all, |s| match &s.curve.fit {
            Some(f) => format!("R\u{b2} of a straight line {:.3}", f.r_squared),
            None => "too few points".into(),
        }),
        judged(all, |s| {
            let f = s.curve.fit.as_ref()?;
            Some(known(f.reduced_chi_squared)? > 1.0 + SIGNIFICANT * (2.0 / f.points as f64).sqrt())
        }),
    );
    let monotone = finding(
        "they are not even monotone",
        "figure 6",
        each(all, |s| {
            let [rise, fall] = rise_and_fall(&s.curve.points);
            format!("rises by {} and falls by {} standard errors", rounded(rise), rounded(fall))
        }),
        judged(all, |s| {
            (s.curve.points.len() > 2).then(|| rise_and_fall(&s.curve.points).iter().all(|v| *v > SIGNIFICANT))
        }),
    );
    linear.into_iter().chain(monotone).collect()
}

/// The variance near edges and without them.
fn of_edges(all: &[PictureSeries]) -> Vec<Finding> {
    let near = finding(
        "the variance is high near edges",
        "figures 5 and 7",
        each(all, |s| format!("{} times that of the rest", rounded(s.mean_variance[1] / s.mean_variance[2]))),
        judged(all, |s| Some(known(s.mean_variance[1])? > known(s.mean_variance[2]).filter(|_| varies(s))?)),
    );
    let sobel = finding(
        "the Sobel image of one frame resembles the variance",
        "figures 5 and 7",
        each(all, |s| {
            let [pearson, spearman] = s.correlations;
            format!("correlation {pearson:.2}, of ranks {spearman:.2}")
        }),
        judged(all, |s| Some(known(s.correlations[1])? >= ALIKE)),
    );
    let without = finding(
        "without the strong edges the variance is much lower, or even almost below 2",
        "figure 8",
        each(all, |s| {
            format!(
                "{} DN\u{b2} instead of {}, {:.0} % of the curve below 2",
                rounded(s.mean_variance[2]),
                rounded(mean(s)),
                100.0 * quiet(&s.filtered.points)
            )
        }),
        judged(all, |s| {
            known(s.mean_variance[1]).filter(|_| varies(s))?;
            Some(s.mean_variance[2] < 0.5 * mean(s) || quiet(&s.filtered.points) >= ALMOST)
        }),
    );
    [near, sobel, without].into_iter().flatten().collect()
}

/// The name of a series.
pub(super) fn name(s: &PictureSeries) -> String {
    format!("{} spp{}", s.spp, if s.is_denoised { " denoised" } else { "" })
}

/// Share of the points of a curve below the variance that the paper calls practically free of noise.
fn quiet(points: &[TransferPoint]) -> f64 {
    points.iter().filter(|p| p.variance < QUIET).count() as f64 / points.len().max(1) as f64
}

/// The largest rise and the largest fall of a curve from left to right, in standard errors, between groups of about as
/// many pixels each.
fn rise_and_fall(points: &[TransferPoint]) -> [f64; 2] {
    let total: u64 = points.iter().map(|p| p.pixels).sum();
    let per_group = (total / GROUPS as u64).max(1);
    // Mean of the variances and its squared error, weighted by pixels.
    let mut groups: Vec<(f64, f64)> = Vec::new();
    let (mut n, mut sum, mut error) = (0u64, 0.0, 0.0);
    for p in points {
        let w = p.pixels as f64;
        n += p.pixels;
        sum += w * p.variance;
        error += (w * p.variance_error).powi(2);
        if n >= per_group {
            groups.push((sum / n as f64, error / (n as f64).powi(2)));
            (n, sum, error) = (0, 0.0, 0.0);
        }
    }
    let mut most = [0.0f64; 2];
    for (i, (a, a_error)) in groups.iter().enumerate() {
        for (b, b_error) in &groups[i + 1..] {
            let step = (b - a) / (a_error + b_error).sqrt().max(1e-12);
            most = [most[0].max(step), most[1].max(-step)];
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(mean: f64, variance: f64) -> TransferPoint {
        let (mean_error, variance_error) = (0.1, 0.1);
        TransferPoint { mean, mean_error, variance, variance_error, degrees_of_freedom: 490.0, pixels: 10 }
    }

    #[test]
    fn a_line_rises_and_a_hill_does_both() {
        let line: Vec<_> = (0..100).map(|i| point(f64::from(i), f64::from(i))).collect();
        let [rise, fall] = rise_and_fall(&line);
        assert!(rise > 100.0 && fall == 0.0, "{rise}, {fall}");
        let hill: Vec<_> = (0..100).map(|i| point(f64::from(i), 50.0 - f64::from(i - 50).abs())).collect();
        assert!(rise_and_fall(&hill).iter().all(|v| *v > 50.0));
        assert_eq!(rise_and_fall(&[]), [0.0, 0.0]);
        // Two groups, one with all pixels: errors are those of means.
        let two =
            [TransferPoint { pixels: 1000, ..point(1.0, 3.0) }, TransferPoint { pixels: 1000, ..point(2.0, 4.0) }];
        let [rise, fall] = rise_and_fall(&two);
        assert!((rise - 1.0 / (0.02f64).sqrt()).abs() < 1e-9 && fall == 0.0, "{rise}");
    }

    #[test]
    fn verdicts_follow_from_all_series() {
        assert_eq!(Verdict::from_outcomes(&[]), None);
        assert_eq!(Verdict::from_outcomes(&[true, true]), Some(Verdict::Same));
        assert_eq!(Verdict::from_outcomes(&[true, false]), Some(Verdict::Partly));
        assert_eq!(Verdict::from_outcomes(&[false]), Some(Verdict::Different));
        assert_eq!(quiet(&[point(1.0, 1.0), point(2.0, 3.0)]), 0.5);
    }
}
