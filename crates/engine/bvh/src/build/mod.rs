//! Construction of a tree: boxes are split from the top down into a binary tree, which is then collapsed into nodes of
//! eight.
//!
//! The binary tree comes from splits by the binned surface area heuristic (Wald 2007), with the sizes of boxes as a fourth
//! axis ([`split`]). Then the largest nodes are reinserted where they cost least (Meister & Bittner 2018b;
//! [`reinsertion`]). The collapse is optimal for the surface area heuristic (Ylitie, Karras & Laine 2017; [`collapse`]).
//! All is deterministic, with the same bits on every instruction set and any number of threads ([`subtrees`]).
//!
//! Boxes are scaled by a power of two, so that no area overflows or vanishes. The boxes of the nodes come from the boxes
//! that were not scaled. If the tree is too deep for a fixed stack, it is built again with fewer levels.

mod collapse;
mod reinsertion;
mod split;
mod subtrees;

use dunkelfeld_geometry::{Aabb, Threads};
use fearless_simd::Level;
use glam::Vec3;

use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Node, Tree};
use collapse::{Collapse, Leaves};
use reinsertion::reinsert_largest;
use split::{Reference, Splitter};

/// Maximum number of levels of the binary tree at first. Trees of ordinary scenes have 20 to 50.
const LEVELS: usize = 96;

/// Number of boxes, and of leaves, of a task. It does not depend on the number of threads.
pub(crate) const CHUNK: usize = 1 << 13;

/// Builds a tree over boxes by the instructions of a level, with leaves of up to `leaf_size` (at most eight) boxes. `payload`
/// receives the number of a leaf and those of its boxes, and returns its payload (below 2^31). All boxes must be finite and
/// not empty.
pub(crate) fn build_tree(
    level: Level,
    threads: Threads,
    boxes: &[Aabb],
    leaf_size: usize,
    payload: impl Fn(u32, &[u32]) -> u32 + Sync,
) -> (Tree, Leaves) {
    if boxes.is_empty() {
        return (Tree::EMPTY, Leaves::default());
    }
    let threads = if boxes.len() < Threads::LARGE { Threads::ONE } else { threads };
    let (nodes, leaves, root) = wide_tree(&Splitter { level, leaf_size, threads }, boxes);
    let mut tree = Tree { nodes, root, ..Tree::EMPTY };
    let filled = leaves.map(threads, |number, members| {
        let bounds = members.iter().fold(Aabb::EMPTY, |all, &i| all.union(boxes[i as usize]));
        (LEAF | payload(number, members), bounds)
    });
    fill_nodes(&mut tree, &filled);
    (tree, leaves)
}

/// The nodes without their boxes, the leaves, and the child word of the root.
fn wide_tree(splitter: &Splitter, boxes: &[Aabb]) -> (Vec<Node>, Leaves, u32) {
    let leaf_size = splitter.leaf_size;
    let mut references = references(boxes);
    let mut binary = splitter.build(&mut references, LEVELS);
    reinsert_largest(&mut binary, leaf_size);
    let mut collapsed = Collapse::new(&binary, &references, leaf_size);
    if !collapsed.emit() {
        binary = splitter.build(&mut references, MAX_DEPTH);
        collapsed = Collapse::new(&binary, &references, leaf_size);
        collapsed.emit();
    }
    let Collapse { mut nodes, leaves, root, .. } = collapsed;
    nodes.shrink_to_fit();
    (nodes, leaves, root)
}

/// Gives the nodes of a tree their boxes, and the words of their leaves. The leaves have their numbers instead, and each
/// node is before its children.
fn fill_nodes(tree: &mut Tree, leaves: &[(u32, Aabb)]) {
    let mut bounds = vec![Aabb::EMPTY; tree.nodes.len()];
    let filled = |word: u32, bounds: &[Aabb]| match word & LEAF {
        0 => (word, bounds[word as usize]),
        _ => leaves[(word & !LEAF) as usize],
    };
    for at in (0..tree.nodes.len()).rev() {
        let node = &mut tree.nodes[at];
        for slot in 0..WIDTH {
            let word = node.children[slot];
            if word != NONE {
                let (word, child) = filled(word, &bounds);
                node.set(slot, &child, word);
                bounds[at] = bounds[at].union(child);
            }
        }
    }
    (tree.root, tree.bounds) = filled(tree.root, &bounds);
}

/// The boxes around their common centre, scaled by a power of two so that the largest coordinate is about one.
fn references(boxes: &[Aabb]) -> Vec<Reference> {
    let all = boxes.iter().fold(Aabb::EMPTY, |all, b| all.union(*b));
    let middle = all.center();
    let half = (0.5 * all.max - 0.5 * all.min).max_element().max(f32::MIN_POSITIVE);
    // By exponents: the factor may exceed the range of f32, its square root does not.
    let root = (f64::from(half).log2().floor() * -0.5).exp2() as f32;
    let scale = |v: Vec3| (v - middle) * root * root;
    let scaled = boxes.iter().map(|b| Aabb { min: scale(b.min), max: scale(b.max) });
    (0..).zip(scaled).map(|(number, b)| Reference::new(&b, number)).collect()
}
