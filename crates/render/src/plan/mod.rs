//! The allocation of the samples of a render, and the decision to end it. Both use its film, between rounds.
//!
//! The plan is computed once, from a uniform pilot. The number of samples of a pixel depends only on its neighbours.
//! The mean of the pixel is therefore unbiased: the number of its samples does not depend on their values, apart from
//! the common level of all pixels. Later samples only determine the final level.

pub(crate) mod extrapolation;
pub(crate) mod forecast;
pub(crate) mod pilot_forecast;

use crate::error::Error;
use crate::film_noise::{FilmNoise, SignalModel};
use crate::parallel::mean_without_gaps;
use crate::plan::extrapolation::ConvergenceFit;
use crate::plan::forecast::{Forecast, ForecastInput, Throughput};
use crate::rendered_film::RenderedFilm;
use crate::settings::RenderSettings;
use dunkelfeld_adaptive::required_samples::{DEFAULT_TARGET, RequiredSamples, SensorNoise, total};
use dunkelfeld_adaptive::variance::neighbours::PredictedNoise;
use dunkelfeld_adaptive::variance::pooled::PixelNoise;
use dunkelfeld_adaptive::weights::{self, Pilot, Shares, Strategy};
use dunkelfeld_film::{Film, Plane};
use serde::{Deserialize, Serialize};

/// First number of samples per pixel of a pilot whose size is not yet determined: one for each batch of the film.
pub(crate) const FIRST_LOOK: u32 = dunkelfeld_film::BATCHES as u32;
/// Largest growth of the pilot between two estimates. An estimate from few samples is too uncertain for more.
const GROWTH: f64 = 2.0;
/// The pilot ends with this share of the estimated remaining samples, rounded down to a power of two. With less,
/// forecasts have an error of more than a fifth (`docs/accuracy.md`). It has the same number of samples in each pixel.
const PILOT_SHARE: f64 = 0.2;
/// Lower bound of a pixel's share, as a part of the pilot's samples. The neighbours of a pixel may have no noise in the
/// pilot, but noise in later samples. Such a pixel also needs samples.
const MIN_PILOT_SHARE: f64 = 0.1;

/// The inputs of a decision.
#[derive(Clone, Copy)]
pub(crate) struct State<'a> {
    pub(crate) film: &'a RenderedFilm,
    pub(crate) counts: &'a Plane<u32>,
}

/// A decision about the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NoiseVerdict {
    /// The noise is hidden.
    Hidden,
    /// The pilot needs this number of samples per pixel before the plan.
    GrowPilot(u32),
    /// Estimated number of samples of the whole image until the noise is hidden.
    After(f64),
}

/// The planner of a render.
pub(crate) struct Planner<'a> {
    settings: &'a RenderSettings,
    shares: Shares,
    state: PlannerState,
    forecast: Option<Forecast>,
}

/// The state of the planning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct PlannerState {
    is_made: bool,
    /// Samples per pixel of the pilot at the previous estimate.
    seen: f64,
    /// The estimates of the required samples so far.
    trend: ConvergenceFit,
}

impl<'a> Planner<'a> {
    pub(crate) fn new(settings: &'a RenderSettings) -> Self {
        let shares = Shares::from_weights(weights::uniform(settings.width, settings.height));
        Self { settings, shares, state: PlannerState::default(), forecast: None }
    }

    /// The planner of a stored render, in its stored state.
    pub(crate) fn resumed(
        settings: &'a RenderSettings,
        shares: Shares,
        state: PlannerState,
        forecast: Option<Forecast>,
    ) -> Self {
        Self { settings, shares, state, forecast }
    }

    /// The state of the planning: with shares and forecast, it is all that [`Self::resumed`] needs.
    pub(crate) fn state(&self) -> PlannerState {
        self.state
    }

    /// The forecast.
    pub(crate) fn forecast(&self) -> Option<&Forecast> {
        self.forecast.as_ref()
    }

    /// The distribution of samples from now on.
    pub(crate) fn shares(&self) -> &Shares {
        &self.shares
    }

    /// The weights of the plan, and the forecast.
    pub(crate) fn into_parts(self) -> (Plane<f32>, Option<Forecast>) {
        (self.shares.weights, self.forecast)
    }

    /// Computes the plan from the pilot. With a sensor, it returns a forecast.
    ///
    /// # Errors
    /// An exposure outside the ranges of the sensor.
    pub(crate) fn plan(&mut self, state: State<'_>, pace: &Throughput<'_>) -> Result<Option<&Forecast>, Error> {
        let (signal_model, image) = self.exposed(&state.film.sums)?;
        let is_measured = signal_model.sensor.is_some() || self.settings.strategy().needs_noise();
        let measure = || {
            let measured = FilmNoise::new(&signal_model, state.film);
            let strategy = self.settings.strategy();
            if !strategy.needs_noise() {
                return PilotNoise { own: measured.pixel_noise(), measured, expected: None };
            }
            let (own, expected) = measured.pixel_noise_and_expected(sensor_of_plan(&measured, strategy));
            PilotNoise { measured, expected: Some(expected), own }
        };
        let pilot_noise = is_measured.then(measure);
        self.fix(&signal_model, image, pilot_noise.as_ref(), state, pace);
        Ok(self.forecast.as_ref())
    }

    /// The unit of noise at the exposure of the image so far, and the image in that unit.
    fn exposed(&self, film: &Film) -> Result<(SignalModel, Plane<f32>), Error> {
        let mean = mean_without_gaps(film);
        let signal_model = SignalModel::new(&mean, &self.settings.sensor)?;
        let image = signal_model.image(&mean);
        Ok((signal_model, image))
    }

    /// Compares the image with the noise level at which the render ends. Computes the plan once the pilot suffices, and
    /// then reports the forecast.
    ///
    /// # Errors
    /// An exposure outside the ranges of the sensor.
    pub(crate) fn judge(
        &mut self,
        k: f64,
        state: State<'_>,
        pace: &Throughput<'_>,
        report: impl FnOnce(&Forecast),
    ) -> Result<NoiseVerdict, Error> {
        let (signal_model, image) = self.exposed(&state.film.sums)?;
        let measured = FilmNoise::new(&signal_model, state.film);
        let own = measured.pixel_noise();
        let share = self.settings.budget.hidden_share();
        let is_hidden =
            measured.certify_by(own.data().iter().copied(), k).is_some_and(|c| c.certificate.hidden >= share);
        let required_samples = measured.needs_by(&own, k);
        let spp = mean_count(state.counts);
        let weights = &self.shares.weights;
        if self.state.is_made {
            if is_hidden {
                return Ok(NoiseVerdict::Hidden);
            }
            let needed = required_samples
                .map(|n| self.state.trend.extrapolate(n.if_weighted(state.counts, weights, share), state.counts));
            return Ok(NoiseVerdict::After(needed.map_or(f64::INFINITY, |targets| total(&targets))));
        }
        let required = required_samples.map_or(f64::INFINITY, |n| total(&n.if_weighted(state.counts, weights, share)));
        let required = required / state.counts.data().len() as f64;
        self.state.trend.note(spp, required);
        // A pilot with a target of 20 samples has 16: see below.
        let is_whole = 2.0 * spp > f64::from(self.settings.pilot_spp);
        if is_hidden && is_whole {
            return Ok(NoiseVerdict::Hidden);
        }
        let wanted = (PILOT_SHARE * required).min(GROWTH * spp).max(f64::from(self.settings.pilot_spp));
        // Powers of two in every batch: only these numbers of quasi-random points are evenly distributed. Other numbers
        // have more noise, which would distort the comparison of two estimates. `as` saturates.
        let wanted = FIRST_LOOK << (wanted as u32 / FIRST_LOOK).max(1).ilog2();
        // If it has not grown after a request, it cannot grow: the budget does not allow it.
        let has_grown = spp > self.state.seen;
        self.state.seen = spp;
        if has_grown && f64::from(wanted) > 1.01 * spp {
            return Ok(NoiseVerdict::GrowPilot(wanted));
        }
        let pilot_noise = PilotNoise::new(measured, own, self.settings.strategy());
        self.fix(&signal_model, image, Some(&pilot_noise), state, pace);
        if let Some(forecast) = &self.forecast {
            report(forecast);
        }
        let targets = self.targets(&pilot_noise, (k, share), state.counts, &self.shares.weights);
        Ok(NoiseVerdict::After(targets.map_or(f64::INFINITY, |t| total(&t))))
    }

    /// Fixes the shares for the rest of the render, and computes the forecast.
    fn fix(
        &mut self,
        signal_model: &SignalModel,
        image: Plane<f32>,
        pilot_noise: Option<&PilotNoise<'_>>,
        state: State<'_>,
        pace: &Throughput<'_>,
    ) {
        let target = self.settings.budget.noise;
        let shares = self.shares_after(signal_model, &image, pilot_noise, state.counts);
        // The forecast needs the memory.
        drop(image);
        let targets = |k, share| pilot_noise.and_then(|s| self.targets(s, (k, share), state.counts, &shares.weights));
        let required = |k| pilot_noise.and_then(|s| s.measured.needs_by(&s.own, k));
        let forecast_input = ForecastInput {
            film: state.film,
            counts: state.counts,
            targets: &targets,
            required: &required,
            target,
            share: self.settings.budget.hidden_share(),
        };
        self.forecast = Forecast::new(&forecast_input, pace);
        self.shares = shares;
        self.state.is_made = true;
    }

    /// The shares of the samples after a pilot of `counts` samples per pixel.
    fn shares_after(
        &self,
        signal_model: &SignalModel,
        image: &Plane<f32>,
        pilot_noise: Option<&PilotNoise<'_>>,
        counts: &Plane<u32>,
    ) -> Shares {
        let (strategy, target) = (self.settings.strategy(), self.settings.budget.noise);
        let required_samples = pilot_noise
            .filter(|_| strategy == Strategy::Sensor)
            .and_then(|s| s.planned(target.unwrap_or(DEFAULT_TARGET)));
        match (&required_samples, target, strategy) {
            // All pixels approach their required samples in proportion, so that all are hidden at the same time.
            (Some(required_samples), Some(_), Strategy::Sensor) => {
                Shares::from_weights(required_samples.shares(least(counts)))
            }
            _ => strategy.shares(&Pilot {
                luminance: image,
                white: signal_model.white,
                sobel_floor: self.settings.sobel_floor,
                measured: pilot_noise
                    .and_then(|s| s.expected.as_ref())
                    .map(|expected| weights::MeasuredNoise { expected, required_samples: required_samples.as_ref() }),
            }),
        }
    }

    /// Estimated samples per pixel until a share of the pixels is hidden at k with the strategy of the render. `None` without a
    /// sensor. Shares are planned from the neighbours. The total follows from the variance that is certified.
    fn targets(
        &self,
        pilot_noise: &PilotNoise<'_>,
        (k, share): (f64, f64),
        counts: &Plane<u32>,
        weights: &Plane<f32>,
    ) -> Option<Plane<f32>> {
        let required_samples = pilot_noise.measured.needs_by(&pilot_noise.own, k)?;
        let targets = match self.settings.strategy() {
            Strategy::Sensor => {
                let weights = pilot_noise.planned(k)?.shares(least(counts));
                required_samples.if_weighted(counts, &weights, share)
            }
            Strategy::Uniform | Strategy::Sobel | Strategy::Variance => {
                required_samples.if_weighted(counts, weights, share)
            }
        };
        Some(self.state.trend.extrapolate(targets, counts))
    }
}

/// Lower bound of the required samples of a pixel after a pilot of this size.
fn least(counts: &Plane<u32>) -> f32 {
    (MIN_PILOT_SHARE * mean_count(counts)) as f32
}

/// Samples per pixel.
fn mean_count(counts: &Plane<u32>) -> f64 {
    counts.data().iter().map(|&n| f64::from(n)).sum::<f64>() / counts.data().len().max(1) as f64
}

/// The sensor of a plan. A strategy that minimises the variance of the image's mean does not use it.
fn sensor_of_plan(measured: &FilmNoise<'_>, strategy: Strategy) -> Option<SensorNoise> {
    measured.sensor.filter(|_| strategy != Strategy::Variance)
}

/// The noise of the pilot.
struct PilotNoise<'a> {
    /// From the pixels themselves.
    measured: FilmNoise<'a>,
    /// For plans: from the neighbours of each pixel. `None` where a plan does not depend on noise.
    expected: Option<Plane<PredictedNoise>>,
    /// For the certificate.
    own: Plane<PixelNoise>,
}

impl<'a> PilotNoise<'a> {
    fn new(measured: FilmNoise<'a>, own: Plane<PixelNoise>, strategy: Strategy) -> Self {
        let expected = strategy.needs_noise().then(|| measured.expected(sensor_of_plan(&measured, strategy)));
        Self { measured, expected, own }
    }

    /// The target of a plan for `k`. `None` without a sensor, and where a plan does not depend on noise.
    fn planned(&self, k: f64) -> Option<RequiredSamples> {
        self.measured.sensor.and(self.expected.as_ref()).map(|expected| RequiredSamples::expected(expected, k))
    }
}
