//! Fresnel reflection: exact for dielectrics, Schlick's approximation for other surfaces.

use dunkelfeld_lanes::{Lanes, Mask, Real};

/// Reflection and refraction of unpolarised light at a smooth boundary between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FresnelDielectric<F = f32> {
    /// Reflected share of the power, in `[0, 1]`; exactly 1 for total reflection.
    pub reflectance: F,
    /// Cosine of the angle of refraction, zero for total reflection.
    pub cos_t: F,
}

/// Reflection at a boundary, for an angle of incidence with cosine `cos_i >= 0`. `eta` is the index of refraction
/// behind the boundary over the one in front of it (Fresnel 1823; Born and Wolf 1999, section 1.5.2).
#[inline(always)]
pub fn dielectric<F: Lanes>(cos_i: F, eta: F) -> FresnelDielectric<F> {
    let (zero, one) = (eta.constant(0.0), eta.constant(1.0));
    // (1 - c)(1 + c) keeps the digits of a small sine.
    let sin2_t = cos_i.one_minus().max(zero) * (cos_i + 1.0) * (eta * eta).recip();
    let cos_t = sin2_t.one_minus().max(zero).sqrt();
    let is_total = one.le(sin2_t) | cos_i.le(zero);
    let is_matched = eta.eq(one);
    let reflectance = is_total.select(one, from_cosines(cos_i, cos_t, eta)).only(!is_matched);
    FresnelDielectric { reflectance, cos_t: is_matched.select(cos_i, cos_t) }
}

/// Reflectance at a boundary for two given angles, by their cosines (above zero).
///
/// The result is the same if both cosines are multiplied by one factor.
///
/// On a much denser side the angle of refraction depends on the last digits of the angle of incidence. With both
/// cosines given no precision is lost, and the value is the same from either side.
#[inline(always)]
pub fn from_cosines<F: Real>(cos_i: F, cos_t: F, eta: F) -> F {
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    (perpendicular * perpendicular + parallel * parallel) * eta.constant(0.5)
}

/// Reflectance of a dielectric at normal incidence.
#[inline]
pub fn normal_reflectance(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// Schlick's (1994) weight `(1 - cos)^5`, with the cosine clamped to `[0, 1]`.
#[inline(always)]
pub fn schlick_weight<F: Lanes>(cos: F) -> F {
    let m = cos.one_minus().clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_reflectances() {
        for (cos, eta, expected) in [
            (1.0, 1.5, 0.04),
            (1.0, 1.0 / 1.5, 0.04),
            (1.0, 1.49, 0.038_725_2),
            (0.5, 1.5, 0.089_186_7), // Snell by hand: sin_t = sqrt(0.75) / 1.5
            (0.0, 1.5, 1.0),
            (0.0, 1.0, 0.0),
            (0.5, 1.0, 0.0),
            (0.5, 1.0 / 1.5, 1.0), // beyond the critical angle
            (1.0, 1000.0, 0.996_008),
        ] {
            let f = dielectric(cos, eta).reflectance;
            assert!((f - expected).abs() < 2e-6, "cos {cos}, eta {eta}: {f}, expected {expected}");
        }
    }

    #[test]
    fn reflectance_is_symmetric_and_at_most_one() {
        for i in 0..=1000 {
            let cos = i as f32 / 1000.0;
            for eta in [1e-3, 0.5, 0.999_999, 1.0, 1.000_001, 1.49, 2.4, 1e3] {
                let f = dielectric(cos, eta);
                assert!(
                    (0.0..=1.0).contains(&f.reflectance) && (0.0..=1.0).contains(&f.cos_t),
                    "cos {cos} eta {eta}: {f:?}"
                );
                if eta > 1.01 && cos > 0.05 {
                    let back = dielectric(f.cos_t, 1.0 / eta);
                    // In the reverse direction the cosine is the root of a difference. Its rounding error grows by
                    // eta^2 / cos.
                    assert!((back.reflectance - f.reflectance).abs() < 1e-6 * eta * eta / cos, "cos {cos}, eta {eta}");
                }
            }
        }
    }
}
