//! The diffuse lobe: Lambert, darkened at grazing angles, with retro-reflection from roughness (Burley 2012, 2015).

use crate::fresnel::schlick_weight;
use dunkelfeld_lanes::Lanes;
use std::f32::consts::FRAC_1_PI;

/// The lobe without its colour, times the cosine of `wi` [1/sr], for the cosines of both directions.
///
/// `cos_d` is the cosine between either direction and their half vector. Diffuse factor and retro-reflection are
/// separated as in Burley (2015, section 5.3). The lobe may exceed an albedo of one for rough white surfaces at grazing
/// angles.
#[inline(always)]
pub fn eval_diffuse<F: Lanes>(cos_o: F, cos_i: F, cos_d: F, roughness: F) -> F {
    let (fo, fi) = (schlick_weight(cos_o), schlick_weight(cos_i));
    let lambert = (fo * 0.5).one_minus() * (fi * 0.5).one_minus();
    let r = roughness * 2.0 * cos_d * cos_d;
    let retro = r * (fo + fi + fo * fi * (r - 1.0));
    cos_i * FRAC_1_PI * (lambert + retro)
}
