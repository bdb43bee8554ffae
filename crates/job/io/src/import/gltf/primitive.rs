//! One glTF primitive as a triangle mesh: attributes, topology, repairs.

use super::accessor::{Accessors, Stored};
use super::deform::{Deformation, deform};
use crate::import::warnings::Warnings;
use dunkelfeld_geometry::{Mesh, Vec2, Vec3, Vec4};
use gltf::json::Index;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use std::cell::Cell;

/// Reads a primitive in its default pose. `Ok(None)` means that there is nothing to render (points, lines). An error
/// gives the reason why the data cannot be used.
pub(super) fn read_primitive(
    accessors: &Accessors<'_>,
    primitive: &Primitive,
    deformation: &Deformation<'_>,
    place: &str,
    warnings: &mut Warnings,
) -> Result<Option<Mesh>, String> {
    let Checked::Valid(mode) = primitive.mode else { return Err("its mode does not exist".into()) };
    if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        let what = if mode == Mode::Points { "points" } else { "lines" };
        warnings.push(place, format!("{what} have no surface and are left out"));
        return Ok(None);
    }
    let position = attribute(primitive, Semantic::Positions).ok_or("it has no POSITION")?;
    accessors.warn_alignment(position, warnings);
    let positions = accessors.vectors::<3>(position, Stored::Quantized).map_err(|e| {
        if primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key("KHR_draco_mesh_compression")) {
            format!("{e} (its data is compressed by KHR_draco_mesh_compression, which is not supported)")
        } else {
            e
        }
    })?;
    let positions: Vec<Vec3> = positions.into_iter().map(Vec3::from_array).collect();
    let outside = Cell::new(0);
    let mut reader = Attributes { accessors, primitive, count: positions.len(), place, warnings };
    let mut mesh = Mesh {
        normals: reader.read::<3, _>(Semantic::Normals, Stored::Quantized, Vec3::from_array),
        tangents: reader.read::<4, _>(Semantic::Tangents, Stored::Quantized, Vec4::from_array),
        uvs: [0, 1].map(|set| reader.read::<2, _>(Semantic::TexCoords(set), Stored::Quantized, finite_uv)),
        colors: reader.read::<4, _>(Semantic::Colors(0), Stored::Normalized, |rgba| color(rgba, &outside)),
        triangles: Vec::new(),
        positions,
    };
    if outside.get() > 0 {
        let (n, all) = (outside.get(), mesh.colors.len());
        warnings.push(place, format!("COLOR_0 is outside [0, 1] at {n} of {all} vertices and is clamped there"));
    }
    mesh.triangles = triangles(accessors, primitive, mode, mesh.positions.len(), place, warnings)?;
    if mesh.normals.is_empty() {
        // Tangents without normals are ignored (glTF 2.0, section 3.7.2.1).
        mesh.tangents.clear();
    }
    deform(&mut mesh, accessors, primitive, deformation, place, warnings);
    let before = mesh.triangles.len();
    mesh.triangles.retain(|t| t.iter().all(|i| mesh.positions.get(*i as usize).is_some_and(|p| p.is_finite())));
    if mesh.triangles.is_empty() {
        return Err("every triangle has a vertex that is infinite or not a number".into());
    }
    if mesh.triangles.len() < before {
        let lost = before - mesh.triangles.len();
        warnings.push(place, format!("{lost} of {before} triangles have a vertex that is not finite; left out"));
    }
    drop_unused_vertices(&mut mesh);
    repair_normals(&mut mesh, place, warnings);
    repair_tangents(&mut mesh, place, warnings);
    Ok(Some(mesh))
}

/// The accessor of an attribute.
pub(super) fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(Index::value)
}

/// Bytes that a mesh occupies.
pub(super) fn mesh_bytes(mesh: &Mesh) -> u64 {
    let vectors = 12 * (mesh.positions.len() + mesh.triangles.len() + mesh.normals.len());
    let wide = 16 * (mesh.tangents.len() + mesh.colors.len());
    (vectors + wide + 8 * (mesh.uvs[0].len() + mesh.uvs[1].len())) as u64
}

struct Attributes<'r, 'a> {
    accessors: &'r Accessors<'a>,
    primitive: &'r Primitive,
    count: usize,
    place: &'r str,
    warnings: &'r mut Warnings,
}

impl Attributes<'_, '_> {
    /// An optional attribute; one that cannot be used is left out with a warning.
    fn read<const N: usize, T>(
        &mut self,
        semantic: Semantic,
        stored: Stored,
        convert: impl Fn([f32; N]) -> T,
    ) -> Vec<T> {
        let name = semantic.to_string();
        let Some(index) = attribute(self.primitive, semantic) else { return Vec::new() };
        // The comparison is first, because a wrong count may be very large.
        let values = match self.accessors.count(index) {
            Some(n) if n != self.count => Err(format!("it has {n} elements for {} vertices", self.count)),
            _ => self.accessors.vectors::<N>(index, stored),
        };
        match values {
            Ok(values) => {
                self.accessors.warn_alignment(index, self.warnings);
                values.into_iter().map(convert).collect()
            }
            Err(e) => {
                self.warnings.push(self.place, format!("{name} cannot be used and is left out: {e}"));
                Vec::new()
            }
        }
    }
}

fn finite_uv(uv: [f32; 2]) -> Vec2 {
    Vec2::from_array(uv.map(|v| if v.is_finite() { v } else { 0.0 }))
}

/// A vertex colour; counts those that were outside the range or not numbers.
fn color(rgba: [f32; 4], outside: &Cell<usize>) -> Vec4 {
    // A quantised one may differ by rounding.
    let is_within = rgba.iter().all(|v| (-1e-6..=1.0 + 1e-6).contains(v));
    outside.set(outside.get() + usize::from(!is_within));
    Vec4::from_array(rgba.map(|v| if v.is_nan() { 1.0 } else { v.clamp(0.0, 1.0) }))
}

/// The triangles of a list, strip or fan (glTF 2.0, section 3.7.2.1), indexed or not. Triangles with an index out of range
/// are left out.
fn triangles(
    accessors: &Accessors<'_>,
    primitive: &Primitive,
    mode: Mode,
    vertices: usize,
    place: &str,
    warnings: &mut Warnings,
) -> Result<Vec<[u32; 3]>, String> {
    let indices: Vec<u32> = match primitive.indices {
        Some(index) => accessors.whole::<1>(index.value())?.into_iter().map(|[i]| i).collect(),
        None => (0..u32::try_from(vertices).map_err(|_| "it has more than 2^32 vertices")?).collect(),
    };
    let list: Vec<[u32; 3]> = match mode {
        Mode::TriangleFan => match indices.split_first() {
            Some((hub, rim)) => {
                rim.windows(2).filter_map(|w| if let [a, b] = w { Some([*a, *b, *hub]) } else { None }).collect()
            }
            None => Vec::new(),
        },
        Mode::TriangleStrip => (indices.windows(3).enumerate())
            .filter_map(|(i, w)| match (i % 2, w) {
                (0, [a, b, c]) => Some([*a, *b, *c]),
                (_, [a, b, c]) => Some([*a, *c, *b]),
                _ => None,
            })
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect(),
        _ => {
            let (triangles, rest) = indices.as_chunks::<3>();
            if !rest.is_empty() {
                warnings.push(place, format!("{} indices beyond whole triangles are ignored", rest.len()));
            }
            triangles.to_vec()
        }
    };
    if list.is_empty() {
        return Err("it has too few vertices for a triangle".into());
    }
    let total = list.len();
    let kept: Vec<_> = list.into_iter().filter(|t| t.iter().all(|i| (*i as usize) < vertices)).collect();
    if kept.is_empty() {
        return Err(format!("every triangle has a vertex index out of range of {vertices} vertices"));
    }
    if kept.len() < total {
        let lost = total - kept.len();
        warnings.push(
            place,
            format!("{lost} of {total} triangles have a vertex index out of range of {vertices} vertices; left out"),
        );
    }
    Ok(kept)
}

/// Keeps the vertices that triangles use: many primitives may share one large vertex buffer.
fn drop_unused_vertices(mesh: &mut Mesh) {
    const UNUSED: u32 = u32::MAX;
    let mut new_index = vec![UNUSED; mesh.positions.len()];
    for i in mesh.triangles.iter().flatten() {
        new_index[*i as usize] = 0;
    }
    let mut kept = Vec::new();
    for (old, new) in new_index.iter_mut().enumerate().filter(|(_, new)| **new != UNUSED) {
        *new = kept.len() as u32;
        kept.push(old);
    }
    if kept.len() == mesh.positions.len() {
        return;
    }
    fn gather<T: Copy>(values: &mut Vec<T>, kept: &[usize]) {
        if !values.is_empty() {
            *values = kept.iter().map(|i| values[*i]).collect();
        }
    }
    gather(&mut mesh.positions, &kept);
    gather(&mut mesh.normals, &kept);
    gather(&mut mesh.tangents, &kept);
    gather(&mut mesh.colors, &kept);
    mesh.uvs.iter_mut().for_each(|uvs| gather(uvs, &kept));
    for i in mesh.triangles.iter_mut().flatten() {
        *i = new_index[*i as usize];
    }
}

/// Makes all normals unit vectors. A zero or infinite one is replaced by the area-weighted mean of the faces around the
/// vertex.
fn repair_normals(mesh: &mut Mesh, place: &str, warnings: &mut Warnings) {
    let usable = |n: &Vec3| n.is_finite() && n.length_squared() > 1e-12 && n.length_squared().is_finite();
    let bad = mesh.normals.iter().filter(|n| !usable(n)).count();
    if bad > 0 {
        if bad == mesh.normals.len() {
            warnings.push(place, "no normal is usable; the mesh is shaded flat");
            mesh.normals.clear();
            mesh.tangents.clear();
            return;
        }
        let mut faces = vec![Vec3::ZERO; mesh.positions.len()];
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
            let area = (b - a).cross(c - a);
            triangle.iter().for_each(|i| faces[*i as usize] += area);
        }
        for (normal, face) in mesh.normals.iter_mut().zip(faces) {
            if !usable(normal) {
                *normal = face.normalize_or(Vec3::Z);
            }
        }
        warnings.push(place, format!("{bad} normals were zero or not finite; the faces' mean takes their place"));
    }
    mesh.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Z));
}

/// Makes tangents unit vectors with a sign of +1 or -1; a mesh with an unusable one gets new tangents later.
fn repair_tangents(mesh: &mut Mesh, place: &str, warnings: &mut Warnings) {
    for tangent in &mut mesh.tangents {
        let direction = tangent.truncate();
        if !tangent.is_finite() || direction.length_squared() < 1e-12 || !direction.length_squared().is_finite() {
            warnings.push(place, "a tangent is zero or not finite; the tangents are computed anew");
            mesh.tangents.clear();
            return;
        }
        *tangent = direction.normalize().extend(if tangent.w < 0.0 { -1.0 } else { 1.0 });
    }
}
