//! Tangents where a material needs them and the file has none: MikkTSpace (Mikkelsen, 2008), as glTF prescribes.

use bevy_mikktspace::{Geometry, TangentSpace};
use dunkelfeld_geometry::{Mesh, Vec2, Vec4};
use std::collections::HashMap;

/// Fills `mesh.tangents` from its texture coordinates `uv`, one per vertex. Vertices whose corners get different
/// tangents are split; a mesh without normals, which is shaded flat, is split at every corner.
///
/// Returns `false`, and leaves the mesh as it is, if the tangents cannot be computed.
pub(super) fn generate(mesh: &mut Mesh, uv: &[Vec2]) -> bool {
    if uv.len() != mesh.positions.len() || mesh.triangles.is_empty() {
        return false;
    }
    let mut corners = Corners { mesh, uv, tangents: vec![[1.0, 0.0, 0.0, 1.0]; 3 * mesh.triangles.len()] };
    if bevy_mikktspace::generate_tangents(&mut corners).is_err() {
        return false;
    }
    let tangents = corners.tangents;
    split(mesh, &tangents);
    true
}

struct Corners<'a> {
    mesh: &'a Mesh,
    uv: &'a [Vec2],
    tangents: Vec<[f32; 4]>,
}

impl Corners<'_> {
    fn index(&self, face: usize, vertex: usize) -> usize {
        self.mesh.triangles[face][vertex] as usize
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.mesh.positions[self.index(face, vertex)].to_array()
    }

    fn normal(&self, face: usize, vertex: usize) -> [f32; 3] {
        if self.mesh.normals.is_empty() {
            let [a, b, c] = self.mesh.corners(face);
            return (b - a).cross(c - a).normalize_or_zero().to_array();
        }
        self.mesh.normals[self.index(face, vertex)].to_array()
    }

    fn tex_coord(&self, face: usize, vertex: usize) -> [f32; 2] {
        // In glTF v points down in the image while a normal map's green points up, so the bitangent runs against v.
        let uv = self.uv[self.index(face, vertex)];
        [uv.x, 1.0 - uv.y]
    }

    fn set_tangent(&mut self, tangent_space: Option<TangentSpace>, face: usize, vertex: usize) {
        let tangent = tangent_space.unwrap_or_default().tangent_encoded();
        if tangent.iter().all(|v| v.is_finite()) && tangent[..3].iter().any(|v| *v != 0.0) {
            self.tangents[3 * face + vertex] = tangent;
        }
    }
}

/// Gives every corner a vertex with its tangent; corners of one vertex that agree keep sharing it.
fn split(mesh: &mut Mesh, corner_tangents: &[[f32; 4]]) {
    let flat = mesh.normals.is_empty();
    let mut seen: HashMap<(u32, [u32; 4], usize), u32> = HashMap::new();
    let mut source = Vec::with_capacity(mesh.positions.len());
    let mut tangents = Vec::with_capacity(mesh.positions.len());
    for (face, triangle) in mesh.triangles.iter_mut().enumerate() {
        for (k, index) in triangle.iter_mut().enumerate() {
            let corner = 3 * face + k;
            let tangent = corner_tangents[corner];
            let key = (*index, tangent.map(f32::to_bits), if flat { corner } else { 0 });
            let new = *seen.entry(key).or_insert(source.len() as u32);
            if new as usize == source.len() {
                source.push(*index as usize);
                tangents.push(Vec4::from_array(tangent));
            }
            *index = new;
        }
    }
    fn gather<T: Copy>(values: &mut Vec<T>, source: &[usize]) {
        if !values.is_empty() {
            *values = source.iter().map(|i| values[*i]).collect();
        }
    }
    gather(&mut mesh.positions, &source);
    gather(&mut mesh.normals, &source);
    gather(&mut mesh.colors, &source);
    mesh.uvs.iter_mut().for_each(|uvs| gather(uvs, &source));
    mesh.tangents = tangents;
}
