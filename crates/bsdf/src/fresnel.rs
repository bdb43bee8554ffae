//! Fresnel reflection: exact for dielectrics, Schlick's approximation for other surfaces.

use dunkelfeld_radiometry::Rgb;

/// Reflection and refraction of unpolarised light at a smooth boundary between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FresnelDielectric {
    /// Reflected share of the power, in `[0, 1]`; exactly 1 for total reflection.
    pub reflectance: f32,
    /// Cosine of the angle of refraction, zero for total reflection.
    pub cos_t: f32,
}

/// Reflection at a boundary, for an angle of incidence with cosine `cos_i >= 0`. `eta` is the index of refraction
/// behind the boundary over the one in front of it (Fresnel 1823; Born and Wolf 1999, section 1.5.2).
#[inline]
pub fn dielectric(cos_i: f32, eta: f32) -> FresnelDielectric {
    if eta == 1.0 {
        return FresnelDielectric { reflectance: 0.0, cos_t: cos_i };
    }
    // (1 - c)(1 + c) keeps the digits of a small sine.
    let sin2_t = (1.0 - cos_i).max(0.0) * (1.0 + cos_i) / (eta * eta);
    if sin2_t >= 1.0 || cos_i <= 0.0 {
        return FresnelDielectric { reflectance: 1.0, cos_t: (1.0 - sin2_t).max(0.0).sqrt() };
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    FresnelDielectric { reflectance: from_cosines(cos_i, cos_t, eta), cos_t }
}

/// Reflectance at a boundary for two given angles, by their cosines (above zero).
///
/// On a much denser side the angle of refraction depends on the last digits of the angle of incidence. With both
/// cosines given no precision is lost, and the value is the same from either side.
#[inline]
pub fn from_cosines(cos_i: f32, cos_t: f32, eta: f32) -> f32 {
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    0.5 * (perpendicular * perpendicular + parallel * parallel)
}

/// Reflectance of a dielectric at normal incidence.
#[inline]
pub fn normal_reflectance(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// Schlick's (1994) weight `(1 - cos)^5`, with the cosine clamped to `[0, 1]`.
#[inline]
pub fn schlick_weight(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Schlick's (1994) reflectance between `f0` at normal incidence and white at grazing incidence, for a
/// [`schlick_weight`].
#[inline]
pub fn schlick(f0: Rgb, weight: f32) -> Rgb {
    f0.lerp(Rgb::WHITE, weight)
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
    fn no_parallel_reflection_at_brewsters_angle() {
        let eta = 1.49f32;
        let cos = 1.0 / (1.0 + eta * eta).sqrt();
        let f = dielectric(cos, eta);
        // Only the perpendicular polarisation is left: ((eta^2 - 1) / (eta^2 + 1))^2 / 2.
        let r = (eta * eta - 1.0) / (eta * eta + 1.0);
        assert!((f.reflectance - 0.5 * r * r).abs() < 1e-6);
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
