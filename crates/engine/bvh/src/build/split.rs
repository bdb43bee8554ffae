//! Splits from the top down by the binned surface area heuristic (Wald 2007).
//!
//! Each set of boxes is sorted into bins along the three axes, by the centres of the boxes, and by the logarithm of their
//! surface area. The last one separates a few large boxes from many small ones, which lie in the way of all splits by
//! position. The split with the smallest sum of areas times numbers of leaves is taken. It is a function of the set, not of
//! its order.

use dunkelfeld_geometry::{Aabb, Threads};
use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, f32x4, f32x8};

use super::subtrees::Subtrees;
use crate::simd8::{Eight, WIDTH, dispatch8, greater};

/// Cost of a leaf in units of one node. A block of eight triangles takes about a fifth longer than eight boxes.
pub(super) const LEAF_COST: f32 = 1.2;
/// Maximum number of bins of an axis.
const BINS: usize = 16;
/// Sets of fewer boxes are sorted into half as many bins.
const SMALL_SET: usize = 64;
/// Smallest range of the sizes of a set that is split by size: the logarithm to base two of a ratio of areas.
const SIZE_RANGE: f32 = 3.0;
/// Smallest extent of the centres along an axis that can be split. The largest extent of all is about one.
const MIN_EXTENT: f32 = 1e-30;

/// Costs of a forest of at most 1, 2, .. 7 wide subtrees.
pub(super) type Costs = [f32; WIDTH - 1];

/// A box in one register: the negated lower corner and the number of the box, then the upper corner and the size of the
/// box. With negated lower sides, a maximum is the union of boxes; lanes 3 and 7 of a union have no meaning. The difference
/// of the halves is twice the centre, and the size on a fourth axis: numbers are so small as floats that they do not
/// change it (up to 800 million; the sizes of later boxes are wrong, which only makes the tree worse).
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Reference(Eight);

impl Reference {
    const EMPTY: Self = Self([f32::NEG_INFINITY; WIDTH]);

    pub(super) fn new(bounds: &Aabb, number: u32) -> Self {
        let (lo, hi) = (-bounds.min, bounds.max);
        let mut this = Self([lo.x, lo.y, lo.z, f32::from_bits(number), hi.x, hi.y, hi.z, 0.0]);
        // The bits of a positive float are a piecewise linear logarithm.
        this.0[7] = 1.0 + this.half_area().to_bits() as f32 / (1u32 << 23) as f32;
        this
    }

    /// The number of the box.
    pub(super) fn number(&self) -> u32 {
        self.0[3].to_bits()
    }

    pub(super) fn bounds(&self) -> Aabb {
        let [x, y, z, _, u, v, w, _] = self.0;
        Aabb { min: [-x, -y, -z].into(), max: [u, v, w].into() }
    }

    /// Half of the surface area.
    #[inline(always)]
    fn half_area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.0[axis] + self.0[axis + 4]);
        x * y + y * z + z * x
    }

    /// Twice the centre along an axis; the size on axis 3.
    #[inline(always)]
    fn center(&self, axis: usize) -> f32 {
        self.0[axis + 4] - self.0[axis]
    }

    #[inline(always)]
    fn vector<S: Simd>(&self, simd: S) -> f32x8<S> {
        f32x8::load_array_ref(simd, &self.0)
    }
}

/// The smallest box around the centres.
#[inline(always)]
fn centers<S: Simd>(boxes: f32x8<S>) -> f32x8<S> {
    let (low, high) = boxes.split();
    (low - high).combine(high - low)
}

/// A node of the binary tree.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct BinaryNode {
    pub(super) bounds: Aabb,
    /// Costs of the forests of wide subtrees below.
    pub(super) costs: Costs,
    /// Number of boxes below.
    pub(super) count: u32,
    /// Two nodes. In a leaf, `[LEAF, first box]`: its boxes are neighbours in the list of references.
    pub(super) children: [u32; 2],
}

impl BinaryNode {
    /// A leaf without boxes.
    pub(super) const EMPTY: Self =
        Self { bounds: Aabb::EMPTY, costs: [0.0; WIDTH - 1], count: 0, children: [LEAF_CHILD, 0] };

    /// A node that is never a leaf of the binary tree, over two others.
    pub(super) fn above(nodes: &[Self], children: [u32; 2], leaf_size: usize) -> Self {
        let [left, right] = children.map(|child| &nodes[child as usize]);
        let bounds = left.bounds.union(right.bounds);
        let count = left.count + right.count;
        let costs = forest_costs(bounds.half_area(), &left.costs, &right.costs, count as usize <= leaf_size);
        Self { bounds, costs, count, children }
    }

    pub(super) fn is_leaf(&self) -> bool {
        self.children[0] == LEAF_CHILD
    }

    /// The node of a subtree that follows so many other nodes.
    pub(super) fn moved(self, nodes: u32) -> Self {
        if self.is_leaf() { self } else { Self { children: self.children.map(|child| child + nodes), ..self } }
    }
}

/// The first child of a leaf.
const LEAF_CHILD: u32 = u32::MAX;

/// The binary tree. A leaf has up to `leaf_size` boxes.
#[derive(Debug)]
pub(super) struct Binary {
    pub(super) nodes: Vec<BinaryNode>,
    pub(super) root: u32,
}

/// Costs of the forests below a node with two children. A node costs its area, a leaf its area times [`LEAF_COST`].
#[inline(always)]
fn forest_costs(area: f32, left: &Costs, right: &Costs, may_be_leaf: bool) -> Costs {
    // The best division of k roots among the children.
    let mut divided = [f32::INFINITY; WIDTH + 1];
    for l in 1..WIDTH {
        for r in 1..=WIDTH - l {
            divided[l + r] = divided[l + r].min(left[l - 1] + right[r - 1]);
        }
    }
    let inner = area + divided[WIDTH];
    let mut costs = [0.0; WIDTH - 1];
    costs[0] = if may_be_leaf { inner.min(area * LEAF_COST) } else { inner };
    for roots in 2..WIDTH {
        costs[roots - 1] = costs[roots - 2].min(divided[roots]);
    }
    costs
}

/// The map from centres to bins.
#[derive(Clone, Copy)]
struct Binning {
    bins: usize,
    /// The smallest centre.
    min: [f32; 4],
    /// Bins per length; zero on axes that are not split.
    scale: [f32; 4],
}

impl Binning {
    fn new(centers: &Reference, count: usize) -> Self {
        let bins = if count < SMALL_SET { BINS / 2 } else { BINS };
        let scale = [0, 1, 2, 3].map(|axis| {
            let size = centers.0[axis] + centers.0[axis + 4];
            let smallest = if axis == 3 { SIZE_RANGE } else { MIN_EXTENT };
            if size >= smallest { bins as f32 * 0.9999 / size } else { 0.0 }
        });
        Self { bins, min: [0, 1, 2, 3].map(|axis| -centers.0[axis]), scale }
    }
}

/// A division of a set: the boxes whose bin along the axis is below `bin`, and the others.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Split {
    axis: usize,
    bin: usize,
}

/// A part of a set: its box, and the box of its centres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    bounds: Reference,
    centers: Reference,
}

/// The best split; None if all boxes are in one bin of each axis. `AXES` is 3, or 4 with the sizes.
#[inline(always)]
fn best_split<S: Simd, const AXES: usize>(simd: S, set: &[Reference], binning: &Binning) -> Option<Split> {
    let mut boxes = [[Reference::EMPTY; BINS]; AXES];
    let mut counts = [[0u32; BINS]; AXES];
    let (min, scale) = (f32x4::from_slice(simd, &binning.min), f32x4::from_slice(simd, &binning.scale));
    for reference in set {
        let all = reference.vector(simd);
        let (low, high) = all.split();
        let bins: [i32; 4] = simd.cvt_i32_f32x4(((high - low) - min) * scale).into();
        for axis in 0..AXES {
            let bin = bins[axis] as usize % BINS;
            boxes[axis][bin].0 = greater(boxes[axis][bin].vector(simd), all).into();
            counts[axis][bin] += 1;
        }
    }
    // The number of full leaves.
    let leaves = |count: u32| count.div_ceil(WIDTH as u32) as f32;
    let mut best = (f32::INFINITY, None);
    for axis in (0..AXES).filter(|&axis| binning.scale[axis] > 0.0) {
        let mut above = [f32::INFINITY; BINS];
        let (mut union, mut count) = (Reference::EMPTY.vector(simd), 0);
        for bin in (1..binning.bins).rev() {
            union = greater(union, boxes[axis][bin].vector(simd));
            count += counts[axis][bin];
            if count > 0 {
                above[bin] = Reference(union.into()).half_area() * leaves(count);
            }
        }
        (union, count) = (Reference::EMPTY.vector(simd), 0);
        for bin in 1..binning.bins {
            union = greater(union, boxes[axis][bin - 1].vector(simd));
            count += counts[axis][bin - 1];
            let cost = Reference(union.into()).half_area() * leaves(count) + above[bin];
            // The cost of an empty part is infinite or NaN.
            if cost < best.0 {
                best = (cost, Some(Split { axis, bin }));
            }
        }
    }
    best.1
}

/// Sorts a set into the two parts of a split. Returns the number of boxes in the first part, and the extents.
#[inline(always)]
fn partition<S: Simd>(simd: S, set: &mut [Reference], binning: &Binning, split: Split) -> (usize, [Extent; 2]) {
    let (min, scale) = (binning.min[split.axis], binning.scale[split.axis]);
    let empty = Reference::EMPTY.vector(simd);
    let [mut left, mut right] = [[empty; 2]; 2];
    let mut count = 0;
    for i in 0..set.len() {
        let reference = set[i];
        let at = (reference.center(split.axis) - min) * scale;
        let is_left = f32x8::splat(simd, at).simd_lt(f32x8::splat(simd, split.bin as f32));
        let all = reference.vector(simd);
        for (side, vector) in [all, centers(all)].into_iter().enumerate() {
            left[side] = greater(left[side], is_left.select(vector, empty));
            right[side] = greater(right[side], is_left.select(empty, vector));
        }
        // The order within the parts has no meaning, so there is no branch: each box moves to the end of the first part,
        // which grows if the box belongs to it.
        set[i] = set[count];
        set[count] = reference;
        count += usize::from(at < split.bin as f32);
    }
    let extent = |[bounds, centers]: [f32x8<S>; 2]| Extent {
        bounds: Reference(bounds.into()),
        centers: Reference(centers.into()),
    };
    (count, [extent(left), extent(right)])
}

/// The extent of a set.
#[inline(always)]
fn extent<S: Simd>(simd: S, set: &[Reference]) -> Extent {
    let mut unions = [Reference::EMPTY.vector(simd); 2];
    for reference in set {
        let all = reference.vector(simd);
        unions = [greater(unions[0], all), greater(unions[1], centers(all))];
    }
    Extent { bounds: Reference(unions[0].into()), centers: Reference(unions[1].into()) }
}

/// The builder of the binary tree.
pub(super) struct Splitter {
    pub(super) level: Level,
    /// Maximum number of boxes of a leaf.
    pub(super) leaf_size: usize,
    pub(super) threads: Threads,
}

impl Splitter {
    /// Builds the tree of at least one box, with at most so many levels. Sorts the references. If the remaining levels are
    /// only enough for halving, sets are halved.
    pub(super) fn build(&self, references: &mut [Reference], levels: usize) -> Binary {
        let mut nodes = Vec::with_capacity(references.len() / 2);
        let whole = self.extent(references);
        if references.len() < Threads::LARGE || self.threads == Threads::ONE {
            self.build_below(references, 0, &whole, levels, &mut nodes);
        } else {
            Subtrees::new(self, references, whole, levels).build(&mut nodes);
        }
        Binary { nodes, root: 0 }
    }

    /// Appends the subtree of a set that begins at number `first` of the list. Recursion is as deep as the levels.
    pub(super) fn build_below(
        &self,
        set: &mut [Reference],
        first: u32,
        whole: &Extent,
        levels: usize,
        nodes: &mut Vec<BinaryNode>,
    ) {
        let at = nodes.len();
        let bounds = whole.bounds.bounds();
        let leaf = [whole.bounds.half_area() * LEAF_COST; WIDTH - 1];
        let count = set.len() as u32;
        nodes.push(BinaryNode { bounds, costs: leaf, count, children: [LEAF_CHILD, first] });
        if set.len() <= self.leaf_size {
            return;
        }
        let (middle, parts) = self.divide(set, whole, levels);
        let (left, right) = set.split_at_mut(middle);
        self.build_below(left, first, &parts[0], levels.saturating_sub(1), nodes);
        let second = nodes.len() as u32;
        self.build_below(right, first + middle as u32, &parts[1], levels.saturating_sub(1), nodes);
        nodes[at] = BinaryNode::above(nodes, [at as u32 + 1, second], self.leaf_size);
    }

    /// Sorts a set of at least two boxes into two parts that are not empty. Returns the number of boxes in the first part.
    pub(super) fn divide(&self, set: &mut [Reference], whole: &Extent, levels: usize) -> (usize, [Extent; 2]) {
        if levels > set.len().ilog2() as usize + 2 {
            let binning = Binning::new(&whole.centers, set.len());
            if let Some(split) = self.best_split(set, &binning) {
                let (middle, parts) = self.partition(set, &binning, split);
                if middle > 0 && middle < set.len() {
                    return (middle, parts);
                }
            }
        }
        let middle = halve(set, &whole.centers);
        (middle, [self.extent(&set[..middle]), self.extent(&set[middle..])])
    }

    // The kernels are functions of their own: their memory would otherwise be on the stack of each level.

    #[inline(never)]
    fn best_split(&self, set: &[Reference], binning: &Binning) -> Option<Split> {
        if binning.scale[3] > 0.0 {
            dispatch8!(self.level, simd => best_split::<_, 4>(simd, set, binning))
        } else {
            dispatch8!(self.level, simd => best_split::<_, 3>(simd, set, binning))
        }
    }

    #[inline(never)]
    fn partition(&self, set: &mut [Reference], binning: &Binning, split: Split) -> (usize, [Extent; 2]) {
        dispatch8!(self.level, simd => partition(simd, set, binning, split))
    }

    #[inline(never)]
    pub(super) fn extent(&self, set: &[Reference]) -> Extent {
        dispatch8!(self.level, simd => extent(simd, set))
    }
}

/// Sorts a set into two halves along the longest axis of the centres, and by number if centres are equal.
fn halve(set: &mut [Reference], centers: &Reference) -> usize {
    let size = |axis: usize| centers.0[axis] + centers.0[axis + 4];
    let axis = (1..3).fold(0, |longest, axis| if size(axis) > size(longest) { axis } else { longest });
    let middle = set.len() / 2;
    set.select_nth_unstable_by(middle, |a, b| {
        a.center(axis).total_cmp(&b.center(axis)).then(a.number().cmp(&b.number()))
    });
    middle
}
