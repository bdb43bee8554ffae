//! The noise that an image will have with any number of samples, from a uniform pilot of it.

use super::extrapolation::{DEFAULT_SLOPE, MAX_SLOPE, SLOPE_DAMPING};
use super::{Planner, mean_count};
use crate::error::Error;
use crate::film_noise::FilmNoise;
use crate::rendered_film::RenderedFilm;
use crate::settings::RenderSettings;
use dunkelfeld_adaptive::budget::uniform_spp;
use dunkelfeld_adaptive::plan::next_round;
use dunkelfeld_adaptive::required_samples::{HIDDEN_SHARE, RequiredSamples, quantile_of};
use dunkelfeld_film::Plane;

/// Samples per pixel from which the noise of an image is known: a variance needs two.
const MIN_SPP: f64 = 2.0;

/// The forecast of the level of noise of an image under a time limit, from a uniform pilot. The pilot may have fewer and
/// larger pixels than the image.
#[derive(Clone, Debug, PartialEq)]
pub struct PilotForecast {
    /// Samples that each pixel needs to be hidden at k = 1.
    required: RequiredSamples,
    /// Distribution of the samples after the pilot of the image.
    weights: Plane<f32>,
    /// Samples per pixel of this pilot.
    spp: f64,
    /// The exponents a of the estimated variance, v ~ n^-a, with less and with more samples than this pilot.
    trend: [f64; 2],
    /// Samples per pixel of the pilot of the image, where its budget allows them.
    pilot_spp: u32,
}

impl PilotForecast {
    /// A forecast from the film of a pilot, and from that of its first samples, which gives the trend of the estimates.
    /// `settings` are those of the image, with the width and the height of the films. `None` without a sensor.
    ///
    /// # Errors
    /// An exposure outside the ranges of the sensor.
    pub fn new(film: &RenderedFilm, first: &RenderedFilm, settings: &RenderSettings) -> Result<Option<Self>, Error> {
        let planner = Planner::new(settings);
        let (signal_model, image) = planner.exposed(&film.sums)?;
        let measured = FilmNoise::new(&signal_model, film).behind(&image);
        let own = measured.pixel_noise();
        let Some(required) = measured.needs_by(&own, 1.0) else { return Ok(None) };
        let counts = measured.counts.clone();
        let weights = planner.weights_after(&signal_model, &image, &film.sums);
        // The exposure is that of the pilot, which knows the brightness of the image better.
        let measured = FilmNoise::new(&signal_model, first).behind(&planner.exposed(&first.sums)?.1);
        let earlier = measured.needs_by(&measured.pixel_noise(), 1.0);
        let before = earlier.and_then(|earlier| Some((mean_count(&measured.counts), decisive(&earlier)?)));
        let spp = mean_count(&counts);
        let trend = trend(before, decisive(&required).map(|needed| (spp, needed)));
        Ok(Some(Self { required, weights, spp, trend, pilot_spp: settings.pilot_spp }))
    }

    /// Are all pixels saturated? Then there is no level.
    pub fn is_saturated(&self) -> bool {
        self.required.saturated.data().iter().all(|is_saturated| *is_saturated)
    }

    /// The k at which 99 % of the unsaturated pixels are hidden after `spp` samples per pixel in the mean. `None` if all
    /// pixels are saturated, and if the noise of more than 1 % of the others is unknown.
    ///
    /// The samples are distributed as in the render: uniform in its pilot, and then by its plan. The variance of a mean of n
    /// samples is v / n. The estimate of v from n samples falls as n^-a, since rare light that is sampled once counts for the
    /// pixels around it. a is measured on the pilot and its first samples, and damped for more samples than those of the pilot,
    /// as in the forecast of a render.
    pub fn level_after(&self, spp: f64) -> Option<f64> {
        if !(spp >= MIN_SPP && spp.is_finite() && self.spp > 0.0) {
            return None;
        }
        let samples = &self.required.samples;
        let uniform = uniform_spp(spp, self.pilot_spp);
        let ratios = if uniform >= spp {
            samples.map(|n| n / spp as f32)
        } else {
            let pilot = Plane::new(samples.width(), samples.height(), uniform as u32);
            let plan = next_round(&pilot, &self.weights, (spp * samples.data().len() as f64) as u64);
            let mut counts = plan.data().iter();
            samples.map(|needed| needed / counts.next().map_or(1.0, |&n| n as f32))
        };
        let unsaturated = ratios.data().iter().zip(self.required.saturated.data()).filter(|(_, full)| !**full);
        let ratio = quantile_of(unsaturated.map(|(ratio, _)| *ratio), HIDDEN_SHARE)?;
        let slope = self.trend[usize::from(spp > self.spp)];
        let variance = f64::from(ratio) * (spp / self.spp).powf(-slope);
        variance.is_finite().then(|| variance.sqrt())
    }
}

/// The required samples that decide whether an image with the same number of samples in each pixel is hidden.
fn decisive(required: &RequiredSamples) -> Option<f64> {
    let unsaturated = required.samples.data().iter().zip(required.saturated.data()).filter(|(_, full)| !**full);
    quantile_of(unsaturated.map(|(n, _)| *n), HIDDEN_SHARE).map(f64::from).filter(|n| *n > 0.0 && n.is_finite())
}

/// The exponents of [`PilotForecast`] from the samples per pixel and the required samples, before and now.
fn trend(before: Option<(f64, f64)>, now: Option<(f64, f64)>) -> [f64; 2] {
    match (before, now) {
        (Some(before), Some(now)) if before.0 < now.0 => {
            let slope = ((before.1 / now.1).ln() / (now.0 / before.0).ln()).clamp(0.0, MAX_SLOPE);
            [slope, SLOPE_DAMPING * slope]
        }
        _ => [DEFAULT_SLOPE; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forecast(samples: Plane<f32>, weights: Plane<f32>) -> PilotForecast {
        let saturated = samples.map(|n| *n == 0.0);
        let required = RequiredSamples { samples, saturated };
        PilotForecast { required, weights, spp: 16.0, trend: [1.0, 0.5], pilot_spp: 16 }
    }

    /// All pixels need 400 samples: k^2 is 400 / n (n / 16)^-a, with a = 1 below and a = 1/2 above 16.
    #[test]
    fn the_level_follows_the_root_law_with_the_trend_of_the_estimate() {
        let even = forecast(Plane::new(20, 10, 400.0), Plane::new(20, 10, 1.0));
        for spp in [2.0, 5.0, 16.0, 128.0, 2000.0f64] {
            let slope = if spp > 16.0 { 0.5 } else { 1.0 };
            let expected = (400.0 / spp * (spp / 16.0).powf(-slope)).sqrt();
            let level = even.level_after(spp).expect("known");
            assert!((level / expected - 1.0).abs() < 1e-3, "{level} and {expected} at {spp}");
        }
    }

    /// Half of the pixels need 800 samples and get three quarters of those after the pilot; the others need 200. With 160
    /// samples per pixel the pilot has 32, and the water level w has w 1.5 + w 0.5 = 320: 240 and 80. Both k^2 are 10 / 3 and
    /// 2.5, of which the quantile is the larger one. Below 16 samples per pixel all have the same number.
    #[test]
    fn the_trend_is_that_of_the_estimates() {
        // Half of the required samples after four times the samples: 4^-a = 1/2.
        let [below, above] = trend(Some((4.0, 800.0)), Some((16.0, 400.0)));
        assert!((below - 0.5).abs() < 1e-12 && (above - 0.375).abs() < 1e-12);
        assert_eq!(trend(Some((4.0, 300.0)), Some((16.0, 400.0))), [0.0, 0.0]);
        assert_eq!(trend(Some((4.0, 1e9)), Some((16.0, 400.0))), [MAX_SLOPE, SLOPE_DAMPING]);
        assert_eq!(trend(None, Some((16.0, 400.0))), [DEFAULT_SLOPE; 2]);
    }

    #[test]
    fn samples_are_distributed_as_in_the_render() {
        let by_half = |left: f32, right: f32| Plane::from_fn(20, 10, |x, _| if x < 10 { left } else { right });
        let planned = forecast(by_half(800.0, 200.0), by_half(1.5, 0.5));
        let level = planned.level_after(160.0).expect("known");
        assert!((level / ((800.0f64 / 240.0).sqrt() * 10f64.powf(-0.25)) - 1.0).abs() < 0.01, "{level}");
        let level = planned.level_after(10.0).expect("known");
        assert!((level / (80f64.sqrt() * 1.6f64.sqrt()) - 1.0).abs() < 1e-3, "{level}");
    }

    #[test]
    fn pixels_without_a_level_count_as_in_a_certificate() {
        let weights = || Plane::new(20, 10, 1.0);
        // Two of 200 pixels are 1 %, three are more.
        let unknown = |n: u32| Plane::from_fn(20, 10, |x, y| if y == 0 && x < n { f32::INFINITY } else { 400.0 });
        assert!(forecast(unknown(2), weights()).level_after(64.0).is_some());
        assert_eq!(forecast(unknown(3), weights()).level_after(64.0), None);
        // Saturated pixels do not count.
        let most = Plane::from_fn(20, 10, |x, _| if x > 0 { 0.0 } else { 100.0 });
        let level = forecast(most, weights()).level_after(16.0).expect("known");
        assert!((level - 2.5).abs() < 1e-6, "{level}");
        let all = forecast(Plane::new(20, 10, 0.0), weights());
        assert!(all.is_saturated() && all.level_after(64.0).is_none());
        for spp in [0.0, 1.9, f64::NAN, f64::INFINITY] {
            assert_eq!(forecast(unknown(0), weights()).level_after(spp), None, "{spp}");
        }
    }
}
