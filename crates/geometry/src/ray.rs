//! A ray: origin, direction and length.

use glam::Vec3;

/// A half-line `origin + t * direction` for `0 < t < t_max`, in metres.
///
/// `direction` has unit length in world space; object-space rays of an instance may be scaled, `t` keeps its meaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start of the ray \[m\].
    pub origin: Vec3,
    /// Direction (unit length in world space).
    pub direction: Vec3,
    /// Upper end of the ray parameter; hits at `t >= t_max` do not count.
    pub t_max: f32,
}

impl Ray {
    /// An unbounded ray.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// A ray that ends at the parameter `t_max`.
    #[inline]
    pub fn with_end(origin: Vec3, direction: Vec3, t_max: f32) -> Self {
        Self { origin, direction, t_max }
    }

    /// The point at parameter `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}
