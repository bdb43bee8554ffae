//! How the samples are shared out: relative weights per pixel, mean one.
//!
//! Each strategy is a pure function of planes. A strategy says how *unequal* pixels are; how many samples there are to
//! share is the business of [`crate::plan`], and how many the clock allows that of [`crate::schedule`].

use std::fmt;
use std::str::FromStr;

use dunkelfeld_film::Plane;

use crate::sobel::{gamma_image, magnitude};

/// No pixel's Sobel magnitude counts for less than this share of the image's mean magnitude. With it, the flattest
/// pixel gets at least `FLOOR / (1 + FLOOR)`, a fifth, of the average.
pub const SOBEL_FLOOR: f32 = 0.25;
/// Nor for less than half a grey level per pixel [DN/pixel], below which eight bits show their own rounding, not an edge.
pub const SOBEL_RESOLUTION: f32 = 0.5;

/// A way to share samples among pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Strategy {
    /// The same number everywhere.
    Uniform,
    /// In proportion to the Sobel magnitude of the pilot image, above a floor (Kludt et al.).
    #[default]
    Sobel,
}

impl Strategy {
    /// All strategies, in the order in which they are documented.
    pub const ALL: [Self; 2] = [Self::Uniform, Self::Sobel];

    /// The name on the command line and in job files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Sobel => "sobel",
        }
    }

    /// Does the strategy look at a pilot, so that new data may change its mind?
    pub const fn needs_pilot(self) -> bool {
        !matches!(self, Self::Uniform)
    }

    /// The relative weights, all positive, with mean one (to within rounding).
    pub fn weights(self, pilot: &Pilot<'_>) -> Plane<f32> {
        match self {
            Self::Uniform => uniform(pilot.luminance.width(), pilot.luminance.height()),
            Self::Sobel => sobel(&magnitude(&gamma_image(pilot.luminance, pilot.white)), pilot.sobel_floor),
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

/// What is known of the image when the samples are shared out: means over all samples taken so far.
#[derive(Clone, Copy, Debug)]
pub struct Pilot<'a> {
    /// Mean luminance per pixel, in any linear unit.
    pub luminance: &'a Plane<f32>,
    /// The level, in that unit, at which the camera saturates.
    pub white: f32,
    /// Weight of a region without edges, relative to the mean Sobel magnitude; [`SOBEL_FLOOR`] by default, and for
    /// what is not from 0 to 1.
    pub sobel_floor: f32,
}

/// Equal weights.
pub fn uniform(width: u32, height: u32) -> Plane<f32> {
    Plane::new(width, height, 1.0)
}

/// Weights in proportion to the Sobel magnitude [DN/pixel], above [`SOBEL_RESOLUTION`] and `floor` times the mean
/// magnitude, with mean one. An image without edges gives equal weights. Magnitudes that are not finite count as the floor;
/// a `floor` that is not from 0 to 1 counts as [`SOBEL_FLOOR`].
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

/// The mean, summed in f64 in the order of the values; zero for none.
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
    fn names_go_there_and_back() {
        for strategy in Strategy::ALL {
            assert_eq!(strategy.name().parse(), Ok(strategy));
        }
        let error = "neyman".parse::<Strategy>().expect_err("no such strategy");
        assert_eq!(error.to_string(), "there is no allocation `neyman`; there are uniform, sobel");
    }

    #[test]
    fn weights_are_proportional_to_the_magnitude_above_the_floor() {
        // Mean 25, so the floor is 6.25: above it the ratios are those of the magnitudes, below it all are equal.
        let plane = Plane::from_vec(4, 1, vec![0.0, 5.0, 35.0, 60.0]).expect("four values");
        let weights = sobel(&plane, SOBEL_FLOOR);
        assert_mean_one(&weights);
        let w = weights.data();
        assert!((w[3] / w[2] - 60.0 / 35.0).abs() < 1e-5);
        assert!((w[3] / w[1] - 60.0 / 6.25).abs() < 1e-4);
        assert_eq!(w[0], w[1]);
    }

    #[test]
    fn nobody_gets_less_than_a_fifth() {
        // One steep pixel among ever more flat ones.
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
        let pilot = Pilot { luminance: &luminance, white: 1.0, sobel_floor: SOBEL_FLOOR };
        let weights = Strategy::Sobel.weights(&pilot);
        assert_mean_one(&weights);
        assert!(*weights.at(15, 4) > 5.0 && *weights.at(16, 4) > 5.0);
        assert!(*weights.at(3, 4) < 0.5);
        assert!(Strategy::Uniform.weights(&pilot).data().iter().all(|&w| w == 1.0));
    }
}
