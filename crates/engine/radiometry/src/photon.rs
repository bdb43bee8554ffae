//! Conversion from watts to photons, and from watts to lumens.
//!
//! The constants are those that define the SI since 2019, so they have no error.

use crate::rgb::Rgb;
use crate::units::{Irradiance, Metres, Nanometres, Seconds};

/// Planck constant h \[J s\], exact (BIPM, SI Brochure 2019).
pub const PLANCK: f64 = 6.626_070_15e-34;

/// Speed of light in vacuum c \[m/s\], exact (BIPM, SI Brochure 2019).
pub const SPEED_OF_LIGHT: f64 = 299_792_458.0;

/// Luminous efficacy of green light at 540 THz, K_cd \[lm/W\], exact (BIPM, SI Brochure 2019).
pub const PHOTOPIC: f64 = 683.0;

/// Energy of one photon, h c / lambda \[J\].
pub fn photon_energy(wavelength: Nanometres) -> f64 {
    PLANCK * SPEED_OF_LIGHT / wavelength.metres().0
}

/// Mean number of photons that reach a square pixel of the given pitch during an exposure,
/// mu_p = A E t lambda / (h c) (EMVA 1288 release 4.0, Linear).
pub fn photons(pixel_pitch: Metres, irradiance: Irradiance, time: Seconds, wavelength: Nanometres) -> f64 {
    pixel_pitch.0 * pixel_pitch.0 * irradiance.0 * time.0 / photon_energy(wavelength)
}

/// Lumens (or candela, nits, lux, according to the per-area and per-angle units of the watts) of a linear Rec. 709
/// triple of watts.
///
/// The convention: a triple's luminous power is 683 lm/W times its Rec. 709 luminance. A grey triple of 1 W therefore
/// counts as 1 W of light at the eye's peak. glTF exporters and renderers use this convention when they convert candela
/// to watts. It is a convention for strengths of lights, not a spectral computation.
pub fn lumens(watts: Rgb) -> f64 {
    PHOTOPIC * f64::from(watts.luminance())
}

/// Luminous efficacy \[lm/W\] of light of one wavelength: 683 V, with the luminous efficiency V of the eye (CIE 1924), which
/// is the y-bar of the standard observer (CIE 1931). The two lobes are the fit of Wyman, Sloan and Shirley (2013), within
/// 0.01 of V. From 360 nm to 830 nm; 0 beyond, as in the table of the standard.
pub fn luminous_efficacy(wavelength: Nanometres) -> f64 {
    let Nanometres(nm) = wavelength;
    if !(360.0..=830.0).contains(&nm) {
        return 0.0;
    }
    let lobe = |center: f64, below: f64, above: f64| {
        let distance = (nm - center) / if nm < center { below } else { above };
        (-0.5 * distance * distance).exp()
    };
    PHOTOPIC * (0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// EMVA 1288 gives the conversion with its constants multiplied out: mu_p = 50.34 A t lambda E, with A in um^2, t
    /// in ms, lambda in um and E in uW/cm^2.
    #[test]
    fn photon_numbers_meet_the_anchor_of_the_standard() {
        for (pitch_um, time_ms, lambda_um, e_uw_cm2) in
            [(1.0, 1.0, 1.0, 1.0), (5.86, 2.5, 0.545, 0.3), (2.25, 40.0, 0.536, 12.0)]
        {
            let got = photons(
                Metres::from_micrometres(pitch_um),
                Irradiance(e_uw_cm2 * 1e-2),
                Seconds(time_ms * 1e-3),
                Nanometres(lambda_um * 1e3),
            );
            let standard = 50.34 * pitch_um * pitch_um * time_ms * lambda_um * e_uw_cm2;
            assert!((got / standard - 1.0).abs() < 5e-5, "{got} photons, the standard says {standard}");
        }
    }

    /// The table of the standard observer (CIE 1931).
    #[test]
    fn the_efficacy_of_one_wavelength_is_that_of_the_standard_observer() {
        for (nm, v) in [
            (400.0, 0.000_396),
            (470.0, 0.090_98),
            (525.0, 0.7932),
            (555.0, 1.0),
            (590.0, 0.757),
            (625.0, 0.321),
            (630.0, 0.265),
            (700.0, 0.004_102),
        ] {
            let found = luminous_efficacy(Nanometres(nm)) / PHOTOPIC;
            assert!((found - v).abs() < 0.01, "{nm} nm: {found} instead of {v}");
        }
        assert_eq!([200.0, 850.0, 1550.0, f64::NAN].map(|nm| luminous_efficacy(Nanometres(nm))), [0.0; 4]);
    }
}
