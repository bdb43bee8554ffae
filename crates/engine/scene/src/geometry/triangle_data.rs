//! The data of a triangle that an intersection needs, in one record.
//!
//! A path hits triangles all over the scene. With separate arrays for indices, positions, normals and parts, a hit
//! would wait for memory four times in a row. A record is one line of the cache. Normals of corners have a record of
//! their own, which flat triangles do not need. Records consist of rows of four numbers, which lanes load at once.

use dunkelfeld_geometry::{Mesh, Vec3, geometric_normal};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, V3};

/// The number of the normals of a triangle without normals of its own at the corners.
pub(crate) const FLAT: u32 = u32::MAX;

/// A vector and the bits of an integer.
type Row = [f32; 4];

#[inline(always)]
fn row(v: Vec3, word: u32) -> Row {
    v.extend(f32::from_bits(word)).to_array()
}

#[inline(always)]
fn vector([x, y, z, _]: Row) -> Vec3 {
    Vec3::new(x, y, z)
}

/// The vectors and the integers of one row of records, one for each lane.
macro_rules! load_row {
    ($token:ident, $records:ident, $row:literal) => {{
        let [x, y, z, word] = F::load_rows(
            $token,
            #[inline(always)]
            |lane| &$records[lane].0[$row],
        );
        (V3::new(x, y, z), word.to_bits())
    }};
}

/// A triangle in its mesh's own space. The rows are the three corners \[m\] and the unit normal by the winding. Their
/// integers are the part and its material, if the mesh is stored in render space, the number of the triangle in the
/// part, and that of its normals in [`Facets`], or [`FLAT`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Facet([Row; 4]);

/// [`Facet`] in lanes.
pub(crate) struct FacetLanes<F: Lanes> {
    pub(crate) corners: [V3<F>; 3],
    pub(crate) normal: V3<F>,
    pub(crate) part: F::Word,
    pub(crate) material: F::Word,
    pub(crate) triangle: F::Word,
    pub(crate) normals: F::Word,
}

impl Facet {
    /// A triangle for lanes that are not used.
    pub(crate) const NONE: Self = Self([[0.0; 4]; 4]);

    /// The corners \[m\].
    pub(crate) fn corners(&self) -> [Vec3; 3] {
        let [a, b, c, _] = self.0;
        [vector(a), vector(b), vector(c)]
    }

    /// Unit normal by the winding.
    pub(crate) fn normal(&self) -> Vec3 {
        vector(self.0[3])
    }

    /// The part it belongs to, if its mesh is stored in render space.
    pub(crate) fn part(&self) -> u32 {
        self.0[0][3].to_bits()
    }

    /// The material of this part.
    #[inline(always)]
    pub(crate) fn material(&self) -> u32 {
        self.0[1][3].to_bits()
    }

    /// The number of its normals in [`Facets`], or [`FLAT`].
    pub(crate) fn normals(&self) -> u32 {
        self.0[3][3].to_bits()
    }

    /// The triangles in lanes.
    #[inline(always)]
    pub(crate) fn load<F: Lanes>(token: F::Token, triangles: &[&Self; MAX_WIDTH]) -> FacetLanes<F> {
        let (a, part) = load_row!(token, triangles, 0);
        let (b, material) = load_row!(token, triangles, 1);
        let (c, triangle) = load_row!(token, triangles, 2);
        let (normal, normals) = load_row!(token, triangles, 3);
        FacetLanes { corners: [a, b, c], normal, part, material, triangle, normals }
    }
}

/// Normals of the corners of a triangle. The integers mean nothing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CornerNormals([Row; 3]);

impl CornerNormals {
    /// Normals for lanes that are not used.
    pub(crate) const NONE: Self = Self([[0.0; 4]; 3]);

    /// The normals of the corners.
    pub(crate) fn vectors(&self) -> [Vec3; 3] {
        self.0.map(vector)
    }

    /// The normals of the corners in lanes.
    #[inline(always)]
    pub(crate) fn load<F: Lanes>(token: F::Token, normals: &[&Self; MAX_WIDTH]) -> [V3<F>; 3] {
        [load_row!(token, normals, 0).0, load_row!(token, normals, 1).0, load_row!(token, normals, 2).0]
    }
}

/// The triangles of one or more meshes.
#[derive(Debug, Default)]
pub(crate) struct Facets {
    triangles: Vec<Facet>,
    /// The normals of the triangles that have normals of their own at the corners.
    normals: Vec<CornerNormals>,
}

impl Facets {
    /// The triangles of a mesh.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Self {
        let mut facets = Self::default();
        facets.extend(mesh, u32::MAX, u32::MAX);
        facets
    }

    /// Adds the triangles of a mesh in their order.
    pub(crate) fn extend(&mut self, mesh: &Mesh, part: u32, material: u32) {
        let is_smooth = !mesh.normals.is_empty();
        self.triangles.reserve_exact(mesh.triangles.len());
        for (triangle, vertices) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(triangle);
            let normal = geometric_normal(&[a, b, c]);
            let corners = is_smooth.then(|| vertices.map(|v| mesh.normals[v as usize]));
            let corners = corners.filter(|corners| corners.iter().any(|corner| !is_parallel(*corner, normal)));
            let normals = if corners.is_some() { self.normals.len() as u32 } else { FLAT };
            self.normals.extend(corners.map(|corners| CornerNormals(corners.map(|normal| row(normal, 0)))));
            let facet = [row(a, part), row(b, material), row(c, triangle as u32), row(normal, normals)];
            self.triangles.push(Facet(facet));
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Size in memory \[bytes\].
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.triangles.as_slice()) + size_of_val(self.normals.as_slice())
    }

    /// A triangle by its number.
    #[inline(always)]
    pub(crate) fn triangle(&self, number: u32) -> &Facet {
        &self.triangles[number as usize]
    }

    /// Normals of the corners of a triangle, by their number.
    #[inline(always)]
    pub(crate) fn normals(&self, number: u32) -> &CornerNormals {
        &self.normals[number as usize]
    }
}

/// Is the normal of a corner that of the triangle, up to its side and the rounding of unit vectors in single precision?
/// Files often store the normals of flat faces.
fn is_parallel(corner: Vec3, normal: Vec3) -> bool {
    const ROUNDING: f32 = 1e-6;
    let unit = corner.normalize_or_zero();
    (unit - normal).length().min((unit + normal).length()) <= ROUNDING
}
