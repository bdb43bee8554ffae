//! Collapse of the binary tree into nodes of eight, optimal for the surface area heuristic (Ylitie, Karras & Laine 2017).
//!
//! Each binary node has the least cost of a forest of at most 1, 2, .. 7 wide subtrees, from the costs of its children. The
//! children of a wide node are the best forest of eight below its binary node.

use super::CHUNK;
use super::split::{Binary, BinaryNode, LEAF_COST, Reference};
use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Node};
use dunkelfeld_geometry::Threads;

/// The collapse, and the wide tree as far as it is made.
pub(super) struct Collapse<'a> {
    binary: &'a [BinaryNode],
    references: &'a [Reference],
    leaf_size: usize,
    start: u32,
    /// Nodes without boxes, each before its children. Their leaves have the numbers of the leaves instead of payloads.
    pub(super) nodes: Vec<Node>,
    /// Leaves.
    pub(super) leaves: Leaves,
    /// The child word of the root.
    pub(super) root: u32,
}

/// Leaves: the numbers of their boxes.
#[derive(Default)]
pub(crate) struct Leaves {
    members: Vec<u32>,
    /// The end of each leaf in `members`.
    ends: Vec<u32>,
}

impl Leaves {
    /// Number of leaves.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// The boxes of a leaf.
    fn members(&self, leaf: usize) -> &[u32] {
        let start = if leaf == 0 { 0 } else { self.ends[leaf - 1] };
        &self.members[start as usize..self.ends[leaf] as usize]
    }

    /// The results of a function of the number and the boxes of each leaf.
    pub(crate) fn map<T: Send>(&self, threads: Threads, value: impl Fn(u32, &[u32]) -> T + Sync) -> Vec<T> {
        let of = |leaf: usize| value(leaf as u32, self.members(leaf));
        if threads == Threads::ONE || self.len() < CHUNK {
            return (0..self.len()).map(of).collect();
        }
        let chunks = (0..self.len()).step_by(CHUNK).map(|start| start..(start + CHUNK).min(self.len()));
        let parts = threads.map(chunks.collect(), |chunk| chunk.map(of).collect::<Vec<T>>());
        let mut all = Vec::with_capacity(self.len());
        parts.into_iter().for_each(|part| all.extend(part));
        all
    }
}

impl<'a> Collapse<'a> {
    pub(super) fn new(binary: &'a Binary, references: &'a [Reference], leaf_size: usize) -> Self {
        let leaves = Leaves { members: Vec::with_capacity(references.len()), ends: Vec::new() };
        let nodes = Vec::with_capacity(binary.nodes.len() / WIDTH + 1);
        Self { binary: &binary.nodes, references, leaf_size, start: binary.root, nodes, leaves, root: NONE }
    }

    /// Makes the wide tree. False if it would be too deep.
    pub(super) fn emit(&mut self) -> bool {
        match self.emit_below(self.start, 1) {
            Some(root) => self.root = root,
            None => return false,
        }
        true
    }

    /// Appends the wide subtree of a binary node and returns its child word. Recursion is as deep as the tree: bounded.
    fn emit_below(&mut self, number: u32, depth: usize) -> Option<u32> {
        let node = &self.binary[number as usize];
        let leaf_cost = node.bounds.half_area() * LEAF_COST;
        if node.is_leaf() || (node.count as usize <= self.leaf_size && leaf_cost <= node.costs[0]) {
            self.gather(number);
            self.leaves.ends.push(self.leaves.members.len() as u32);
            return Some(LEAF | (self.leaves.ends.len() as u32 - 1));
        }
        if depth > MAX_DEPTH {
            return None;
        }
        let mut forest = Forest { roots: [0; WIDTH], len: 0 };
        self.forest(number, WIDTH, &mut forest);
        let roots = &mut forest.roots[..forest.len];
        self.sort(roots);
        let at = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        for (slot, &mut root) in roots.iter_mut().enumerate() {
            self.nodes[at].children[slot] = self.emit_below(root, depth + 1)?;
        }
        Some(at as u32)
    }

    /// The best wide subtrees below a node if it may have `roots` of them.
    fn forest(&self, number: u32, roots: usize, out: &mut Forest) {
        let node = &self.binary[number as usize];
        let mut roots = roots;
        // The smallest number of roots with the same cost.
        while roots > 1 && roots < WIDTH && node.costs[roots - 1] >= node.costs[roots - 2] {
            roots -= 1;
        }
        if roots == 1 || node.is_leaf() {
            out.roots[out.len] = number;
            out.len += 1;
            return;
        }
        let [left, right] = node.children;
        let (l, r) = (&self.binary[left as usize].costs, &self.binary[right as usize].costs);
        let mut best = (1, l[0] + r[roots - 2]);
        for k in 2..roots {
            let cost = l[k - 1] + r[roots - k - 1];
            if cost < best.1 {
                best = (k, cost);
            }
        }
        self.forest(left, best.0, out);
        self.forest(right, roots - best.0, out);
    }

    /// Sorts the children of a node for rays of occlusion. These take the first child first and then the others from the
    /// last one on, whatever the distances. A child with a large area for each of its boxes comes first: the boxes are
    /// probably large, and a test of few boxes probably ends the ray.
    fn sort(&self, roots: &mut [u32]) {
        let area = |number: &u32| {
            let node = &self.binary[*number as usize];
            node.bounds.half_area() / node.count as f32
        };
        roots.sort_by(|a, b| area(b).total_cmp(&area(a)));
        roots[1..].reverse();
    }

    /// Appends the boxes below a node to the members of the last leaf.
    fn gather(&mut self, number: u32) {
        let node = self.binary[number as usize];
        let [left, right] = node.children;
        if node.is_leaf() {
            let boxes = &self.references[right as usize..][..node.count as usize];
            self.leaves.members.extend(boxes.iter().map(Reference::number));
        } else {
            self.gather(left);
            self.gather(right);
        }
    }
}

/// Roots of wide subtrees.
struct Forest {
    roots: [u32; WIDTH],
    len: usize,
}
