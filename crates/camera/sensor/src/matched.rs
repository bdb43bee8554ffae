//! Noise-matched exposure: the camera adds its noise less the noise of the render.
//!
//! A rendered mean R scatters around the true mean with a known variance v. A camera adds the variance R of a Poisson
//! number and the variance sigma^2 of the read noise. So frames of re-rendered images have v too much variance. Two
//! parts correct this: the part cp of the mean is exposed without shot noise, and the part cd of the variance of the
//! read noise is not drawn:
//!
//! cp = min(v, 0.95 R), cd = min(v - cp, 0.95 sigma^2), N = cp + Poisson(R - cp) + sqrt(sigma^2 - cd) normal.
//!
//! The mean of N stays R. Its variance over renders *and* exposures is v + (R - cp) + (sigma^2 - cd). That is the
//! variance of the camera, R + sigma^2, if the two parts together reach v (law of total variance). Any estimator of v
//! is valid if it is unbiased and rarely reaches the limits. An estimate with three degrees of freedom leaves 4.6 % too
//! much at v = 0.49 (R + sigma^2). One with 60 leaves less than 0.5 %, down to 20 electrons.

use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::Electrons;

use crate::model::SensorModel;
use crate::optics::Exposure;

/// At most this share of the mean, and of the variance of the read noise, is exposed without noise. So a small part of
/// the camera's own noise always remains.
const MOST: f64 = 0.95;
/// The method is valid up to this ratio of the render noise to the camera's, as standard deviations.
const MAX_NOISE_RATIO: f64 = 0.8;
/// The method must also be valid this many standard deviations below the rendered mean.
const MARGIN: f64 = 2.0;

/// The noise that is drawn when a rendered image is exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExposureNoise {
    /// The whole noise of the camera, in addition to that of the render. This is correct for images without noise of
    /// their own.
    #[default]
    Plain,
    /// The noise of the camera less that of the render, so that frames of independent renders scatter as those of the
    /// camera.
    Matched,
}

impl ExposureNoise {
    /// Its name for files and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Matched => "matched",
        }
    }
}

/// The parts of the noise of a pixel that are not drawn \[e-^2\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Part of the shot noise: cp, which is also the part of the mean \[e-\] that is exposed without noise.
    pub shot: f64,
    /// Part of the read noise: cd.
    pub read: f64,
}

/// The parts of the noise of a pixel that are left out. The pixel's Poisson number has the given mean R \[e-\] (with
/// dark electrons), its read noise the given variance \[e-^2\], and its rendered mean the given variance \[e-^2\]. Both
/// parts are zero if the render variance is unknown: not a number, infinite or negative.
#[inline]
pub fn left_out(render_variance: f64, poisson_mean: f64, read_variance: f64) -> LeftOut {
    if !(render_variance > 0.0 && render_variance.is_finite()) {
        return LeftOut { shot: 0.0, read: 0.0 };
    }
    let shot = render_variance.min(MOST * poisson_mean);
    LeftOut { shot, read: (render_variance - shot).min(MOST * read_variance) }
}

/// Returns whether the method is valid for such a pixel. Its render noise must be known and at most 0.8 of the
/// camera's, as standard deviations. The correction must also be possible if its true mean is two of them darker.
#[inline]
pub fn holds(render_variance: f64, poisson_mean: f64, read_variance: f64) -> bool {
    let darker = (poisson_mean - MARGIN * render_variance.sqrt()).max(0.0);
    render_variance >= 0.0
        && render_variance <= largest_variance(poisson_mean, read_variance)
        && render_variance <= MOST * (darker + read_variance)
}

/// The largest render variance at which the method can be valid \[e-^2\].
#[inline]
pub fn largest_variance(poisson_mean: f64, read_variance: f64) -> f64 {
    MAX_NOISE_RATIO * MAX_NOISE_RATIO * (poisson_mean + read_variance)
}

/// A plane that is true for pixels at which the method is valid, from the mean electrons of an exposure and their
/// variance \[e-^2\]. The fixed pattern of a device is not considered.
pub fn matched_where(
    model: &SensorModel,
    exposure: Exposure,
    electrons: &Plane<f32>,
    render_variance: &Plane<f32>,
) -> Plane<bool> {
    let Electrons(dark) = model.dark_electrons(exposure.time());
    // The shared noise of a row cannot be left out for one of its pixels.
    let read = model.pixel_dark_noise().0.powi(2);
    let mut variances = render_variance.data().iter();
    electrons.map(|&e| variances.next().is_some_and(|&v| holds(f64::from(v), f64::from(e) + dark, read)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shot_noise_is_left_out_first_then_read_noise_and_never_all_of_it() {
        let cases = [
            (0.0, (0.0, 0.0)),
            (30.0, (30.0, 0.0)),
            (95.0, (95.0, 0.0)),
            (100.0, (95.0, 5.0)),
            (1e9, (95.0, 9.5)),
            (f64::INFINITY, (0.0, 0.0)),
            (f64::NAN, (0.0, 0.0)),
            (-1.0, (0.0, 0.0)),
        ];
        for (variance, (shot, read)) in cases {
            assert_eq!(left_out(variance, 100.0, 10.0), LeftOut { shot, read }, "variance {variance}");
        }
        assert_eq!(left_out(3.0, 0.0, 0.0), LeftOut { shot: 0.0, read: 0.0 }, "nothing is there to be left out");
    }

    #[test]
    fn it_holds_where_the_render_is_quieter_than_the_camera() {
        // 1000 electrons and a read noise of 3: the variance of the camera is 1009.
        for k in [0.0, 0.3, 0.7, 0.79] {
            assert!(holds(k * k * 1009.0, 1000.0, 9.0), "{k}");
        }
        for bad in [0.81 * 0.81 * 1009.0, 1e12, f64::INFINITY, f64::NAN, -1.0] {
            assert!(!holds(bad, 1000.0, 9.0), "{bad}");
        }
        // The method is valid for black pixels without noise. Faint pixels have less noise than must be left out.
        assert!(holds(0.0, 0.0, 9.0) && holds(0.0, 0.0, 0.0));
        assert!(holds(0.49 * 29.0, 20.0, 9.0) && !holds(0.6 * 8.0, 7.0, 1.0));
    }
}
