//! Closed bodies between two heights above a surface: the hollows of clear solids.

use super::patch::Patch;
use super::surface::LocalSurface;
use dunkelfeld_geometry::{DVec3, Mesh};
use std::collections::HashSet;

/// The closed mesh between the heights `top` and `bottom` \[m\] above the points of a patch. The top has the normals of
/// the surface, the bottom the unit normals `normal`, which point out of the surface too. At the boundary of the patch
/// both sheets meet, or a wall connects them.
pub(super) fn closed(
    patch: &Patch,
    surface: &LocalSurface<'_>,
    top: impl Fn(usize) -> f64,
    bottom: impl Fn(usize) -> f64,
    normal: impl Fn(usize) -> DVec3,
) -> Mesh {
    let (mut mesh, _) = patch.mesh(surface, None, top, |i| patch.feet[i].normal);
    let (lower, _) = patch.mesh(surface, None, bottom, |i| -normal(i));
    let count = mesh.positions.len() as u32;
    mesh.positions.extend(&lower.positions);
    mesh.normals.extend(&lower.normals);
    let edges = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let directed: HashSet<[u32; 2]> = patch.triangles.iter().flat_map(edges).collect();
    mesh.triangles.extend(lower.triangles.iter().map(|[a, b, c]| [count + a, count + c, count + b]));
    // In the order of the triangles, so that the result does not depend on the order of the set. Walls have vertices of
    // their own, because they meet the sheets at edges.
    for [a, b] in patch.triangles.iter().flat_map(edges).filter(|[a, b]| !directed.contains(&[*b, *a])) {
        let [a, b] = [a, b].map(|i| i as usize);
        let corners = [lower.positions[a], lower.positions[b], mesh.positions[b], mesh.positions[a]];
        let diagonals = [corners[2] - corners[0], corners[3] - corners[1]].map(|d| d.as_dvec3());
        let outward = diagonals[0].cross(diagonals[1]).normalize_or_zero().as_vec3();
        let first = mesh.positions.len() as u32;
        if corners[1] != corners[2] {
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        if corners[3] != corners[0] {
            mesh.triangles.push([first, first + 2, first + 3]);
        }
        if mesh.triangles.last().is_some_and(|t| t[0] == first) {
            mesh.positions.extend(corners);
            mesh.normals.extend([outward; 4]);
        }
    }
    mesh
}
