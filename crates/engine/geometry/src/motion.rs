//! Rigid motion: a constant velocity and a rotation about an axis at a constant speed.

use dunkelfeld_lanes::Real;
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::TAU;

use crate::{Aabb, Ray, Transform};

/// Parts of a full turn in the bounds of a rotation.
const STEPS_PER_TURN: f64 = 64.0;
/// Relative margin of the bounds, for the rounding of coordinates to f32.
const MARGIN: f64 = 4.0 * f32::EPSILON as f64;

/// A rotation about an axis.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Spin {
    /// Unit vector along the axis. The rotation is right-handed about it.
    pub axis: DVec3,
    /// A point of the axis at time 0 \[m\].
    pub origin: DVec3,
    /// Angular speed \[rad/s\].
    pub speed: f64,
}

/// A rigid motion at constant speeds. At time 0 it is the identity.
///
/// With the velocity v, the axis through c and the angular speed w, a point p is at `c + R(w t) (p - c) + v t` at the
/// time t. The axis moves with the velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RigidMotion {
    /// Velocity \[m/s\].
    pub velocity: DVec3,
    /// Rotation, if there is one.
    pub spin: Option<Spin>,
}

impl RigidMotion {
    /// A motion without rotation.
    pub fn linear(velocity: DVec3) -> Self {
        Self { velocity, spin: None }
    }

    /// A rotation at `speed` \[rad/s\] about an axis through `origin` \[m\]. `None` if the axis has no direction.
    pub fn rotation(axis: DVec3, origin: DVec3, speed: f64) -> Option<Self> {
        let axis = axis.try_normalize()?;
        Some(Self { velocity: DVec3::ZERO, spin: Some(Spin { axis, origin, speed }) })
    }

    /// True if nothing moves.
    pub fn is_static(&self) -> bool {
        self.velocity == DVec3::ZERO && self.spin.is_none_or(|s| s.speed == 0.0)
    }

    /// True if all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let spin = |s: &Spin| s.axis.is_normalized() && s.origin.is_finite() && s.speed.is_finite();
        self.velocity.is_finite() && self.spin.as_ref().is_none_or(spin)
    }

    /// The same motion in a space whose origin is `offset` \[m\] away: a point p of this space is `p - offset` there.
    #[must_use]
    pub fn seen_from(&self, offset: DVec3) -> Self {
        Self { velocity: self.velocity, spin: self.spin.map(|s| Spin { origin: s.origin - offset, ..s }) }
    }

    /// The motion of an object that a map of the world has moved: the map after this motion is the result after the map. The
    /// map consists of a rotation, a uniform scale, a reflection and a translation; others give an approximation.
    #[must_use]
    pub fn mapped(&self, map: &DAffine3) -> Self {
        let side = map.matrix3.determinant().signum();
        let spin = self.spin.map(|s| Spin {
            axis: (map.transform_vector3(s.axis) * side).try_normalize().unwrap_or(s.axis),
            origin: map.transform_point3(s.origin),
            speed: s.speed,
        });
        Self { velocity: map.transform_vector3(self.velocity), spin }
    }

    /// The map of points at time 0 to points at the time `t` \[s\].
    pub fn at(&self, t: f64) -> DAffine3 {
        let shift = self.velocity * t;
        match self.spin {
            None => DAffine3::from_translation(shift),
            Some(Spin { axis, origin, speed }) => {
                let matrix3 = rotation_about(axis, speed * t);
                DAffine3 { matrix3, translation: origin - matrix3 * origin + shift }
            }
        }
    }

    /// A transform after the motion until the time `t` \[s\]. The inverse is that of the transform after the inverse
    /// motion, so that both cancel as before.
    #[inline]
    pub fn moved(&self, transform: &Transform, t: f64) -> Transform {
        let (to_world, to_object) = (transform.to_world(), transform.to_object());
        let shift = self.velocity * t;
        match self.spin {
            None => Transform::from_inverse_pair(
                DAffine3 { matrix3: to_world.matrix3, translation: to_world.translation + shift },
                DAffine3 { matrix3: to_object.matrix3, translation: to_object.translation - to_object.matrix3 * shift },
            ),
            Some(Spin { axis, origin, speed }) => {
                let matrix3 = rotation_about(axis, speed * t);
                let inverse3 = matrix3.transpose();
                let motion = DAffine3 { matrix3, translation: origin - matrix3 * origin + shift };
                let back = DAffine3 { matrix3: inverse3, translation: origin - inverse3 * (origin + shift) };
                Transform::from_inverse_pair(motion * *to_world, *to_object * back)
            }
        }
    }

    /// [`Transform::unit_ray`] of the transform after the motion until the time of the ray.
    #[inline]
    pub fn unit_ray(&self, transform: &Transform, ray: &Ray) -> (Ray, f32) {
        let t = f64::from(ray.time);
        match self.spin {
            // The object meets the ray where the object at rest meets the ray after the inverse motion.
            None => transform.unit_ray_from(ray.origin.as_dvec3() - self.velocity * t, ray),
            Some(_) => self.moved(transform, t).unit_ray(ray),
        }
    }

    /// A box around the box `bounds` at all times from `from` to `to` \[s\]. It may be larger than the smallest one.
    pub fn swept(&self, bounds: &Aabb, from: f64, to: f64) -> Aabb {
        if bounds.is_empty() {
            return Aabb::EMPTY;
        }
        let (lo, hi) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let (mut low, mut high) = (lo, hi);
        if let Some(Spin { axis, origin, speed }) = self.spin.filter(|s| s.speed != 0.0) {
            (low, high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let angle = (speed * (to - from)).abs().min(TAU);
            let steps = (angle / TAU * STEPS_PER_TURN).ceil().max(1.0);
            let step = angle / steps * speed.signum();
            let corners = bounds.corners().map(|c| c.as_dvec3() - origin);
            for i in 0..=steps as u32 {
                let turn = rotation_about(axis, speed * from + f64::from(i) * step);
                for corner in &corners {
                    let p = origin + turn * *corner;
                    (low, high) = (low.min(p), high.max(p));
                }
            }
            // Between two steps an arc of radius r leaves its chord by at most r (1 - cos(step / 2)).
            let radius = corners.iter().map(|c| c.cross(axis).length()).fold(0.0, f64::max);
            let sagitta = radius * (1.0 - (0.5 * step).cos());
            (low, high) = (low - sagitta, high + sagitta);
        }
        let [first, last] = [self.velocity * from, self.velocity * to];
        (low, high) = (low + first.min(last), high + first.max(last));
        let margin = low.abs().max(high.abs()) * MARGIN;
        let round = |v: DVec3, outward: fn(f32) -> f32| v.as_vec3().map(outward);
        Aabb { min: round(low - margin, f32::next_down), max: round(high + margin, f32::next_up) }
    }

    /// The speed \[m/s\] of a point at time 0.
    pub fn velocity_at(&self, point: DVec3) -> DVec3 {
        let turning = self.spin.map_or(DVec3::ZERO, |s| s.speed * s.axis.cross(point - s.origin));
        self.velocity + turning
    }
}

/// The right-handed rotation about a unit axis by an angle \[rad\] (Rodrigues 1840). It has the same bits on every machine.
fn rotation_about(axis: DVec3, angle: f64) -> DMat3 {
    let turns = angle / TAU;
    let (cos, sin) = f64::cos_sin((turns - turns.floor()) * TAU);
    let column = |e: DVec3| axis * (axis.dot(e) * (1.0 - cos)) + e * cos + axis.cross(e) * sin;
    DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn motion() -> RigidMotion {
        RigidMotion {
            velocity: DVec3::new(0.5, -1.0, 2.0),
            ..RigidMotion::rotation(DVec3::new(1.0, 2.0, -0.5), DVec3::new(0.3, 0.1, -0.7), 3.0).unwrap()
        }
    }

    #[test]
    fn points_of_the_axis_move_with_the_velocity_and_others_turn_right_handed() {
        let m = RigidMotion::rotation(DVec3::Z, DVec3::new(1.0, 0.0, 0.0), std::f64::consts::FRAC_PI_2).unwrap();
        let p = m.at(1.0).transform_point3(DVec3::new(2.0, 0.0, 5.0));
        assert!((p - DVec3::new(1.0, 1.0, 5.0)).length() < 1e-12, "{p}");
        let m = motion();
        let on_axis = m.spin.unwrap().origin;
        assert!((m.at(0.7).transform_point3(on_axis) - (on_axis + 0.7 * m.velocity)).length() < 1e-12);
        // The velocity is the derivative.
        let q = DVec3::new(1.0, -2.0, 0.4);
        let h = 1e-6;
        let derivative = (m.at(h).transform_point3(q) - m.at(-h).transform_point3(q)) / (2.0 * h);
        assert!((derivative - m.velocity_at(q)).length() < 1e-8);
    }

    #[test]
    fn a_mapped_motion_commutes_with_its_map() {
        let turned = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        for linear in [turned, turned * 3.0, turned * DMat3::from_diagonal(DVec3::new(-2.0, 2.0, 2.0))] {
            let map = DAffine3::from_mat3_translation(linear, DVec3::new(0.3, -2.0, 1.0));
            let p = DVec3::new(1.0, 0.4, -0.2);
            let there = map.transform_point3(motion().at(0.4).transform_point3(p));
            assert!((motion().mapped(&map).at(0.4).transform_point3(map.transform_point3(p)) - there).length() < 1e-12);
        }
    }

    #[test]
    fn a_ray_meets_the_moved_object_as_the_moved_ray_meets_the_object() {
        let rest = Transform::new(DAffine3::from_scale(DVec3::new(2.0, -1.0, 0.5))).unwrap();
        for m in [motion(), RigidMotion::linear(DVec3::new(1.0, 2.0, 3.0))] {
            for time in [-2.0, 0.0, 0.3, 9.0] {
                let ray = Ray { time, ..Ray::new(Vec3::new(0.3, 4.0, -1.0), Vec3::new(0.6, -0.8, 0.0)) };
                let (a, scale_a) = m.unit_ray(&rest, &ray);
                let (b, scale_b) = m.moved(&rest, f64::from(time)).unit_ray(&ray);
                assert!((a.origin - b.origin).length() <= 4e-7 * b.origin.length(), "{} {}", a.origin, b.origin);
                assert_eq!((a.direction, scale_a, a.t_max, a.time), (b.direction, scale_b, b.t_max, b.time));
            }
        }
    }

    #[test]
    fn swept_bounds_hold_the_box_at_every_time() {
        let bounds = Aabb { min: Vec3::new(-0.2, 0.4, 1.0), max: Vec3::new(0.5, 0.9, 3.0) };
        for (from, to) in [(0.0, 0.1), (-0.4, 0.7), (-3.0, 5.0)] {
            let swept = motion().swept(&bounds, from, to);
            for i in 0..=1000 {
                let pose = motion().at(from + (to - from) * f64::from(i) / 1000.0);
                for c in 0..8 {
                    let pick = |k: usize| f64::from(if c >> k & 1 == 0 { bounds.min[k] } else { bounds.max[k] });
                    let p = pose.transform_point3(DVec3::new(pick(0), pick(1), pick(2))).as_vec3();
                    assert!(swept.contains(p), "{p} at step {i} of {from} to {to}");
                }
            }
        }
        // A full turn is not much larger than the circle.
        let spin = RigidMotion::rotation(DVec3::Z, DVec3::ZERO, 100.0).unwrap();
        let disc = spin.swept(&Aabb { min: Vec3::new(1.0, 0.0, 0.0), max: Vec3::new(1.0, 0.0, 1.0) }, 0.0, 1.0);
        assert!((disc.max.x - 1.0).abs() < 0.01 && (disc.min.y + 1.0).abs() < 0.01, "{disc:?}");
    }
}
