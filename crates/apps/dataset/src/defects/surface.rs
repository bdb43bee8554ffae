//! The surface of one object near a place: projection, distances, and the attributes at a point.

use super::tree::{Step, Tree, distance_to_box, distance_to_triangle, segment_meets_box, segment_meets_triangle};
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Mesh, Vec2, Vec4};
use dunkelfeld_scene::{Instance, SceneBuilder};

/// Smallest cosine between the direction of a projection and the normal of a triangle that it may meet.
const LEAST_COSINE: f64 = 0.2;
/// A shading normal is used if its cosine to the normal of the triangle is at least this.
const LEAST_AGREEMENT: f64 = 0.5;

/// A triangle of the object.
#[derive(Clone, Copy)]
pub(super) struct Facet {
    /// Index into [`SceneBuilder::meshes`].
    pub(super) part: usize,
    /// Index into the triangles of the mesh.
    pub(super) triangle: usize,
    /// Unit normal in the world, on the side given by the winding.
    pub(super) normal: DVec3,
}

/// A point of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceHit {
    /// Position relative to the origin of the surface \[m\].
    pub(super) point: DVec3,
    /// Unit shading normal: interpolated, on the side of the geometric one.
    pub(super) normal: DVec3,
    /// Index into the facets of the surface.
    pub(super) facet: usize,
    /// Weights of the corners of the triangle.
    pub(super) weights: [f64; 3],
}

/// The triangles of one object that are within a radius of a place, in the axes of the world. Positions are relative to
/// the place, so that they keep their precision in f32.
pub(super) struct LocalSurface<'a> {
    scene: &'a SceneBuilder,
    matrix: DMat3,
    normal_matrix: DMat3,
    /// -1 if the placement of the object is a reflection.
    side: f64,
    /// From here to the space of the meshes.
    pub(super) to_mesh: DAffine3,
    pub(super) corners: Vec<[DVec3; 3]>,
    pub(super) facets: Vec<Facet>,
    tree: Tree,
}

/// The corners of a triangle in its own space; `None` if an index is out of range.
pub(super) fn corners_of(mesh: &Mesh, triangle: usize) -> Option<[DVec3; 3]> {
    let [a, b, c] = mesh.triangles.get(triangle)?.map(|i| mesh.positions.get(i as usize));
    Some([a?.as_dvec3(), b?.as_dvec3(), c?.as_dvec3()])
}

/// The cross product of two edges in the world: normal times twice the area. It points to the side that is the front,
/// also for a reflected object.
pub(super) fn oriented_area(to_world: &DAffine3, corners: &[DVec3; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|p| to_world.transform_point3(p));
    (b - a).cross(c - a) * to_world.matrix3.determinant().signum()
}

impl<'a> LocalSurface<'a> {
    /// The triangles of the parts `parts` of an object that are within `radius` of the place `origin` \[m\]. An
    /// infinite radius takes all. Triangles without area are left out.
    pub(super) fn collect(
        scene: &'a SceneBuilder,
        instance: &Instance,
        parts: &[usize],
        origin: DVec3,
        radius: f64,
    ) -> Self {
        let to_world = instance.to_world;
        let (mut corners, mut facets) = (Vec::new(), Vec::new());
        for &part in parts {
            let Some(mesh) = scene.meshes.get(part).map(|m| &m.mesh) else { continue };
            for triangle in 0..mesh.triangles.len() {
                let Some(local) = corners_of(mesh, triangle) else { continue };
                let placed = local.map(|p| to_world.transform_point3(p) - origin);
                let (low, high) = (placed[0].min(placed[1]).min(placed[2]), placed[0].max(placed[1]).max(placed[2]));
                if distance_to_box(DVec3::ZERO, low, high) > radius {
                    continue;
                }
                let Some(normal) = oriented_area(&to_world, &local).try_normalize() else { continue };
                if placed.iter().all(|p| p.is_finite()) {
                    corners.push(placed);
                    facets.push(Facet { part, triangle, normal });
                }
            }
        }
        let matrix = to_world.matrix3;
        let tree = Tree::new(&corners);
        let side = matrix.determinant().signum();
        let normal_matrix = matrix.inverse().transpose();
        let to_mesh = (DAffine3::from_translation(-origin) * to_world).inverse();
        Self { scene, matrix, normal_matrix, side, to_mesh, corners, facets, tree }
    }

    /// The point of the surface nearest to `point` on the line through it along `normal`, at most `reach` \[m\] away on
    /// either side. Triangles that face away from `normal`, or are almost parallel to it, do not count.
    pub(super) fn project(&self, point: DVec3, normal: DVec3, reach: f64) -> Option<SurfaceHit> {
        let (from, way) = (point + normal * reach, normal * (-2.0 * reach));
        let mut best: Option<(f64, usize, [f64; 3])> = None;
        self.tree.visit(|step| match step {
            Step::Box(low, high) => segment_meets_box(from, way, low, high),
            Step::Triangle(i) => {
                if self.facets[i].normal.dot(normal) >= LEAST_COSINE
                    && let Some((t, weights)) = segment_meets_triangle(from, way, &self.corners[i])
                {
                    let height = (t - 0.5).abs();
                    // On a common edge the triangle with the lowest index is taken.
                    if best.is_none_or(|(least, other, _)| (height, i) < (least, other)) {
                        best = Some((height, i, weights));
                    }
                }
                false
            }
        });
        best.map(|(_, facet, weights)| self.hit(facet, weights))
    }

    /// The point of a triangle with these weights of the corners.
    fn hit(&self, facet: usize, weights: [f64; 3]) -> SurfaceHit {
        let [a, b, c] = self.corners[facet];
        let point = a * weights[0] + b * weights[1] + c * weights[2];
        SurfaceHit { point, normal: self.shading_normal(facet, weights), facet, weights }
    }

    fn shading_normal(&self, facet: usize, weights: [f64; 3]) -> DVec3 {
        let Facet { part, triangle, normal } = self.facets[facet];
        self.smooth_normal(&self.scene.meshes[part].mesh, triangle, weights, normal)
    }

    /// The unit shading normal at a point of a triangle with the geometric normal `normal`, in the axes of the world.
    pub(super) fn smooth_normal(&self, mesh: &Mesh, triangle: usize, weights: [f64; 3], normal: DVec3) -> DVec3 {
        let Some(mixed) = mixed(mesh, &mesh.normals, triangle, weights, |n| n.as_dvec3()) else { return normal };
        let smooth = (self.normal_matrix * mixed).normalize_or_zero();
        let smooth = if smooth.dot(normal) < 0.0 { -smooth } else { smooth };
        if smooth.dot(normal) >= LEAST_AGREEMENT { smooth } else { normal }
    }

    /// True if the segment between two points meets one of the facets that count.
    pub(super) fn is_met(&self, from: DVec3, to: DVec3, counts: impl Fn(&Facet) -> bool) -> bool {
        let mut is_met = false;
        self.tree.visit(|step| match step {
            Step::Box(low, high) => !is_met && segment_meets_box(from, to - from, low, high),
            Step::Triangle(i) => {
                let hit = segment_meets_triangle(from, to - from, &self.corners[i]);
                is_met |= hit.is_some() && counts(&self.facets[i]);
                false
            }
        });
        is_met
    }

    /// The distance \[m\] between a point and the surface, or `limit` if it is larger.
    pub(super) fn distance(&self, point: DVec3, limit: f64) -> f64 {
        let mut least = limit;
        self.tree.visit(|step| match step {
            Step::Box(low, high) => distance_to_box(point, low, high) < least,
            Step::Triangle(i) => {
                least = least.min(distance_to_triangle(point, &self.corners[i]));
                false
            }
        });
        least
    }

    /// True if a point is inside the closed surface: the majority of three rays crosses it an odd number of times.
    pub(super) fn contains(&self, point: DVec3, reach: f64) -> bool {
        // Directions along which models have no edges.
        let directions =
            [DVec3::new(0.317, 0.563, 0.763), DVec3::new(-0.811, 0.237, 0.535), DVec3::new(0.271, -0.933, -0.237)];
        let odd = |direction: &&DVec3| {
            let way = **direction * reach;
            let mut crossings = 0u32;
            self.tree.visit(|step| match step {
                Step::Box(low, high) => segment_meets_box(point, way, low, high),
                Step::Triangle(i) => {
                    crossings += u32::from(segment_meets_triangle(point, way, &self.corners[i]).is_some());
                    false
                }
            });
            crossings % 2 == 1
        };
        directions.iter().filter(odd).count() >= 2
    }

    /// The part of the object that a point belongs to.
    pub(super) fn part_of(&self, hit: &SurfaceHit) -> usize {
        self.facets[hit.facet].part
    }

    /// The weights of the corners of a triangle at a point, projected on its plane. Outside of the triangle they
    /// continue linearly.
    pub(super) fn weights_at(&self, facet: usize, point: DVec3) -> [f64; 3] {
        let [a, b, c] = self.corners[facet];
        let normal = (b - a).cross(c - a);
        let square = normal.length_squared();
        let weight = |from: DVec3, to: DVec3| normal.dot((to - from).cross(point - from)) / square;
        let (w0, w1) = (weight(b, c), weight(c, a));
        [w0, w1, 1.0 - w0 - w1]
    }

    /// Texture coordinates of a point of a triangle; zero if the mesh has none.
    pub(super) fn uv(&self, facet: usize, weights: [f64; 3], set: usize) -> Vec2 {
        let Facet { part, triangle, .. } = self.facets[facet];
        let mesh = &self.scene.meshes[part].mesh;
        mixed(mesh, &mesh.uvs[set], triangle, weights, |v| v.as_dvec2()).unwrap_or_default().as_vec2()
    }

    /// Vertex colour of a point; white if the mesh has none.
    pub(super) fn color(&self, hit: &SurfaceHit) -> Vec4 {
        let Facet { part, triangle, .. } = self.facets[hit.facet];
        let mesh = &self.scene.meshes[part].mesh;
        let as_f64 = |v: &Vec4| v.as_dvec4();
        mixed(mesh, &mesh.colors, triangle, hit.weights, as_f64).map_or(Vec4::ONE, |c| c.as_vec4())
    }

    /// Tangent of a point, with the sign of its bitangent. `frame` leads from the axes of the world to those of the result.
    pub(super) fn tangent(&self, hit: &SurfaceHit, frame: &DAffine3) -> Vec4 {
        let Facet { part, triangle, .. } = self.facets[hit.facet];
        let mesh = &self.scene.meshes[part].mesh;
        let xyz = |t: &Vec4| t.truncate().as_dvec3();
        let Some(local) = mixed(mesh, &mesh.tangents, triangle, hit.weights, xyz) else { return Vec4::X };
        let placed = frame.matrix3 * (self.matrix * local);
        let tangent = placed.try_normalize().unwrap_or_else(|| hit.normal.any_orthonormal_vector());
        let first = mesh.triangles[triangle][0] as usize;
        let sign = mesh.tangents.get(first).map_or(1.0, |t| t.w);
        tangent.as_vec3().extend(sign * (self.side * frame.matrix3.determinant().signum()) as f32)
    }
}

/// An attribute of a triangle's corners, mixed by weights. `None` if the mesh does not have it.
fn mixed<T, V>(mesh: &Mesh, values: &[T], triangle: usize, weights: [f64; 3], convert: impl Fn(&T) -> V) -> Option<V>
where
    V: std::ops::Mul<f64, Output = V> + std::ops::Add<Output = V>,
{
    if values.len() != mesh.positions.len() {
        return None;
    }
    let [a, b, c] = mesh.triangles.get(triangle)?.map(|i| values.get(i as usize).map(&convert));
    Some(a? * weights[0] + b? * weights[1] + c? * weights[2])
}
