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

/// Builds a tree over boxes, with leaves of up to `leaf_size` (at most eight) boxes. `payload` receives the number of a leaf
/// and those of its boxes, and returns its payload (below 2^31). All boxes must be finite and not empty.
pub(crate) fn build_tree(
    threads: Threads,
    boxes: &[Aabb],
    leaf_size: usize,
    payload: impl Fn(u32, &[u32]) -> u32 + Sync,
) -> (Tree, Leaves) {
    build_tree_for(Level::new(), threads, boxes, leaf_size, payload)
}

/// [`build_tree`] by the instructions of a level.
fn build_tree_for(
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::simd8::levels;

    fn unit(random: &mut Pcg64) -> f32 {
        (random.next_u32() >> 8) as f32 / 16_777_216.0
    }

    /// Boxes in a unit cube. Their sizes are from 2^-12 to 1/2, the small ones much more frequent.
    fn random_boxes(count: usize) -> Vec<Aabb> {
        let mut random = Pcg64::seed_from_u64(17);
        (0..count)
            .map(|_| {
                let corner = Vec3::from_array(std::array::from_fn(|_| unit(&mut random)));
                let size = (0.5f32 * unit(&mut random)).powi(6).max(1.0 / 4096.0) * 32.0;
                Aabb { min: corner, max: corner + size * Vec3::from_array(std::array::from_fn(|_| unit(&mut random))) }
            })
            .collect()
    }

    /// Bits of the nodes, and the boxes of the leaves.
    type Bits = (Vec<([[u32; WIDTH]; 6], [u32; WIDTH])>, Vec<Vec<u32>>);

    fn bits(level: Level, threads: usize, boxes: &[Aabb], leaf_size: usize) -> Bits {
        let (tree, leaves) = build_tree_for(level, Threads::new(threads), boxes, leaf_size, |leaf, _| leaf);
        let nodes = tree.nodes.iter().map(|n| (n.bounds.map(|side| side.map(f32::to_bits)), n.children));
        (nodes.collect(), leaves.map(Threads::ONE, |_, members| members.to_vec()))
    }

    #[test]
    fn all_instruction_sets_give_the_same_tree() {
        let boxes = random_boxes(20_000);
        for leaf_size in [1, 8] {
            let plain = bits(Level::fallback(), 1, &boxes, leaf_size);
            for level in levels() {
                assert!(bits(level, 1, &boxes, leaf_size) == plain, "{level:?} differs from plain Rust");
            }
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_tree() {
        // More leaves than one task has; sets that are halved because they have one centre; as few boxes as have several tasks.
        let equal = [Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE }; 20_000];
        let mut mixed = random_boxes(100_000);
        mixed[30_000..50_000].copy_from_slice(&equal);
        for boxes in [&mixed[..], &equal, &random_boxes(Threads::LARGE)] {
            let plain = bits(Level::fallback(), 1, boxes, 8);
            for level in levels() {
                for threads in [2, 3, 8] {
                    assert!(bits(level, threads, boxes, 8) == plain, "{level:?}, {threads} threads: another tree");
                }
            }
        }
    }

    #[test]
    fn clusters_become_the_leaves_of_one_node() {
        // Eight clusters of eight unit cubes, far from each other: any other tree costs more. 5 is prime to 64.
        let boxes: Vec<Aabb> = (0..64)
            .map(|i| {
                let (cluster, place) = (i * 5 % 64 / 8, i * 5 % 8);
                let corner = Vec3::new(1000.0 * cluster as f32, place as f32, 0.0);
                Aabb { min: corner, max: corner + 1.0 }
            })
            .collect();
        let (tree, leaves) = build_tree(Threads::ONE, &boxes, 8, |leaf, _| leaf);
        let clusters_of = |_: u32, leaf: &[u32]| leaf.iter().map(|i| i * 5 % 64 / 8).collect::<BTreeSet<u32>>();
        let of_leaves = leaves.map(Threads::ONE, clusters_of);
        assert!(of_leaves.iter().all(|clusters| clusters.len() == 1), "a leaf has boxes of several clusters");
        let clusters: BTreeSet<u32> = of_leaves.into_iter().flatten().collect();
        assert_eq!((tree.nodes.len(), leaves.len(), clusters.len()), (1, 8, 8));
        assert_eq!(tree.bounds, Aabb { min: Vec3::ZERO, max: Vec3::new(7001.0, 8.0, 1.0) });
    }

    #[test]
    fn a_binary_tree_has_no_more_levels_than_it_may_have() {
        let boxes = random_boxes(1000);
        for levels in [10, 11, 14, 96] {
            let binary = Splitter { level: Level::new(), leaf_size: 1, threads: Threads::ONE }
                .build(&mut references(&boxes), levels);
            let mut depths = vec![0; binary.nodes.len()];
            for at in 0..binary.nodes.len() {
                let node = &binary.nodes[at];
                if !node.is_leaf() {
                    for child in node.children {
                        depths[child as usize] = depths[at] + 1;
                    }
                }
            }
            let deepest = depths.into_iter().max().unwrap();
            assert!(deepest <= levels, "{deepest} levels instead of {levels}");
            assert_eq!(binary.nodes.len(), 1999);
        }
    }
}
