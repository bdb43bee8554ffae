//! Validation of the invariants of the structure.

use dunkelfeld_geometry::Aabb;
use std::collections::HashSet;

use crate::pairs::{MAX_LEVELS, Subtree};
use crate::scene::{Bvh, MeshTree};
use crate::simd8::WIDTH;
use crate::tree::{LEAF, MAX_DEPTH, NONE, Tree};

/// Checks every invariant of both levels. The error contains the first broken one.
pub(crate) fn validate(bvh: &Bvh) -> Result<(), String> {
    for (i, mesh) in bvh.meshes.iter().enumerate() {
        validate_mesh(mesh).map_err(|e| format!("mesh {i}: {e}"))?;
    }
    let mut seen = vec![false; bvh.instances.len()];
    traverse(&bvh.top, |payload, bounds| {
        let instance = bvh.instances.get(payload as usize).ok_or(format!("no instance {payload}"))?;
        if !bounds.encloses(&instance.bounds) {
            return Err(format!("instance {payload} sticks out of its box"));
        }
        once(&mut seen, payload, "instance")
    })
    .map_err(|e| format!("instances: {e}"))?;
    for (i, instance) in bvh.instances.iter().enumerate() {
        if instance.mesh as usize >= bvh.meshes.len() {
            return Err(format!("instance {i} names mesh {}", instance.mesh));
        }
        if !seen[i] && instance.bounds.min.is_finite() && instance.bounds.max.is_finite() {
            return Err(format!("instance {i} is in no leaf"));
        }
    }
    Ok(())
}

fn validate_mesh(mesh: &MeshTree) -> Result<(), String> {
    let mut seen = HashSet::new();
    let mut numbers = Vec::new();
    traverse(&mesh.tree, |payload, bounds| {
        let (block, part) = mesh.block(payload).ok_or(format!("no block {payload}"))?;
        let before = numbers.len();
        for (_, number, corners) in block.triangles() {
            if !bounds.encloses(&Aabb::from_points(corners)) {
                return Err(format!("triangle {number} sticks out of its box"));
            }
            numbers.push((part, number));
        }
        if numbers.len() == before {
            return Err(format!("block {payload} is empty"));
        }
        if seen.insert(payload) { Ok(()) } else { Err(format!("block {payload} is in two leaves")) }
    })?;
    let blocks = mesh.blocks.len() + mesh.parts.iter().map(|part| part.blocks.len()).sum::<usize>();
    if seen.len() != blocks {
        return Err(format!("{} blocks of {blocks} are in leaves", seen.len()));
    }
    let mut of_pairs = Vec::new();
    traverse_pairs(&mesh.tree, |leaf, bounds| {
        let (block, part) = mesh.block(leaf.word & !LEAF).ok_or(format!("pairs: no block {}", leaf.word & !LEAF))?;
        for (lane, number, corners) in block.triangles().filter(|(lane, ..)| leaf.triangles >> lane & 1 == 1) {
            if !bounds.encloses(&Aabb::from_points(corners)) {
                return Err(format!("pairs: triangle {number} in lane {lane} sticks out of its box"));
            }
            of_pairs.push((part, number));
        }
        Ok(())
    })?;
    of_pairs.sort_unstable();
    numbers.sort_unstable();
    if of_pairs != numbers {
        return Err("the leaves of the pairs have other triangles than those of the nodes".into());
    }
    if let Some(twice) = numbers.windows(2).find(|w| w[0] == w[1]) {
        return Err(format!("triangle {:?} is there twice", twice[0]));
    }
    if numbers.len() != mesh.triangles {
        return Err(format!("{} triangles of {} are in leaves", numbers.len(), mesh.triangles));
    }
    Ok(())
}

fn once(seen: &mut [bool], payload: u32, what: &str) -> Result<(), String> {
    if std::mem::replace(&mut seen[payload as usize], true) {
        return Err(format!("{what} {payload} is in two leaves"));
    }
    Ok(())
}

/// Calls `leaf` with each leaf of the pairs and its box.
fn traverse_pairs(tree: &Tree, mut leaf: impl FnMut(Subtree, &Aabb) -> Result<(), String>) -> Result<(), String> {
    let mut work = vec![(tree.first, tree.bounds, 0)];
    while let Some((subtree, bounds, depth)) = work.pop() {
        if subtree.word == NONE {
            continue;
        }
        if subtree.word & LEAF != 0 {
            leaf(subtree, &bounds)?;
            continue;
        }
        let pair = tree.pairs.get(subtree.word as usize).ok_or(format!("no pair {}", subtree.word))?;
        if depth >= MAX_LEVELS {
            return Err(format!("deeper than {MAX_LEVELS} pairs"));
        }
        for child in 0..2 {
            let of_child = pair.child_bounds(child);
            if of_child.is_empty() || !bounds.encloses(&of_child) {
                return Err(format!("pair {}: box {child} is empty or sticks out of its parent", subtree.word));
            }
            work.push((pair.child(child), of_child, depth + 1));
        }
    }
    Ok(())
}

/// Calls `leaf` with each leaf's payload and box, after the check of its nodes.
fn traverse(tree: &Tree, mut leaf: impl FnMut(u32, &Aabb) -> Result<(), String>) -> Result<(), String> {
    if tree.root == NONE {
        return if tree.nodes.is_empty() { Ok(()) } else { Err("nodes without a root".into()) };
    }
    let mut visited = vec![false; tree.nodes.len()];
    let mut work = vec![(tree.root, tree.bounds, 1)];
    while let Some((word, bounds, depth)) = work.pop() {
        if word & LEAF != 0 {
            leaf(word & !LEAF, &bounds)?;
            continue;
        }
        let node = tree.nodes.get(word as usize).ok_or(format!("no node {word}"))?;
        if std::mem::replace(&mut visited[word as usize], true) {
            return Err(format!("node {word} has two parents"));
        }
        if depth > MAX_DEPTH {
            return Err(format!("deeper than {MAX_DEPTH} nodes"));
        }
        let mut union = Aabb::EMPTY;
        for slot in 0..WIDTH {
            let child = node.child_bounds(slot);
            if node.children[slot] == NONE {
                if !child.is_empty() {
                    return Err(format!("node {word}: slot {slot} is unused but has a box"));
                }
                continue;
            }
            if child.is_empty() || !bounds.encloses(&child) {
                return Err(format!("node {word}: box {slot} is empty or sticks out of its parent"));
            }
            union = union.union(child);
            work.push((node.children[slot], child, depth + 1));
        }
        if union != bounds {
            return Err(format!("node {word}: its boxes do not fill their parent's"));
        }
    }
    match visited.iter().position(|v| !v) {
        Some(lost) => Err(format!("node {lost} is not reached")),
        None => Ok(()),
    }
}
