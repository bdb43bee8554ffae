//! Noise-matched exposure: of the noise that the camera would add, that which the render brought along is left out.
//!
//! A rendered mean R scatters around the truth with a variance v that is known. A camera adds a Poisson number's R and the
//! read noise's sigma^2 on top, so that frames of re-rendered images have v too much. Here the part cp of the mean that is
//! exposed as it is, without shot noise, and the part cd of the read noise's variance that is not drawn make up for it:
//!
//! cp = min(v, 0.95 R), cd = min(v - cp, 0.95 sigma^2), N = cp + Poisson(R - cp) + sqrt(sigma^2 - cd) normal.
//!
//! The mean of N stays R. Its variance over renders *and* exposures is v + (R - cp) + (sigma^2 - cd): that of the camera,
//! R + sigma^2, wherever the two parts could be as large as v (law of total variance). It does not matter how v was estimated
//! as long as the estimate is right on average and rarely meets the limits: an estimate with three degrees of freedom
//! leaves 4.6 % too much at v = 0.49 (R + sigma^2), one with 60 less than 0.5 %, down to 20 electrons.

use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::Electrons;

use crate::model::SensorModel;
use crate::optics::Exposure;

/// At most this share of the mean, and of the read noise's variance, is exposed without noise: a trace of the camera's
/// own noise is always there.
const MOST: f64 = 0.95;
/// The method is trusted up to a render noise of this share of the camera's, as standard deviations.
const HOLDS_UP_TO: f64 = 0.8;
/// So many standard deviations below the rendered mean, it must still hold.
const MARGIN: f64 = 2.0;

/// What noise is drawn when a rendered image is exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExposureNoise {
    /// All of the camera's, on top of what the render has: right for images without noise of their own.
    #[default]
    Plain,
    /// What is missing to the camera's, so that frames of independent renders scatter as those of the camera.
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

/// What is not drawn of the noise of a pixel \[e-^2\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Of the shot noise: cp, which is also the part of the mean \[e-\] that is exposed as it is.
    pub shot: f64,
    /// Of the read noise: cd.
    pub read: f64,
}

/// What a pixel leaves out whose Poisson number has the given mean R \[e-\] (dark electrons included) and whose read noise has
/// the given variance \[e-^2\], if its mean was rendered with the given variance \[e-^2\]. Nothing if that is not known: not a
/// number, infinite or negative.
#[inline]
pub fn left_out(render_variance: f64, poisson_mean: f64, read_variance: f64) -> LeftOut {
    if !(render_variance > 0.0 && render_variance.is_finite()) {
        return LeftOut { shot: 0.0, read: 0.0 };
    }
    let shot = render_variance.min(MOST * poisson_mean);
    LeftOut { shot, read: (render_variance - shot).min(MOST * read_variance) }
}

/// Does the method hold for such a pixel: is its render noise known, at most 0.8 of the camera's as standard deviations,
/// and could the pixel still make up for it if its true mean were two of them darker?
#[inline]
pub fn holds(render_variance: f64, poisson_mean: f64, read_variance: f64) -> bool {
    let darker = (poisson_mean - MARGIN * render_variance.sqrt()).max(0.0);
    render_variance >= 0.0
        && render_variance <= HOLDS_UP_TO * HOLDS_UP_TO * (poisson_mean + read_variance)
        && render_variance <= MOST * (darker + read_variance)
}

/// Where the method holds, pixel by pixel, for the mean electrons of an exposure and their variance \[e-^2\]; the fixed
/// pattern of a device is left out of account.
pub fn matched_where(
    model: &SensorModel,
    exposure: Exposure,
    electrons: &Plane<f32>,
    render_variance: &Plane<f32>,
) -> Plane<bool> {
    let Electrons(dark) = model.dark_electrons(exposure.time());
    // What the pixels of a row read together cannot be left out for one of them.
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
        // 1000 electrons and a read noise of 3: the camera's variance is 1009.
        for k in [0.0, 0.3, 0.7, 0.79] {
            assert!(holds(k * k * 1009.0, 1000.0, 9.0), "{k}");
        }
        for bad in [0.81 * 0.81 * 1009.0, 1e12, f64::INFINITY, f64::NAN, -1.0] {
            assert!(!holds(bad, 1000.0, 9.0), "{bad}");
        }
        // Black pixels without noise hold; faint ones would have to give more than they have.
        assert!(holds(0.0, 0.0, 9.0) && holds(0.0, 0.0, 0.0));
        assert!(holds(0.49 * 29.0, 20.0, 9.0) && !holds(0.6 * 8.0, 7.0, 1.0));
    }
}
