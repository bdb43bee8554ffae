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

    /// A frame around a unit normal whose tangent is as near to `tangent` as orthogonality allows.
    ///
    /// A tangent that is zero, not finite or parallel to the normal is replaced by that of [`Self::from_normal`].
    #[inline(always)]
    pub fn from_normal_tangent(normal: V3<F>, tangent: V3<F>) -> Self {
        let t = tangent - normal * normal.dot(tangent);
        let len2 = t.length_squared();
        // 1e-12 relative to the tangent's own length: below that the direction is rounding noise.
        let is_long =
            len2.gt(tangent.length_squared() * 1e-12) & len2.gt(len2.constant(f32::MIN_POSITIVE)) & len2.is_finite();
        // A tangent almost parallel to the normal loses orthogonality by rounding, so it is projected again.
        let t = t / len2.sqrt();
        let t = (t - normal * normal.dot(t)).normalize();
        let other = Self::from_normal(normal);
        Self {
            tangent: V3::select(is_long, t, other.tangent),
            bitangent: V3::select(is_long, normal.cross(t), other.bitangent),
            normal,
        }
    }

    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    pub fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        Self {
            tangent: V3::select(mask, yes.tangent, no.tangent),
            bitangent: V3::select(mask, yes.bitangent, no.bitangent),
            normal: V3::select(mask, yes.normal, no.normal),
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
