//! What noise-matched exposure has to know of a film: the variance of every pixel, and where it tells the truth.

use dunkelfeld_film::Plane;
use dunkelfeld_render::film_noise::FilmNoise;
use dunkelfeld_sensor::{Exposure, SensorModel, matched_where};

/// Where noise-matched exposure holds: there frames of independent renders have the variance of the camera's.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    /// Does it hold in the pixel: the layer `matched.Y`.
    pub held: Plane<bool>,
    /// Share of the pixels where it holds, in \[0, 1\].
    pub share: f64,
    /// Variance of the render that was left out, as far as it could be, over that of the camera. Infinite where it is not known, and
    /// where the pixel holds a rare sample: one that lifts it by more than one of the camera's standard deviations.
    pub ratios: Plane<f32>,
}

impl Matched {
    /// Judges the pixels of an exposure by their mean electrons and what is known of the noise of these.
    pub(crate) fn new(
        measured: &FilmNoise<'_>,
        known: &CompensationInputs,
        electrons: &Plane<f32>,
        model: &SensorModel,
        exposure: Exposure,
    ) -> Self {
        let Some(sensor) = measured.sensor else { return Self::nowhere(electrons.width(), electrons.height()) };
        let held = known.held(electrons, model, exposure);
        let mut pixels = known.variance.data().iter().zip(known.is_rare.data());
        let ratios = measured.mean.map(|&mean| match pixels.next() {
            Some((v, false)) => v / sensor.variance(f64::from(mean)) as f32,
            _ => f32::INFINITY,
        });
        Self { share: share(&held), held, ratios }
    }

    /// Of an image whose noise nobody knows.
    pub(crate) fn nowhere(width: u32, height: u32) -> Self {
        let ratios = Plane::new(width, height, f32::INFINITY);
        Self { held: Plane::new(width, height, false), share: 0.0, ratios }
    }
}

fn share(held: &Plane<bool>) -> f64 {
    held.data().iter().filter(|h| **h).count() as f64 / held.data().len().max(1) as f64
}

/// The noise of a film's pixels, as far as it is to be made up for.
#[derive(Clone, Debug)]
pub(crate) struct CompensationInputs {
    /// Variance of the rendered mean of each pixel [e-^2], by its own samples as far as they tell. Infinite where the pixel has samples in
    /// fewer than two batches: its neighbours may tell how noisy its samples are, but not whether it is one of them.
    pub(crate) variance: Plane<f32>,
    /// Does the pixel hold a rare sample ([`Matched::ratios`])? What it brings cannot be made up for where it is, and is not to be
    /// where it is not: such pixels tell their neighbours nothing.
    pub(crate) is_rare: Plane<bool>,
}

impl CompensationInputs {
    pub(crate) fn from_noise(measured: &FilmNoise<'_>) -> Self {
        let told = measured.without_outliers();
        Self { variance: told.map(|t| t.1), is_rare: told.map(|t| t.0) }
    }

    /// Where the method holds for a sensor that sees so many electrons.
    pub(crate) fn held(&self, electrons: &Plane<f32>, model: &SensorModel, exposure: Exposure) -> Plane<bool> {
        let mut held = matched_where(model, exposure, electrons, &self.variance);
        held.data_mut().iter_mut().zip(self.is_rare.data()).for_each(|(held, rare)| *held &= !rare);
        held
    }
}
