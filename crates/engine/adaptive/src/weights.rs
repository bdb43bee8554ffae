//! The allocation of samples to pixels: relative weights per pixel with mean one.
//!
//! Each strategy is a pure function of planes. A strategy sets the *ratios* between pixels. [`crate::plan`] sets the
//! number of samples to distribute, and [`crate::budget`] the number that the clock allows.

use std::fmt;
use std::str::FromStr;

use dunkelfeld_film::Plane;
use serde::{Deserialize, Serialize};

use crate::sobel::{gamma_image, magnitude};

/// Lower bound of the Sobel magnitude of a pixel, as a share of the mean magnitude of the image. With it, the flattest
/// pixel gets at least `FLOOR / (1 + FLOOR)`, a fifth, of the average.
pub const SOBEL_FLOOR: f32 = 0.25;
/// Lower bound of the Sobel magnitude, half a grey level per pixel [DN/pixel]. Below it, differences come from 8-bit
/// rounding and not from an edge.
pub const SOBEL_RESOLUTION: f32 = 0.5;
/// Exponent of the weights of [`sensor`]. With known variances 1/2 has the least mean noise (Neyman 1934), and 1 hides all
/// pixels at the same time. Those of a pilot err by a factor, and pixels with more noise take more time for each sample. Of the
/// exponents tried, this one hides 90 % and 99 % of the pixels soonest (`docs/research/sample-plans.md`).
const EXPONENT: f64 = 0.4;
/// Reach of the neighbourhood in [`sensor`], along either axis \[pixels\]. Reaches from 2 to 5 change less than 2 %.
const REACH: u32 = 3;
/// Weight of the mean of the image beside the neighbours of a pixel \[pixels\]. Weights from 1 to 16 change less than 6 %.
const PRIOR: f64 = 4.0;

/// A strategy that distributes samples over pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// The same number everywhere.
    Uniform,
    /// In proportion to the Sobel magnitude of the pilot image, above a floor (Kludt et al.).
    Sobel,
    /// More where the measured variance is large beside that of the sensor ([`sensor`]).
    Sensor,
}

impl Strategy {
    /// All strategies, in the order in which they are documented.
    pub const ALL: [Self; 3] = [Self::Uniform, Self::Sobel, Self::Sensor];

    /// The default strategy: [`Self::Sensor`] with a sensor, otherwise [`Self::Uniform`].
    pub const fn default_for(has_sensor: bool) -> Self {
        if has_sensor { Self::Sensor } else { Self::Uniform }
    }

    /// The name on the command line and in job files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Sobel => "sobel",
            Self::Sensor => "sensor",
        }
    }

    /// The weights of all pixels. Without measured noise, [`Self::Sensor`] is uniform.
    pub fn weights(self, pilot: &Pilot<'_>) -> Plane<f32> {
        match (self, pilot.noise) {
            (Self::Sobel, _) => sobel(&magnitude(&gamma_image(pilot.luminance, pilot.white)), pilot.sobel_floor),
            (Self::Sensor, Some(noise)) => sensor(noise),
            (Self::Uniform, _) | (Self::Sensor, None) => uniform(pilot.luminance.width(), pilot.luminance.height()),
        }
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
    /// The variance of one sample of each pixel over that of the sensor, for [`Strategy::Sensor`]: see [`sensor`].
    pub noise: Option<&'a Plane<f32>>,
}

/// Weights `r^0.4` with mean one. r is the noise of a pixel as its neighbours have it: the mean of `noise` over the square
/// of 7 x 7 pixels around it, without itself, and four pixels of the mean of the image. So the samples of a pixel decide
/// nothing about their own number, and the mean of the pixel stays unbiased (Kirk and Arvo 1991).
///
/// `noise` is the variance of one sample over that of the sensor. Values that are not finite do not count; they stand for
/// saturated pixels. A pixel without any other in its neighbourhood has the weight zero. If all have it, all are equal.
pub fn sensor(noise: &Plane<f32>) -> Plane<f32> {
    let (width, height) = (noise.width(), noise.height());
    let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
    let near = |x: u32, size: u32| x.saturating_sub(REACH)..(x + REACH + 1).min(size);
    // The sum and the number of values: of a pixel, of its row in the square, of the image.
    let value = |&v: &f32| if v.is_finite() { [f64::from(v), 1.0] } else { [0.0; 2] };
    let rows = Plane::from_fn(width, height, |x, y| {
        near(x, width).map(|column| value(noise.at(column, y))).fold([0.0; 2], add)
    });
    let [sum, pixels] = noise.data().iter().map(value).fold([0.0; 2], add);
    let mean = sum / pixels.max(1.0);
    // No difference of sums: it would depend on the pixel by its rounding.
    let weights = Plane::from_fn(width, height, |x, y| {
        let above_and_below = near(y, height).filter(|&row| row != y).map(|row| *rows.at(x, row));
        let beside = near(x, width).filter(|&column| column != x).map(|column| value(noise.at(column, y)));
        let [sum, pixels] = above_and_below.chain(beside).fold([0.0; 2], add);
        if pixels == 0.0 { 0.0 } else { ((sum + PRIOR * mean) / (pixels + PRIOR)).powf(EXPONENT) as f32 }
    });
    if weights.data().iter().any(|&w| w > 0.0) { normalised(weights) } else { uniform(width, height) }
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
    fn the_sobel_strategy_sends_samples_to_the_edge() {
        let luminance = Plane::from_fn(32, 8, |x, _| if x < 16 { 0.1 } else { 0.9 });
        let pilot = Pilot { luminance: &luminance, white: 1.0, sobel_floor: SOBEL_FLOOR, noise: None };
        let weights = Strategy::Sobel.weights(&pilot);
        assert_mean_one(&weights);
        assert!(*weights.at(15, 4) > 5.0 && *weights.at(16, 4) > 5.0);
        assert!(*weights.at(3, 4) < 0.5);
        // The others without measured noise.
        assert!([Strategy::Uniform, Strategy::Sensor].iter().all(|s| s.weights(&pilot) == uniform(32, 8)));
    }

    #[test]
    fn a_pixel_has_the_noise_of_its_neighbours_and_of_the_image() {
        let noise = Plane::from_fn(40, 40, |x, y| (1 + (7 * x + 3 * y) % 11) as f32);
        let weights = sensor(&noise);
        assert_mean_one(&weights);
        let mean = f64::from(mean(noise.data().iter().copied()));
        let of = |x: u32, y: u32| {
            let square = (y - 3..=y + 3).flat_map(|y| (x - 3..=x + 3).map(move |x| (x, y)));
            let sum: f64 = square.filter(|&at| at != (x, y)).map(|(x, y)| f64::from(*noise.at(x, y))).sum();
            ((sum + 4.0 * mean) / 52.0).powf(0.4)
        };
        for (x, y) in [(3, 3), (20, 11), (36, 30)] {
            let ratio = f64::from(weights.at(x, y) / weights.at(17, 17));
            assert!((ratio / (of(x, y) / of(17, 17)) - 1.0).abs() < 1e-5, "{x}, {y}: {ratio}");
        }
    }

    /// A pixel may change the mean of the image, and with it the weights of all. So the ratio to a pixel is compared that has
    /// the same neighbours.
    #[test]
    fn the_noise_of_a_pixel_does_not_change_its_own_weight() {
        for own in [0.0, 1.0, 1e12, f32::MAX, f32::NAN] {
            let weights = sensor(&Plane::from_fn(40, 40, |x, y| if (x, y) == (20, 20) { own } else { 5.0 }));
            assert!((weights.at(20, 20) / weights.at(5, 5) - 1.0).abs() < 1e-6, "{own}");
            assert!(own < 6.0 || own.is_nan() || weights.at(21, 20) > weights.at(20, 20), "{own}");
        }
    }

    #[test]
    fn saturated_pixels_do_not_count() {
        // Two halves, and a saturated square in one.
        let is_full = |x: u32, y: u32| (10..20).contains(&x) && (10..20).contains(&y);
        let noise = Plane::from_fn(60, 30, |x, y| match (is_full(x, y), x < 30) {
            (true, _) => f32::INFINITY,
            (_, true) => 4.0,
            _ => 400.0,
        });
        let weights = sensor(&noise);
        assert_eq!((*weights.at(14, 14), *weights.at(15, 15)), (0.0, 0.0));
        // Beside it fewer pixels count, so that the mean of the image has more weight.
        assert!(*weights.at(9, 15) >= *weights.at(4, 4) && *weights.at(9, 15) < 1.5 * *weights.at(4, 4));
        assert!(*weights.at(50, 15) > 1.5 * *weights.at(4, 4));
        for nothing in [0.0, f32::NAN, f32::INFINITY] {
            assert_eq!(sensor(&Plane::new(6, 5, nothing)), uniform(6, 5), "{nothing}");
        }
        assert_eq!(sensor(&Plane::new(1, 1, 7.0)), uniform(1, 1));
        assert!(sensor(&Plane::new(0, 0, 7.0)).data().is_empty());
    }
}
