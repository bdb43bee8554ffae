//! The forecast of a render from its pilot: samples and seconds until its noise is hidden at several k.

use crate::rendered_film::RenderedFilm;
use dunkelfeld_adaptive::required_samples::{RequiredSamples, total};
use dunkelfeld_adaptive::tile_cost::CostMap;
use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

/// The levels of every forecast: total noise 41, 22, 12 and 3 % above the sensor's.
pub const FORECAST_LEVELS: [f64; 4] = [1.0, 0.7, 0.5, 0.25];

/// The earlier share of the pixels whose time a forecast also has.
const EARLY_SHARE: f64 = 0.9;
/// Most objects that are named as those of the last pixels.
const MAX_NAMED: usize = 2;

/// Cost until the share of the unsaturated pixels at which the render ends, or 99 %, is hidden at some k.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForecastLevel {
    /// The level: the standard deviation of the render's noise over that of the sensor's.
    pub k: f64,
    /// Samples of the whole image, those of the pilot included. `null` where the pilot could not determine it.
    pub samples: Option<f64>,
    /// Wall-clock seconds of the whole command. `null` where the pilot could not determine it.
    pub seconds: Option<f64>,
    /// The actual number of samples; `null` unless the render ended because it was hidden at this k.
    pub actual_samples: Option<f64>,
    /// The actual seconds, `null` in the same cases.
    pub actual_seconds: Option<f64>,
}

/// The shares of the pixels that are hidden early and late.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForecastCourse {
    /// The share of the pixels of the levels of the forecast.
    pub share: f64,
    /// Wall-clock seconds until 90 % of the pixels are hidden. `null` where the pilot could not determine it, and for a
    /// share of 90 % or less.
    pub early_seconds: Option<f64>,
    /// The objects that have most of the other pixels, the most first.
    pub last_objects: Vec<String>,
}

/// A forecast. It is computed once, after the pilot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// One entry for each level, in descending order of k: those of [`FORECAST_LEVELS`] and the level at which the
    /// render ends.
    pub levels: Vec<ForecastLevel>,
    /// The level at which the render ends, if there is one.
    pub target: Option<f64>,
    /// Seconds since the start of the command at the time of the forecast.
    pub made_at: f64,
    /// Samples of the whole image at the time of the forecast.
    pub made_from: u64,
    /// The course of the level of [`Self::shown`].
    #[serde(default)]
    pub course: Option<ForecastCourse>,
    /// Remaining seconds of this render from then on, to the first limit that it reaches. `None` if unknown.
    pub remaining: Option<f64>,
}

/// The speed of the machine, for a forecast.
pub(crate) struct Throughput<'a> {
    /// Seconds since the start, now.
    pub(crate) elapsed: f64,
    pub(crate) threads: usize,
    pub(crate) costs: &'a CostMap,
    /// Seconds after the last sample.
    pub(crate) closing: f64,
    /// Limits of the render: seconds, and samples of the whole image.
    pub(crate) limits: (Option<f64>, Option<u64>),
}

/// The inputs of a forecast.
pub(crate) struct ForecastInput<'a> {
    pub(crate) film: &'a RenderedFilm,
    /// Samples per pixel so far.
    pub(crate) counts: &'a Plane<u32>,
    /// Samples per pixel until a share of the pixels is hidden at k; `None` without a sensor.
    pub(crate) targets: &'a dyn Fn(f64, f64) -> Option<Plane<f32>>,
    /// Samples that each pixel needs by itself at k.
    pub(crate) required: &'a dyn Fn(f64) -> Option<RequiredSamples>,
    /// The level at which the render ends.
    pub(crate) target: Option<f64>,
    /// The share of the pixels that must be hidden.
    pub(crate) share: f64,
}

impl Forecast {
    /// A forecast from the measurements of the pilot; `None` without a sensor.
    pub(crate) fn new(input: &ForecastInput<'_>, pace: &Throughput<'_>) -> Option<Self> {
        let ForecastInput { counts, target, share, .. } = *input;
        let known = |v: f64| v.is_finite().then_some(v);
        let seconds = |targets: &Plane<f32>| {
            known(pace.elapsed + thread_seconds(targets, counts, pace.costs)? / pace.threads as f64 + pace.closing)
        };
        let mut levels: Vec<f64> = FORECAST_LEVELS.into_iter().chain(target).collect();
        levels.sort_by(|a, b| b.total_cmp(a));
        levels.dedup();
        let levels = levels.into_iter().map(|k| {
            let targets = (input.targets)(k, share)?;
            let (samples, seconds) = (known(total(&targets)), seconds(&targets));
            Some(ForecastLevel { k, samples, seconds, actual_samples: None, actual_seconds: None })
        });
        let levels: Vec<ForecastLevel> = levels.collect::<Option<_>>()?;
        let made_from = counts.data().iter().map(|&n| u64::from(n)).sum();
        let by_time = pace.limits.0.map(|seconds| seconds - pace.elapsed);
        let by_samples = pace.limits.1.zip(pace.costs.mean()).map(|(samples, seconds)| {
            seconds * samples.saturating_sub(made_from) as f64 / pace.threads as f64 + pace.closing
        });
        let mut forecast = Self { levels, target, made_at: pace.elapsed, made_from, course: None, remaining: None };
        if let Some(k) = forecast.shown().map(|level| level.k) {
            let early = if share > EARLY_SHARE { (input.targets)(k, EARLY_SHARE) } else { None };
            let early_seconds = early.and_then(|targets| seconds(&targets));
            forecast.course = Some(ForecastCourse { share, early_seconds, last_objects: input.last_objects(k) });
        }
        let by_noise = forecast.target().and_then(|l| l.seconds).map(|seconds| seconds - pace.elapsed);
        forecast.remaining = [by_time, by_samples, by_noise].into_iter().flatten().reduce(f64::min);
        Some(forecast)
    }

    /// The level at which the render ends, or 0.7.
    pub fn shown(&self) -> Option<&ForecastLevel> {
        self.target().or(self.levels.iter().find(|l| l.k == 0.7))
    }

    /// The level at which the render ends.
    pub fn target(&self) -> Option<&ForecastLevel> {
        self.levels.iter().find(|l| Some(l.k) == self.target)
    }
}

impl ForecastInput<'_> {
    /// The objects of the pixels that are not hidden when the share of the pixels is: the one with most of them, and the
    /// next one if the first has less than half.
    fn last_objects(&self, k: f64) -> Vec<String> {
        let Some((targets, required)) = (self.targets)(k, self.share).zip((self.required)(k)) else {
            return Vec::new();
        };
        let names = &self.film.object_names;
        let mut pixels = vec![0u64; names.len()];
        let rest = required.samples.data().iter().zip(targets.data()).zip(self.film.ids.data());
        for ids in rest.filter(|((required, target), _)| required > target).filter_map(|(_, ids)| ids.as_ref()) {
            if let Some(n) = pixels.get_mut(ids.object() as usize) {
                *n += 1;
            }
        }
        let all: u64 = pixels.iter().sum();
        let mut objects: Vec<(u64, &String)> = pixels.into_iter().zip(names).filter(|(n, _)| *n > 0).collect();
        objects.sort_by_key(|object| std::cmp::Reverse(object.0));
        let is_most = objects.first().is_some_and(|(n, _)| 2 * n >= all);
        objects.into_iter().take(if is_most { 1 } else { MAX_NAMED }).map(|(_, name)| name.clone()).collect()
    }
}

/// Seconds of one thread for the missing samples. `None` if no cost has been measured.
fn thread_seconds(targets: &Plane<f32>, counts: &Plane<u32>, costs: &CostMap) -> Option<f64> {
    let grid = costs.grid();
    let width = targets.width() as usize;
    (0..grid.len())
        .map(|tile| {
            let rect = grid.rect(tile);
            let rows = (rect.y0 as usize..rect.y1 as usize)
                .map(|y| y * width + rect.x0 as usize..y * width + rect.x1 as usize);
            let missing = |(&target, &count): (&f32, &u32)| f64::from(target) - f64::from(count);
            let samples: f64 = rows
                .map(|row| targets.data()[row.clone()].iter().zip(&counts.data()[row]).map(missing).sum::<f64>())
                .sum();
            Some(samples * costs.per_sample(tile)?)
        })
        .sum()
}
