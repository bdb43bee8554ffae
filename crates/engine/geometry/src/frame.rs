//! Orthonormal frames and directions in them.

use dunkelfeld_lanes as lanes;
use glam::Vec3;

/// A unit direction in a local frame whose normal is +z.
///
/// A type of its own, so that world and local directions cannot be mixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalDir(pub Vec3);

impl LocalDir {
    /// The direction with the given components. The caller must ensure unit length.
    #[inline]
    pub const fn new(x: f32, y: f32, z: f32) -> Self {
        Self(Vec3::new(x, y, z))
    }

    /// Cosine of the angle to the normal, signed.
    #[inline]
    pub fn cos_theta(self) -> f32 {
        self.0.z
    }

    /// Absolute cosine of the angle to the normal.
    #[inline]
    pub fn abs_cos_theta(self) -> f32 {
        self.0.z.abs()
    }

    /// True if both directions lie on the same side of the surface.
    #[inline]
    pub fn same_side(self, other: Self) -> bool {
        self.0.z * other.0.z > 0.0
    }
}

impl std::ops::Neg for LocalDir {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// A right-handed orthonormal frame in world space: tangent, bitangent, normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local +x in world space.
    pub tangent: Vec3,
    /// Local +y in world space.
    pub bitangent: Vec3,
    /// Local +z in world space.
    pub normal: Vec3,
}

impl From<lanes::Frame<f32>> for Frame {
    #[inline(always)]
    fn from(f: lanes::Frame<f32>) -> Self {
        Self { tangent: f.tangent.into(), bitangent: f.bitangent.into(), normal: f.normal.into() }
    }
}

impl From<Frame> for lanes::Frame<f32> {
    #[inline(always)]
    fn from(f: Frame) -> Self {
        Self { tangent: f.tangent.into(), bitangent: f.bitangent.into(), normal: f.normal.into() }
    }
}

impl Frame {
    /// A frame around a unit normal, without branches and without a singular direction (Duff et al. 2017).
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        lanes::Frame::<f32>::from_normal(n.into()).into()
    }

    /// A frame around a unit normal whose tangent is as near to `tangent` as orthogonality allows.
    ///
    /// A tangent that is zero, not finite or parallel to the normal is replaced by that of [`Frame::from_normal`].
    #[inline]
    pub fn from_normal_tangent(normal: Vec3, tangent: Vec3) -> Self {
        lanes::Frame::<f32>::from_normal_tangent(normal.into(), tangent.into()).into()
    }

    /// World direction to local direction.
    #[inline]
    pub fn to_local(&self, w: Vec3) -> LocalDir {
        LocalDir(lanes::Frame::<f32>::from(*self).to_local(w.into()).into())
    }

    /// Local direction to world direction.
    #[inline]
    pub fn to_world(&self, l: LocalDir) -> Vec3 {
        lanes::Frame::<f32>::from(*self).to_world(l.0.into()).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_right_handed_around_the_sphere() {
        for i in 0..2000 {
            let z = -1.0 + 2.0 * (i as f32 + 0.5) / 2000.0;
            let phi = i as f32 * 2.399_963;
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * phi.cos(), r * phi.sin(), z).normalize();
            for f in [Frame::from_normal(n), Frame::from_normal_tangent(n, Vec3::new(0.3, -2.0, 0.5))] {
                assert!((f.tangent.cross(f.bitangent) - n).length() < 1e-5, "n = {n}");
                assert!(f.tangent.dot(n).abs() < 1e-6 && (f.tangent.length() - 1.0).abs() < 1e-5);
                let w = Vec3::new(0.1, 0.7, -0.3).normalize();
                assert!((f.to_world(f.to_local(w)) - w).length() < 1e-5);
            }
        }
    }
}
