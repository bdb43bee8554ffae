//! Beams: intervals that contain the rays of a packet. Boxes that no ray of the packet can enter are found eight at once.

use dunkelfeld_lanes::{Lanes, Mask, V3};

use crate::tree::{FAR_SCALE, Node, Slabs};
use crate::triangle_block::TriangleBlock;

/// The slab test of a packet as a whole.
///
/// The distance of a ray to a plane grows with each of its numbers or falls with it, also after rounding. So the extremes of
/// the numbers give bounds of the distances of all rays. A box that is left out is one that no ray enters.
pub(crate) struct Beam<E> {
    /// As in [`Slabs`].
    near: [usize; 3],
    near_origin: [E; 3],
    /// The values of least and of greatest magnitude.
    near_inverse: [[E; 2]; 3],
    far_origin: [E; 3],
    far_inverse: [[E; 2]; 3],
}

impl<E: Lanes> Beam<E> {
    /// The beam of the rays of all lanes, from their origins, their slabs and the growth of boxes.
    #[inline(always)]
    pub(crate) fn new<F: Lanes<Eight = E>>(origin: V3<F>, slabs: &Slabs<F>, growth: F) -> Self {
        let token = F::eight(growth.token());
        let zero = E::splat(token, 0.0);
        let mut beam = Self {
            near: slabs.near,
            near_origin: [zero; 3],
            near_inverse: [[zero; 2]; 3],
            far_origin: [zero; 3],
            far_inverse: [[zero; 2]; 3],
        };
        let grow = growth.extremes()[1];
        for (axis, origin) in [origin.x, origin.y, origin.z].into_iter().enumerate() {
            let ([low, high], [least, greatest]) = (origin.extremes(), slabs.near_inverse[axis].extremes());
            // The near side of a box is the upper one if the rays go down.
            let is_down = slabs.near[axis] & 1 == 1;
            let (near, far) = if is_down { (low - grow, high + grow) } else { (high + grow, low - grow) };
            let [first, last] = if is_down { [greatest, least] } else { [least, greatest] };
            (beam.near_origin[axis], beam.far_origin[axis]) = (E::splat(token, near), E::splat(token, far));
            beam.near_inverse[axis] = [E::splat(token, first), E::splat(token, last)];
            beam.far_inverse[axis] = [E::splat(token, first * FAR_SCALE), E::splat(token, last * FAR_SCALE)];
        }
        beam
    }

    /// The children that a ray may enter before `end`.
    #[inline(always)]
    pub(crate) fn children(&self, node: &Node, end: f32) -> u32 {
        let token = self.near_origin[0].token();
        let mut sides = [[self.near_origin[0]; 2]; 3];
        for (sides, near) in sides.iter_mut().zip(self.near) {
            *sides = [E::load(token, &node.bounds[near]), E::load(token, &node.bounds[near ^ 1])];
        }
        self.entered(sides, end)
    }

    /// The triangles whose boxes a ray may enter before `end`.
    #[inline(always)]
    pub(crate) fn triangles(&self, block: &TriangleBlock, end: f32) -> u32 {
        let token = self.near_origin[0].token();
        let mut sides = [[self.near_origin[0]; 2]; 3];
        for (axis, sides) in sides.iter_mut().enumerate() {
            let [a, b, c] = block.corners_of_axis(axis);
            let (a, b, c) = (E::load(token, a), E::load(token, b), E::load(token, c));
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            *sides = if self.near[axis] & 1 == 0 { [low, high] } else { [high, low] };
        }
        // Free lanes are NaN.
        self.entered(sides, end) & sides[0][0].eq(sides[0][0]).bits()
    }

    #[inline(always)]
    fn entered(&self, sides: [[E; 2]; 3], end: f32) -> u32 {
        let token = self.near_origin[0].token();
        let (mut near, mut far) = (E::splat(token, 0.0), E::splat(token, end));
        for (axis, [near_side, far_side]) in sides.into_iter().enumerate() {
            let (n, f) = (near_side - self.near_origin[axis], far_side - self.far_origin[axis]);
            let ([n0, n1], [f0, f1]) = (self.near_inverse[axis], self.far_inverse[axis]);
            // 0 * inf, a ray along a side of the box, is a NaN: it must not narrow the interval, hence this order.
            near = (n * n0).min(n * n1).max(near);
            far = (f * f0).max(f * f1).min(far);
        }
        near.le(far).bits()
    }
}
