//! Objects in the world, and their meshes in render space.

use crate::build::builder::Instance;
use dunkelfeld_geometry::{DAffine3, DMat3, Mesh, Transform, Vec3};

/// An object in the world: its number, the description, and its transform.
pub(crate) type PlacedObject = (u32, Instance, Transform);

/// Moves a mesh to render space. A mirroring transform reverses the winding, so that front faces stay front faces.
pub(crate) fn bake(mesh: &Mesh, to_render: &DAffine3) -> Mesh {
    let mirrored = to_render.matrix3.determinant() < 0.0;
    // The normals are not normalised one by one. Between the corners of a triangle an uneven scale must turn them as in
    // an instance, where they are interpolated first. A common factor keeps them in range.
    let in_range = |m: DMat3| m * (1.0 / m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length()));
    let (linear, normal_matrix) = (in_range(to_render.matrix3), in_range(to_render.matrix3.inverse().transpose()));
    let direction = |m: &DMat3, v: Vec3| (*m * v.as_dvec3()).as_vec3();
    Mesh {
        positions: mesh.positions.iter().map(|p| to_render.transform_point3(p.as_dvec3()).as_vec3()).collect(),
        triangles: mesh.triangles.iter().map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] }).collect(),
        normals: mesh.normals.iter().map(|&n| direction(&normal_matrix, n)).collect(),
        tangents: mesh
            .tangents
            .iter()
            .map(|t| direction(&linear, t.truncate()).extend(if mirrored { -t.w } else { t.w }))
            .collect(),
        uvs: mesh.uvs.clone(),
        colors: mesh.colors.clone(),
    }
}
