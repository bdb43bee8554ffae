//! The measured numbers of a linear camera, and the results that follow from them.

use crate::measurement::Ordered;
use crate::propagate::Inputs;
use crate::saturation::Saturation;
use crate::spatial::{Estimate, Likeness, Spatial, Variances};

/// Variance of the rounding to whole grey values, sigma_q^2 \[DN^2\].
pub(crate) const ROUNDING: f64 = 1.0 / 12.0;
/// Below this dark variance \[DN^2\] rounding dominates, and the dark noise has only a bound (release 4.0 Linear).
pub(crate) const MIN_DARK_VARIANCE: f64 = 0.24;
/// Values that alternate between two neighbours have a variance of 1/4 at most, and slightly more by chance \[DN^2\].
const MAX_ROUNDING_SHARE: f64 = 0.26;
/// Least number of exposure times for a line through the dark levels.
pub(crate) const MIN_EXPOSURES: usize = 3;
/// Regressions for R and K end at this fraction of saturation.
const RANGE: f64 = 0.7;

/// Mean and variance of a level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    pub(crate) exposure: f64,
    pub(crate) photons: f64,
    /// Index of its dark level.
    pub(crate) dark: usize,
    pub(crate) mean: Estimate,
    pub(crate) variance: Estimate,
}

/// The numbers from which the figures of a linear camera are computed.
#[derive(Clone, Debug)]
pub(crate) struct Summary {
    /// By ascending photons.
    pub(crate) bright: Vec<Point>,
    /// By ascending exposure time.
    pub(crate) dark: Vec<Point>,
    /// Number of bright levels in 0 to 70 % of saturation.
    pub(crate) used: usize,
    pub(crate) saturation: Estimate,
    /// Mean response of these pixels over that of all pixels of their kind: 1, with its standard error.
    pub(crate) response: Estimate,
    /// Difference of the mean dark value of these pixels from that of all pixels of their kind \[DN\]: 0, with its
    /// standard error.
    pub(crate) offset: Estimate,
    /// Temporal dark variance that the pixels of a row share \[DN^2\], mean over the dark pairs.
    pub(crate) row_variance: Estimate,
    /// Statistics of the bright and the dark stack, and the similarity of their patterns.
    pub(crate) spatial: Option<(Spatial, Spatial, Likeness)>,
    /// The dark variance is so small that [`MIN_DARK_VARIANCE`] replaces it.
    pub(crate) is_bound: bool,
}

/// Indices of the results of [`Summary::results`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub(crate) enum Is {
    Responsivity,
    Gain,
    Efficiency,
    DarkMean,
    /// These are squares: a square root cannot be taken before errors are known.
    DarkVariance,
    DarkNoise2,
    RowNoise2,
    LeastElectrons,
    LeastPhotons,
    MostPhotons,
    MostElectrons,
    SnrMax,
    SnrMaxDb,
    Range,
    RangeDb,
    DarkCurrentMean,
    DarkCurrentVariance,
    Dsnu2,
    DsnuPixel2,
    DsnuRow2,
    DsnuColumn2,
    Prnu2,
    PrnuPixel2,
    PrnuRow2,
    PrnuColumn2,
}

/// The number of results.
pub(crate) const RESULTS: usize = Is::PrnuColumn2 as usize + 1;

impl Summary {
    pub(crate) fn new(data: &Ordered<'_>, saturation: &Saturation) -> Self {
        let point = |level: &crate::measurement::Level, dark| {
            let of = |q: &crate::quantity::Quantity| Estimate { value: q.value, error: q.standard_error };
            let (mean, variance) = (of(&level.pair.mean), of(&level.pair.variance));
            Point { exposure: level.exposure, photons: level.photons, dark, mean, variance }
        };
        let dark: Vec<Point> = data.dark.iter().enumerate().map(|(i, l)| point(l, i)).collect();
        let bright: Vec<Point> = data.bright.iter().map(|s| point(s.level, s.dark)).collect();
        let inside = |p: &Point| p.mean.value - dark[p.dark].mean.value <= RANGE * saturation.signal;
        let used = bright.iter().position(|p| !inside(p)).unwrap_or(bright.len());
        let spatial = data.stacks.map(|(bright, dark)| {
            (
                Spatial::from_stacks(&bright.stack),
                Spatial::from_stacks(&dark.stack),
                Likeness::from_stacks(&bright.stack, &dark.stack),
            )
        });
        let pairs = data.dark.len() as f64;
        let of_rows = |i: usize| data.dark.iter().map(move |l| l.pair.row_variance[i]);
        let row_variance = Estimate {
            value: of_rows(0).sum::<f64>() / pairs,
            error: of_rows(1).map(|e| e * e).sum::<f64>().sqrt() / pairs,
        };
        let mut summary = Self {
            bright,
            dark,
            used,
            saturation: Estimate { value: saturation.photons, error: saturation.error },
            response: Estimate { value: 1.0, error: 0.0 },
            offset: Estimate::default(),
            row_variance,
            spatial,
            is_bound: false,
        };
        // If dark current makes all dark levels noisy, the noise without it may be small or even negative by chance,
        // and not by rounding.
        let is_steady = summary.dark[0].variance.value < MAX_ROUNDING_SHARE;
        summary.is_bound = is_steady && summary.dark_variance() < MIN_DARK_VARIANCE;
        (summary.response.error, summary.offset.error) = summary.sampling_errors();
        summary
    }

    /// The same numbers with this variance \[DN^2\] in place of dark variances that rounding may have caused.
    pub(crate) fn with_dark_variance(&self, variance: f64) -> Self {
        let mut s = self.clone();
        for d in s.dark.iter_mut().filter(|d| d.variance.value < MAX_ROUNDING_SHARE) {
            d.variance.value = variance;
        }
        s
    }

    /// The number of different exposure times of the dark levels.
    pub(crate) fn exposures(&self) -> usize {
        let mut times: Vec<f64> = self.dark.iter().map(|d| d.exposure).collect();
        times.dedup_by(|a, b| crate::measurement::same_time(*a, *b));
        times.len()
    }

    /// All results, in the order of [`Is`]. NaN if the measurement does not determine a result.
    pub(crate) fn results(&self) -> [f64; RESULTS] {
        let mut r = [f64::NAN; RESULTS];
        let mut set = |place: Is, value: f64| r[place as usize] = value;
        let used = &self.bright[..self.used];
        let signal = |p: &Point| p.mean.value - self.dark[p.dark].mean.value;
        // Release 4.0 Linear, responsivity, and equation (50), both through the origin.
        let responsivity = through_origin(used.iter().map(|p| (p.photons, signal(p)))) * self.response.value;
        let gain =
            through_origin(used.iter().map(|p| (signal(p), p.variance.value - self.dark[p.dark].variance.value)));
        let efficiency = responsivity / gain;
        set(Is::Responsivity, responsivity);
        set(Is::Gain, gain);
        set(Is::Efficiency, efficiency);

        let has_times = self.exposures() >= MIN_EXPOSURES;
        let mean_line = line(self.dark.iter().map(|d| (d.exposure, d.mean.value)));
        let variance_line = line(self.dark.iter().map(|d| (d.exposure, d.variance.value)));
        let dark_mean = if has_times { mean_line.1 } else { self.dark[0].mean.value };
        set(Is::DarkMean, dark_mean + self.offset.value);
        let dark_variance = if self.is_bound { MIN_DARK_VARIANCE } else { self.dark_variance() };
        set(Is::DarkVariance, dark_variance);
        set(Is::DarkNoise2, (dark_variance - ROUNDING) / (gain * gain));
        set(Is::RowNoise2, self.row_variance.value / (gain * gain));
        if has_times {
            set(Is::DarkCurrentMean, mean_line.0 / gain);
            set(Is::DarkCurrentVariance, variance_line.0 / (gain * gain));
        }

        // (27), with sigma_d^2 + sigma_q^2 / K^2 = sigma_y.dark^2 / K^2.
        let least = (dark_variance / (gain * gain) + 0.25).max(0.0).sqrt() + 0.5;
        // If the pixels were brighter than others of their kind, these would saturate later.
        let most = self.saturation.value / self.response.value;
        let max_electrons = efficiency * most;
        let range = max_electrons / least;
        set(Is::LeastElectrons, least);
        set(Is::LeastPhotons, least / efficiency);
        set(Is::MostPhotons, most);
        set(Is::MostElectrons, max_electrons);
        set(Is::SnrMax, max_electrons.sqrt());
        set(Is::SnrMaxDb, 10.0 * max_electrons.log10());
        set(Is::Range, range);
        set(Is::RangeDb, 20.0 * range.log10());

        if let Some((bright, dark, _)) = &self.spatial {
            let (b, d) = (bright.split(), dark.split());
            let of = |v: Variances| [v.total, v.pixel, v.row, v.column];
            let light = bright.mean - dark.mean;
            let places = [
                (Is::Dsnu2, Is::Prnu2),
                (Is::DsnuPixel2, Is::PrnuPixel2),
                (Is::DsnuRow2, Is::PrnuRow2),
                (Is::DsnuColumn2, Is::PrnuColumn2),
            ];
            for ((dsnu, prnu), (b, d)) in places.into_iter().zip(of(b).into_iter().zip(of(d))) {
                set(dsnu, d / (gain * gain));
                set(prnu, (b - d) / (light * light));
            }
        }
        r
    }

    /// sigma_y.dark^2 \[DN^2\]: without dark current if there are enough exposure times, otherwise that of the shortest
    /// exposure.
    fn dark_variance(&self) -> f64 {
        if self.exposures() >= MIN_EXPOSURES {
            line(self.dark.iter().map(|d| (d.exposure, d.variance.value))).1
        } else {
            self.dark[0].variance.value
        }
    }

    /// The pixels of a camera are a sample of such pixels. Standard errors of the mean of their responses, as a
    /// fraction, and of the mean of their dark values \[DN\].
    fn sampling_errors(&self) -> (f64, f64) {
        let Some((bright, dark, _)) = &self.spatial else { return (0.0, 0.0) };
        let (b, d) = (bright.split(), dark.split());
        let (m, n) = (bright.rows, bright.columns);
        let of_mean = |pixel: f64, row: f64, column: f64| {
            (pixel.max(0.0) / (m * n) + row.max(0.0) / m + column.max(0.0) / n).sqrt()
        };
        let response = of_mean(b.pixel - d.pixel, b.row - d.row, b.column - d.column);
        let light = bright.mean - dark.mean;
        (if light > 0.0 { response / light } else { 0.0 }, of_mean(d.pixel, d.row, d.column))
    }
}

impl Inputs for Summary {
    fn count(&self) -> usize {
        4 + 2 * (self.bright.len() + self.dark.len()) + if self.spatial.is_some() { 8 } else { 0 }
    }

    fn moved(&self, index: usize, sign: f64) -> Self {
        let mut s = self.clone();
        let shift = |e: &mut Estimate, by: f64| e.value += by * e.error;
        let levels = s.bright.len() + s.dark.len();
        match index {
            0 => shift(&mut s.saturation, sign),
            1 => shift(&mut s.response, sign),
            2 => shift(&mut s.offset, sign),
            3 => shift(&mut s.row_variance, sign),
            i if i - 4 < 2 * levels => {
                let (which, is_variance) = ((i - 4) / 2, i % 2 == 1);
                let point = s.bright.iter_mut().chain(&mut s.dark).nth(which);
                if let Some(p) = point {
                    shift(if is_variance { &mut p.variance } else { &mut p.mean }, sign);
                }
            }
            i => {
                if let Some((bright, dark, like)) = &mut s.spatial {
                    // Squares of normal numbers with correlation r have the correlation r^2. The shared part of the two
                    // images changes both, the rest of the bright one changes it alone.
                    let alike = [like.residual, like.column_means, like.row_means].map(|r| r * r);
                    let both = [
                        (&mut bright.residual, &mut dark.residual),
                        (&mut bright.column_means, &mut dark.column_means),
                        (&mut bright.row_means, &mut dark.row_means),
                    ];
                    match i - 4 - 2 * levels {
                        6 => shift(&mut bright.temporal, sign),
                        7 => shift(&mut dark.temporal, sign),
                        part => {
                            let which = part % 3;
                            if let Some((b, d)) = both.into_iter().nth(which) {
                                let common = alike[which].clamp(0.0, 1.0);
                                if part < 3 {
                                    shift(d, sign);
                                    shift(b, sign * common);
                                } else {
                                    shift(b, sign * (1.0 - common * common).sqrt());
                                }
                            }
                        }
                    }
                }
            }
        }
        s
    }
}

/// Slope of the least-squares line through the origin, sum(x y) / sum(x x).
fn through_origin(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (xx, xy) = points.fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + x * x, xy + x * y));
    xy / xx
}

/// Slope and intercept of the least-squares line.
pub(crate) fn line(points: impl Iterator<Item = (f64, f64)> + Clone) -> (f64, f64) {
    let (n, sx, sy) = points.clone().fold((0.0, 0.0, 0.0), |(n, sx, sy), (x, y)| (n + 1.0, sx + x, sy + y));
    let (mx, my) = (sx / n, sy / n);
    let (xx, xy) = points.fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + (x - mx).powi(2), xy + (x - mx) * (y - my)));
    let slope = xy / xx;
    (slope, my - slope * mx)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_by_hand() {
        assert_eq!(line([(1.0, 3.0), (2.0, 5.0), (4.0, 9.0)].into_iter()), (2.0, 1.0));
        // (1*2 + 2*5) / (1 + 4).
        assert_eq!(through_origin([(1.0, 2.0), (2.0, 5.0)].into_iter()), 2.4);
    }

    /// A camera with given numbers: K = 0.5, eta = 0.6, dark noise 16 + 1/12 DN^2 at t = 0 with 2 e-/s.
    fn paper(times: &[f64]) -> Summary {
        let exact = |value| Estimate { value, error: 0.0 };
        let dark_at = |t: f64| (20.0 + 0.5 * 2.0 * t, 4.0 + ROUNDING + 0.25 * 2.0 * t);
        let dark: Vec<Point> = times
            .iter()
            .enumerate()
            .map(|(i, &t)| {
                let (mean, variance) = dark_at(t);
                Point { exposure: t, photons: 0.0, dark: i, mean: exact(mean), variance: exact(variance) }
            })
            .collect();
        let bright = (1..=10)
            .map(|k| {
                let (i, photons) = (k % times.len(), 1000.0 * k as f64);
                let (mean, variance) = dark_at(times[i]);
                Point {
                    exposure: times[i],
                    photons,
                    dark: i,
                    mean: exact(mean + 0.5 * 0.6 * photons),
                    variance: exact(variance + 0.25 * 0.6 * photons),
                }
            })
            .collect();
        let saturation = exact(10_000.0);
        let response = exact(1.0);
        let offset = exact(0.0);
        let row_variance = exact(1.0);
        Summary { bright, dark, used: 7, saturation, response, offset, row_variance, spatial: None, is_bound: false }
    }

    #[test]
    fn a_camera_is_restored_from_its_summary() {
        let r = paper(&[1.0, 2.0, 3.0, 4.0]).results();
        let sigma_d2 = 4.0 / 0.25;
        let least = (sigma_d2 + ROUNDING / 0.25 + 0.25f64).sqrt() + 0.5;
        let expected = [
            (Is::Responsivity, 0.3),
            (Is::Gain, 0.5),
            (Is::Efficiency, 0.6),
            (Is::DarkMean, 20.0),
            (Is::DarkNoise2, sigma_d2),
            (Is::RowNoise2, 4.0),
            (Is::DarkCurrentMean, 2.0),
            (Is::DarkCurrentVariance, 2.0),
            (Is::LeastElectrons, least),
            (Is::LeastPhotons, least / 0.6),
            (Is::MostElectrons, 6000.0),
            (Is::SnrMaxDb, 10.0 * 6000f64.log10()),
            (Is::Range, 6000.0 / least),
        ];
        for (which, value) in expected {
            let got = r[which as usize];
            assert!((got - value).abs() < 1e-9 * value.abs(), "{which:?}: {got}, expected {value}");
        }
    }

    #[test]
    fn two_times_make_no_line() {
        let r = paper(&[1.0, 2.0]).results();
        assert!(r[Is::DarkCurrentMean as usize].is_nan());
        // The value of the shortest exposure: 4 + 0.5 DN^2.
        assert!((r[Is::DarkNoise2 as usize] - 18.0).abs() < 1e-9);
    }

    #[test]
    fn every_input_has_its_own_error() {
        let mut s = paper(&[1.0, 2.0, 3.0]);
        for p in s.bright.iter_mut().chain(&mut s.dark) {
            (p.mean.error, p.variance.error) = (1.0, 1.0);
        }
        (s.saturation.error, s.response.error, s.offset.error, s.row_variance.error) = (1.0, 0.1, 0.1, 0.1);
        for i in 0..s.count() {
            let m = s.moved(i, 1.0);
            let changed = s
                .bright
                .iter()
                .chain(&s.dark)
                .zip(m.bright.iter().chain(&m.dark))
                .filter(|(a, b)| a.mean != b.mean || a.variance != b.variance)
                .count();
            let others = [m.saturation != s.saturation, m.response != s.response, m.offset != s.offset];
            let others = others.into_iter().chain([m.row_variance != s.row_variance]);
            let others = others.filter(|c| *c).count();
            assert_eq!(changed + others, 1, "input {i}");
        }
    }
}
