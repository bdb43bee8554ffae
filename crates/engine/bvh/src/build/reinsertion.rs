//! Reinsertion of the largest nodes (Meister & Bittner 2018b) by obvhs.
//!
//! A split by the surface area heuristic does not see that a large box among many small ones is cheaper near the root.
//! Reinsertion moves it there. Only the nodes above a cut through the tree are moved: the largest ones decide most about
//! the cost, and obvhs takes as long for all others as the rest of the build.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3A;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;

use super::split::{Binary, BinaryNode};

/// Number of subtrees below the cut.
const SUBTREES: usize = 1 << 15;
/// Nodes that are tried in the first pass, as a fraction of those above the cut. Pass k tries one (2 k + 1)-th of them.
const TRIED: f32 = 0.2;
/// Number of passes.
const PASSES: usize = 16;
/// No pass begins on a deeper tree: obvhs has a stack for 190 levels.
const MAX_LEVELS: usize = 128;

/// Moves the largest nodes of a tree where they cost least. The nodes above them are made anew.
pub(super) fn reinsert_largest(binary: &mut Binary, leaf_size: usize) {
    let Some((mut above, subtrees)) = cut(binary) else { return };
    let mut optimizer = ReinsertionOptimizer::default();
    for pass in 0..PASSES {
        if levels(&above) > MAX_LEVELS {
            break;
        }
        optimizer.run(&mut above, TRIED, Some(vec![1.0 / (2 * pass + 1) as f32]));
    }
    let mut numbers = vec![0; above.nodes.len()];
    for at in parents_first(&above).into_iter().rev() {
        let node = &above.nodes[at as usize];
        numbers[at as usize] = if node.is_leaf() {
            subtrees[node.first_index as usize]
        } else {
            let children = [0, 1].map(|side| numbers[node.first_index as usize + side]);
            binary.nodes.push(BinaryNode::above(&binary.nodes, children, leaf_size));
            binary.nodes.len() as u32 - 1
        };
    }
    binary.root = numbers[0];
}

/// The tree above the cut, and the nodes of the binary tree that its leaves stand for. None if there is nothing to move.
///
/// The cut is made by division of the largest node until there are enough. So the nodes are in about the order of their
/// areas, as obvhs needs it.
fn cut(binary: &Binary) -> Option<(Bvh2, Vec<u32>)> {
    let mut numbers = vec![binary.root];
    let mut above = Bvh2::default();
    above.nodes.push(subtree(binary, binary.root, 0));
    // The bits of areas are in the order of areas, because these are not negative.
    let area = |number: u32| binary.nodes[number as usize].bounds.half_area().to_bits();
    let mut largest = BinaryHeap::from([(area(binary.root), Reverse(0))]);
    let mut subtrees = 1;
    while subtrees < SUBTREES {
        let Some((_, Reverse(at))) = largest.pop() else { break };
        let node = &binary.nodes[numbers[at] as usize];
        if node.is_leaf() {
            continue;
        }
        above.nodes[at].make_inner(numbers.len() as u32);
        for child in node.children {
            largest.push((area(child), Reverse(numbers.len())));
            above.nodes.push(subtree(binary, child, numbers.len()));
            numbers.push(child);
        }
        subtrees += 1;
    }
    // Three leaves are the fewest that can be ordered in more than one way.
    if subtrees < 3 {
        return None;
    }
    above.primitive_indices = (0..numbers.len() as u32).collect();
    Some((above, numbers))
}

/// A subtree below the cut: a leaf of obvhs with the place of its number.
fn subtree(binary: &Binary, number: u32, place: usize) -> Bvh2Node {
    let bounds = &binary.nodes[number as usize].bounds;
    Bvh2Node::new(obvhs::aabb::Aabb::new(Vec3A::from(bounds.min), Vec3A::from(bounds.max)), 1, place as u32)
}

/// The nodes, each before its children.
fn parents_first(tree: &Bvh2) -> Vec<u32> {
    let mut order = Vec::with_capacity(tree.nodes.len());
    let mut work = vec![0];
    while let Some(at) = work.pop() {
        order.push(at);
        let node = &tree.nodes[at as usize];
        if !node.is_leaf() {
            work.extend([node.first_index, node.first_index + 1]);
        }
    }
    order
}

/// Number of levels.
fn levels(tree: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut work = vec![(0, 1)];
    while let Some((at, level)) = work.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[at as usize];
        if !node.is_leaf() {
            work.extend([(node.first_index, level + 1), (node.first_index + 1, level + 1)]);
        }
    }
    deepest
}
