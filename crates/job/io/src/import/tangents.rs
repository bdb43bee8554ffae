//! Tangents for materials that need them in files without tangents: MikkTSpace (Mikkelsen, 2008), as glTF prescribes.

use bevy_mikktspace::{Geometry, TangentSpace};
use dunkelfeld_geometry::{Mesh, Vec2, Vec4};
use std::collections::HashMap;

/// Fills `mesh.tangents` from its texture coordinates `uv`, one per vertex. Vertices whose corners get different
/// tangents are split; a mesh without normals, which is shaded flat, is split at every corner.
///
/// Returns `false`, and does not change the mesh, if the tangents cannot be computed: coordinates are missing, or one
/// vertex belongs to more than 2048 triangles.
pub(crate) fn generate(mesh: &mut Mesh, uv: &[Vec2]) -> bool {
    if uv.len() != mesh.positions.len() || mesh.triangles.is_empty() {
        return false;
    }
    // Triangles of equal corners are never hit, but the search for a neighbour to copy from is quadratic in them.
    let whole = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        a != b && b != c && c != a
    };
    let faces = (0..mesh.triangles.len()).filter(|f| whole(&mesh.triangles[*f])).collect();
    let mut corners = Corners { mesh, uv, faces, tangents: vec![[1.0, 0.0, 0.0, 1.0]; 3 * mesh.triangles.len()] };
    if corners.largest_fan() > LARGEST_FAN {
        return false;
    }
    if bevy_mikktspace::generate_tangents(&mut corners).is_err() {
        return false;
    }
    let tangents = corners.tangents;
    split(mesh, &tangents);
    true
}

/// Triangles around one vertex are gathered by recursion and compared pair by pair: without a bound a large fan would
/// exhaust stack and time.
const LARGEST_FAN: usize = 2048;

struct Corners<'a> {
    mesh: &'a Mesh,
    uv: &'a [Vec2],
    /// The triangles that are used.
    faces: Vec<usize>,
    tangents: Vec<[f32; 4]>,
}

impl Corners<'_> {
    fn index(&self, face: usize, vertex: usize) -> usize {
        self.mesh.triangles[self.faces[face]][vertex] as usize
    }

    /// The largest number of triangles at a vertex. Vertices of equal position, normal and coordinates count as one.
    fn largest_fan(&self) -> usize {
        let mut fans: HashMap<[u32; 8], usize> = HashMap::new();
        for (face, vertex) in (0..self.faces.len()).flat_map(|f| (0..3).map(move |v| (f, v))) {
            let [x, y, z] = self.position(face, vertex);
            let [nx, ny, nz] = self.normal(face, vertex);
            let [u, v] = self.tex_coord(face, vertex);
            *fans.entry([x, y, z, nx, ny, nz, u, v].map(f32::to_bits)).or_default() += 1;
        }
        fans.into_values().max().unwrap_or(0)
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.faces.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.mesh.positions[self.index(face, vertex)].to_array()
    }

    fn normal(&self, face: usize, vertex: usize) -> [f32; 3] {
        if self.mesh.normals.is_empty() {
            let [a, b, c] = self.mesh.corners(self.faces[face]);
            return (b - a).cross(c - a).normalize_or_zero().to_array();
        }
        self.mesh.normals[self.index(face, vertex)].to_array()
    }

    fn tex_coord(&self, face: usize, vertex: usize) -> [f32; 2] {
        // In glTF v points down in the image while the green of a normal map points up, so the bitangent is opposite to
        // v.
        let uv = self.uv[self.index(face, vertex)];
        [uv.x, 1.0 - uv.y]
    }

    fn set_tangent(&mut self, tangent_space: Option<TangentSpace>, face: usize, vertex: usize) {
        let tangent = tangent_space.unwrap_or_default().tangent_encoded();
        if tangent.iter().all(|v| v.is_finite()) && tangent[..3].iter().any(|v| *v != 0.0) {
            self.tangents[3 * self.faces[face] + vertex] = tangent;
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
