//! From parsed faces to meshes: triangles, vertices shared where all their attributes agree, normals where none are given.

use super::closed::{are_closed, first_at_same_place};
use super::read::{Corner, Face, NONE, Parsed};
use super::tally::Tally;
use crate::import::mesh_file::{linear, origin};
use crate::import::triangulate::{Outcome, Triangulator, newell_normal};
use dunkelfeld_geometry::{DVec3, Mesh, Vec2, Vec3, Vec4};
use std::cell::LazyCell;
use std::collections::HashMap;

/// The triangles of one object that share a material.
pub(super) struct Part {
    /// Index into [`Parsed::objects`].
    pub object: u32,
    /// Index into [`Parsed::materials`].
    pub material: u32,
    /// The triangles, relative to the origin of the [`Assembly`].
    pub mesh: Mesh,
    /// Does the material refract, and is the surface of the whole object, or that of this part alone, closed?
    pub closed: bool,
}

/// All parts, by object and then by material.
pub(super) struct Assembly {
    /// The parts.
    pub parts: Vec<Part>,
    /// Origin of the meshes in the file's coordinates: f32 keeps full accuracy far from the file's origin.
    pub origin: DVec3,
}

/// A triangle: three corners (indices into [`Parsed::corners`]) and its face.
struct Triangle {
    corners: [u32; 3],
    face: u32,
}

/// Builds the meshes. `refracts` are the materials for which it is known whether a surface is closed.
pub(super) fn assemble(parsed: &Parsed, refracts: impl Fn(u32) -> bool, tally: &mut Tally) -> Assembly {
    let origin = origin(parsed.positions.iter().map(|p| DVec3::from_array(*p)));
    let mut triangles = triangulate_all(parsed, tally);
    let smooth = SmoothNormals::gather(parsed, &triangles);
    let key = |t: &Triangle| parsed.faces.get(t.face as usize).map_or((0, 0), |f| (f.object, f.material));
    // Stable, so triangles keep the file's order within a part.
    triangles.sort_by_key(key);
    let places = LazyCell::new(|| first_at_same_place(&parsed.positions));
    let is_closed = |triangles: &[Triangle]| {
        let position = |c: u32| parsed.corners[c as usize].position;
        are_closed(&places, triangles.iter().map(|t| t.corners.map(position)))
    };
    let mut recent = vec![Recent::default(); parsed.positions.len()];
    let mut parts = Vec::new();
    for object in triangles.chunk_by(|a, b| key(a).0 == key(b).0) {
        let object_closed = LazyCell::new(|| is_closed(object));
        for part in object.chunk_by(|a, b| key(a) == key(b)) {
            let (object_id, material) = part.first().map_or((0, 0), key);
            let mesh = build_mesh(parsed, part, &smooth, origin, (&mut recent, parts.len() as u32 + 1), tally);
            let closed = refracts(material) && (*object_closed || (part.len() < object.len() && is_closed(part)));
            parts.push(Part { object: object_id, material, mesh, closed });
        }
    }
    Assembly { parts, origin }
}

fn position(parsed: &Parsed, corner: u32) -> DVec3 {
    DVec3::from_array(parsed.positions[parsed.corners[corner as usize].position as usize])
}

fn triangulate_all(parsed: &Parsed, tally: &mut Tally) -> Vec<Triangle> {
    let mut triangulator = Triangulator::default();
    let mut triangles = Vec::with_capacity(parsed.faces.len());
    let (mut points, mut corners, mut ears) = (Vec::new(), Vec::<u32>::new(), Vec::new());
    for (face_id, face) in parsed.faces.iter().enumerate() {
        // A vertex that is repeated adds only a triangle without area.
        corners.clear();
        corners.extend(face.first..face.first + face.count);
        corners.dedup_by_key(|c| parsed.corners[*c as usize].position);
        points.clear();
        points.extend(corners.iter().map(|c| position(parsed, *c)));
        if points.iter().any(|p| !p.is_finite()) {
            tally.add(face.line, "the face uses an unusable vertex and is dropped");
            continue;
        }
        ears.clear();
        match triangulator.triangulate(&points, &mut ears) {
            Outcome::Done => {}
            Outcome::Degenerate => tally.add(face.line, "the face has no area and is dropped"),
            Outcome::TooLarge => tally.add(face.line, "the face has more than 20000 corners and is dropped"),
        }
        for ear in &ears {
            let [a, b, c] = ear.map(|i| points[i as usize]);
            if newell_normal(&[a, b, c]).is_some() {
                triangles.push(Triangle { corners: ear.map(|i| corners[i as usize]), face: face_id as u32 });
            }
        }
    }
    triangles
}

/// Normals of smoothing groups: for each vertex and group the faces' normals, weighted by the angle at the vertex
/// (Thürmer and Wüthrich 1998), which does not depend on how polygons are cut into triangles.
struct SmoothNormals {
    /// From (position, group) to an index into `sums`.
    ids: HashMap<(u32, u32), u32>,
    sums: Vec<DVec3>,
}

impl SmoothNormals {
    fn gather(parsed: &Parsed, triangles: &[Triangle]) -> Self {
        let mut normals = Self { ids: HashMap::new(), sums: Vec::new() };
        for triangle in triangles {
            let group = parsed.faces[triangle.face as usize].smoothing;
            if group == 0 || triangle.corners.iter().all(|c| has_normal(parsed, &parsed.corners[*c as usize])) {
                continue;
            }
            let points = triangle.corners.map(|c| position(parsed, c));
            let Some(normal) = newell_normal(&points) else { continue };
            for i in 0..3 {
                let (here, next, last) = (points[i], points[(i + 1) % 3], points[(i + 2) % 3]);
                let angle = (next - here).angle_between(last - here);
                let vertex = parsed.corners[triangle.corners[i] as usize].position;
                let fresh = normals.sums.len() as u32;
                let id = *normals.ids.entry((vertex, group)).or_insert(fresh);
                if id == fresh {
                    normals.sums.push(DVec3::ZERO);
                }
                normals.sums[id as usize] += normal * angle;
            }
        }
        normals
    }

    fn find(&self, corner: &Corner, face: &Face) -> Option<(u32, Vec3)> {
        let id = *self.ids.get(&(corner.position, face.smoothing))?;
        let sum = self.sums[id as usize];
        // Faces folded onto each other give no direction.
        (sum.length() > 1e-6).then(|| (id, sum.normalize().as_vec3()))
    }
}

fn has_normal(parsed: &Parsed, corner: &Corner) -> bool {
    corner.normal != NONE && parsed.normals[corner.normal as usize] != [0.0; 3]
}

/// Source of a vertex's normal. It is part of the key that makes two corners the same vertex.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
enum NormalSource {
    File(u32),
    Group(u32),
    Face(u32),
    /// No corner of the mesh has one: the mesh has flat shading.
    #[default]
    Flat,
}

/// The vertex that was last used at a position. Most corners need this one.
#[derive(Clone, Copy, Default)]
struct Recent {
    /// Number of the part it belongs to; 0 is none.
    part: u32,
    texcoord: u32,
    source: NormalSource,
    vertex: u32,
}

/// Builds the mesh of one part; `number` counts the parts from 1.
fn build_mesh(
    parsed: &Parsed,
    triangles: &[Triangle],
    smooth: &SmoothNormals,
    origin: DVec3,
    (recent, number): (&mut [Recent], u32),
    tally: &mut Tally,
) -> Mesh {
    let all_corners = || triangles.iter().flat_map(|t| t.corners.map(|c| (&parsed.corners[c as usize], t.face)));
    let flat = all_corners().all(|(c, f)| !has_normal(parsed, c) && parsed.faces[f as usize].smoothing == 0);
    let with_uv = all_corners().any(|(c, _)| c.texcoord != NONE);
    let with_color = !parsed.colors.is_empty();

    let mut mesh = Mesh { triangles: Vec::with_capacity(triangles.len()), ..Mesh::default() };
    let mut vertices: HashMap<(u32, u32, NormalSource), u32> = HashMap::new();
    for triangle in triangles {
        let face = &parsed.faces[triangle.face as usize];
        let face_normal = newell_normal(&triangle.corners.map(|c| position(parsed, c))).unwrap_or(DVec3::Z).as_vec3();
        let indices = triangle.corners.map(|c| {
            let corner = parsed.corners[c as usize];
            let (source, normal) = if flat {
                (NormalSource::Flat, Vec3::ZERO)
            } else if has_normal(parsed, &corner) {
                let normal = Vec3::from_array(parsed.normals[corner.normal as usize]);
                (NormalSource::File(corner.normal), normal)
            } else if face.smoothing != 0
                && let Some((id, normal)) = smooth.find(&corner, face)
            {
                (NormalSource::Group(id), normal)
            } else {
                (NormalSource::Face(triangle.face), face_normal)
            };
            if with_uv && corner.texcoord == NONE {
                tally.add(face.line, "a corner lacks the texture coordinate that others have; 0 is used");
            }
            let last = &mut recent[corner.position as usize];
            if (last.part, last.texcoord, last.source) == (number, corner.texcoord, source) {
                return last.vertex;
            }
            let vertex = *vertices.entry((corner.position, corner.texcoord, source)).or_insert_with(|| {
                let place = DVec3::from_array(parsed.positions[corner.position as usize]) - origin;
                mesh.positions.push(place.as_vec3());
                if !flat {
                    mesh.normals.push(normal);
                }
                if with_uv {
                    let [u, v] = parsed.texcoords.get(corner.texcoord as usize).copied().unwrap_or_default();
                    // In OBJ, v begins at the bottom of the image, in a Mesh at the top.
                    mesh.uvs[0].push(Vec2::new(u, 1.0 - v));
                }
                if with_color {
                    let [r, g, b] = parsed.colors[corner.position as usize].map(linear);
                    mesh.colors.push(Vec4::new(r, g, b, 1.0));
                }
                (mesh.positions.len() - 1) as u32
            });
            *last = Recent { part: number, texcoord: corner.texcoord, source, vertex };
            vertex
        });
        mesh.triangles.push(indices);
    }
    // White vertices have no effect.
    if mesh.colors.iter().all(|c| *c == Vec4::ONE) {
        mesh.colors = Vec::new();
    }
    mesh
}
