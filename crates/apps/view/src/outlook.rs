//! The expected noise of a render: for the camera of the job from its plan, for others from the measured points.

use crate::protocol::{CurvePoint, ForecastPoint};
use dunkelfeld::adaptive::ForecastLevel;

/// The most samples per pixel of a view.
pub(crate) const MAX_SPP: f64 = 65_536.0;
/// Samples per pixel of the pilot, after which the plan follows.
pub(crate) const PILOT_SPP: u32 = 32;
/// The levels of a forecast. Those from 1 on are those of a plan.
const LEVELS: [f64; 8] = [4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.25];
/// The progress of a render whose expected time has passed, and whose target is not reached.
const NEARLY: f64 = 0.99;
/// The newest points of which the median is taken, and the fewest that suffice.
const NEWEST: usize = 5;
const FEWEST: usize = 3;

/// The levels of a plan for an image of so many pixels. The clock of a plan goes on during a pause, that of a view does not.
/// The levels above those of the plan follow by the root law, as far as they are ahead of the pilot.
pub(crate) fn of_plan(levels: &[ForecastLevel], pixels: f64, paused: f64) -> Vec<ForecastPoint> {
    let point = |level: &ForecastLevel| ForecastPoint {
        k: level.k,
        seconds: level.seconds.map(|seconds| seconds - paused),
        spp: level.samples.map(|samples| samples / pixels.max(1.0)),
    };
    let planned: Vec<ForecastPoint> = levels.iter().map(point).collect();
    let highest = planned.iter().map(|point| point.k).fold(0.0, f64::max);
    let earlier = |k: f64| {
        let spp = value_at(&planned, k, |point| point.spp)?;
        let seconds = value_at(&planned, k, |point| point.seconds);
        (spp > f64::from(PILOT_SPP)).then_some(ForecastPoint { k, seconds, spp: Some(spp) })
    };
    let above = LEVELS.into_iter().filter(|k| highest > 0.0 && *k > highest).filter_map(earlier);
    above.chain(planned.iter().copied()).collect()
}

/// The share of a render that has passed, and its remaining seconds, from the expected time of its target. A target that is
/// not reached is never complete, and its time is not known when the expected time has passed.
pub(crate) fn progress_at(elapsed: f64, expected: Option<f64>, is_reached: bool) -> (f64, Option<f64>) {
    match expected {
        _ if is_reached => (1.0, Some(0.0)),
        Some(expected) if expected > elapsed => ((elapsed / expected).clamp(0.0, NEARLY), Some(expected - elapsed)),
        Some(_) => (NEARLY, None),
        None => (0.0, None),
    }
}

/// The samples and seconds at which the noise will have fallen to some levels, from the measured points of one camera.
///
/// The variance of a Monte Carlo mean falls with the number of its samples n, and k is a ratio of standard deviations. So
/// k^2 n is constant while the samples are distributed over the pixels as now. Its median over the newest points gives n at
/// each level, and the samples per second of the newer half of the samples give the time. Levels that are reached are left
/// out. Empty with fewer than three points after the pilot, whose uniform samples say little about those of the plan.
pub(crate) fn from_measured(curve: &[CurvePoint]) -> Vec<ForecastPoint> {
    let known: Vec<(&CurvePoint, f64)> = curve
        .iter()
        .filter_map(|point| Some((point, point.k99.filter(|k| *k > 0.0)?)))
        .filter(|(point, _)| point.spp > f64::from(PILOT_SPP) && point.seconds > 0.0)
        .collect();
    let newest = &known[known.len().saturating_sub(NEWEST)..];
    let Some(&(last, k99)) = newest.last().filter(|_| newest.len() >= FEWEST) else { return Vec::new() };
    let mut products: Vec<f64> = newest.iter().map(|(point, k)| k * k * point.spp).collect();
    products.sort_by(f64::total_cmp);
    let product = products[products.len() / 2];
    let earlier = known.iter().map(|(point, _)| *point).find(|point| 2.0 * point.spp >= last.spp);
    let rate = earlier
        .filter(|earlier| earlier.spp < last.spp && earlier.seconds < last.seconds)
        .map_or(last.spp / last.seconds, |earlier| (last.spp - earlier.spp) / (last.seconds - earlier.seconds));
    let is_ahead = |k: &f64| *k < k99 && product / (k * k) > last.spp;
    let point = |k: f64| {
        let spp = product / (k * k);
        ForecastPoint { k, seconds: Some(last.seconds + (spp - last.spp) / rate), spp: Some(spp) }
    };
    LEVELS.into_iter().filter(is_ahead).map(point).collect()
}

/// The levels of a forecast, without the times of those that a view does not reach.
pub(crate) fn within_view(forecast: &[ForecastPoint]) -> Vec<ForecastPoint> {
    let is_reached = |point: &ForecastPoint| point.spp.is_none_or(|spp| spp <= MAX_SPP);
    forecast
        .iter()
        .map(|point| ForecastPoint { seconds: point.seconds.filter(|_| is_reached(point)), ..*point })
        .collect()
}

/// The seconds at which the noise will have fallen to `k`; `None` if a view does not reach it.
pub(crate) fn seconds_at(forecast: &[ForecastPoint], k: f64) -> Option<f64> {
    if value_at(forecast, k, |point| point.spp).is_some_and(|spp| spp > MAX_SPP) {
        return None;
    }
    value_at(forecast, k, |point| point.seconds)
}

/// A value at `k` that falls with the noise. Between two points on the logarithms of both, beyond them by the
/// root law.
fn value_at(forecast: &[ForecastPoint], k: f64, value: impl Fn(&ForecastPoint) -> Option<f64>) -> Option<f64> {
    let mut points: Vec<(f64, f64)> =
        forecast.iter().filter_map(|point| Some((point.k, value(point).filter(|v| *v > 0.0)?))).collect();
    points.sort_by(|a, b| b.0.total_cmp(&a.0));
    let below = points.iter().position(|point| point.0 <= k);
    let root = |(level, value): (f64, f64)| value * (level / k).powi(2);
    match below {
        None => points.last().map(|&end| root(end)),
        Some(0) => points.first().map(|&first| root(first)),
        Some(i) => {
            let ((k0, v0), (k1, v1)) = (points[i - 1], points[i]);
            Some(v0 * (v1 / v0).powf((k / k0).ln() / (k1 / k0).ln()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(f64, f64, f64)]) -> Vec<CurvePoint> {
        let point = |&(seconds, spp, k99): &(f64, f64, f64)| CurvePoint { seconds, spp, k99: Some(k99), film: 0 };
        points.iter().map(point).collect()
    }

    /// A render of the root law: 2 s without samples, then 100 samples per pixel and second, k = 25 / sqrt(n).
    #[test]
    fn the_root_law_is_continued() {
        let law = |seconds: f64| (seconds, 100.0 * (seconds - 2.0), 25.0 / (100.0 * (seconds - 2.0)).sqrt());
        let points: Vec<_> = [3.0, 4.0, 5.0, 7.0, 9.0, 12.0].map(law).to_vec();
        let outlook = from_measured(&curve(&points));
        // k is 0.8 at 12 s: the level 1 is reached.
        assert_eq!(outlook.iter().map(|point| point.k).collect::<Vec<_>>(), [0.7, 0.5, 0.25]);
        for point in &outlook {
            let spp = (25.0 / point.k).powi(2);
            assert!((point.spp.expect("known") - spp).abs() < 1e-9 * spp);
            assert!((point.seconds.expect("known") - (2.0 + spp / 100.0)).abs() < 1e-9 * spp);
        }
        // One point that is far off does not move it, and two points are too few.
        let mut off = points.clone();
        off[4].2 *= 3.0;
        for (found, expected) in from_measured(&curve(&off)).iter().zip(&outlook) {
            let spp = expected.spp.expect("known");
            assert!(found.k == expected.k && (found.spp.expect("known") - spp).abs() < 1e-9 * spp);
        }
        assert_eq!(from_measured(&curve(&points[..2])), []);
        // Points of the pilot do not count.
        let pilot: Vec<_> = points.iter().map(|&(seconds, spp, k99)| (seconds, 0.03 * spp, k99)).collect();
        assert_eq!(from_measured(&curve(&pilot)), []);
        let mut unknown = curve(&points);
        unknown.iter_mut().for_each(|point| point.k99 = None);
        assert_eq!(from_measured(&unknown), []);
    }

    #[test]
    fn a_plan_is_without_pauses() {
        let level =
            |k, samples, seconds| ForecastLevel { k, samples, seconds, actual_samples: None, actual_seconds: None };
        let plan = of_plan(&[level(1.0, Some(3000.0), Some(70.0)), level(0.5, None, None)], 100.0, 60.0);
        let point = |k, seconds, spp| ForecastPoint { k, seconds, spp };
        assert_eq!(plan, [point(1.0, Some(10.0), Some(30.0)), point(0.5, None, None)]);
        // Levels above 1 by the root law; at k = 4 the pilot has more samples.
        let plan = of_plan(&[level(1.0, Some(40_000.0), Some(160.0)), level(0.7, None, None)], 100.0, 60.0);
        assert_eq!(plan.iter().map(|point| point.k).collect::<Vec<_>>(), [2.8, 2.0, 1.4, 1.0, 0.7]);
        assert_eq!(plan[1], point(2.0, Some(25.0), Some(100.0)));
        assert!((plan[0].spp.expect("known") - 400.0 / 7.84).abs() < 1e-9);
        assert_eq!(of_plan(&[level(1.0, None, None)], 100.0, 0.0), [point(1.0, None, None)]);
    }

    #[test]
    fn a_target_that_is_not_reached_is_never_complete() {
        assert_eq!(progress_at(5.0, Some(20.0), false), (0.25, Some(15.0)));
        for (elapsed, expected) in [(20.0, 20.0), (300.0, 20.0), (1.0, 0.0), (1.0, -4.0)] {
            assert_eq!(progress_at(elapsed, Some(expected), false), (NEARLY, None));
        }
        assert!(progress_at(19.99, Some(20.0), false).0 <= NEARLY);
        assert_eq!(progress_at(5.0, None, false), (0.0, None));
        assert_eq!(progress_at(5.0, Some(20.0), true), (1.0, Some(0.0)));
    }

    #[test]
    fn times_between_and_beyond_levels() {
        let point = |k: f64, seconds| ForecastPoint { k, seconds, spp: None };
        let forecast = [point(1.0, Some(10.0)), point(0.7, None), point(0.5, Some(40.0)), point(0.25, Some(320.0))];
        let close = |k: f64, seconds: f64| {
            let found = seconds_at(&forecast, k).expect("known");
            assert!((found - seconds).abs() < 1e-9 * seconds, "{k}: {found}");
        };
        [(1.0, 10.0), (0.5, 40.0), (0.25, 320.0)].into_iter().for_each(|(k, seconds)| close(k, seconds));
        close(0.5f64.sqrt(), 20.0);
        close(2.0, 2.5);
        close(0.125, 1280.0);
        assert_eq!(seconds_at(&[], 0.5), None);
        // Beyond the samples of a view.
        let with_samples =
            [1.0, 0.5].map(|k: f64| ForecastPoint { k, seconds: Some(1e3 / (k * k)), spp: Some(2e4 / (k * k)) });
        let seconds: Vec<_> = within_view(&with_samples).iter().map(|point| point.seconds).collect();
        assert_eq!(seconds, [Some(1e3), None]);
        assert!(seconds_at(&with_samples, 0.6).is_some() && seconds_at(&with_samples, 0.5).is_none());
        assert_eq!(seconds_at(&with_samples, 0.1), None);
        assert_eq!(seconds_at(&[point(0.5, None)], 0.5), None);
    }
}
