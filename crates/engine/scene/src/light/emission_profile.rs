//! Angular distributions of the radiance of an emitting surface.

use dunkelfeld_lanes::{Lanes, cos_sin_of_angle, pow};
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;

/// The radiance of an emitting surface by direction, relative to [`Material::emission`](crate::Material::emission).
///
/// The argument of all formulas is mu, the cosine between the direction and the normal on the emitting side.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub enum EmissionProfile {
    /// The same radiance in all directions (Lambert 1760).
    #[default]
    Lambertian,
    /// mu^exponent. The radiant intensity of a small emitter then follows mu^(exponent + 1), the usual model of an LED
    /// with a lens (Moreno and Sun 2008).
    CosinePower {
        /// 0 or more; 0 is Lambertian.
        exponent: f32,
    },
    /// 1 - tan(theta) / tan(half_angle), and 0 beyond the half-angle: a grid of tubes in front of the surface, as the
    /// spread of an area light in Cycles.
    Louver {
        /// Half of the full angle \[rad\], in (0, pi/2).
        half_angle: f32,
    },
    /// ramp^2 / mu, where the ramp rises linearly from `cos_outer` to `cos_inner`: the radiant intensity of a small disc
    /// is that of a spot light (KHR_lights_punctual).
    Spot {
        /// Cosine of the half-angle of the full cone.
        cos_inner: f32,
        /// Cosine of the half-angle of the edge, in [0, `cos_inner`].
        cos_outer: f32,
    },
}

impl EmissionProfile {
    /// The profile of an LED whose radiant intensity falls to one half at `half_angle` \[rad\] from its axis, in
    /// (0, pi/2). An angle of 60 degrees or more is Lambertian.
    pub fn from_half_intensity_angle(half_angle: f64) -> Self {
        let exponent = 0.5f64.ln() / half_angle.cos().ln() - 1.0;
        if exponent > 0.0 { Self::CosinePower { exponent: exponent as f32 } } else { Self::Lambertian }
    }

    /// The relative radiance in a direction with the cosine `mu` in (0, 1]; 0 for other cosines.
    #[inline(always)]
    pub fn eval<F: Lanes>(&self, mu: F) -> F {
        let relative = match *self {
            Self::Lambertian => mu.constant(1.0),
            Self::CosinePower { exponent } => {
                pow(mu.max(mu.constant(f32::MIN_POSITIVE)).min(mu.constant(1.0)), mu.constant(exponent))
            }
            Self::Louver { half_angle } => {
                let tan = (mu * mu).one_minus().max(mu.constant(0.0)).sqrt() / mu;
                let (cos, sin) = cos_sin_of_angle(half_angle);
                (tan * (cos / sin)).one_minus().max(mu.constant(0.0))
            }
            Self::Spot { cos_inner, cos_outer } => spot(mu, cos_inner, cos_outer) / mu,
        };
        relative.only(mu.is_positive())
    }

    /// [`Self::eval`] in double precision: at one degree from the normal, the cosine in single precision gives the angle to
    /// 2e-4 of it.
    pub(crate) fn eval_f64(&self, mu: f64) -> f64 {
        if mu.is_nan() || mu <= 0.0 {
            return 0.0;
        }
        match *self {
            Self::Lambertian => 1.0,
            Self::CosinePower { exponent } => mu.min(1.0).powf(f64::from(exponent)),
            Self::Louver { half_angle } => {
                let tan = (1.0 - mu * mu).max(0.0).sqrt() / mu;
                (1.0 - tan / f64::from(half_angle).tan()).max(0.0)
            }
            Self::Spot { cos_inner, cos_outer } => {
                let (inner, outer) = (f64::from(cos_inner), f64::from(cos_outer));
                let ramp = if inner > outer {
                    ((mu - outer) / (inner - outer)).clamp(0.0, 1.0)
                } else {
                    f64::from(u8::from(mu >= outer))
                };
                ramp * ramp / mu
            }
        }
    }

    /// The tangent of the angle from the normal beyond which the radiance is zero, or below 1e-16 of that along the normal.
    pub(crate) fn cutoff_tangent(&self) -> f64 {
        match *self {
            Self::Lambertian => f64::INFINITY,
            // 1 + tan^2 = 1 / mu^2.
            Self::CosinePower { exponent } => (10f64.powf(32.0 / f64::from(exponent)) - 1.0).sqrt(),
            Self::Louver { half_angle } => f64::from(half_angle).tan(),
            Self::Spot { cos_outer, .. } => tangent(f64::from(cos_outer)),
        }
    }

    /// Angles from the normal at which the radiance or its slope jumps: their tangents, and the share of the distance from the
    /// normal to which a quadrature resolves them.
    pub(crate) fn edges(&self) -> [(f64, f64); 2] {
        let slope = 1.0 / 64.0;
        match *self {
            Self::Lambertian | Self::CosinePower { .. } => [(f64::INFINITY, slope); 2],
            Self::Louver { .. } => [(self.cutoff_tangent(), slope), (f64::INFINITY, slope)],
            Self::Spot { cos_inner, cos_outer } if cos_inner > cos_outer => {
                [(tangent(f64::from(cos_inner)), slope), (self.cutoff_tangent(), slope)]
            }
            Self::Spot { .. } => [(self.cutoff_tangent(), 1.0 / 1024.0), (f64::INFINITY, slope)],
        }
    }

    /// The tangent of an angle over which the radiance changes.
    pub(crate) fn width_tangent(&self) -> f64 {
        match *self {
            Self::Lambertian => f64::INFINITY,
            // The logarithm of the radiance falls by about one half.
            Self::CosinePower { exponent } => 1.0 / f64::from(exponent).sqrt(),
            Self::Louver { .. } | Self::Spot { .. } => self.cutoff_tangent(),
        }
    }

    /// [`Self::eval`] for weights: a power is replaced by (1 + x / 8)^-8, where x is -ln(mu^exponent) to second order. It
    /// is above the power in the tail and needs no logarithm.
    #[inline(always)]
    pub(crate) fn estimate<F: Lanes>(&self, mu: F) -> F {
        let Self::CosinePower { exponent } = *self else { return self.eval(mu) };
        let below = mu.one_minus().max(mu.constant(0.0));
        let x = below * exponent * (below * 0.5 + 1.0);
        let root = (x * 0.125 + 1.0).recip();
        let square = root * root;
        let fourth = square * square;
        fourth * fourth
    }

    /// The radiant exitance over that of a Lambertian surface of the same `emission`: the integral of `eval(mu) mu` over
    /// the hemisphere, over pi. In (0, 1] except for a spot, whose value is relative to its axis.
    pub fn exitance(&self) -> f64 {
        match *self {
            Self::Lambertian => 1.0,
            Self::CosinePower { exponent } => 2.0 / (f64::from(exponent) + 2.0),
            Self::Louver { half_angle } => {
                let a = f64::from(half_angle);
                1.0 - a / a.tan()
            }
            Self::Spot { cos_inner, cos_outer } => {
                let (ci, co) = (f64::from(cos_inner), f64::from(cos_outer));
                2.0 * ((1.0 - ci) + (ci - co).max(0.0) / 3.0)
            }
        }
    }

    /// The angle from the normal beyond which the surface does not emit, at most pi/2 \[rad\].
    pub(crate) fn cutoff_angle(&self) -> f32 {
        match *self {
            Self::Lambertian | Self::CosinePower { .. } => FRAC_PI_2,
            Self::Louver { half_angle } => half_angle,
            Self::Spot { cos_outer, .. } => cos_outer.clamp(0.0, 1.0).acos(),
        }
    }

    /// True if the parameters are in their ranges.
    pub(crate) fn is_valid(&self) -> bool {
        match *self {
            Self::Lambertian => true,
            Self::CosinePower { exponent } => (0.0..=1e6).contains(&exponent),
            Self::Louver { half_angle } => half_angle > 1e-3 && f64::from(half_angle) < 0.5 * PI,
            Self::Spot { cos_inner, cos_outer } => {
                0.0 <= cos_outer && cos_outer <= cos_inner && cos_inner <= 1.0 && cos_outer < 1.0
            }
        }
    }
}

/// The relative intensity of a spot light in a direction with the cosine `mu` to its axis: the square of a ramp from the
/// outer to the inner cosine (KHR_lights_punctual).
#[inline(always)]
pub(crate) fn spot<F: Lanes>(mu: F, cos_inner: f32, cos_outer: f32) -> F {
    let ramp = if cos_inner > cos_outer {
        ((mu - cos_outer) / (cos_inner - cos_outer)).clamp(0.0, 1.0)
    } else {
        mu.constant(1.0).only(mu.ge(mu.constant(cos_outer)))
    };
    ramp * ramp
}

/// The tangent of an angle with the cosine `mu`, in (0, 1]; infinite for other cosines.
fn tangent(mu: f64) -> f64 {
    if mu > 0.0 { (1.0 - mu * mu).max(0.0).sqrt() / mu } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed forms of the exitance against the midpoint rule in the cosine.
    #[test]
    fn the_exitance_is_the_integral_of_the_profile() {
        for profile in [
            EmissionProfile::Lambertian,
            EmissionProfile::CosinePower { exponent: 3.7 },
            EmissionProfile::from_half_intensity_angle(15f64.to_radians()),
            EmissionProfile::Louver { half_angle: 0.4 },
            EmissionProfile::Spot { cos_inner: 0.9, cos_outer: 0.7 },
        ] {
            assert!(profile.is_valid());
            let n = 200_000;
            let mu = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
            let sum: f64 = (0..n).map(|i| 2.0 * mu(i) * f64::from(profile.eval(mu(i) as f32)) / f64::from(n)).sum();
            assert!((sum / profile.exitance() - 1.0).abs() < 1e-4, "{profile:?}: {sum} {}", profile.exitance());
        }
    }

    #[test]
    fn both_precisions_agree_within_the_cutoff() {
        for profile in [
            EmissionProfile::Lambertian,
            EmissionProfile::CosinePower { exponent: 3.7 },
            EmissionProfile::Louver { half_angle: 0.4 },
            EmissionProfile::Spot { cos_inner: 0.9, cos_outer: 0.7 },
        ] {
            for i in 1..=1000 {
                let mu = f64::from(i) / 1000.0;
                let (single, double) = (f64::from(profile.eval(mu as f32)), profile.eval_f64(mu));
                assert!((single - double).abs() < 1e-5, "{profile:?} at {mu}: {single} {double}");
                assert!(tangent(mu) < 1.001 * profile.cutoff_tangent() || double < 1e-15, "{profile:?} at {mu}");
            }
        }
    }

    #[test]
    fn an_led_has_half_of_its_intensity_at_the_half_angle() {
        for degrees in [5.0, 20.0, 45.0, 59.0f64] {
            let mu = degrees.to_radians().cos() as f32;
            let profile = EmissionProfile::from_half_intensity_angle(degrees.to_radians());
            assert!((profile.eval(mu) * mu - 0.5).abs() < 1e-5, "{degrees}");
            assert_eq!(profile.eval(1.0), 1.0);
        }
        assert_eq!(EmissionProfile::from_half_intensity_angle(1.2), EmissionProfile::Lambertian);
    }

    #[test]
    fn no_profile_emits_backward_or_beyond_its_cone() {
        let louver = EmissionProfile::Louver { half_angle: 0.4 };
        assert_eq!(louver.eval(0.41f32.cos()), 0.0);
        for p in [EmissionProfile::Lambertian, louver, EmissionProfile::CosinePower { exponent: 2.0 }] {
            assert_eq!((p.eval(0.0), p.eval(-0.5), p.eval(f32::NAN)), (0.0, 0.0, 0.0));
        }
        for invalid in [
            EmissionProfile::CosinePower { exponent: -0.1 },
            EmissionProfile::Louver { half_angle: 0.0 },
            EmissionProfile::Louver { half_angle: 1.6 },
            EmissionProfile::Spot { cos_inner: 0.5, cos_outer: 0.6 },
        ] {
            assert!(!invalid.is_valid(), "{invalid:?}");
        }
    }
}
