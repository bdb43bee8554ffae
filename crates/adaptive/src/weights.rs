//! The allocation of samples to pixels: relative weights per pixel with mean one, and the samples that each pixel
//! needs.
//!
//! Each strategy is a pure function of planes. A strategy sets the *ratios* between pixels. [`crate::plan`] sets the
//! number of samples to distribute, and [`crate::budget`] the number that the clock allows.

use std::fmt;
use std::str::FromStr;

use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

use crate::required_samples::RequiredSamples;
use crate::sobel::{gamma_image, magnitude};
use crate::variance::neighbours::PredictedNoise;

/// Lower bound of the Sobel magnitude of a pixel, as a share of the mean magnitude of the image. With it, the flattest
/// pixel gets at least `FLOOR / (1 + FLOOR)`, a fifth, of the average.
pub const SOBEL_FLOOR: f32 = 0.25;
/// Lower bound of the Sobel magnitude, half a grey level per pixel [DN/pixel]. Below it, differences come from 8-bit
/// rounding and not from an edge.
pub const SOBEL_RESOLUTION: f32 = 0.5;

/// A strategy that distributes samples over pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// The same number everywhere.
    Uniform,
    /// In proportion to the Sobel magnitude of the pilot image, above a floor (Kludt et al.).
    Sobel,
    /// In proportion to the standard deviation of a sample (Neyman 1934). For a given number of samples, this has the
    /// least variance of the image mean.
    Variance,
    /// By the noise of the sensor, until the render variance of all pixels is hidden by the sensor variance. If the
    /// budget does not suffice, in proportion to `sqrt(v / s)`: v is the variance of a sample and s the sensor
    /// variance. The few pixels that need most count as the largest of the others, since a render does
    /// not wait for them.
    Sensor,
}

impl Strategy {
    /// All strategies, in the order in which they are documented.
    pub const ALL: [Self; 4] = [Self::Uniform, Self::Sobel, Self::Variance, Self::Sensor];

    /// The default strategy: [`Self::Sensor`] with a sensor, otherwise that of the founding paper.
    pub const fn default_for(has_sensor: bool) -> Self {
        if has_sensor { Self::Sensor } else { Self::Sobel }
    }

    /// The name on the command line and in job files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Sobel => "sobel",
            Self::Variance => "variance",
            Self::Sensor => "sensor",
        }
    }

    /// Returns whether the strategy uses measured variances ([`Pilot::measured`]).
    pub const fn needs_noise(self) -> bool {
        matches!(self, Self::Variance | Self::Sensor)
    }

    /// The shares of all pixels. A strategy without its data falls back to the next simpler one: `sensor` without a
    /// sensor to `variance`, and `variance` without variances to `uniform`.
    pub fn shares(self, pilot: &Pilot<'_>) -> Shares {
        let (width, height) = (pilot.luminance.width(), pilot.luminance.height());
        match (self, &pilot.measured) {
            (Self::Sobel, _) => {
                Shares::from_weights(sobel(&magnitude(&gamma_image(pilot.luminance, pilot.white)), pilot.sobel_floor))
            }
            (Self::Sensor, Some(MeasuredNoise { required_samples: Some(required_samples), .. })) => {
                Shares { weights: deviation(&required_samples.capped()), caps: Some(required_samples.capped_targets()) }
            }
            (Self::Variance | Self::Sensor, Some(MeasuredNoise { expected, .. })) => {
                Shares::from_weights(deviation(&expected.map(|e| e.ratio)))
            }
            (Self::Uniform, _) | (Self::Variance | Self::Sensor, None) => Shares::from_weights(uniform(width, height)),
        }
    }
}

/// Shares of a budget: in proportion to weights, up to caps. Once all caps are met, in proportion to the caps.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// Relative weights, none negative, with mean one (to within rounding).
    pub weights: Plane<f32>,
    /// Samples at which a pixel has its required number. `None` without such numbers.
    pub caps: Option<Plane<f32>>,
}

impl Shares {
    /// Shares from weights alone.
    pub fn from_weights(weights: Plane<f32>) -> Self {
        Self { weights, caps: None }
    }
}

impl fmt::Display for Strategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A strategy name that does not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownStrategy(pub String);

impl fmt::Display for UnknownStrategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Strategy::ALL.map(Strategy::name).join(", ");
        write!(f, "there is no allocation `{}`; there are {names}", self.0)
    }
}

impl std::error::Error for UnknownStrategy {}

impl FromStr for Strategy {
    type Err = UnknownStrategy;

    fn from_str(name: &str) -> Result<Self, UnknownStrategy> {
        Self::ALL.into_iter().find(|s| s.name() == name).ok_or_else(|| UnknownStrategy(name.to_owned()))
    }
}

/// Statistics of the image when the samples are distributed: means over all samples so far.
#[derive(Clone, Copy, Debug)]
pub struct Pilot<'a> {
    /// Mean luminance per pixel, in any linear unit.
    pub luminance: &'a Plane<f32>,
    /// The level at which the camera saturates, in the unit of `luminance`.
    pub white: f32,
    /// Weight of a region without edges, relative to the mean Sobel magnitude. [`SOBEL_FLOOR`] is the default, and
    /// replaces values that are not from 0 to 1.
    pub sobel_floor: f32,
    /// Variances, for the strategies that need them.
    pub measured: Option<MeasuredNoise<'a>>,
}

/// Measured variances. The planes have the size of the pilot.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredNoise<'a> {
    /// Predicted variance of a sample of each pixel over the sensor variance. Without a sensor, or for
    /// [`Strategy::Variance`], the divisor is the same everywhere.
    pub expected: &'a Plane<PredictedNoise>,
    /// Samples that each pixel needs until its noise is hidden by that of the sensor.
    pub required_samples: Option<&'a RequiredSamples>,
}

/// Weights `sqrt(v)`. A pixel of unknown variance has the largest weight of the others.
fn deviation(variance: &Plane<f32>) -> Plane<f32> {
    let (width, height) = (variance.width(), variance.height());
    let weights: Vec<f32> = variance.data().iter().map(|&v| f64::from(v).sqrt() as f32).collect();
    let heaviest = weights.iter().copied().filter(|w| w.is_finite()).fold(0.0f32, f32::max);
    let heaviest = if heaviest > 0.0 { heaviest } else { 1.0 };
    let weights = weights.into_iter().map(|w| if w.is_finite() { w } else { heaviest }).collect();
    match Plane::from_vec(width, height, weights) {
        Some(weights) if weights.data().iter().any(|&w| w > 0.0) => normalised(weights),
        _ => uniform(width, height),
    }
}

/// Equal weights.
pub fn uniform(width: u32, height: u32) -> Plane<f32> {
    Plane::new(width, height, 1.0)
}

/// Weights in proportion to the Sobel magnitude [DN/pixel], with mean one. Magnitudes have two lower bounds:
/// [`SOBEL_RESOLUTION`], and `floor` times the mean magnitude. An image without edges has equal weights. Magnitudes
/// that are not finite count as the floor. A `floor` that is not from 0 to 1 counts as [`SOBEL_FLOOR`].
pub fn sobel(magnitude: &Plane<f32>, floor: f32) -> Plane<f32> {
    let known = |m: f32| if m.is_finite() { m } else { 0.0 };
    let mean = mean(magnitude.data().iter().map(|&m| known(m)));
    let share = if (0.0..=1.0).contains(&floor) { floor } else { SOBEL_FLOOR };
    let floor = SOBEL_RESOLUTION.max(share * mean);
    normalised(magnitude.map(|&m| known(m).max(floor)))
}

/// Scales positive weights to mean one.
fn normalised(mut weights: Plane<f32>) -> Plane<f32> {
    let mean = mean(weights.data().iter().copied());
    weights.data_mut().iter_mut().for_each(|w| *w /= mean);
    weights
}

/// The mean, summed in f64 in the order of the values. Zero without values.
fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len().max(1) as f64;
    (values.map(f64::from).sum::<f64>() / count) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_mean_one(weights: &Plane<f32>) {
        let m = mean(weights.data().iter().copied());
        assert!((m - 1.0).abs() < 1e-5, "mean {m}");
        assert!(weights.data().iter().all(|w| *w > 0.0 && w.is_finite()));
    }

    #[test]
    fn names_are_parsed_as_printed() {
        for strategy in Strategy::ALL {
            assert_eq!(strategy.name().parse(), Ok(strategy));
        }
        let error = "neyman".parse::<Strategy>().expect_err("no such strategy");
        assert_eq!(error.to_string(), "there is no allocation `neyman`; there are uniform, sobel, variance, sensor");
    }

    #[test]
    fn weights_are_proportional_to_the_magnitude_above_the_floor() {
        // The mean is 25, so the floor is 6.25. Above it the ratios are those of the magnitudes, below it all are
        // equal.
        let plane = Plane::from_vec(4, 1, vec![0.0, 5.0, 35.0, 60.0]).expect("four values");
        let weights = sobel(&plane, SOBEL_FLOOR);
        assert_mean_one(&weights);
        let w = weights.data();
        assert!((w[3] / w[2] - 60.0 / 35.0).abs() < 1e-5);
        assert!((w[3] / w[1] - 60.0 / 6.25).abs() < 1e-4);
        assert_eq!(w[0], w[1]);
    }

    #[test]
    fn every_weight_is_a_fifth_of_the_average_or_more() {
        // One steep pixel among a growing number of flat ones.
        for n in [2, 10, 1000, 100_000] {
            let weights = sobel(&Plane::from_fn(n, 1, |x, _| if x == 0 { 127.5 } else { 0.0 }), SOBEL_FLOOR);
            assert_mean_one(&weights);
            let least = weights.data().iter().copied().fold(f32::INFINITY, f32::min);
            assert!(least >= SOBEL_FLOOR / (1.0 + SOBEL_FLOOR) - 1e-5, "{n} pixels: {least}");
        }
    }

    #[test]
    fn an_image_without_edges_is_sampled_uniformly() {
        for level in [0.0, 0.3] {
            assert!(sobel(&Plane::new(7, 5, level), SOBEL_FLOOR).data().iter().all(|&w| (w - 1.0).abs() < 1e-6));
        }
        assert!(sobel(&Plane::new(0, 0, 0.0), SOBEL_FLOOR).data().is_empty());
    }

    #[test]
    fn values_that_are_no_numbers_do_not_spread() {
        let weights =
            sobel(&Plane::from_vec(3, 1, vec![f32::NAN, 10.0, f32::INFINITY]).expect("three values"), SOBEL_FLOOR);
        assert_mean_one(&weights);
        assert!(weights.data()[1] > weights.data()[0]);
    }

    #[test]
    fn a_floor_that_is_no_share_counts_as_the_default() {
        let plane = Plane::from_vec(4, 1, vec![0.0, 5.0, 35.0, 60.0]).expect("four values");
        for floor in [f32::NAN, f32::INFINITY, -0.5, 1.5] {
            assert_eq!(sobel(&plane, floor).data(), sobel(&plane, SOBEL_FLOOR).data(), "floor {floor}");
        }
    }

    #[test]
    fn the_sobel_strategy_sends_samples_to_the_edge() {
        let luminance = Plane::from_fn(32, 8, |x, _| if x < 16 { 0.1 } else { 0.9 });
        let pilot = Pilot { luminance: &luminance, white: 1.0, sobel_floor: SOBEL_FLOOR, measured: None };
        let Shares { weights, caps } = Strategy::Sobel.shares(&pilot);
        assert_mean_one(&weights);
        assert!(*weights.at(15, 4) > 5.0 && *weights.at(16, 4) > 5.0);
        assert!(*weights.at(3, 4) < 0.5);
        assert_eq!(caps, None);
        assert_eq!(Strategy::Uniform.shares(&pilot), Shares::from_weights(uniform(32, 8)));
        // Without measured noise.
        assert_eq!(Strategy::Sensor.shares(&pilot), Shares::from_weights(uniform(32, 8)));
    }

    const UNKNOWN: f32 = f32::INFINITY;

    /// Weights of four pixels with the given predicted noise and strategy.
    fn weights_of(strategy: Strategy, ratios: [f32; 4]) -> Vec<f32> {
        let row = |v: [f32; 4]| Plane::from_vec(4, 1, v.to_vec()).expect("four values");
        let expected = row(ratios).map(|&ratio| PredictedNoise { ratio, saturated: ratio == 0.0 });
        let required_samples = RequiredSamples::expected(&expected, 0.5);
        let measured = Some(MeasuredNoise { expected: &expected, required_samples: Some(&required_samples) });
        let pilot = Pilot { luminance: &row([0.0; 4]), white: 1.0, sobel_floor: SOBEL_FLOOR, measured };
        let shares = strategy.shares(&pilot);
        assert_eq!(shares.caps.is_some(), strategy == Strategy::Sensor);
        let m = mean(shares.weights.data().iter().copied());
        assert!((m - 1.0).abs() < 1e-5, "mean {m}");
        shares.weights.into_vec()
    }

    fn assert_ratios(weights: &[f32], expected: [f32; 4]) {
        for (w, e) in weights.iter().zip(expected) {
            assert!((w / weights[0] - e / expected[0]).abs() < 1e-4, "{weights:?} are not as {expected:?}");
        }
    }

    #[test]
    fn neyman_weights_are_proportional_to_the_deviation() {
        for strategy in [Strategy::Variance, Strategy::Sensor] {
            assert_ratios(&weights_of(strategy, [1.0, 4.0, 9.0, 16.0]), [1.0, 2.0, 3.0, 4.0]);
        }
    }

    #[test]
    fn unknown_pixels_have_the_largest_weight() {
        let pixels = [4.0, UNKNOWN, 9.0, 0.0];
        assert_ratios(&weights_of(Strategy::Variance, pixels), [2.0, 3.0, 3.0, 0.0]);
        for nothing in [UNKNOWN, 0.0] {
            assert_ratios(&weights_of(Strategy::Variance, [nothing; 4]), [1.0; 4]);
        }
    }

    #[test]
    fn the_default_is_the_sensors_where_there_is_one() {
        assert_eq!([true, false].map(Strategy::default_for), [Strategy::Sensor, Strategy::Sobel]);
    }
}
