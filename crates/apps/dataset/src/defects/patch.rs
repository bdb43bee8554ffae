//! Meshes that follow a surface: positions above it, and the attributes of the surface below.

use super::surface::{LocalSurface, SurfaceHit};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Vec2};

/// A texture coordinate that differs from that of the neighbouring triangle by more than this multiple of its change
/// over a triangle lies beyond a seam.
const SEAM: f32 = 1.0;

/// Points of a surface and the triangles between them. Triangles wind counter-clockwise from outside.
pub(super) struct Patch {
    /// The points.
    pub(super) feet: Vec<SurfaceHit>,
    /// The triangles.
    pub(super) triangles: Vec<[u32; 3]>,
    /// From the points to the space of the mesh.
    pub(super) frame: DAffine3,
    /// Texture coordinates of its own, of each point, and the set that they replace.
    pub(super) own_uvs: Option<(usize, Vec<Vec2>)>,
}

impl Patch {
    /// A grid of points, row by row. Rows follow each other along the curve, and the columns go from right to left.
    pub(super) fn grid(feet: Vec<SurfaceHit>, columns: usize) -> Self {
        let rows = feet.len() / columns.max(1);
        let at = |r: usize, c: usize| (r * columns + c) as u32;
        let cell = |(r, c): (usize, usize)| {
            [[at(r, c), at(r + 1, c), at(r + 1, c + 1)], [at(r, c), at(r + 1, c + 1), at(r, c + 1)]]
        };
        let cells = (1..rows).flat_map(|r| (1..columns).map(move |c| (r - 1, c - 1)));
        Self { feet, triangles: cells.flat_map(cell).collect(), frame: DAffine3::IDENTITY, own_uvs: None }
    }

    /// A middle point and rings around it, counter-clockwise from outside. Each ring has `spokes` points.
    pub(super) fn disk(feet: Vec<SurfaceHit>, spokes: usize) -> Self {
        let rings = (feet.len().saturating_sub(1)) / spokes.max(1);
        let at = |ring: usize, spoke: usize| (1 + ring * spokes + spoke % spokes) as u32;
        let mut triangles: Vec<_> = (0..spokes).map(|j| [0, at(0, j), at(0, j + 1)]).collect();
        for k in 1..rings {
            for j in 0..spokes {
                let (a, b) = (at(k - 1, j), at(k, j));
                triangles.extend([[a, b, at(k, j + 1)], [a, at(k, j + 1), at(k - 1, j + 1)]]);
            }
        }
        Self { feet, triangles, frame: DAffine3::IDENTITY, own_uvs: None }
    }

    /// The largest height \[m\] of the surface above the triangles between the points, at least 0. `None` if the
    /// surface is not found below a triangle.
    pub(super) fn rise(&self, surface: &LocalSurface<'_>) -> Option<f64> {
        let mut rise = 0.0f64;
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|i| &self.feet[i as usize]);
            let normal = (a.normal + b.normal + c.normal).try_normalize()?;
            let reach = a.point.distance(b.point).max(b.point.distance(c.point)).max(c.point.distance(a.point));
            let middle = (a.point + b.point + c.point) / 3.0;
            for point in [middle, 0.5 * (a.point + b.point), 0.5 * (b.point + c.point), 0.5 * (c.point + a.point)] {
                let hit = surface.project(point, normal, reach)?;
                rise = rise.max((hit.point - point).dot(normal));
            }
        }
        Some(rise)
    }

    /// The mesh at these heights \[m\] above the points, with these unit normals. `source` is the part of the surface
    /// below, index and mesh. If it is given and all points belong to it, the new mesh has its texture coordinates,
    /// colours and tangents. The second result is true if there are texture coordinates.
    pub(super) fn mesh(
        &self,
        surface: &LocalSurface<'_>,
        source: Option<(usize, &Mesh)>,
        height: impl Fn(usize) -> f64,
        normal: impl Fn(usize) -> DVec3,
    ) -> (Mesh, bool) {
        let lifted = |(i, foot): (usize, &SurfaceHit)| {
            self.frame.transform_point3(foot.point + foot.normal * height(i)).as_vec3()
        };
        let to_normal = self.frame.matrix3.inverse().transpose();
        let is_reflected = self.frame.matrix3.determinant() < 0.0;
        let in_frame =
            |n: DVec3| if self.frame == DAffine3::IDENTITY { n } else { (to_normal * n).normalize_or_zero() };
        let mut mesh = Mesh {
            positions: self.feet.iter().enumerate().map(lifted).collect(),
            triangles: self.triangles.clone(),
            normals: (0..self.feet.len()).map(|i| in_frame(normal(i)).as_vec3()).collect(),
            ..Mesh::default()
        };
        if is_reflected {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        if let Some((set, uvs)) = &self.own_uvs {
            mesh.uvs[*set].clone_from(uvs);
        }
        let is_own = |set: usize| self.own_uvs.as_ref().is_some_and(|(own, _)| *own == set);
        let Some((part, below)) = source else { return (mesh, false) };
        if self.feet.iter().any(|f| surface.part_of(f) != part) {
            return (mesh, false);
        }
        let n = below.positions.len();
        if below.colors.len() == n {
            mesh.colors = self.feet.iter().map(|f| surface.color(f)).collect();
        }
        if below.tangents.len() == n {
            mesh.tangents = self.feet.iter().map(|f| surface.tangent(f, &self.frame)).collect();
        }
        for set in 0..2 {
            if below.uvs[set].len() == n && !is_own(set) {
                mesh.uvs[set] = self.feet.iter().map(|f| surface.uv(f.facet, f.weights, set)).collect();
            }
        }
        let sets: Vec<usize> = (0..2).filter(|set| !mesh.uvs[*set].is_empty() && !is_own(*set)).collect();
        self.cut_seams(surface, &mut mesh, &sets);
        let has_uvs = !mesh.uvs[0].is_empty() || !mesh.uvs[1].is_empty();
        (mesh, has_uvs)
    }

    /// Gives each triangle across a seam of the texture coordinates vertices of its own. Their coordinates continue
    /// those of the triangle below its first corner.
    fn cut_seams(&self, surface: &LocalSurface<'_>, mesh: &mut Mesh, sets: &[usize]) {
        for t in 0..mesh.triangles.len() {
            let corners = mesh.triangles[t].map(|i| i as usize);
            let feet = corners.map(|i| &self.feet[i]);
            if feet.iter().all(|f| f.facet == feet[0].facet) {
                continue;
            }
            let continued =
                |set: usize| feet.map(|f| surface.uv(feet[0].facet, surface.weights_at(feet[0].facet, f.point), set));
            let is_seam = |set: &usize| {
                let uv = continued(*set);
                let change = uv[0].distance(uv[1]).max(uv[0].distance(uv[2])).max(uv[1].distance(uv[2]));
                (0..3).any(|k| uv[k].distance(mesh.uvs[*set][corners[k]]) > SEAM * change)
            };
            if !sets.iter().any(is_seam) {
                continue;
            }
            let first = mesh.positions.len() as u32;
            for (k, i) in corners.into_iter().enumerate() {
                mesh.positions.push(mesh.positions[i]);
                mesh.normals.push(mesh.normals[i]);
                if !mesh.colors.is_empty() {
                    mesh.colors.push(mesh.colors[i]);
                }
                if !mesh.tangents.is_empty() {
                    mesh.tangents.push(mesh.tangents[i]);
                }
                if let Some((own, uvs)) = &self.own_uvs {
                    mesh.uvs[*own].push(uvs[i]);
                }
                for &set in sets {
                    let uv = continued(set)[k];
                    mesh.uvs[set].push(if uv.is_finite() { uv } else { Vec2::ZERO });
                }
            }
            mesh.triangles[t] = [first, first + 1, first + 2];
        }
    }
}
