//! The data of a triangle that an intersection needs, in one record.
//!
//! A path hits triangles all over the scene. With separate arrays for indices, positions, normals and parts, a hit
//! would wait for memory four times in a row. With one record it waits once.

use dunkelfeld_geometry::{Mesh, Vec3, geometric_normal};

/// The data of a triangle for intersection and shading, in its mesh's own space.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Facet {
    /// The corners [m].
    pub(crate) corners: [Vec3; 3],
    /// Unit normal by the winding.
    pub(crate) normal: Vec3,
    /// Normals of the corners; the geometric normal if the mesh has none.
    pub(crate) normals: [Vec3; 3],
    /// The part it belongs to, if its mesh is stored in render space.
    pub(crate) part: u32,
    /// True if it has normals of its own at the corners.
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
