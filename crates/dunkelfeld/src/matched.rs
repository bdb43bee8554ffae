//! What noise-matched exposure has to know of a film: the variance of every pixel, and where it tells the truth.

use crate::noise::Measured;
use dunkelfeld_film::Plane;
use dunkelfeld_sensor::{Exposure, SensorModel, matched_where};

/// A sample that lifts its pixel by more standard deviations than this is not what the pixel's variance knows of.
const OUTLIER: f32 = 3.0;

/// Where noise-matched exposure holds: there frames of independent renders have the variance of the camera's.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    /// Does it hold in the pixel: the layer `matched.Y`.
    pub held: Plane<bool>,
    /// Share of the pixels where it holds, in \[0, 1\].
    pub share: f64,
}

impl Matched {
    /// Judges the pixels of an exposure by their mean electrons, the variance of these as [`variance_of_means`] gives it, and
    /// the samples they come from.
    pub(crate) fn new(
        measured: &Measured,
        variance: &Plane<f32>,
        electrons: &Plane<f32>,
        model: &SensorModel,
        exposure: Exposure,
    ) -> Self {
        let mut held = matched_where(model, exposure, electrons, variance);
        let e = &measured.evidence;
        let known = e.counts.data().iter().zip(e.mean.data()).zip(e.largest.data()).zip(variance.data());
        for (held, (((&n, &mean), &largest), &variance)) in held.data_mut().iter_mut().zip(known) {
            // By so much the pixel is above the mean of its other samples. A lone sample's variance is not known anyway.
            let lift = (largest - mean) / (n.max(2) - 1) as f32;
            *held &= lift <= OUTLIER * variance.sqrt() || lift <= f32::EPSILON * mean;
        }
        let count = held.data().iter().filter(|h| **h).count();
        Self { share: count as f64 / held.data().len().max(1) as f64, held }
    }

    /// Of an image whose noise nobody knows.
    pub(crate) fn nowhere(width: u32, height: u32) -> Self {
        Self { held: Plane::new(width, height, false), share: 0.0 }
    }
}

/// Variance of the rendered mean of each pixel [e-^2], pooled over its surface. Infinite where the pixel itself has samples
/// in fewer than two batches: its neighbours may tell how noisy its samples are, but not whether it is one of them.
pub(crate) fn variance_of_means(measured: &Measured) -> Plane<f32> {
    let e = &measured.evidence;
    let mut own = e.counts.data().iter().zip(e.variance.data());
    measured.noise.map(|noise| match own.next() {
        Some((&n, v)) if v.is_finite() => noise.of_mean(n),
        _ => f32::INFINITY,
    })
}
