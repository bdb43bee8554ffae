//! The noise of a film for noise-matched exposure: the variance of every pixel, and the pixels where it is reliable.

use dunkelfeld_film::Plane;
use dunkelfeld_render::film_noise::{FilmNoise, PixelVariance, sensor_noise};
use dunkelfeld_sensor::{Exposure, SensorModel, matched_where};

/// The pixels where noise-matched exposure holds. There, frames of independent renders have the variance of the
/// camera's frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    /// Does it hold in the pixel? The layer `matched.Y`.
    pub held: Plane<bool>,
    /// Share of the pixels where it holds, in \[0, 1\].
    pub share: f64,
    /// Variance of the render over that of the camera. The part of the render variance that could be compensated does
    /// not count. Infinite where it is unknown, and where the pixel contains a rare sample, which raises it by more
    /// than one standard deviation of the camera.
    pub ratios: Plane<f32>,
}

impl Matched {
    /// Checks the pixels of an exposure by their mean electrons and the known part of their noise.
    pub(crate) fn new(
        measured: &FilmNoise<'_>,
        known: &CompensationInputs,
        electrons: &Plane<f32>,
        model: &SensorModel,
        exposure: Exposure,
    ) -> Self {
        match measured.sensor {
            Some(_) => Self::of_known(known, (electrons, &measured.mean), model, exposure),
            None => Self::nowhere(electrons.width(), electrons.height()),
        }
    }

    /// [`Self::new`] for electrons with the mean signal of their film.
    pub(crate) fn of_known(
        known: &CompensationInputs,
        (electrons, mean): (&Plane<f32>, &Plane<f32>),
        model: &SensorModel,
        exposure: Exposure,
    ) -> Self {
        let sensor = sensor_noise(model, exposure);
        let held = known.held(electrons, model, exposure);
        let mut pixels = known.variance.data().iter().zip(known.is_rare.data());
        let ratios = mean.map(|&mean| match pixels.next() {
            Some((v, false)) => v / sensor.variance(f64::from(mean)) as f32,
            _ => f32::INFINITY,
        });
        Self { share: share(&held), held, ratios }
    }

    /// For an image with unknown noise.
    pub(crate) fn nowhere(width: u32, height: u32) -> Self {
        let ratios = Plane::new(width, height, f32::INFINITY);
        Self { held: Plane::new(width, height, false), share: 0.0, ratios }
    }
}

fn share(held: &Plane<bool>) -> f64 {
    held.data().iter().filter(|h| **h).count() as f64 / held.data().len().max(1) as f64
}

/// The noise of a film's pixels, as far as it is compensated.
#[derive(Clone, Debug)]
pub(crate) struct CompensationInputs {
    /// Variance of the rendered mean of each pixel [e-^2], from its own samples if they suffice. Infinite where the
    /// pixel has samples in fewer than two batches. Then its neighbours may determine the variance of its samples, but
    /// not whether it contains a rare sample.
    pub(crate) variance: Plane<f32>,
    /// Does the pixel contain a rare sample ([`Matched::ratios`])? Its contribution cannot be compensated in this
    /// pixel, and must not be compensated in others. Such pixels are left out of the estimates of their neighbours.
    pub(crate) is_rare: Plane<bool>,
}

impl CompensationInputs {
    pub(crate) fn from_variances(variances: &Plane<PixelVariance>) -> Self {
        Self { variance: variances.map(|pixel| pixel.variance), is_rare: variances.map(|pixel| pixel.is_rare) }
    }

    /// An image without light, which has no noise.
    pub(crate) fn none([width, height]: [u32; 2]) -> Self {
        Self { variance: Plane::new(width, height, 0.0), is_rare: Plane::new(width, height, false) }
    }

    /// The noise of the sum of independent means. A rare sample in one of them is one in the sum.
    pub(crate) fn sum(parts: impl Iterator<Item = Self>) -> Option<Self> {
        parts.reduce(|mut sum, part| {
            sum.variance.data_mut().iter_mut().zip(part.variance.data()).for_each(|(sum, v)| *sum += v);
            sum.is_rare.data_mut().iter_mut().zip(part.is_rare.data()).for_each(|(sum, rare)| *sum |= rare);
            sum
        })
    }

    /// The pixels where the method holds, for a sensor with these mean electrons.
    pub(crate) fn held(&self, electrons: &Plane<f32>, model: &SensorModel, exposure: Exposure) -> Plane<bool> {
        let mut held = matched_where(model, exposure, electrons, &self.variance);
        held.data_mut().iter_mut().zip(self.is_rare.data()).for_each(|(held, rare)| *held &= !rare);
        held
    }
}
