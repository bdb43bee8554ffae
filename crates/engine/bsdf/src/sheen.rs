//! The sheen lobe of cloth: light at grazing half-angles (Burley 2012).

use crate::fresnel::schlick_weight;
use dunkelfeld_lanes::Lanes;
use dunkelfeld_radiometry::Rgb;

/// The lobe without its colour, times the cosine of `wi` [1/sr]; `cos_d` as in [`crate::diffuse::eval_diffuse`].
#[inline(always)]
pub fn eval_sheen<F: Lanes>(cos_i: F, cos_d: F) -> F {
    schlick_weight(cos_d) * cos_i
}

/// A colour scaled to luminance one, white if it is black: the hue that tints sheen and specular reflection.
///
/// The weights are those of Mitsuba, which differ from the ones of Rec. 709 in the fourth digit: parity of tinted lobes to
/// 1e-4 needs them.
#[inline]
pub fn hue(color: Rgb) -> Rgb {
    let luminance = 0.212_671 * color.r + 0.715_16 * color.g + 0.072_169 * color.b;
    if luminance > 0.0 { color / luminance } else { Rgb::WHITE }
}
