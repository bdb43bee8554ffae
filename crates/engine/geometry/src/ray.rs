//! A ray: origin, direction, length and time.

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
    /// Time at which the ray meets moving parts \[s\]; 0 is the pose of the scene file.
    pub time: f32,
}

impl Ray {
    /// An unbounded ray at time 0.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY, time: 0.0 }
    }

    /// A ray at time 0 that ends at the parameter `t_max`.
    #[inline]
    pub fn with_end(origin: Vec3, direction: Vec3, t_max: f32) -> Self {
        Self { origin, direction, t_max, time: 0.0 }
    }

    /// The same ray at another time \[s\].
    #[inline]
    #[must_use]
    pub fn at_time(self, time: f32) -> Self {
        Self { time, ..self }
    }

    /// The point at parameter `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}
