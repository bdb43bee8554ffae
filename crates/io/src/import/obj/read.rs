//! Reads the cleaned text with `tobj`, and converts its arrays and the separately stored names to plain lists.

use super::clean::{Cleaner, Found, REGISTER_LINE, with_none};
use super::plain::Counts;
use super::tally::Tally;
use std::panic::{AssertUnwindSafe, catch_unwind};
use tobj::LoadOptions;

/// Means "no texture coordinate" and "no normal".
pub(super) const NONE: u32 = u32::MAX;

/// The content of an OBJ file, with indices resolved and checked.
#[derive(Debug, Default)]
pub(super) struct Parsed {
    /// Positions; not finite where those of the file were unusable.
    pub positions: Vec<[f64; 3]>,
    /// Vertex colours, if any vertex has one; white where a vertex has none.
    pub colors: Vec<[f32; 3]>,
    /// Texture coordinates, v up.
    pub texcoords: Vec<[f32; 2]>,
    /// Normals, of unit length; the zero vector where unusable.
    pub normals: Vec<[f32; 3]>,
    /// Corners of all faces.
    pub corners: Vec<Corner>,
    /// The faces.
    pub faces: Vec<Face>,
    /// Faces that cannot be used and are not in the list.
    pub dropped_faces: usize,
    /// Names of objects and groups; the first is that of faces before any name.
    pub objects: Vec<String>,
    /// Material names in order of first use, as written; the first, empty one is "none".
    pub materials: Vec<String>,
    /// Material libraries and their lines, as written.
    pub libraries: Vec<(u32, String)>,
}

/// One corner of a face: indices into positions, texture coordinates and normals ([`NONE`] where absent).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub position: u32,
    pub texcoord: u32,
    pub normal: u32,
}

/// A polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// First of its corners.
    pub first: u32,
    /// Number of corners, at least 3.
    pub count: u32,
    /// Line in the file.
    pub line: u32,
    /// Smoothing group; 0 is off.
    pub smoothing: u32,
    /// Index into `objects`.
    pub object: u32,
    /// Index into `materials`.
    pub material: u32,
}

/// The reason why a text cannot be read.
#[derive(Debug)]
pub(super) enum Refused {
    /// Its meshes need more memory than allowed.
    TooLarge,
    /// `tobj` does not accept this line: this is the reason.
    Line(u32, String),
}

/// Reads a text shorter than 4 GiB; `most_bytes` bounds the meshes that are made of it.
pub(super) fn read(source: &str, most_bytes: u64, tally: &mut Tally) -> Result<Parsed, Refused> {
    let mut cleaner = Cleaner::new(source, most_bytes, tally);
    // Polygons are not divided, and lists keep their own indices. `assemble` makes the triangles and vertices.
    let options = LoadOptions::default();
    let libraries = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let outcome = catch_unwind(AssertUnwindSafe(|| tobj::load_obj_buf(&mut cleaner, &options, libraries)));
    let found = cleaner.finish();
    if found.too_large {
        return Err(Refused::TooLarge);
    }
    let line = found.line;
    let reason = match outcome {
        Ok(Ok((models, _))) => {
            let mesh = models.into_iter().next().map(|model| model.mesh).unwrap_or_default();
            match from_mesh(&mesh, found) {
                Some(mut parsed) => {
                    scale_colors(&mut parsed.colors, tally);
                    return Ok(parsed);
                }
                None => "vertices or faces were lost while it was read".into(),
            }
        }
        Ok(Err(e)) => e.to_string(),
        Err(_) => "the reader broke down".into(),
    };
    Err(Refused::Line(line, reason))
}

/// `None` if the arrays differ from the content of the cleaned text.
fn from_mesh(mesh: &tobj::Mesh, found: Found) -> Option<Parsed> {
    let Found { total, groups, mut faces, dropped_faces, .. } = found;
    let lists = with_none(&total).map(|n| n as usize);
    let [positions, texcoords, normals] = lists;
    // The register contains each entry before any face does, so the arrays are those of the file. Without a vertex
    // there is neither register nor face.
    let is_complete = mesh.positions.len() == 3 * positions
        && mesh.texcoords.len() == 2 * texcoords
        && mesh.normals.len() == 3 * normals
        && [0, 3 * positions].contains(&mesh.vertex_color.len());
    if positions > 0 && !is_complete {
        return None;
    }
    let registered = if positions > 0 { positions.max(texcoords).max(normals) } else { 0 };
    set_corners(&mut faces, &mesh.face_arities, registered)?;
    let corners = corners(mesh, registered, &total)?;
    if faces.last().is_some_and(|f| (f.first + f.count) as usize != corners.len()) {
        return None;
    }
    Some(Parsed {
        positions: mesh.positions.as_chunks().0.to_vec(),
        colors: mesh.vertex_color.as_chunks().0.iter().map(|rgb: &[f64; 3]| rgb.map(color)).collect(),
        texcoords: mesh.texcoords.as_chunks().0.iter().map(|uv: &[f64; 2]| uv.map(|v| v as f32)).collect(),
        normals: mesh.normals.as_chunks().0.iter().map(unit).collect(),
        corners,
        faces,
        dropped_faces,
        objects: groups.objects,
        materials: groups.materials,
        libraries: groups.libraries,
    })
}

/// Assigns ranges of corners to the faces. `tobj` returns no numbers of corners if all faces, including those of the
/// register, are triangles.
fn set_corners(faces: &mut [Face], arities: &[u32], registered: usize) -> Option<()> {
    let register_lines = registered.div_ceil(REGISTER_LINE as usize);
    if !arities.is_empty() && arities.len() != register_lines + faces.len() {
        return None;
    }
    let mut first = 0_u32;
    for (i, face) in faces.iter_mut().enumerate() {
        (face.first, face.count) = (first, arities.get(register_lines + i).copied().unwrap_or(3));
        first = first.checked_add(face.count)?;
    }
    Some(())
}

/// The corners after the register's.
fn corners(mesh: &tobj::Mesh, registered: usize, total: &Counts) -> Option<Vec<Corner>> {
    // The entry after the last means none.
    let optional = |list: &[u32], i: usize, count: u32| list.get(i).copied().filter(|n| *n < count).unwrap_or(NONE);
    let corner = |(i, position): (usize, &u32)| Corner {
        position: *position,
        texcoord: optional(&mesh.texcoord_indices, i, total[1]),
        normal: optional(&mesh.normal_indices, i, total[2]),
    };
    let corners: Vec<Corner> = mesh.indices.iter().enumerate().skip(registered).map(corner).collect();
    corners.iter().all(|c| c.position < total[0]).then_some(corners)
}

/// A channel of a vertex colour. A negative value, or one that is no number, becomes black.
fn color(v: f64) -> f32 {
    if v >= 0.0 { v as f32 } else { 0.0 }
}

fn unit(normal: &[f64; 3]) -> [f32; 3] {
    let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 0.0 { normal.map(|v| (v / length) as f32) } else { [0.0; 3] }
}

/// Clamps colours to the range from 0 to 1. White where there is none.
fn scale_colors(colors: &mut [[f32; 3]], tally: &mut Tally) {
    let largest = colors.iter().flatten().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
    // A value slightly above one is a rounding error or a bright light. Bytes are far above it.
    let scale = if largest > 2.0 { 1.0 / 255.0 } else { 1.0 };
    if largest > 2.0 {
        tally.note("vertex colours exceed 2 and are taken to run from 0 to 255");
    }
    for color in colors {
        *color = color.map(|v| if v.is_finite() { (v * scale).min(1.0) } else { 1.0 });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(source: &str) -> Parsed {
        read(source, u64::MAX, &mut Tally::default()).unwrap_or_else(|e| panic!("{e:?}\n{source}"))
    }

    #[test]
    fn indices_are_those_of_the_file_and_unused_entries_stay() {
        let p = parsed("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 7 7\nvt 1 0.5\nvn 0 0 2\nvn 0 3 0\nf 4/2/2 2 3//1\n");
        assert_eq!((p.positions.len(), p.positions[0]), (4, [9.0; 3]));
        assert_eq!((p.texcoords[1], p.normals[1]), ([1.0, 0.5], [0.0, 1.0, 0.0]));
        let corners: Vec<[u32; 3]> = p.corners.iter().map(|c| [c.position, c.texcoord, c.normal]).collect();
        assert_eq!(corners, [[3, 1, 1], [1, NONE, NONE], [2, NONE, 0]]);
    }

    /// More entries than one line of the register holds, and fewer than a polygon's corners.
    #[test]
    fn polygons_stay_whole_beside_registers_of_any_length() {
        for n in [1, 2, 3, 4, 255, 256, 257, 259, 600] {
            let vertices: String = (0..n).map(|i| format!("v {i} 0 0\n")).collect();
            let p = parsed(&format!("{vertices}f 1 1 1 1 1\nf {n} 1 {n}\nf -1 -1 -1 -1\n"));
            let ranges: Vec<(u32, u32)> = p.faces.iter().map(|f| (f.first, f.count)).collect();
            assert_eq!(ranges, [(0, 5), (5, 3), (8, 4)], "{n} vertices");
            assert_eq!((p.positions.len(), p.corners.len()), (n, 12));
            assert_eq!(p.corners[5].position as usize, n - 1);
        }
    }

    #[test]
    fn coordinates_keep_all_digits() {
        let p = parsed("v 5000000.123456789 0 0\nv 0 1e-20 0\nv 0 0 4.9e-1\nf 1 2 3\n");
        assert_eq!(p.positions, [[5000000.123456789, 0.0, 0.0], [0.0, 1e-20, 0.0], [0.0, 0.0, 0.49]]);
    }

    #[test]
    fn a_text_without_vertices_has_no_faces() {
        let p = parsed("vt 0 0\nvn 0 0 1\nf 1 2 3\no a\n");
        assert!(p.faces.is_empty() && p.positions.is_empty());
        assert_eq!((p.dropped_faces, p.objects.len()), (1, 2));
    }
}
