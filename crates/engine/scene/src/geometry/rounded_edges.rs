//! Rounded edges: a viewer sees the fillets of sharp edges, on a mesh that has none.
//!
//! A fillet is the cylinder that touches both faces of an edge. Between its lines of contact a ray meets the sharp mesh, and then
//! the fillet behind it: the point of the ray has the normal of that place. So the image is that of a rounded mesh but for its
//! silhouettes, which stay. Edges do not meet each other's fillets: at corners, their tilts are added.

use dunkelfeld_geometry::health::{OPEN, opposite_half_edges};
use dunkelfeld_geometry::{Mesh, Vec2, Vec3, geometric_normal};

/// Cosine of the least angle between the normals of a sharp edge: 15 degrees.
const SHARP: f32 = 0.965_925_8;
/// Cosine of the largest one, 150 degrees. The fillet of a sharper edge would reach far.
const KNIFE: f32 = -0.866_025_4;
/// Most fillets near a triangle, on average.
const MOST_NEAR: usize = 256;
/// The largest sine, and the least cosine, of the angle between a normal and the direction to the viewer: behind the silhouette of
/// a fillet, a ray has the normal of the silhouette.
const GRAZING: [f32; 2] = [0.9998, 0.02];

/// A sharp edge, seen from the face on one side.
#[derive(Clone, Debug)]
struct Side {
    ends: [Vec3; 2],
    /// Unit normals of the other face at the ends.
    normals: [Vec3; 2],
}

/// The fillets of a mesh, in the frame of its object in metres.
#[derive(Clone, Debug)]
pub(crate) struct RoundedEdges {
    radius: f32,
    sides: Vec<Side>,
    /// For each triangle its first entry in `near`, and the end of the last one.
    starts: Vec<u32>,
    /// The sides that round some of a triangle.
    near: Vec<u32>,
}

/// The fillet of an edge at a point of a face.
#[derive(Clone, Copy)]
struct Fillet {
    /// Unit tangent toward the normal of the other face.
    along: Vec3,
    /// Sine and cosine of the angle from the normal of the face.
    sin: f32,
    cos: f32,
    lift: f32,
}

impl RoundedEdges {
    /// The fillets of a radius \[m\] of the sharp convex edges of a mesh, whose axes are scaled first. An edge needs two triangles,
    /// whose corners may have their own normals. `None` if a triangle would have more than [`MOST_NEAR`] of them.
    pub(crate) fn new(mesh: &Mesh, scale: Vec3, radius: f32) -> Option<Self> {
        let triangles = mesh.triangles.len();
        let opposite = opposite_half_edges(mesh);
        let vertex = |half: u32| mesh.triangles[half as usize / 3][half as usize % 3] as usize;
        let next = |half: u32| half - half % 3 + (half + 1) % 3;
        let at = |half: u32| mesh.positions[vertex(half)] * scale;
        let ends = |half: u32| [at(half), at(next(half))];
        let facets: Vec<Vec3> =
            (0..triangles).map(|t| geometric_normal(&mesh.corners(t).map(|corner| corner * scale))).collect();
        let normal = |half: u32| {
            let facet = facets[half as usize / 3];
            let own = mesh.normals.get(vertex(half)).map_or(facet, |n| (*n / scale).normalize_or(facet));
            if own.dot(facet) < 0.0 { -own } else { own }
        };
        let normals = |half: u32| [normal(half), normal(next(half))];
        // The least cosine between the normals of both faces.
        let cosine = |half: u32| match opposite[half as usize] {
            OPEN => -1.0,
            other => {
                let ([a, b], [to_b, to_a]) = (normals(half), normals(other));
                a.dot(to_a).min(b.dot(to_b))
            }
        };
        let cosines: Vec<f32> = (0..3 * triangles as u32).map(cosine).collect();
        let (mut sides, mut near, mut reached) = (Vec::new(), Vec::new(), vec![u32::MAX; triangles]);
        for (half, &cosine) in (0..).zip(&cosines) {
            let other = opposite[half as usize];
            if other == OPEN || !(KNIFE..SHARP).contains(&cosine) {
                continue;
            }
            let (face, apex) = (half / 3, at(next(next(other))));
            if facets[face as usize].dot(apex - at(half)) >= 0.0 {
                continue;
            }
            let ([b, a], number) = (normals(other), sides.len() as u32);
            let (reach, edge) = (radius * half_tangent(cosine), ends(half));
            sides.push(Side { ends: edge, normals: [a, b] });
            // All triangles of the face within reach, from neighbour to neighbour.
            let mut open = vec![face];
            reached[face as usize] = number;
            while let Some(triangle) = open.pop() {
                near.push((triangle, number));
                for half in 3 * triangle..3 * triangle + 3 {
                    let beyond = opposite[half as usize] / 3;
                    if cosines[half as usize] >= SHARP
                        && reached[beyond as usize] != number
                        && distance(edge, ends(half)) <= reach
                    {
                        reached[beyond as usize] = number;
                        open.push(beyond);
                    }
                }
            }
            if near.len() > MOST_NEAR * triangles {
                return None;
            }
        }
        near.sort_unstable();
        let starts = (0..=triangles as u32).map(|t| near.partition_point(|n| n.0 < t) as u32).collect();
        Some(Self { radius, sides, starts, near: near.into_iter().map(|(_, side)| side).collect() })
    }

    pub(crate) fn radius(&self) -> f32 {
        self.radius
    }

    /// The unit normal that a viewer in the unit direction `view` sees at a point \[m\] of a triangle with a unit normal, and the
    /// height \[m\] above the point from which no direction above that normal meets the mesh at the edge. `None` beside fillets.
    pub(crate) fn at(&self, triangle: u32, point: Vec3, normal: Vec3, view: Vec3) -> Option<(Vec3, f32)> {
        let [start, end] = *self.starts.get(triangle as usize..)?.first_chunk()?;
        let fillets = || {
            let near = self.near[start as usize..end as usize].iter().map(|&side| &self.sides[side as usize]);
            near.filter_map(|side| side.fillet(self.radius, point, normal, view))
        };
        let Fillet { along, sin, cos, mut lift } = fillets().min_by(|a, b| a.cos.total_cmp(&b.cos))?;
        let mut tilted = along * sin + normal * cos;
        for other in fillets() {
            // The part of its tilt that those before do not contain: pieces of one edge count once.
            let missing = other.sin - tilted.dot(other.along);
            if missing > 0.0 {
                tilted += other.along * missing;
                lift = lift.max(other.lift);
            }
        }
        let tilted = tilted.normalize_or(normal);
        let missing = GRAZING[1] - tilted.dot(view);
        let seen = if missing > 0.0 { (tilted + view * missing).normalize_or(normal) } else { tilted };
        Some((seen, lift))
    }
}

impl Side {
    /// The fillet at a point of the face, whose unit normal is given. `None` beside it.
    fn fillet(&self, radius: f32, point: Vec3, normal: Vec3, view: Vec3) -> Option<Fillet> {
        let [a, b] = self.ends;
        let t = share(point, self.ends);
        let off = point.distance(a + (b - a) * t);
        let other = self.normals[0].lerp(self.normals[1], t).normalize_or(normal);
        let cos = normal.dot(other);
        let along = (other - normal * cos).try_normalize()?;
        let contact = radius * half_tangent(cos);
        if off >= contact {
            return None;
        }
        // In the plane across the edge, with the tangent along x and the normal along y, in units of the radius: the ray through
        // the point passes the axis of the cylinder at the distance of its sine of incidence.
        let Vec2 { x, y } = Vec2::new(view.dot(along), view.dot(normal).max(GRAZING[1])).normalize();
        let sin = ((contact - off) / radius * y - x).clamp(-GRAZING[0], GRAZING[0]);
        let cos = (1.0 - sin * sin).sqrt();
        let (sin, cos) = (sin * y + cos * x, cos * y - sin * x);
        let lift = if off * sin < contact * cos { off * sin / cos } else { contact };
        Some(Fillet { along, sin, cos, lift })
    }
}

/// The tangent of half an angle from its cosine.
fn half_tangent(cosine: f32) -> f32 {
    ((1.0 - cosine).max(0.0) / (1.0 + cosine)).sqrt()
}

/// The share of a segment before the place that is nearest to a point.
fn share(point: Vec3, [a, b]: [Vec3; 2]) -> f32 {
    ((point - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0)
}

/// The distance of two segments in a plane that do not cross.
fn distance(a: [Vec3; 2], b: [Vec3; 2]) -> f32 {
    let to = |point: Vec3, segment: [Vec3; 2]| point.distance(segment[0].lerp(segment[1], share(point, segment)));
    to(a[0], b).min(to(a[1], b)).min(to(b[0], a)).min(to(b[1], a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{cuboid, turned};

    const RADIUS: f32 = 0.1;

    fn cube() -> (Mesh, RoundedEdges) {
        let mesh = cuboid(Vec3::ZERO, Vec3::ONE);
        let edges = RoundedEdges::new(&mesh, Vec3::ONE, RADIUS).expect("few edges");
        (mesh, edges)
    }

    /// What a viewer sees at a point of a mesh.
    fn seen(mesh: &Mesh, edges: &RoundedEdges, point: Vec3, facing: Vec3, view: Vec3) -> Option<Vec3> {
        let is_there = |t: &usize| {
            let corners = mesh.corners(*t);
            let inside = |k: usize| {
                let side = corners[(k + 1) % 3] - corners[k];
                side.cross(point - corners[k]).dot(geometric_normal(&corners)) >= -1e-6
            };
            geometric_normal(&corners).dot(facing) > 0.99 && (0..3).all(inside)
        };
        let triangle = (0..mesh.triangles.len()).find(is_there).expect("a point of the mesh") as u32;
        Some(edges.at(triangle, point, facing, view.normalize())?.0)
    }

    /// Each ray through a strip of contact meets the cylinder where its normal is that of the cylinder.
    #[test]
    fn a_viewer_sees_the_cylinder() {
        let (mesh, edges) = cube();
        let axis = Vec3::new(1.0 - RADIUS, 0.5, 1.0 - RADIUS);
        for view in [Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.3, 0.5, 1.0), Vec3::new(-0.05, 0.2, 1.0)] {
            for i in 0..10 {
                let point = Vec3::new(1.0 - RADIUS * i as f32 / 10.0, 0.5, 1.0);
                let normal = seen(&mesh, &edges, point, Vec3::Z, view).expect("within the contact");
                let place = axis + normal * RADIUS;
                let off = (place - point) - view * (place - point).dot(view) / view.length_squared();
                // The place may lie anywhere along the edge.
                let across = Vec3::Y.cross(view).normalize();
                let is_silhouette = normal.dot(view.normalize()) < 0.05;
                assert!(is_silhouette || off.dot(across).abs() < 1e-5 && normal.y.abs() < 1e-5, "{view} {i}: {normal}");
            }
        }
        assert!(seen(&mesh, &edges, Vec3::new(0.5, 0.5, 1.0), Vec3::Z, Vec3::Z).is_none(), "beside all fillets");
    }

    /// At an edge and at a corner both faces have one normal, so that no seam is visible.
    #[test]
    fn faces_meet_without_a_seam() {
        let (mesh, edges) = cube();
        for point in [Vec3::new(1.0, 0.5, 1.0), Vec3::ONE] {
            let view = point - 0.4;
            let [a, b] = [Vec3::Z, Vec3::X].map(|facing| seen(&mesh, &edges, point, facing, view).expect("an edge"));
            assert!(a.distance(b) < 1e-3, "{point}: {a} and {b}");
        }
    }

    /// Triangles beyond a flat neighbour are rounded too: slivers, whose own edges are not sharp. Concave edges stay.
    #[test]
    fn slivers_are_rounded_and_concave_edges_are_not() {
        let mut mesh = cuboid(Vec3::ZERO, Vec3::ONE);
        // The top as slivers to a point near one of its edges.
        let normals: Vec<Vec3> = (0..mesh.triangles.len()).map(|t| geometric_normal(&mesh.corners(t))).collect();
        let mut normal = normals.iter();
        mesh.triangles.retain(|_| normal.next().is_some_and(|n| n.z < 0.5));
        let first = mesh.positions.len() as u32;
        let top = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.96, 0.5]];
        mesh.positions.extend(top.map(|[x, y]| Vec3::new(x, y, 1.0)));
        mesh.triangles.extend([0, 1, 2, 3].map(|k| [first + k, first + (k + 1) % 4, first + 4]));
        let edges = RoundedEdges::new(&mesh, Vec3::ONE, RADIUS).expect("few edges");
        assert!(seen(&mesh, &edges, Vec3::new(0.95, 0.45, 1.0), Vec3::Z, Vec3::Z).is_some(), "a sliver");
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(RoundedEdges::new(&mesh, Vec3::ONE, RADIUS).expect("few edges").sides.is_empty(), "a hollow");
    }

    #[test]
    fn a_radius_over_many_edges_is_refused() {
        let disc = turned(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.0, 0.5]].map(Vec2::from), 1000);
        assert!(RoundedEdges::new(&disc, Vec3::ONE, 0.05).is_some());
        assert!(RoundedEdges::new(&disc, Vec3::ONE, 1.0).is_none());
    }
}
