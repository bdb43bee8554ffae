//! The binary tree of packets: its inner nodes have two boxes, and its leaves a few triangles of a block.
//!
//! It refines the tree of [`Node`](crate::tree::Node)s: the children of a node are divided by the surface area heuristic, and
//! so are the triangles of a block. A packet tests two boxes at a time, and continues only below those that its rays enter.

use dunkelfeld_geometry::Aabb;

use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Node, moved};
use crate::triangle_block::TriangleBlock;

/// Maximum number of pairs from the root to a leaf: those of a block, and those of the children of each node.
pub(crate) const MAX_LEVELS: usize = (MAX_DEPTH + 1) * (WIDTH - 1);
/// Maximum number of triangles of a leaf.
const TRIANGLES: usize = 4;
/// Cost of a pair in units of a triangle: the least times on the stations and on a mesh of 1 M triangles.
const PAIR_COST: f32 = 1.6;

/// Two children with their boxes.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Pair {
    /// `bounds[2 axis]` has the lower sides of both, `bounds[2 axis + 1]` the upper ones.
    pub(crate) bounds: [[f32; 2]; 6],
    pub(crate) children: [u32; 2],
    /// Of a child that is a leaf: bits of its triangles.
    pub(crate) triangles: [u8; 2],
    /// Are the children within a block?
    pub(crate) is_block: bool,
    /// The node with these descendants, or [`NONE`].
    pub(crate) node: u32,
}

/// A subtree: the number of a pair, or [`LEAF`] and the payload of a block or an instance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Subtree {
    pub(crate) word: u32,
    /// Bits of the triangles of a leaf.
    pub(crate) triangles: u8,
}

impl Subtree {
    pub(crate) const NONE: Self = Self { word: NONE, triangles: 0 };

    /// The same one in a tree whose pairs begin at `first`, with the number of the part in its payload.
    pub(crate) fn moved(self, first: u32, payload: u32) -> Self {
        Self { word: moved(self.word, first, payload), ..self }
    }
}

impl Pair {
    pub(crate) fn child(&self, number: usize) -> Subtree {
        Subtree { word: self.children[number], triangles: self.triangles[number] }
    }

    pub(crate) fn set_child(&mut self, number: usize, child: Subtree) {
        (self.children[number], self.triangles[number]) = (child.word, child.triangles);
    }

    pub(crate) fn child_bounds(&self, number: usize) -> Aabb {
        Aabb {
            min: [0, 2, 4].map(|side| self.bounds[side][number]).into(),
            max: [1, 3, 5].map(|side| self.bounds[side][number]).into(),
        }
    }

    fn set_bounds(&mut self, number: usize, bounds: &Aabb) {
        for axis in 0..3 {
            self.bounds[2 * axis][number] = bounds.min[axis];
            self.bounds[2 * axis + 1][number] = bounds.max[axis];
        }
    }
}

/// The pairs over the nodes of a tree and the blocks of its leaves. Each pair is before its descendants.
pub(crate) struct Pairs<'a> {
    pub(crate) nodes: &'a [Node],
    pub(crate) blocks: &'a [TriangleBlock],
    pub(crate) pairs: Vec<Pair>,
}

impl Pairs<'_> {
    /// The subtree of a child of a node. Recursion is as deep as the tree: bounded.
    pub(crate) fn of_child(&mut self, word: u32) -> Subtree {
        if word & LEAF == 0 {
            let node = &self.nodes[word as usize];
            let mut children = Set::default();
            for slot in (0..WIDTH).filter(|slot| node.children[*slot] != NONE) {
                children.push(node.child_bounds(slot), node.children[slot]);
            }
            return self.over(children.boxes(), None, word);
        }
        match self.blocks.get((word & !LEAF) as usize) {
            Some(block) => {
                let mut triangles = Set::default();
                for (lane, _, corners) in block.triangles() {
                    triangles.push(Aabb::from_points(corners), lane);
                }
                self.over(triangles.boxes(), Some(word), NONE)
            }
            None => Subtree { word, triangles: 0 },
        }
    }

    /// A subtree over some boxes: children of a node, or triangles of a block, which is the child `block` of a node.
    fn over(&mut self, boxes: &mut [(Aabb, u32)], block: Option<u32>, node: u32) -> Subtree {
        if let (None, [(_, child)]) = (block, &*boxes) {
            return self.of_child(*child);
        }
        let (middle, cost) = divide(boxes);
        if let Some(word) = block
            && (boxes.len() == 1 || boxes.len() <= TRIANGLES && boxes.len() as f32 <= PAIR_COST + cost)
        {
            return Subtree { word, triangles: boxes.iter().fold(0, |bits, (_, lane)| bits | 1 << lane) };
        }
        let at = self.pairs.len();
        self.pairs.push(Pair {
            bounds: [[0.0; 2]; 6],
            children: [NONE; 2],
            triangles: [0; 2],
            is_block: block.is_some(),
            node,
        });
        let (left, right) = boxes.split_at_mut(middle);
        for (number, part) in [left, right].into_iter().enumerate() {
            self.pairs[at].set_bounds(number, &part.iter().fold(Aabb::EMPTY, |all, (b, _)| all.union(*b)));
            let child = self.over(part, block, NONE);
            self.pairs[at].set_child(number, child);
        }
        Subtree { word: at as u32, triangles: 0 }
    }
}

/// Up to eight boxes with their numbers.
struct Set {
    boxes: [(Aabb, u32); WIDTH],
    len: usize,
}

impl Default for Set {
    fn default() -> Self {
        Self { boxes: [(Aabb::EMPTY, 0); WIDTH], len: 0 }
    }
}

impl Set {
    fn push(&mut self, bounds: Aabb, number: u32) {
        self.boxes[self.len] = (bounds, number);
        self.len += 1;
    }

    fn boxes(&mut self) -> &mut [(Aabb, u32)] {
        &mut self.boxes[..self.len]
    }
}

/// Sorts boxes so that the first ones and the others have the least sum of areas times numbers. Returns the number of the
/// first ones, and that sum in units of the area of all.
fn divide(boxes: &mut [(Aabb, u32)]) -> (usize, f32) {
    let center = |(b, _): &(Aabb, u32), axis: usize| b.min[axis] + b.max[axis];
    let mut best = (f32::INFINITY, 0, boxes.len() / 2);
    for axis in 0..3 {
        boxes.sort_by(|a, b| center(a, axis).total_cmp(&center(b, axis)));
        let mut costs = [0.0; WIDTH];
        let mut bounds = Aabb::EMPTY;
        for (i, (b, _)) in boxes.iter().enumerate().rev() {
            bounds = bounds.union(*b);
            costs[i] = bounds.half_area() * (boxes.len() - i) as f32;
        }
        bounds = Aabb::EMPTY;
        for i in 1..boxes.len() {
            bounds = bounds.union(boxes[i - 1].0);
            let cost = bounds.half_area() * i as f32 + costs[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    boxes.sort_by(|a, b| center(a, best.1).total_cmp(&center(b, best.1)));
    let all = boxes.iter().fold(Aabb::EMPTY, |all, (b, _)| all.union(*b)).half_area();
    (best.2, best.0 / all)
}
