//! Orthonormal frames per lane.

use crate::{Lanes, V3};

/// A right-handed orthonormal frame in world space, per lane. Local directions have the normal along +z.
#[derive(Clone, Copy, Debug)]
pub struct Frame<F> {
    /// Local +x in world space.
    pub tangent: V3<F>,
    /// Local +y in world space.
    pub bitangent: V3<F>,
    /// Local +z in world space.
    pub normal: V3<F>,
}

impl<F: Lanes> Frame<F> {
    /// A frame around a unit normal, without branches and without a singular direction (Duff et al. 2017).
    #[inline(always)]
    pub fn from_normal(n: V3<F>) -> Self {
        let sign = n.z.constant(1.0).copysign(n.z);
        let a = n.z.constant(-1.0) / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            tangent: V3::new((sign * n.x * n.x * a) + 1.0, sign * b, -sign * n.x),
            bitangent: V3::new(b, sign + n.y * n.y * a, -n.y),
            normal: n,
        }
    }

    /// World direction to local direction.
    #[inline(always)]
    pub fn to_local(&self, w: V3<F>) -> V3<F> {
        V3::new(w.dot(self.tangent), w.dot(self.bitangent), w.dot(self.normal))
    }

    /// Local direction to world direction.
    #[inline(always)]
    pub fn to_world(&self, w: V3<F>) -> V3<F> {
        self.tangent * w.x + self.bitangent * w.y + self.normal * w.z
    }
}
