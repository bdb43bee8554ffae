//! The diffuse lobe: Lambert, darkened at grazing angles, with retro-reflection from roughness (Burley 2012, 2015).

use crate::fresnel::schlick_weight;
use dunkelfeld_geometry::LocalDir;
use std::f32::consts::FRAC_1_PI;

/// The lobe without its colour, times `|cos wi|` [1/sr].
///
/// `cos_d` is the cosine between either direction and their half vector. Diffuse factor and retro-reflection are
/// separated as in Burley (2015, section 5.3). The lobe may exceed an albedo of one for rough white surfaces at grazing
/// angles.
#[inline]
pub fn eval_diffuse(wo: LocalDir, wi: LocalDir, cos_d: f32, roughness: f32) -> f32 {
    let (fo, fi) = (schlick_weight(wo.abs_cos_theta()), schlick_weight(wi.abs_cos_theta()));
    let lambert = (1.0 - 0.5 * fo) * (1.0 - 0.5 * fi);
    let r = 2.0 * roughness * cos_d * cos_d;
    let retro = r * (fo + fi + fo * fi * (r - 1.0));
    FRAC_1_PI * wi.abs_cos_theta() * (lambert + retro)
}
