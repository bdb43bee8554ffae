//! Construction of a tree: boxes are split from the top down into a binary tree, which is then collapsed into nodes of
//! eight.
//!
//! The binary tree comes from splits by the binned surface area heuristic (Wald 2007), with the sizes of boxes as a fourth
//! axis ([`split`]). Then the largest nodes are reinserted where they cost least (Meister & Bittner 2018b;
//! [`reinsertion`]). The collapse is optimal for the surface area heuristic (Ylitie, Karras & Laine 2017; [`collapse`]).
//! All is deterministic and single-threaded, with the same bits on every instruction set.
//!
//! Boxes are scaled by a power of two, so that no area overflows or vanishes. The boxes of the nodes come from the boxes
//! that were not scaled. If the tree is too deep for a fixed stack, it is built again with fewer levels.

mod collapse;
mod reinsertion;
mod split;

use dunkelfeld_geometry::Aabb;
use fearless_simd::Level;
use glam::Vec3;

use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Tree};
use collapse::Collapse;
use reinsertion::reinsert_largest;
use split::{Reference, Splitter};

/// Maximum number of levels of the binary tree at first. Trees of ordinary scenes have 20 to 50.
const LEVELS: usize = 96;

/// Builds a tree over boxes. `make_leaf` receives the numbers of up to `leaf_size` (at most eight) boxes and returns
/// the payload (below 2^31) of their leaf. All boxes must be finite and not empty.
pub(crate) fn build_tree(boxes: &[Aabb], leaf_size: usize, make_leaf: impl FnMut(&[u32]) -> u32) -> Tree {
    build_tree_for(Level::new(), boxes, leaf_size, make_leaf)
}

/// [`build_tree`] by the instructions of a level.
fn build_tree_for(level: Level, boxes: &[Aabb], leaf_size: usize, mut make_leaf: impl FnMut(&[u32]) -> u32) -> Tree {
    if boxes.is_empty() {
        return Tree::EMPTY;
    }
    let mut references = references(boxes);
    let splitter = Splitter { level, leaf_size };
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
    let mut tree = Tree { nodes, root, bounds: Aabb::EMPTY };
    let filled: Vec<(u32, Aabb)> = leaves
        .iter()
        .map(|members| {
            let bounds = members.iter().fold(Aabb::EMPTY, |all, &i| all.union(boxes[i as usize]));
            (LEAF | make_leaf(members), bounds)
        })
        .collect();
    fill_nodes(&mut tree, &filled);
    tree
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

    /// The leaves of a tree with the number of nodes above each.
    fn leaves(tree: &Tree) -> Vec<(u32, usize)> {
        let mut found = Vec::new();
        let mut work = vec![(tree.root, 0)];
        while let Some((word, depth)) = work.pop() {
            if word & LEAF == 0 {
                work.extend(tree.nodes[word as usize].children.map(|child| (child, depth + 1)));
            } else if word != NONE {
                found.push((word & !LEAF, depth));
            }
        }
        found
    }

    #[test]
    fn all_instruction_sets_give_the_same_tree() {
        let boxes = random_boxes(20_000);
        let build = |level: Level, leaf_size: usize| {
            let mut members = Vec::new();
            let tree = build_tree_for(level, &boxes, leaf_size, |leaf| {
                members.push(leaf.to_vec());
                members.len() as u32 - 1
            });
            let nodes = tree.nodes.iter().map(|n| (n.bounds.map(|side| side.map(f32::to_bits)), n.children));
            (nodes.collect::<Vec<_>>(), members)
        };
        for leaf_size in [1, 8] {
            let plain = build(Level::fallback(), leaf_size);
            for level in levels() {
                assert!(build(level, leaf_size) == plain, "{level:?} differs from plain Rust");
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
        let mut clusters = BTreeSet::new();
        let tree = build_tree(&boxes, 8, |leaf| {
            assert_eq!(leaf.len(), 8);
            let of_leaf: BTreeSet<u32> = leaf.iter().map(|i| i * 5 % 64 / 8).collect();
            assert_eq!(of_leaf.len(), 1, "a leaf has boxes of several clusters");
            clusters.extend(of_leaf.iter().copied());
            clusters.len() as u32 - 1
        });
        assert_eq!((tree.nodes.len(), clusters.len()), (1, 8));
        assert_eq!(tree.bounds, Aabb { min: Vec3::ZERO, max: Vec3::new(7001.0, 8.0, 1.0) });
    }

    #[test]
    fn large_boxes_among_small_ones_are_near_the_root() {
        // A room of six walls with a dense grid of small boxes in the middle, in which the walls have their centres.
        let mut boxes: Vec<Aabb> = (0..17 * 17 * 17)
            .map(|i| {
                let corner = Vec3::new((i % 17) as f32, (i / 17 % 17) as f32, (i / 289) as f32) * 0.01 - 0.085;
                Aabb { min: corner, max: corner + 0.01 }
            })
            .collect();
        let first_wall = boxes.len() as u32;
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let mut wall = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };
                (wall.min[axis], wall.max[axis]) = (side, side);
                boxes.push(wall);
            }
        }
        let mut has_wall = Vec::new();
        let tree = build_tree(&boxes, 8, |leaf| {
            has_wall.push(leaf.iter().any(|&i| i >= first_wall));
            has_wall.len() as u32 - 1
        });
        let walls: Vec<usize> =
            leaves(&tree).iter().filter(|(leaf, _)| has_wall[*leaf as usize]).map(|l| l.1).collect();
        assert!(!walls.is_empty() && walls.iter().all(|&depth| depth == 1), "nodes above the walls: {walls:?}");
    }

    #[test]
    fn a_binary_tree_has_no_more_levels_than_it_may_have() {
        let boxes = random_boxes(1000);
        for levels in [10, 11, 14, 96] {
            let binary = Splitter { level: Level::new(), leaf_size: 1 }.build(&mut references(&boxes), levels);
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
