//! An indexed triangle mesh in its own object space.

use glam::{Vec2, Vec3, Vec4};

/// Triangles over shared vertices. Every attribute is either empty or as long as `positions`.
///
/// A front face winds counter-clockwise on the side of its geometric normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions \[m\], object space.
    pub positions: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Unit vertex normals; empty means flat shading.
    pub normals: Vec<Vec3>,
    /// Vertex tangents: xyz unit tangent, w = +1 or -1, the sign of the bitangent (glTF). May be empty.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates, sets 0 and 1, origin at the image's top left (glTF). May be empty.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours with alpha; multiply the base colour. May be empty.
    pub colors: Vec<Vec4>,
}

impl Mesh {
    /// Memory of the vertices and triangles \[bytes\].
    pub fn bytes(&self) -> usize {
        let Self { positions, triangles, normals, tangents, uvs, colors } = self;
        size_of_val(&**positions)
            + size_of_val(&**triangles)
            + size_of_val(&**normals)
            + size_of_val(&**tangents)
            + size_of_val(&*uvs[0])
            + size_of_val(&*uvs[1])
            + size_of_val(&**colors)
    }

    /// The three corner positions of a triangle.
    ///
    /// # Panics
    /// If `triangle` or one of its indices is out of range; meshes in a built scene are validated.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }
}
