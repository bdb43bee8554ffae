//! The allocation of the samples of a render, and the decision to end it. Both use its film, between rounds.
//!
//! The plan is computed once, from a uniform pilot. The number of samples of a pixel depends only on its neighbours.
//! The mean of the pixel is therefore unbiased: the number of its samples does not depend on their values, apart from
//! the common level of all pixels. Later samples only determine the final level.

pub(crate) mod extrapolation;
pub(crate) mod forecast;

use crate::error::Error;
use crate::film_noise::{FilmNoise, SignalModel};
use crate::lens_image::LensImage;
use crate::parallel::mean_image;
use crate::plan::extrapolation::ConvergenceFit;
use crate::plan::forecast::{Forecast, ForecastInput, Throughput};
use crate::rendered_film::RenderedFilm;
use crate::settings::{CaptureRows, RenderSettings};
use dunkelfeld_adaptive::required_samples::{RequiredSamples, total};
use dunkelfeld_adaptive::weights::{self, Pilot, Strategy};
use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

/// First number of samples per pixel of a pilot whose size is not yet determined: one for each batch of the film.
pub(crate) const FIRST_LOOK: u32 = dunkelfeld_film::BATCHES as u32;
/// Largest growth of the pilot between two estimates. An estimate from few samples is too uncertain for more.
const GROWTH: f64 = 2.0;
/// The pilot ends with this share of the estimated remaining samples, rounded down to a power of two. With less,
/// forecasts have an error of more than a fifth (`docs/accuracy.md`). It has the same number of samples in each pixel.
const PILOT_SHARE: f64 = 0.2;

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

/// The noise of an image, or that of the worst of several ones at each pixel.
struct Measured {
    /// Samples that each pixel needs at k = 1, by the variance that is certified. `None` without a sensor.
    required: Option<RequiredSamples>,
    /// The smallest share of hidden pixels.
    hidden: f64,
    /// The weights of the samples after a pilot.
    weights: Plane<f32>,
    /// Variance of one sample of each pixel over that of the sensor.
    noise_of_samples: Option<Plane<f32>>,
}

impl Measured {
    fn max(self, other: Self) -> Self {
        let required = self.required.zip(other.required).map(|(a, b)| a.max(&b));
        let noise_of_samples = self.noise_of_samples.zip(other.noise_of_samples).map(|(mut noise, other)| {
            let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
            let pairs = noise.data_mut().iter_mut().zip(other.data());
            pairs.for_each(|(noise, &other)| *noise = finite(*noise).max(finite(other)));
            noise
        });
        let mut weights = self.weights;
        match &noise_of_samples {
            Some(noise) => weights = weights::sensor(noise),
            None => weights.data_mut().iter_mut().zip(other.weights.data()).for_each(|(w, &other)| *w = w.max(other)),
        }
        Self { required, hidden: self.hidden.min(other.hidden), weights, noise_of_samples }
    }

    /// That of a film whose rows are those of the captures in turn.
    fn in_turn(captures: &[Self]) -> Self {
        fn rows<T: Clone>(of: &[&Plane<T>]) -> Plane<T> {
            let count = of.len() as u32;
            let (width, height) = of.first().map_or((0, 0), |plane| (plane.width(), plane.height()));
            Plane::from_fn(width, height * count, |x, y| of[(y % count) as usize].at(x, y / count).clone())
        }
        fn all<T>(of: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
            of.collect()
        }
        let required = all(captures.iter().map(|c| c.required.as_ref())).map(|of| RequiredSamples {
            samples: rows(&of.iter().map(|required| &required.samples).collect::<Vec<_>>()),
            saturated: rows(&of.iter().map(|required| &required.saturated).collect::<Vec<_>>()),
        });
        let noise_of_samples = all(captures.iter().map(|c| c.noise_of_samples.as_ref())).map(|of| rows(&of));
        let weights = match &noise_of_samples {
            Some(noise) => weights::sensor(noise),
            None => rows(&captures.iter().map(|c| &c.weights).collect::<Vec<_>>()),
        };
        let hidden = captures.iter().fold(1.0, |least: f64, c| least.min(c.hidden));
        Self { required, hidden, weights, noise_of_samples }
    }
}

/// The planner of a render.
pub(crate) struct Planner<'a> {
    settings: &'a RenderSettings,
    weights: Plane<f32>,
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
        let weights = weights::uniform(settings.width, settings.height);
        Self { settings, weights, state: PlannerState::default(), forecast: None }
    }

    /// The planner of a stored render, in its stored state.
    pub(crate) fn resumed(
        settings: &'a RenderSettings,
        weights: Plane<f32>,
        state: PlannerState,
        forecast: Option<Forecast>,
    ) -> Self {
        Self { settings, weights, state, forecast }
    }

    /// The state of the planning: with weights and forecast, it is all that [`Self::resumed`] needs.
    pub(crate) fn state(&self) -> PlannerState {
        self.state
    }

    /// The forecast.
    pub(crate) fn forecast(&self) -> Option<&Forecast> {
        self.forecast.as_ref()
    }

    /// The distribution of samples from now on.
    pub(crate) fn weights(&self) -> &Plane<f32> {
        &self.weights
    }

    /// The weights of the plan, and the forecast.
    pub(crate) fn into_parts(self) -> (Plane<f32>, Option<Forecast>) {
        (self.weights, self.forecast)
    }

    /// Computes the plan from the pilot. With a sensor, it returns a forecast.
    ///
    /// # Errors
    /// An exposure outside the ranges of the sensor.
    pub(crate) fn plan(&mut self, state: State<'_>, pace: &Throughput<'_>) -> Result<Option<&Forecast>, Error> {
        let measured = self.measure(state.film, None)?;
        self.fix(measured, state, pace);
        Ok(self.forecast.as_ref())
    }

    /// Measures the noise of the image so far, or of all captures. The hidden share is that at `k`.
    fn measure(&self, film: &RenderedFilm, k: Option<f64>) -> Result<Measured, Error> {
        let captures = &self.settings.run.captures;
        let Some((first, others)) = captures.split_first() else {
            return self.measure_one(film, self.settings, k);
        };
        let of = |capture| self.measure_one(&film.of_capture(capture)?, &self.settings.of_capture(capture), k);
        if first.rows != CaptureRows::ALL {
            return Ok(Measured::in_turn(&captures.iter().map(of).collect::<Result<Vec<_>, _>>()?));
        }
        others.iter().try_fold(of(first)?, |worst, capture| Ok(worst.max(of(capture)?)))
    }

    fn measure_one(&self, film: &RenderedFilm, settings: &RenderSettings, k: Option<f64>) -> Result<Measured, Error> {
        // The unit of noise at the exposure of the image so far, and the image behind the lens.
        let image = LensImage::new(mean_image(&film.sums, settings.is_spread()), &settings.sensor);
        let signal_model = SignalModel::new(&image.radiance, &settings.sensor)?;
        let strategy = settings.strategy();
        let noise_of_samples = match strategy {
            Strategy::Sensor if !self.state.is_made => signal_model.noise_of_samples(&film.sums),
            _ => None,
        };
        let weights = strategy.weights(&Pilot {
            luminance: &signal_model.image(&image.radiance),
            white: signal_model.white,
            sobel_floor: settings.sobel_floor,
            noise: noise_of_samples.as_ref(),
        });
        let (mut required, mut hidden) = (None, 0.0);
        if signal_model.sensor.is_some() {
            let measured = FilmNoise::new(&signal_model, film).behind(&image);
            let own = measured.pixel_noise();
            required = measured.needs_by(&own, 1.0);
            hidden = k.and_then(|k| measured.certify_by(&own, k)).map_or(0.0, |c| c.certificate.hidden);
        }
        Ok(Measured { required, hidden, weights, noise_of_samples })
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
        let measured = self.measure(state.film, Some(k))?;
        let share = self.settings.budget.hidden_share();
        let is_hidden = measured.hidden >= share;
        let required_samples = measured.required.as_ref().map(|required| required.at(k));
        let spp = mean_count(state.counts);
        let weights = &self.weights;
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
        let required = self.fix(measured, state, pace);
        if let Some(forecast) = &self.forecast {
            report(forecast);
        }
        let targets = self.targets(required.as_ref(), (k, share), state.counts);
        Ok(NoiseVerdict::After(targets.map_or(f64::INFINITY, |t| total(&t))))
    }

    /// Fixes the weights for the rest of the render, and computes the forecast. Returns the samples that each pixel needs at k = 1,
    /// by the variance that is certified.
    fn fix(&mut self, measured: Measured, state: State<'_>, pace: &Throughput<'_>) -> Option<RequiredSamples> {
        self.weights = measured.weights;
        let required = measured.required;
        let forecast_input = ForecastInput {
            film: state.film,
            counts: state.counts,
            targets: &|k, share| self.targets(required.as_ref(), (k, share), state.counts),
            required: &|k| Some(required.as_ref()?.at(k)),
            target: self.settings.budget.noise,
            share: self.settings.budget.hidden_share(),
        };
        self.forecast = Forecast::new(&forecast_input, pace);
        self.state.is_made = true;
        required
    }

    /// Estimated samples per pixel until a share of the pixels is hidden at k with the plan. `None` without a sensor.
    fn targets(
        &self,
        required: Option<&RequiredSamples>,
        (k, share): (f64, f64),
        counts: &Plane<u32>,
    ) -> Option<Plane<f32>> {
        Some(self.state.trend.extrapolate(required?.at(k).if_weighted(counts, &self.weights, share), counts))
    }
}

/// Samples per pixel.
fn mean_count(counts: &Plane<u32>) -> f64 {
    counts.data().iter().map(|&n| f64::from(n)).sum::<f64>() / counts.data().len().max(1) as f64
}
