//! Axis-aligned boxes.

use glam::Vec3;

use crate::{Ray, Transform};

/// An axis-aligned box; empty when any `min` exceeds its `max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest corner \[m\].
    pub min: Vec3,
    /// Largest corner \[m\].
    pub max: Vec3,
}

impl Default for Aabb {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Aabb {
    /// The empty box: the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around some points; [`Aabb::EMPTY`] for none. A NaN coordinate is ignored.
    #[inline]
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::including)
    }

    /// The smallest box around this one and a point.
    #[inline]
    pub fn including(self, p: Vec3) -> Self {
        Self { min: p.min(self.min), max: p.max(self.max) }
    }

    /// The smallest box around two boxes.
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// True if the box is empty. (A point or a flat box is not empty; a box with a NaN is.)
    #[inline]
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Lengths of the sides \[m\]; zero when empty.
    #[inline]
    pub fn size(&self) -> Vec3 {
        if self.is_empty() { Vec3::ZERO } else { self.max - self.min }
    }

    /// The middle; not finite when empty.
    #[inline]
    pub fn center(&self) -> Vec3 {
        // Halved first, so that the largest finite box does not overflow.
        0.5 * self.min + 0.5 * self.max
    }

    /// Half the surface area [m^2], the measure of the surface area heuristic; zero when empty.
    #[inline]
    pub fn half_area(&self) -> f32 {
        let d = self.size();
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// True if the point is in the box, boundary included.
    #[inline]
    pub fn contains(&self, p: Vec3) -> bool {
        self.min.cmple(p).all() && p.cmple(self.max).all()
    }

    /// True if the other box is in this one, boundary included. An empty box is in every box.
    #[inline]
    pub fn encloses(&self, other: &Self) -> bool {
        other.is_empty() || (self.min.cmple(other.min).all() && other.max.cmple(self.max).all())
    }

    /// The smallest box (up to outward rounding) around this box after a transform.
    ///
    /// Interval arithmetic on the matrix (Arvo 1990), in f64, rounded outward by one ulp.
    pub fn transformed(&self, transform: &Transform) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let m = transform.to_world();
        let (lo, hi) = (self.min.as_dvec3(), self.max.as_dvec3());
        let mut min = m.translation;
        let mut max = m.translation;
        for (column, (l, h)) in
            [(m.matrix3.x_axis, (lo.x, hi.x)), (m.matrix3.y_axis, (lo.y, hi.y)), (m.matrix3.z_axis, (lo.z, hi.z))]
        {
            let (a, b) = (column * l, column * h);
            min += a.min(b);
            max += a.max(b);
        }
        Self { min: min.as_vec3().map(f32::next_down), max: max.as_vec3().map(f32::next_up) }
    }

    /// True if a ray could hit the box between its start and its end. Rounding errors never make it false for a ray that
    /// hits the content of the box, also if the ray is the rounded result of a transform.
    #[inline]
    pub fn may_be_hit(&self, ray: &Ray) -> bool {
        // Relative error of a distance: a subtraction, a division, and the rounding of a transformed ray.
        const SLACK: f32 = 16.0 * f32::EPSILON;
        let (mut near, mut far) = (0.0f32, ray.t_max);
        let reach = ray.origin.abs().max(self.min.abs()).max(self.max.abs()) * SLACK;
        let (min, max) = (self.min - reach, self.max + reach);
        for k in 0..3 {
            let (origin, direction) = (ray.origin[k], ray.direction[k]);
            if direction == 0.0 {
                if origin < min[k] || origin > max[k] {
                    return false;
                }
                continue;
            }
            let (a, b) = ((min[k] - origin) / direction, (max[k] - origin) / direction);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        near * (1.0 - SLACK) <= far * (1.0 + SLACK)
    }

    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, lo: f32, hi: f32| if i & bit == 0 { lo } else { hi };
            Vec3::new(pick(1, self.min.x, self.max.x), pick(2, self.min.y, self.max.y), pick(4, self.min.z, self.max.z))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DQuat, DVec3};

    #[test]
    fn a_transformed_box_holds_its_transformed_corners() {
        let b = Aabb { min: Vec3::new(-1.0, -0.3, 2.0), max: Vec3::new(0.5, 0.7, 9.0) };
        let t = Transform::new(DAffine3::from_scale_rotation_translation(
            DVec3::new(-2.0, 0.1, 30.0),
            DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 1.1),
            DVec3::new(1000.0, 0.0, -2.0),
        ))
        .unwrap();
        let moved = b.transformed(&t);
        let tight = Aabb::from_points(b.corners().map(|c| t.point(c)));
        assert!(moved.encloses(&tight), "{moved:?} against {tight:?}");
        assert!((moved.size() - tight.size()).abs().max_element() < 1e-3);
    }

    #[test]
    fn the_box_test_accepts_rays_through_the_box_and_refuses_others() {
        let bounds = Aabb { min: Vec3::new(0.0, 0.0, 0.0), max: Vec3::new(1.0, 1.0, 0.0) };
        let toward = |p: Vec3| {
            let from = Vec3::new(0.3, -2.0, 5.0);
            Ray::new(from, (p - from).normalize())
        };
        for i in 0..100 {
            let p = Vec3::new((i % 10) as f32 / 9.0, (i / 10) as f32 / 9.0, 0.0);
            assert!(bounds.may_be_hit(&toward(p)), "{p}");
        }
        assert!(!bounds.may_be_hit(&toward(Vec3::new(1.01, 0.5, 0.0))));
        assert!(!bounds.may_be_hit(&Ray::with_end(Vec3::new(0.5, 0.5, 2.0), -Vec3::Z, 1.9)));
        assert!(!bounds.may_be_hit(&Ray::new(Vec3::new(0.5, 0.5, -2.0), -Vec3::Z)));
        assert!(bounds.may_be_hit(&Ray::new(Vec3::new(0.5, 0.0, 2.0), -Vec3::Z)), "in the plane of a side");
    }
}
