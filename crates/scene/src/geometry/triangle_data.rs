//! What a hit needs to know of a triangle, in one place.
//!
//! A path meets triangles all over the scene. Gathered from indices, positions, normals and parts, a hit would wait for
//! memory four times in a row; from here it waits once.

use dunkelfeld_geometry::{Mesh, Vec3, geometric_normal};

/// A triangle as hits and shading see it, in its mesh's own space.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Facet {
    /// The corners [m].
    pub(crate) corners: [Vec3; 3],
    /// Unit normal by the winding.
    pub(crate) normal: Vec3,
    /// Normals of the corners; those of the facet where the mesh has none.
    pub(crate) normals: [Vec3; 3],
    /// The part it belongs to, if its mesh is stored in render space.
    pub(crate) part: u32,
    /// Has it normals of its own at the corners?
    pub(crate) is_smooth: bool,
}

impl Facet {
    /// The triangles of a mesh in their order.
    pub(crate) fn of_mesh(mesh: &Mesh, part: u32) -> impl Iterator<Item = Self> + '_ {
        let is_smooth = !mesh.normals.is_empty();
        mesh.triangles.iter().enumerate().map(move |(t, vertices)| {
            let corners = mesh.corners(t);
            let normal = geometric_normal(&corners);
            let normals = if is_smooth { vertices.map(|v| mesh.normals[v as usize]) } else { [normal; 3] };
            Self { corners, normal, normals, part, is_smooth }
        })
    }
}
