//! The node hierarchy: global transforms in f64, and the nodes of the selected scene.

use super::document::Document;
use super::extensions::Transform;
use crate::error::InputError;
use crate::import::warnings::Warnings;
use dunkelfeld_geometry::{DAffine3, DMat3, DQuat, DVec3};
use gltf::json::Index;
use std::path::Path;

/// The transforms of all nodes, and the nodes of the scene.
pub(super) struct Hierarchy {
    /// Node to world, of every node of the file, in the scene or not (joints need not be in the scene).
    pub(super) to_world: Vec<DAffine3>,
    /// The nodes of the scene, parents before children, each once.
    pub(super) shown: Vec<usize>,
}

/// Text for a node in messages.
pub(super) fn node_place(document: &Document, index: usize) -> String {
    match document.root.nodes.get(index).and_then(|n| n.name.as_deref()) {
        Some(name) => format!("node {index} \"{name}\""),
        None => format!("node {index}"),
    }
}

/// Resolves the hierarchy with the given transforms of the nodes. A node with several parents keeps the first. A cycle is cut at its first node. Both cause
/// warnings, and no traversal visits a node twice.
pub(super) fn resolve(
    document: &Document,
    transforms: &[Transform],
    scene: Option<usize>,
    path: &Path,
    warnings: &mut Warnings,
) -> Result<Hierarchy, InputError> {
    let nodes = &document.root.nodes;
    let mut parent = vec![None; nodes.len()];
    let mut children = vec![Vec::new(); nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for child in node.children.iter().flatten().map(Index::value) {
            match parent.get_mut(child) {
                None => warnings.push(node_place(document, i), format!("its child {child} does not exist")),
                Some(slot @ None) => {
                    *slot = Some(i);
                    children[i].push(child);
                }
                Some(Some(first)) => {
                    let message = format!("node {child} is already a child of node {first} and is left there");
                    warnings.push(node_place(document, i), message);
                }
            }
        }
    }
    let mut local: Vec<_> = transforms.iter().enumerate().map(|(i, t)| local(t, document, i, warnings)).collect();
    local.resize(nodes.len(), DAffine3::IDENTITY);
    let mut to_world = vec![DAffine3::IDENTITY; nodes.len()];
    let mut visited = vec![false; nodes.len()];
    // Every node has at most one parent. So a node that no root reaches is on or below a cycle.
    for pass in 0..2 {
        for root in 0..nodes.len() {
            if visited[root] || (pass == 0 && parent[root].is_some()) {
                continue;
            }
            if pass == 1 {
                warnings.push(node_place(document, root), "it is its own ancestor; the cycle is cut here");
            }
            let mut stack = vec![(root, DAffine3::IDENTITY)];
            while let Some((i, above)) = stack.pop() {
                if std::mem::replace(&mut visited[i], true) {
                    continue;
                }
                to_world[i] = above * local[i];
                stack.extend(children[i].iter().map(|c| (*c, to_world[i])));
            }
        }
    }
    let mut stack = scene_roots(document, &parent, scene, path, warnings)?;
    stack.reverse();
    let mut shown = Vec::new();
    let mut seen = vec![false; nodes.len()];
    while let Some(i) = stack.pop() {
        let hidden = document.untyped.nodes.get(i).is_some_and(|n| !n.extensions.visibility.visible);
        if hidden || std::mem::replace(&mut seen[i], true) {
            continue;
        }
        shown.push(i);
        stack.extend(children[i].iter().rev());
    }
    Ok(Hierarchy { to_world, shown })
}

/// The requested scene, else the default one, else the first, else every root.
fn scene_roots(
    document: &Document,
    parent: &[Option<usize>],
    wanted: Option<usize>,
    path: &Path,
    warnings: &mut Warnings,
) -> Result<Vec<usize>, InputError> {
    let root = &document.root;
    let count = root.scenes.len();
    if let Some(wanted) = wanted.filter(|w| *w >= count) {
        return Err(InputError::new(
            path,
            "scenes",
            format!("scene {wanted} was requested, but the file has {count}"),
            "request a scene that exists (the first is 0), or none",
        ));
    }
    let default = root.scene.map(|s| s.value());
    if let Some(missing) = default.filter(|d| *d >= count && wanted.is_none()) {
        warnings.push("scene", format!("the default scene {missing} does not exist"));
    }
    let index = wanted.or(default.filter(|d| *d < count)).unwrap_or(0);
    if wanted.is_none() && root.scene.is_none() && count > 1 {
        warnings.push("scenes", format!("the file has {count} scenes and no default; the first is shown"));
    }
    let Some(scene) = root.scenes.get(index) else {
        let mut roots: Vec<usize> = (0..parent.len()).filter(|i| parent[*i].is_none()).collect();
        if roots.is_empty() {
            roots.extend((!parent.is_empty()).then_some(0));
        }
        return Ok(roots);
    };
    let (roots, missing): (Vec<_>, Vec<_>) = scene.nodes.iter().map(Index::value).partition(|n| *n < parent.len());
    for node in missing {
        warnings.push(format!("scene {index}"), format!("its node {node} does not exist"));
    }
    Ok(roots)
}

/// A node's own transform: its matrix, or translation * rotation * scale (glTF 2.0, section 3.5.3).
fn local(node: &Transform, document: &Document, index: usize, warnings: &mut Warnings) -> DAffine3 {
    if let Some(m) = &node.matrix {
        if [m[3], m[7], m[11]] != [0.0; 3] || m[15] != 1.0 {
            warnings.push(node_place(document, index), "its matrix is not affine; the last row is taken as 0 0 0 1");
        }
        let column = |c: usize| DVec3::new(m[c], m[c + 1], m[c + 2]);
        return DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12));
    }
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    let rotation = if length > 0.0 && length.is_finite() {
        rotation.normalize()
    } else {
        warnings.push(node_place(document, index), "its rotation is no quaternion of length above 0; it is left out");
        DQuat::IDENTITY
    };
    let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
    let translation = DVec3::from_array(node.translation.unwrap_or([0.0; 3]));
    DAffine3::from_scale_rotation_translation(scale, rotation, translation)
}

/// Is the transform invertible in both f32 and f64?
pub(super) fn is_invertible(transform: &DAffine3) -> bool {
    let determinant = transform.matrix3.determinant();
    transform.is_finite() && determinant != 0.0 && determinant.is_finite() && transform.inverse().is_finite()
}
