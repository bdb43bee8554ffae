//! A distant light with an angular diameter, like the sun: the same radiance from all directions of a cone.

use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Frame, Lanes, V3, cos_sin_of_angle, cos_sin_of_turn};
use dunkelfeld_radiometry::Rgb;
use std::f32::consts::{PI, TAU};

/// The compiled light.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Sun {
    /// Unit direction toward the middle of its disc.
    axis: Vec3,
    /// 1 - cos of the half-angle of the cone, in (0, 1].
    one_minus_cos: f32,
    /// Irradiance on a surface that faces the light [W/m^2].
    irradiance: Rgb,
}

impl Sun {
    /// A light of the half-angle `half_angle` \[rad\], in (0, pi/2], and of an irradiance [W/m^2] on a facing surface.
    pub(crate) fn new(axis: Vec3, half_angle: f32, irradiance: Rgb) -> Self {
        // Without the cancellation of 1 - cos.
        let (_, sin_half) = cos_sin_of_angle(0.5 * half_angle);
        Self { axis, one_minus_cos: 2.0 * sin_half * sin_half, irradiance }
    }

    /// Radiance [W/(m^2 sr)] of its disc: the irradiance over the projected solid angle, pi sin^2 of the half-angle.
    pub(crate) fn disc_radiance(&self) -> Rgb {
        let sin2 = self.one_minus_cos * (2.0 - self.one_minus_cos);
        self.irradiance * (1.0 / (PI * sin2))
    }

    /// Radiance [W/(m^2 sr)] from unit directions.
    #[inline(always)]
    pub(crate) fn radiance<F: Lanes>(&self, direction: V3<F>) -> Rgb<F> {
        let token = direction.x.token();
        let [disc, black] = [Rgb::in_lanes(token, self.disc_radiance()), Rgb::in_lanes(token, Rgb::BLACK)];
        Rgb::select(self.contains(direction), disc, black)
    }

    /// Lanes with a direction inside its disc. The chord avoids the cancellation of the cosine.
    #[inline(always)]
    fn contains<F: Lanes>(&self, direction: V3<F>) -> F::Mask {
        let token = direction.x.token();
        (direction - V3::splat(token, self.axis)).length_squared().le(F::splat(token, 2.0 * self.one_minus_cos))
    }

    /// Directions, uniform in the cone (Pharr, Jakob and Humphreys 2016, section 13.6.4), with their density [1/sr].
    #[inline(always)]
    pub(crate) fn sample<F: Lanes>(&self, u: [F; 2]) -> (V3<F>, F) {
        let drop = u[0] * self.one_minus_cos;
        let sin = (drop * (drop.constant(2.0) - drop)).max(drop.constant(0.0)).sqrt();
        let (cos_phi, sin_phi) = cos_sin_of_turn(u[1]);
        let local = V3::new(sin * cos_phi, sin * sin_phi, drop.one_minus());
        let frame = Frame::from_normal(V3::splat(drop.token(), self.axis));
        (frame.to_world(local).normalize(), drop.constant(self.density()))
    }

    /// The densities [1/sr] of directions in [`Self::sample`].
    #[inline(always)]
    pub(crate) fn pdf<F: Lanes>(&self, direction: V3<F>) -> F {
        direction.x.constant(self.density()).only(self.contains(direction))
    }

    #[inline]
    fn density(&self) -> f32 {
        1.0 / (TAU * self.one_minus_cos)
    }

    /// Irradiance [W/m^2] on a facing surface.
    pub(crate) fn irradiance(&self) -> Rgb {
        self.irradiance
    }

    /// Lanes in which light of the disc can reach a surface with this normal that scatters light from above only.
    #[inline(always)]
    pub(crate) fn is_above<F: Lanes>(&self, normal: V3<F>) -> F::Mask {
        let sin = (self.one_minus_cos * (2.0 - self.one_minus_cos)).max(0.0).sqrt();
        let token = normal.x.token();
        V3::splat(token, self.axis).dot(normal).gt(F::splat(token, -sin))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_lie_in_the_disc_and_the_density_integrates_to_one() {
        for half_angle in [1e-3f32, 0.0046, 0.1, 1.0] {
            let axis = Vec3::new(0.3, 0.8, -0.5).normalize();
            let sun = Sun::new(axis, half_angle, Rgb::splat(2.0));
            let (mut irradiance, mut outside) = (0.0, 0);
            let n = 200;
            for i in 0..n * n {
                let u = [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|v| v / n as f32);
                let (d, pdf) = sun.sample::<f32>(u);
                // A direction at the edge may be rounded out of the disc.
                outside += u32::from(sun.pdf(d) != pdf);
                assert!(d.dot(axis.into()) >= half_angle.cos() - 1e-6);
                irradiance += f64::from(sun.disc_radiance().g * d.dot(axis.into()) / pdf) / f64::from(n * n);
            }
            assert!((irradiance / 2.0 - 1.0).abs() < 1e-3, "{half_angle}: {irradiance}");
            assert!(outside < 20, "{half_angle}: {outside} directions are outside of the disc");
            let outside = (axis + 1.05 * half_angle.tan() * axis.any_orthonormal_vector()).normalize();
            let outside = V3::from(outside);
            assert_eq!((sun.pdf::<f32>(outside), sun.radiance::<f32>(outside)), (0.0, Rgb::BLACK));
        }
    }
}
