//! Construction of a tree: obvhs clusters boxes into a binary tree, which is then collapsed into nodes of eight.
//!
//! The binary tree comes from locally-ordered clustering (Meister & Bittner 2018) with reinsertion (Meister & Bittner
//! 2018b), one box to a leaf. The collapse is optimal for the surface area heuristic (Ylitie, Karras & Laine 2017). For
//! each binary node it computes the least cost of a forest of at most 1, 2, .. 7 wide subtrees from the costs of its
//! children. All is deterministic and single-threaded.
//!
//! Clustering takes quadratic time if all costs are equal. Three steps prevent this. Equal boxes become one. Boxes are
//! scaled by a power of two, so that no area overflows or vanishes. If clustering of a sample gives a chain, or if the
//! tree is too deep for a fixed stack, a top-down builder is used instead.

use dunkelfeld_geometry::Aabb;
use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rustc_hash::FxHashMap;

use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Node, Tree};

/// Cost of a leaf in units of one node. A block of eight triangles takes about a fifth longer than eight boxes.
const LEAF_COST: f64 = 1.2;

/// Builds a tree over boxes. `make_leaf` receives the numbers of up to `leaf_size` (at most eight) boxes and returns
/// the payload (below 2^31) of their leaf. All boxes must be finite and not empty.
pub(crate) fn build_tree(boxes: &[Aabb], leaf_size: usize, mut make_leaf: impl FnMut(&[u32]) -> u32) -> Tree {
    if boxes.is_empty() {
        return Tree::EMPTY;
    }
    let groups = Groups::of_equal(boxes);
    let scaled = scaled_to_one(&groups.boxes);
    let clustered = if is_degenerate(&scaled) { None } else { Some(cluster(&scaled)) };
    if let Some(binary) = clustered {
        let collapse = Collapse::new(&binary, &groups, &scaled, leaf_size);
        if let Some(nodes) = collapse.count_nodes() {
            return collapse.emit(nodes, &mut make_leaf);
        }
    }
    let binary = split_top_down(&scaled);
    Collapse::new(&binary, &groups, &scaled, leaf_size).emit(0, &mut make_leaf)
}

/// Groups of equal boxes.
struct Groups {
    boxes: Vec<Aabb>,
    /// `members[starts[g] .. starts[g + 1]]` are the boxes of group g.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Groups {
    fn of_equal(boxes: &[Aabb]) -> Self {
        let mut numbers: FxHashMap<[u32; 6], u32> = FxHashMap::default();
        numbers.reserve(boxes.len());
        let mut distinct = Vec::with_capacity(boxes.len());
        let group_of: Vec<u32> = boxes
            .iter()
            .map(|b| {
                let ([x, y, z], [u, v, w]) = (b.min.to_array(), b.max.to_array());
                *numbers.entry([x, y, z, u, v, w].map(f32::to_bits)).or_insert_with(|| {
                    distinct.push(*b);
                    distinct.len() as u32 - 1
                })
            })
            .collect();
        let mut starts = vec![0u32; distinct.len() + 1];
        for &g in &group_of {
            starts[g as usize + 1] += 1;
        }
        for g in 0..distinct.len() {
            starts[g + 1] += starts[g];
        }
        let mut next = starts.clone();
        let mut members = vec![0; boxes.len()];
        for (i, &g) in group_of.iter().enumerate() {
            members[next[g as usize] as usize] = i as u32;
            next[g as usize] += 1;
        }
        Self { boxes: distinct, starts, members }
    }

    fn members(&self, group: u32) -> &[u32] {
        &self.members[self.starts[group as usize] as usize..self.starts[group as usize + 1] as usize]
    }
}

/// The boxes around their common centre, scaled by a power of two so that the largest coordinate is about one.
fn scaled_to_one(boxes: &[Aabb]) -> Vec<Aabb> {
    let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(*b));
    let middle = all.center();
    let half = (0.5 * all.max - 0.5 * all.min).max_element().max(f32::MIN_POSITIVE);
    // By exponents: the factor may exceed the range of f32, its square root does not.
    let root = (f64::from(half).log2().floor() * -0.5).exp2() as f32;
    let scale = |v: Vec3| (v - middle) * root * root;
    boxes.iter().map(|b| Aabb { min: scale(b.min), max: scale(b.max) }).collect()
}

/// A binary tree over groups, children after parents in no particular order.
struct Binary {
    /// Children of each node, or `[LEAF | group, NONE]`. The root is node 0.
    nodes: Vec<[u32; 2]>,
}

fn cluster(boxes: &[Aabb]) -> Binary {
    let count = boxes.len() as u32;
    if count == 1 {
        return Binary { nodes: vec![[LEAF, NONE]] };
    }
    let boxes: Vec<obvhs::aabb::Aabb> =
        boxes.iter().map(|b| obvhs::aabb::Aabb::new(Vec3A::from(b.min), Vec3A::from(b.max))).collect();
    let settings = BvhBuildParams::slow_build();
    let precision = if count < 1 << 17 { SortPrecision::U128 } else { SortPrecision::U64 };
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Medium,
        &boxes,
        (0..count).collect(),
        precision,
        settings.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut bvh, settings.reinsertion_batch_ratio, None);
    let nodes = bvh
        .nodes
        .iter()
        .map(|n| {
            if n.is_leaf() {
                [LEAF | bvh.primitive_indices[n.first_index as usize], NONE]
            } else {
                [n.first_index, n.first_index + 1]
            }
        })
        .collect();
    Binary { nodes }
}

/// True if clustering would chain these boxes instead of pairing them. It is tested by a tree of a sample of the boxes.
///
/// Nested boxes are the known case: every union has the cost of the outer box, so each round finds one pair.
fn is_degenerate(boxes: &[Aabb]) -> bool {
    const SAMPLE: usize = 1024;
    // A balanced tree of the sample has ten levels. Clustering of ordinary scenes gives about twenty.
    const MAX_CLUSTERED_DEPTH: usize = 64;
    let step = boxes.len().div_ceil(SAMPLE);
    let sample: Vec<Aabb> = boxes.iter().step_by(step).copied().collect();
    let binary = cluster(&sample);
    let mut work = vec![(0u32, 0usize)];
    while let Some((node, depth)) = work.pop() {
        if depth > MAX_CLUSTERED_DEPTH {
            return true;
        }
        let [left, right] = binary.nodes[node as usize];
        if right != NONE {
            work.extend([(left, depth + 1), (right, depth + 1)]);
        }
    }
    false
}

/// Maximum number of levels of a subtree of equal boxes: 2^31 boxes, eight to a node.
const EQUAL_LEVELS: usize = 11;

/// A top-down tree by binned surface area heuristic (Wald 2007). If the remaining levels are only enough for halving,
/// the list is halved, so that the wide tree stays within [`MAX_DEPTH`].
fn split_top_down(boxes: &[Aabb]) -> Binary {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut binary = Binary { nodes: vec![[NONE; 2]] };
    let mut work = vec![(0usize, 0usize, boxes.len(), MAX_DEPTH - EQUAL_LEVELS)];
    while let Some((node, start, end, levels)) = work.pop() {
        let part = &mut order[start..end];
        if let [only] = part {
            binary.nodes[node] = [LEAF | *only, NONE];
            continue;
        }
        let halving_needs = part.len().ilog2() as usize + 2;
        let split = if levels > halving_needs { split_by_area(boxes, part) } else { None };
        let middle = split.unwrap_or_else(|| split_in_half(boxes, part));
        let left = binary.nodes.len();
        binary.nodes[node] = [left as u32, left as u32 + 1];
        binary.nodes.extend([[NONE; 2]; 2]);
        work.push((left, start, start + middle, levels - 1));
        work.push((left + 1, start + middle, end, levels - 1));
    }
    binary
}

/// Sorts the part into two and returns the start of the second; None if all centres lie in one bin of each axis.
fn split_by_area(boxes: &[Aabb], part: &mut [u32]) -> Option<usize> {
    const BINS: usize = 16;
    let centers = Aabb::from_points(part.iter().map(|&i| boxes[i as usize].center()));
    let size = centers.size();
    let bin_of = |i: u32, axis: usize| {
        let at = (boxes[i as usize].center()[axis] - centers.min[axis]) / size[axis];
        ((at * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| size[axis] > 0.0) {
        let mut bins = [(Aabb::EMPTY, 0usize); BINS];
        for &i in part.iter() {
            let bin = &mut bins[bin_of(i, axis)];
            *bin = (bin.0.union(boxes[i as usize]), bin.1 + 1);
        }
        let add = |a: (Aabb, usize), b: &(Aabb, usize)| (a.0.union(b.0), a.1 + b.1);
        let mut above = [0.0; BINS];
        let mut right = (Aabb::EMPTY, 0);
        for k in (1..BINS).rev() {
            right = add(right, &bins[k]);
            above[k] = right.0.half_area() * right.1 as f32;
        }
        let mut left = (Aabb::EMPTY, 0);
        for k in 1..BINS {
            left = add(left, &bins[k - 1]);
            let cost = left.0.half_area() * left.1 as f32 + above[k];
            if left.1 > 0 && left.1 < part.len() && best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, k));
            }
        }
    }
    let (_, axis, first_right) = best?;
    part.sort_by_key(|&i| bin_of(i, axis) >= first_right);
    Some(part.partition_point(|&i| bin_of(i, axis) < first_right))
}

/// As [`split_by_area`], but in half along the widest axis (and by number if centres are equal).
fn split_in_half(boxes: &[Aabb], part: &mut [u32]) -> usize {
    let centers = Aabb::from_points(part.iter().map(|&i| boxes[i as usize].center()));
    let axis = centers.size().max_position();
    let center = |i: u32| boxes[i as usize].center()[axis];
    let middle = part.len() / 2;
    part.select_nth_unstable_by(middle, |&a, &b| center(a).total_cmp(&center(b)).then(a.cmp(&b)));
    middle
}

/// Costs of a forest of at most 1, 2, .. 7 wide subtrees.
type Costs = [f32; WIDTH - 1];

struct Collapse<'a> {
    binary: &'a Binary,
    groups: &'a Groups,
    leaf_size: usize,
    costs: Vec<Costs>,
    bounds: Vec<Aabb>,
    /// Boxes (not groups) below each node.
    counts: Vec<u32>,
    /// True for nodes that become leaves of the wide tree if they become the root of a wide subtree.
    is_leaf: Vec<bool>,
}

impl<'a> Collapse<'a> {
    fn new(binary: &'a Binary, groups: &'a Groups, scaled: &[Aabb], leaf_size: usize) -> Self {
        let n = binary.nodes.len();
        let mut this = Self {
            binary,
            groups,
            leaf_size,
            costs: vec![[0.0; WIDTH - 1]; n],
            bounds: vec![Aabb::EMPTY; n],
            counts: vec![0; n],
            is_leaf: vec![false; n],
        };
        let mut areas = vec![Aabb::EMPTY; n];
        for node in this.children_first() {
            let [left, right] = binary.nodes[node];
            if right == NONE {
                let group = left & !LEAF;
                this.counts[node] = groups.members(group).len() as u32;
                this.bounds[node] = groups.boxes[group as usize];
                areas[node] = scaled[group as usize];
                let leaves = (this.counts[node] as usize).div_ceil(leaf_size);
                this.is_leaf[node] = leaves == 1;
                this.costs[node] = [areas[node].half_area() * LEAF_COST as f32 * leaves as f32; WIDTH - 1];
                continue;
            }
            let (l, r) = (left as usize, right as usize);
            this.counts[node] = this.counts[l] + this.counts[r];
            this.bounds[node] = this.bounds[l].union(this.bounds[r]);
            areas[node] = areas[l].union(areas[r]);
            let area = areas[node].half_area();
            let mut costs = [0.0; WIDTH - 1];
            let internal = area + this.split(l, r, WIDTH).1;
            let leaf = if this.counts[node] as usize <= leaf_size { area * LEAF_COST as f32 } else { f32::INFINITY };
            this.is_leaf[node] = leaf <= internal;
            costs[0] = leaf.min(internal);
            for roots in 2..WIDTH {
                costs[roots - 1] = costs[roots - 2].min(this.split(l, r, roots).1);
            }
            this.costs[node] = costs;
        }
        this
    }

    /// Every node after its children.
    fn children_first(&self) -> Vec<usize> {
        let mut order = Vec::with_capacity(self.binary.nodes.len());
        let mut work = vec![0];
        while let Some(node) = work.pop() {
            order.push(node);
            let [left, right] = self.binary.nodes[node];
            if right != NONE {
                work.extend([left as usize, right as usize]);
            }
        }
        order.reverse();
        order
    }

    /// The best division of `roots` among two children: the number for the left one, and the cost.
    fn split(&self, left: usize, right: usize, roots: usize) -> (usize, f32) {
        let (l, r) = (&self.costs[left], &self.costs[right]);
        let mut best = (1, l[0] + r[roots - 2]);
        for k in 2..roots {
            let cost = l[k - 1] + r[roots - k - 1];
            if cost < best.1 {
                best = (k, cost);
            }
        }
        best
    }

    /// The wide subtrees below `node` if it may have `roots` of them.
    fn forest(&self, node: usize, roots: usize, out: &mut Vec<usize>) {
        let [left, right] = self.binary.nodes[node];
        let mut roots = roots;
        if right != NONE {
            // The smallest number of roots with the same cost.
            while roots > 1 && roots < WIDTH && self.costs[node][roots - 1] >= self.costs[node][roots - 2] {
                roots -= 1;
            }
        }
        if roots == 1 || right == NONE {
            out.push(node);
            return;
        }
        let (l, r) = (left as usize, right as usize);
        let (k, _) = self.split(l, r, roots);
        self.forest(l, k, out);
        self.forest(r, roots - k, out);
    }

    fn emit(&self, nodes: usize, make_leaf: &mut impl FnMut(&[u32]) -> u32) -> Tree {
        let mut tree = Tree { nodes: Vec::with_capacity(nodes), root: NONE, bounds: self.bounds[0] };
        tree.root = self.emit_below(0, &mut tree.nodes, make_leaf);
        tree
    }

    /// Number of wide nodes, or None if the tree would be too deep. It is computed before anything is emitted, because
    /// leaves cannot be removed.
    fn count_nodes(&self) -> Option<usize> {
        let mut nodes = 0;
        let mut work = vec![(0usize, 1usize)];
        let mut forest = Vec::new();
        while let Some((node, depth)) = work.pop() {
            if self.is_leaf[node] {
                continue;
            }
            let below = if self.binary.nodes[node][1] == NONE {
                let leaves = (self.counts[node] as usize).div_ceil(self.leaf_size);
                leaves.ilog(WIDTH) as usize + 1
            } else {
                nodes += 1;
                forest.clear();
                self.forest(node, WIDTH, &mut forest);
                work.extend(forest.iter().map(|&child| (child, depth + 1)));
                0
            };
            if depth + below > MAX_DEPTH {
                return None;
            }
        }
        Some(nodes)
    }

    /// Appends the wide subtree of a binary node and returns its child word. Recursion is as deep as the tree: bounded.
    fn emit_below(&self, node: usize, nodes: &mut Vec<Node>, make_leaf: &mut impl FnMut(&[u32]) -> u32) -> u32 {
        if self.is_leaf[node] {
            let mut members = Vec::with_capacity(self.leaf_size);
            self.gather(node, &mut members);
            return LEAF | make_leaf(&members);
        }
        if self.binary.nodes[node][1] == NONE {
            let members = self.groups.members(self.binary.nodes[node][0] & !LEAF);
            return self.emit_equal(members, &self.bounds[node], nodes, make_leaf);
        }
        let mut forest = Vec::with_capacity(WIDTH);
        self.forest(node, WIDTH, &mut forest);
        let at = nodes.len();
        nodes.push(Node::EMPTY);
        for (slot, &child) in forest.iter().enumerate() {
            let word = self.emit_below(child, nodes, make_leaf);
            nodes[at].set(slot, &self.bounds[child], word);
        }
        at as u32
    }

    /// A balanced subtree over boxes that are all equal and too many for one leaf.
    fn emit_equal(
        &self,
        members: &[u32],
        bounds: &Aabb,
        nodes: &mut Vec<Node>,
        make_leaf: &mut impl FnMut(&[u32]) -> u32,
    ) -> u32 {
        if members.len() <= self.leaf_size {
            return LEAF | make_leaf(members);
        }
        let at = nodes.len();
        nodes.push(Node::EMPTY);
        let leaves = members.len().div_ceil(self.leaf_size);
        let share = leaves.div_ceil(WIDTH) * self.leaf_size;
        for (slot, part) in members.chunks(share).enumerate() {
            let word = self.emit_equal(part, bounds, nodes, make_leaf);
            nodes[at].set(slot, bounds, word);
        }
        at as u32
    }

    /// The boxes below a node.
    fn gather(&self, node: usize, out: &mut Vec<u32>) {
        let [left, right] = self.binary.nodes[node];
        if right == NONE {
            out.extend_from_slice(self.groups.members(left & !LEAF));
        } else {
            self.gather(left as usize, out);
            self.gather(right as usize, out);
        }
    }
}
