//! Visibility of an instance for a camera: contrast to its surroundings over the noise of the camera.

use crate::surface_path::Surfaces;
use crate::surroundings::{Surroundings, Value, difference_of_means, difference_on_surface};
use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{Electrons, Seconds};
use dunkelfeld_sensor::SensorModel;

/// A contrast is distinguished from zero at this number of errors.
const SIGNIFICANT: f64 = 3.0;

/// Pixels of an instance, as a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bounds {
    /// Left, top.
    pub(crate) from: [u32; 2],
    /// Right, bottom, exclusive.
    pub(crate) to: [u32; 2],
}

/// Contrast of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Visibility {
    /// Mean of the instance minus that of its surroundings \[DN\].
    pub(crate) contrast: f64,
    /// Standard error of the contrast by the noise of the render \[DN\]; `None` if it is unknown.
    pub(crate) error: Option<f64>,
    /// Magnitude of the contrast over the standard deviation of the temporal noise of the camera in the surroundings
    /// (EMVA 1288, release 4): of one pixel. The square of the error is subtracted from that of the contrast, to which the
    /// noise of the render adds it on average; below zero the result is 0. `None` if the error is unknown.
    pub(crate) cnr: Option<f64>,
    /// The error over the same noise.
    pub(crate) cnr_error: Option<f64>,
}

impl Visibility {
    /// False if the contrast is below [`SIGNIFICANT`] errors, and these are above the noise of a pixel: it is then unknown
    /// whether a pixel shows the instance. A contrast with smaller errors is known to be near zero.
    pub(crate) fn is_known(&self) -> bool {
        let is_lost = |error: f64| self.contrast.abs() < SIGNIFICANT * error;
        !self.error.is_some_and(is_lost) || !self.cnr_error.is_some_and(|error| SIGNIFICANT * error > 1.0)
    }
}

/// The expected electrons of an image, and what turns them into grey values with noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exposed<'a> {
    pub(crate) electrons: &'a Plane<f32>,
    /// Variance of the render over that of the camera, per pixel; infinite where it is unknown. `None` without a
    /// certificate.
    pub(crate) ratios: Option<&'a Plane<f32>>,
    pub(crate) model: &'a SensorModel,
    pub(crate) time: Seconds,
}

/// The contrast of an instance to the pixels around it. Pixels of `is_excluded` instances are not part of the surroundings:
/// defects that are added to the objects. Electrons above saturation do not count. Behind a colour filter array, pixels of one colour are compared
/// with each other, and the result is that of the colour with the largest ratio. `None` if nothing surrounds the instance,
/// for example if it fills the image, and if both sides are saturated.
///
/// `surfaces` are given for a defect. Its surroundings are then pixels of the smooth surface that carries it, and their
/// shading is continued below it by a polynomial.
pub(crate) fn visibility(
    exposed: &Exposed<'_>,
    instances: &Plane<u16>,
    id: u16,
    bounds: Bounds,
    is_excluded: impl Fn(u16) -> bool,
    surfaces: Option<Surfaces<'_>>,
) -> Option<Visibility> {
    let spec = exposed.model.spec();
    let saturation = exposed.model.saturation().0;
    // A filter array repeats after two rows and two columns.
    let has_filter = spec.quantum_efficiency.filter().is_some();
    let width = i64::from(instances.width());
    let value = |&at: &[i64; 2]| {
        let i = (at[1] * width + at[0]) as usize;
        let electrons = f64::from(exposed.electrons.data()[i]);
        let noise = exposed.model.temporal_variance(Electrons(electrons), exposed.time);
        let ratio = exposed.ratios.and_then(|ratios| ratios.data().get(i)).copied().filter(|ratio| ratio.is_finite());
        Value { at, value: electrons.min(saturation), variance: ratio.map(|ratio| f64::from(ratio) * noise) }
    };
    let found = Surroundings::new(instances, id, bounds, is_excluded, surfaces);
    let is_of = |phase: i64, [x, y]: [i64; 2]| !has_filter || y % 2 * 2 + x % 2 == phase;
    let of_phase = |phase: i64| {
        let of =
            |pixels: &[[i64; 2]]| -> Vec<Value> { pixels.iter().filter(|at| is_of(phase, **at)).map(value).collect() };
        let (inside, ring) = (of(&found.inside), of(&found.ring));
        let difference = match surfaces {
            Some(_) if exposed.ratios.is_some() => difference_on_surface(&inside, &ring)?,
            Some(_) => return None,
            None => difference_of_means(&inside, &ring)?,
        };
        if difference.below >= saturation && difference.below + difference.value >= saturation {
            return None;
        }
        // A prediction outside of the range of the ring may be far from the signal.
        let [least, most] = difference.range;
        let below = Electrons(difference.below.max(least).min(most).clamp(0.0, saturation));
        let noise = exposed.model.temporal_variance(below, exposed.time);
        let signal = difference.variance.map(|variance| (difference.value.powi(2) - variance).max(0.0));
        Some(Visibility {
            contrast: difference.value * spec.system_gain,
            error: difference.variance.map(|variance| variance.sqrt() * spec.system_gain),
            cnr: signal.map(|signal| (signal / noise).sqrt()),
            cnr_error: difference.variance.map(|variance| (variance / noise).sqrt()),
        })
    };
    let ratio = |v: &Visibility| v.cnr.unwrap_or(-1.0);
    (0..if has_filter { 4 } else { 1 }).filter_map(of_phase).max_by(|a, b| ratio(a).total_cmp(&ratio(b)))
}

#[cfg(test)]
#[path = "visibility_tests.rs"]
mod tests;
