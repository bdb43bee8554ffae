//! The tree of boxes: eight children to a node, and its traversal by a ray.
//!
//! The tree contains boxes and calls a leaf visitor. It does not depend on the content of the leaves.

use std::mem::MaybeUninit;

use dunkelfeld_geometry::triangle::UNIT_ROUNDOFF;
use dunkelfeld_geometry::{Aabb, Ray, Vec3};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use crate::simd8::{Eight, WIDTH, bits, greater, lesser, load, splat3};

/// Set in a child word for a leaf; the other bits are the leaf's payload.
pub(crate) const LEAF: u32 = 1 << 31;
/// The child word of an unused slot, and the root of an empty tree.
pub(crate) const NONE: u32 = u32::MAX;
/// Maximum number of levels of nodes. The builder enforces it.
pub(crate) const MAX_DEPTH: usize = 44;
/// Each level leaves at most seven siblings on the stack.
const STACK: usize = (WIDTH - 1) * MAX_DEPTH + 2;

/// A node: the boxes of up to eight children.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// `bounds[2 axis]` holds the lower sides, `bounds[2 axis + 1]` the upper ones. Unused slots are inside out.
    pub(crate) bounds: [Eight; 6],
    /// Child words: the number of a node, or [`LEAF`] and a payload, or [`NONE`].
    pub(crate) children: [u32; WIDTH],
}

impl Node {
    pub(crate) const EMPTY: Self = {
        let (lo, hi) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Self { bounds: [lo, hi, lo, hi, lo, hi], children: [NONE; WIDTH] }
    };

    pub(crate) fn set(&mut self, slot: usize, bounds: &Aabb, child: u32) {
        self.children[slot] = child;
        for axis in 0..3 {
            self.bounds[2 * axis][slot] = bounds.min[axis];
            self.bounds[2 * axis + 1][slot] = bounds.max[axis];
        }
    }

    pub(crate) fn child_bounds(&self, slot: usize) -> Aabb {
        Aabb {
            min: [0, 2, 4].map(|side| self.bounds[side][slot]).into(),
            max: [1, 3, 5].map(|side| self.bounds[side][slot]).into(),
        }
    }
}

/// A tree of boxes with eight children to a node.
#[derive(Clone, Debug)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    /// The child word of the root: a tree of one leaf has no node.
    pub(crate) root: u32,
    /// Bounds of all leaves.
    pub(crate) bounds: Aabb,
}

/// Visitor of the leaves.
pub(crate) trait Leaves {
    /// Tests a leaf. Lowers `t_max` to the nearest hit; true ends the traversal.
    ///
    /// If boxes are so large that differences overflow, an unused slot may be entered. [`NONE`] without its [`LEAF`]
    /// bit is a payload that no leaf has. The visitor must ignore it.
    fn visit(&mut self, payload: u32, t_max: &mut f32) -> bool;
}

/// A ray in the form that the box test needs.
///
/// It is the slab test of Williams et al. (2005). The far side is moved out by rounding as in Ize, "Robust BVH ray
/// traversal" (2013). Each distance has three roundings, so a far distance scaled by `1 + 2 gamma(3)` cannot be too
/// short. That covers the arithmetic of the boxes. The watertight test rounds as well: its corners may be moved
/// sideways by up to 7 u M, where M is the distance to the farthest side of the tree. So a hit may lie outside the
/// triangle's box by as much. Each box therefore grows by 10 u M on every side, plus the rounding of the grown planes.
/// This costs nothing, because the origin is shifted instead: one origin for the near planes and one for the far
/// planes.
#[derive(Clone, Copy)]
pub(crate) struct Slabs<S: Simd> {
    simd: S,
    /// Indices of the three rows of a node with the near sides; the far ones are their neighbours.
    near: [usize; 3],
    near_origin: [f32x8<S>; 3],
    near_inverse: [f32x8<S>; 3],
    far_origin: [f32x8<S>; 3],
    far_inverse: [f32x8<S>; 3],
}

impl<S: Simd> Slabs<S> {
    /// The form of a ray for trees within `bounds`.
    #[inline(always)]
    pub(crate) fn new(simd: S, ray: &Ray, bounds: &Aabb) -> Self {
        let (o, d) = (ray.origin, ray.direction);
        // The farthest side is at the centre plus half the extent, so no maximum of two is needed.
        let (middle, half) = (0.5 * bounds.min + 0.5 * bounds.max, 0.5 * bounds.max - 0.5 * bounds.min);
        let reach = ((middle - o).abs() + half).max_element();
        let grow = 10.0 * UNIT_ROUNDOFF * reach + 2.0 * UNIT_ROUNDOFF * o.abs().max_element();
        let inverse = d.recip();
        // Zero and minus zero differ here, so that the sides fit the sign of the infinite inverse.
        let near = [
            usize::from(inverse.x.is_sign_negative()),
            2 + usize::from(inverse.y.is_sign_negative()),
            4 + usize::from(inverse.z.is_sign_negative()),
        ];
        let shift = Vec3::splat(grow).copysign(inverse);
        let (near_origin, far_origin) = (o + shift, o - shift);
        let far_scale = 1.0 + 8.0 * UNIT_ROUNDOFF;
        Self {
            simd,
            near,
            near_origin: splat3(simd, near_origin.into()),
            near_inverse: splat3(simd, inverse.into()),
            far_origin: splat3(simd, far_origin.into()),
            far_inverse: splat3(simd, (inverse * far_scale).into()),
        }
    }

    /// The children that the ray may hit before `t_max`, and the entry distance of each.
    #[inline(always)]
    fn enter(&self, node: &Node, t_max: f32) -> (u32, f32x8<S>) {
        let (mut near, mut far) = (f32x8::splat(self.simd, 0.0), f32x8::splat(self.simd, t_max));
        for axis in 0..3 {
            let side = self.near[axis];
            let near_side = load(self.simd, &node.bounds[side]);
            let far_side = load(self.simd, &node.bounds[side ^ 1]);
            let n = (near_side - self.near_origin[axis]) * self.near_inverse[axis];
            let f = (far_side - self.far_origin[axis]) * self.far_inverse[axis];
            // 0 * inf, a ray along a side of the box, is a NaN: it must not narrow the interval, hence this order.
            near = greater(n, near);
            far = lesser(f, far);
        }
        (bits(near.simd_le(far)), near)
    }
}

impl Tree {
    /// A tree without leaves.
    pub(crate) const EMPTY: Self = Self { nodes: Vec::new(), root: NONE, bounds: Aabb::EMPTY };

    /// Number of levels of nodes.
    pub(crate) fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut work = vec![(self.root, 1)];
        while let Some((word, depth)) = work.pop() {
            if word & LEAF == 0 {
                deepest = deepest.max(depth);
                work.extend(self.nodes[word as usize].children.map(|child| (child, depth + 1)));
            }
        }
        deepest
    }

    /// Visits the leaves that a ray may hit before `t_max`; near ones first if `ORDERED`. True if a visit ended the
    /// traversal.
    #[inline(always)]
    pub(crate) fn traverse<S: Simd, const ORDERED: bool>(
        &self,
        slabs: &Slabs<S>,
        t_max: &mut f32,
        leaves: &mut impl Leaves,
    ) -> bool {
        if self.root == NONE {
            return false;
        }
        let mut stack = Stack::new();
        let mut word = self.root;
        loop {
            if word & LEAF == 0 {
                let node = &self.nodes[word as usize];
                let (mut entered, near) = slabs.enter(node, *t_max);
                if entered != 0 {
                    let near: Eight = near.into();
                    let first = take(&mut entered, &near, node);
                    if entered == 0 {
                        word = first as u32;
                        continue;
                    }
                    let second = take(&mut entered, &near, node);
                    let (mut nearest, mut next) =
                        if ORDERED && second < first { (second, first) } else { (first, second) };
                    if entered == 0 {
                        stack.push(next);
                        word = nearest as u32;
                        continue;
                    }
                    if ORDERED {
                        let start = stack.top;
                        stack.push(next);
                        while entered != 0 {
                            next = take(&mut entered, &near, node);
                            if next < nearest {
                                std::mem::swap(&mut next, &mut nearest);
                            }
                            stack.push_sorted(next, start);
                        }
                    } else {
                        stack.push(next);
                        while entered != 0 {
                            stack.push(take(&mut entered, &near, node));
                        }
                    }
                    word = nearest as u32;
                    continue;
                }
            } else if leaves.visit(word & !LEAF, t_max) {
                return true;
            }
            loop {
                let Some(entry) = stack.pop() else { return false };
                if !ORDERED || f32::from_bits((entry >> 32) as u32) < *t_max {
                    word = entry as u32;
                    break;
                }
            }
        }
    }
}

/// The next entered child as an entry of the stack: entry distance in the upper half, child word in the lower.
/// Distances are not negative, so the order of the integers is the order of the distances.
#[inline(always)]
fn take(entered: &mut u32, near: &Eight, node: &Node) -> u64 {
    let slot = entered.trailing_zeros() as usize & (WIDTH - 1);
    *entered &= *entered - 1;
    (u64::from(near[slot].to_bits()) << 32) | u64::from(node.children[slot])
}

/// Children that are not visited yet. The stack is not cleared before use, because that would cost a tenth of a short
/// ray.
struct Stack {
    entries: [MaybeUninit<u64>; STACK],
    top: usize,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK], top: 0 }
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        self.entries[self.top].write(entry);
        self.top += 1;
    }

    /// Pushes an entry. The entries from `start` on stay in descending order, with the nearest on top.
    #[inline(always)]
    fn push_sorted(&mut self, entry: u64, start: usize) {
        let mut at = self.top;
        while at > start {
            // SAFETY: `at - 1 < top`, and every entry below `top` was written by a push.
            let below = unsafe { self.entries[at - 1].assume_init() };
            if below >= entry {
                break;
            }
            self.entries[at].write(below);
            at -= 1;
        }
        self.entries[at].write(entry);
        self.top += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<u64> {
        self.top = self.top.checked_sub(1)?;
        // SAFETY: the index was below `top` until now, and every entry below `top` was written by a push.
        Some(unsafe { self.entries[self.top].assume_init() })
    }
}
