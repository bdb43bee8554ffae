//! The tree of boxes: eight children to a node, and its traversal by a ray.
//!
//! The tree contains boxes and calls a leaf visitor. It does not depend on the content of the leaves.

use std::mem::MaybeUninit;

use dunkelfeld_geometry::triangle::UNIT_ROUNDOFF;
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_lanes::{Lanes, Mask, Real, V3};
use fearless_simd::Simd;

use crate::pairs::{Pair, Pairs, Subtree};
use crate::simd8::{Eight, F8, WIDTH};
use crate::triangle_block::TriangleBlock;

/// Set in a child word for a leaf; the other bits are the leaf's payload.
pub(crate) const LEAF: u32 = 1 << 31;
/// The child word of an unused slot, and the root of an empty tree.
pub(crate) const NONE: u32 = u32::MAX;
/// Maximum number of levels of nodes. The builder enforces it.
pub(crate) const MAX_DEPTH: usize = 44;
/// Each level leaves at most seven siblings on the stack.
pub(crate) const STACK: usize = (WIDTH - 1) * MAX_DEPTH + 2;

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
    /// The same tree for packets, and its root.
    pub(crate) pairs: Vec<Pair>,
    pub(crate) first: Subtree,
}

/// A child word of a tree that is joined to others: its nodes begin at `first`, and `payload` has the number of the part.
pub(crate) fn moved(word: u32, first: u32, payload: u32) -> u32 {
    match word {
        NONE => NONE,
        leaf if leaf & LEAF != 0 => leaf | payload,
        node => first + node,
    }
}

/// Visitor of the leaves.
pub(crate) trait Leaves {
    /// Tests a leaf, whose box the ray enters at `entry`. Lowers `t_max` to the nearest hit; true ends the traversal.
    ///
    /// If boxes are so large that differences overflow, an unused slot may be entered. [`NONE`] without its [`LEAF`]
    /// bit is a payload that no leaf has. The visitor must ignore it.
    fn visit(&mut self, payload: u32, entry: f32, t_max: &mut f32) -> bool;
}

/// Factor on distances to far planes.
pub(crate) const FAR_SCALE: f32 = 1.0 + 8.0 * UNIT_ROUNDOFF;

/// A ray in the form that the box test needs.
///
/// It is the slab test of Williams et al. (2005). The far side is moved out by rounding as in Ize, "Robust BVH ray
/// traversal" (2013). Each distance has three roundings, so a far distance scaled by `1 + 2 gamma(3)` cannot be too
/// short. That covers the arithmetic of the boxes. The watertight test rounds as well: its corners may be moved
/// sideways by up to 7 u M, where M is the distance to the farthest side of the tree. So a hit may lie outside the
/// triangle's box by as much. Each box therefore grows by 10 u M on every side, plus the rounding of the grown planes.
/// This costs nothing, because the origin is shifted instead: one origin for the near planes and one for the far
/// planes.
///
/// A packet has a ray in each lane.
#[derive(Clone, Copy)]
pub(crate) struct Slabs<F> {
    /// Indices of the three rows of a node with the near sides; the far ones are their neighbours.
    pub(crate) near: [usize; 3],
    pub(crate) near_origin: [F; 3],
    pub(crate) near_inverse: [F; 3],
    pub(crate) far_origin: [F; 3],
    pub(crate) far_inverse: [F; 3],
}

/// The signs of a direction: bit i is set if coordinate i is negative or minus zero.
#[inline(always)]
pub(crate) fn octant(direction: Vec3) -> usize {
    direction.to_array().iter().enumerate().fold(0, |bits, (axis, x)| bits | usize::from(x.is_sign_negative()) << axis)
}

/// The growth of boxes within `bounds`, for rays from these origins.
#[inline(always)]
pub(crate) fn growth<F: Lanes>(o: V3<F>, bounds: &Aabb) -> F {
    // The farthest side is at the centre plus half the extent, so no maximum of two is needed.
    let (middle, half) = (0.5 * bounds.min + 0.5 * bounds.max, 0.5 * bounds.max - 0.5 * bounds.min);
    let token = o.x.token();
    let reach = ((V3::splat(token, middle) - o).abs() + V3::splat(token, half)).max_element();
    reach * (10.0 * UNIT_ROUNDOFF) + o.abs().max_element() * (2.0 * UNIT_ROUNDOFF)
}

impl<F: Lanes> Slabs<F> {
    /// The form of rays for trees within `bounds`. All directions are in the octant.
    #[inline(always)]
    pub(crate) fn new(o: V3<F>, d: V3<F>, octant: usize, bounds: &Aabb) -> Self {
        let grow = growth(o, bounds);
        // Zero and minus zero differ here, so that the sides fit the sign of the infinite inverse.
        let near = [octant & 1, 2 + (octant >> 1 & 1), 4 + (octant >> 2 & 1)];
        let (o, near_inverse) = ([o.x, o.y, o.z], [d.x.recip(), d.y.recip(), d.z.recip()]);
        let (mut near_origin, mut far_origin, mut far_inverse) = (o, o, near_inverse);
        for axis in 0..3 {
            let shift = grow.copysign(near_inverse[axis]);
            near_origin[axis] = o[axis] + shift;
            far_origin[axis] = o[axis] - shift;
            far_inverse[axis] = near_inverse[axis] * FAR_SCALE;
        }
        Self { near, near_origin, near_inverse, far_origin, far_inverse }
    }

    /// The interval narrowed to that between two planes.
    #[inline(always)]
    pub(crate) fn narrow(&self, axis: usize, near_side: F, far_side: F, near: F, far: F) -> (F, F) {
        let n = (near_side - self.near_origin[axis]) * self.near_inverse[axis];
        let f = (far_side - self.far_origin[axis]) * self.far_inverse[axis];
        // 0 * inf, a ray along a side of the box, is a NaN: it must not narrow the interval, hence this order.
        (n.max(near), f.min(far))
    }
}

/// Three numbers, each in all lanes of its own vector.
#[inline(always)]
pub(crate) fn splat3<F: Lanes>(token: F::Token, [x, y, z]: [f32; 3]) -> [F; 3] {
    [F::splat(token, x), F::splat(token, y), F::splat(token, z)]
}

impl Slabs<f32> {
    /// The same ray in eight lanes, one for each child.
    #[inline(always)]
    pub(crate) fn splat<S: Simd>(&self, simd: S) -> Slabs<F8<S>> {
        Slabs {
            near: self.near,
            near_origin: splat3(simd, self.near_origin),
            near_inverse: splat3(simd, self.near_inverse),
            far_origin: splat3(simd, self.far_origin),
            far_inverse: splat3(simd, self.far_inverse),
        }
    }
}

impl<S: Simd> Slabs<F8<S>> {
    /// The children that the ray may hit before `t_max`, and the entry distance of each.
    #[inline(always)]
    fn enter(&self, node: &Node, t_max: f32) -> (u32, F8<S>) {
        let simd = self.near_origin[0].token();
        let (mut near, mut far) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, t_max));
        for axis in 0..3 {
            let side = self.near[axis];
            let n = Lanes::load(simd, &node.bounds[side]);
            let f = Lanes::load(simd, &node.bounds[side ^ 1]);
            (near, far) = self.narrow(axis, n, f, near, far);
        }
        (near.le(far).bits(), near)
    }
}

impl Tree {
    /// A tree without leaves.
    pub(crate) const EMPTY: Self =
        Self { nodes: Vec::new(), root: NONE, bounds: Aabb::EMPTY, pairs: Vec::new(), first: Subtree::NONE };

    /// Builds the pairs over the nodes and the blocks of the leaves.
    pub(crate) fn pair_up(&mut self, blocks: &[TriangleBlock]) {
        let mut pairs = Pairs { nodes: &self.nodes, blocks, pairs: Vec::new() };
        self.first = pairs.of_child(self.root);
        self.pairs = pairs.pairs;
        self.pairs.shrink_to_fit();
    }

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

    /// The entry of the stack for the whole tree.
    pub(crate) fn start(&self) -> u64 {
        u64::from(self.root)
    }

    /// Visits the leaves below a child that a ray may hit before `t_max`; near ones first if `ORDERED`. True if a visit
    /// ended the traversal. `start` is the child as an entry of the stack.
    #[inline(always)]
    pub(crate) fn traverse<S: Simd, const ORDERED: bool>(
        &self,
        slabs: &Slabs<F8<S>>,
        start: u64,
        t_max: &mut f32,
        leaves: &mut impl Leaves,
    ) -> bool {
        let mut stack = Stack::new();
        let mut entry = start;
        if entry as u32 == NONE {
            return false;
        }
        loop {
            let word = entry as u32;
            if word & LEAF == 0 {
                let node = &self.nodes[word as usize];
                let (mut entered, near) = slabs.enter(node, *t_max);
                if entered != 0 {
                    let near: Eight = near.into();
                    let first = take(&mut entered, &near, node);
                    if entered == 0 {
                        entry = first;
                        continue;
                    }
                    let second = take(&mut entered, &near, node);
                    let (mut nearest, mut next) =
                        if ORDERED && second < first { (second, first) } else { (first, second) };
                    if entered == 0 {
                        stack.push(next);
                        entry = nearest;
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
                    entry = nearest;
                    continue;
                }
            } else if leaves.visit(word & !LEAF, entry_distance(entry), t_max) {
                return true;
            }
            loop {
                let Some(next) = stack.pop() else { return false };
                if !ORDERED || entry_distance(next) <= *t_max {
                    entry = next;
                    break;
                }
            }
        }
    }
}

/// The distance at which a ray enters the box of an entry of the stack.
#[inline(always)]
fn entry_distance(entry: u64) -> f32 {
    f32::from_bits((entry >> 32) as u32)
}

/// The entry of the stack for a child.
#[inline(always)]
pub(crate) fn entry(distance: f32, child: u32) -> u64 {
    (u64::from(distance.to_bits()) << 32) | u64::from(child)
}

/// The next entered child as an entry of the stack: entry distance in the upper half, child word in the lower.
/// Distances are not negative, so the order of the integers is the order of the distances.
#[inline(always)]
fn take(entered: &mut u32, near: &Eight, node: &Node) -> u64 {
    let slot = entered.trailing_zeros() as usize & (WIDTH - 1);
    *entered &= *entered - 1;
    entry(near[slot], node.children[slot])
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
