//! Triangle shells, their smooth normals, and the health measures that the tests put every body to.

use std::collections::HashMap;

use glam::DVec3;

/// Points and triangles of one body, before normals. Triangles wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shell {
    /// Vertex positions \[m\].
    pub(crate) points: Vec<DVec3>,
    /// Corner indices into `points`.
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A mesh as the file stores it: one normal per vertex.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    /// Vertex positions \[m\].
    pub(crate) positions: Vec<DVec3>,
    /// Unit vertex normals, one per position.
    pub(crate) normals: Vec<DVec3>,
    /// Corner indices into `positions`.
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Shell {
    /// Adds a quad `a b c d` (counter-clockwise from outside) as two triangles.
    pub(crate) fn quad(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Gives every corner the mean normal of the faces around its vertex that lie within `crease_degrees` of its own
    /// face, and splits vertices where corners disagree.
    ///
    /// Faces weigh by area times corner angle (Max 1999 shows why unweighted means fail). The area keeps large flats
    /// truly flat beside a narrow fillet, so that the shading normal bends only where the surface does.
    pub(crate) fn smooth(&self, crease_degrees: f64) -> Mesh {
        let limit = crease_degrees.to_radians().cos();
        let faces: Vec<DVec3> = self.triangles.iter().map(|t| area_vector(&self.points, t)).collect();
        let mut around = vec![Vec::new(); self.points.len()];
        for (face, triangle) in self.triangles.iter().enumerate() {
            for corner in 0..3 {
                around[triangle[corner] as usize]
                    .push((face, faces[face] * corner_angle(&self.points, triangle, corner)));
            }
        }
        let mut mesh = Mesh::default();
        let mut known: HashMap<(u32, [i64; 3]), u32> = HashMap::new();
        for (face, triangle) in self.triangles.iter().enumerate() {
            let own = faces[face].normalize();
            let corners = triangle.map(|vertex| {
                let normal = around[vertex as usize]
                    .iter()
                    .filter(|(other, _)| own.dot(faces[*other].normalize()) >= limit)
                    .map(|(_, weighted)| *weighted)
                    .sum::<DVec3>()
                    .normalize();
                let key = (vertex, normal.to_array().map(|c| (c * 1e6).round() as i64));
                *known.entry(key).or_insert_with(|| {
                    mesh.positions.push(self.points[vertex as usize]);
                    mesh.normals.push(normal);
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(corners);
        }
        mesh
    }
}

#[cfg(test)]
impl Mesh {
    /// Area of the smallest triangle \[m^2\].
    pub(crate) fn smallest_area(&self) -> f64 {
        self.triangles.iter().map(|t| 0.5 * area_vector(&self.positions, t).length()).fold(f64::INFINITY, f64::min)
    }

    /// Volume enclosed \[m^3\]; negative when the body is inside out.
    pub(crate) fn volume(&self) -> f64 {
        self.triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| self.positions[i as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    /// Number of directed edges without exactly one partner that runs the other way, after welding equal positions:
    /// 0 for a closed, consistently wound body.
    pub(crate) fn open_edges(&self) -> usize {
        let weld = |i: u32| self.positions[i as usize].to_array().map(|c| (c as f32).to_bits());
        let mut edges: HashMap<_, usize> = HashMap::new();
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *edges.entry((weld(a), weld(b))).or_default() += 1;
            }
        }
        edges.iter().filter(|((a, b), count)| **count != 1 || edges.get(&(*b, *a)) != Some(&1)).count()
    }

    /// Smallest cosine between a face and the normals at its corners.
    pub(crate) fn worst_normal(&self) -> f64 {
        let mut worst = 1.0_f64;
        for t in &self.triangles {
            let face = area_vector(&self.positions, t).normalize();
            for i in t {
                worst = worst.min(face.dot(self.normals[*i as usize]));
            }
        }
        worst
    }
}

/// Twice the area of a triangle, along its normal \[m^2\].
fn area_vector(points: &[DVec3], triangle: &[u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|i| points[i as usize]);
    (b - a).cross(c - a)
}

/// Interior angle of a triangle at one corner \[rad\].
fn corner_angle(points: &[DVec3], triangle: &[u32; 3], corner: usize) -> f64 {
    let at = points[triangle[corner] as usize];
    let next = points[triangle[(corner + 1) % 3] as usize] - at;
    let last = points[triangle[(corner + 2) % 3] as usize] - at;
    next.angle_between(last)
}
