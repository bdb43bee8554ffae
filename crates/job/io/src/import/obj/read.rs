//! Reads an OBJ file with `tobj`.
//!
//! `tobj` gets the vertices, texture coordinates, normals and faces, in one model. Its errors contain no line, and it
//! misreads some statements without an error. So each line is checked before.

use super::groups::Groups;
use super::tally::Tally;
use super::{RE_EXPORT, text, too_large};
use crate::error::InputError;
use std::path::Path;
use tobj::LoadOptions;

/// Means "no texture coordinate" and "no normal".
pub(super) const NONE: u32 = u32::MAX;
/// Larger coordinates count as damaged: their squares exceed the range of f32.
const FARTHEST: f64 = 1e15;
/// Colour of a vertex without one in a file where others have one. It becomes white.
const NO_COLOR: &str = " inf inf inf";

/// The content of an OBJ file, with indices resolved and checked.
#[derive(Debug, Default)]
pub(super) struct Parsed {
    /// Positions that faces use; not finite where those of the file cannot be used.
    pub positions: Vec<[f64; 3]>,
    /// Vertex colours, if any vertex has one; white where a vertex has none.
    pub colors: Vec<[f32; 3]>,
    /// Texture coordinates, v up.
    pub texcoords: Vec<[f32; 2]>,
    /// Normals, of unit length; the zero vector where they cannot be used.
    pub normals: Vec<[f32; 3]>,
    /// Corners of all faces.
    pub corners: Vec<Corner>,
    /// The faces.
    pub faces: Vec<Face>,
    /// Objects, materials and libraries.
    pub groups: Groups,
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
    /// Index into the objects.
    pub object: u32,
    /// Index into the materials.
    pub material: u32,
    /// Have its corners texture coordinates and normals?
    has: [bool; 2],
}

/// Reads a text shorter than 4 GiB; `most_bytes` bounds the meshes that are made of it.
///
/// # Errors
/// A line that cannot be read, or meshes that need more memory.
pub(super) fn read(source: String, path: &Path, most_bytes: u64, tally: &mut Tally) -> Result<Parsed, InputError> {
    let refused = |line: u32, reason: &str| {
        let problem = format!("cannot be read as an OBJ statement: {reason}");
        InputError::new(path, format!("line {line}"), problem, RE_EXPORT)
    };
    let colored = source.lines().any(has_color);
    let mut scan = Scan { text: String::with_capacity(source.len()), ..Scan::default() };
    for (line, content) in (1..).zip(source.lines()) {
        scan.statement(line, content, colored, tally).map_err(|reason| refused(line, reason))?;
        scan.text.push('\n');
    }
    drop(source);
    let [positions, _, _] = scan.counts.map(u64::from);
    let triangles = u64::from(scan.corners) - 2 * scan.faces.len() as u64;
    if positions * if colored { 28 } else { 12 } + triangles * 12 > most_bytes {
        return Err(too_large(path, most_bytes));
    }
    let Scan { text, groups, faces, corners: count, .. } = scan;
    // Polygons are not divided, and lists keep their own indices. `assemble` makes the triangles and vertices.
    let load = |text: &str| {
        let libraries = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
        tobj::load_obj_buf(&mut text.as_bytes(), &LoadOptions::default(), libraries)
    };
    let (models, _) = load(&text).map_err(|e| {
        let line = text::first_refused(&text, |line| line.starts_with('v') && load(line).is_err());
        refused(line, &e.to_string())
    })?;
    let mesh = models.into_iter().next().map(|model| model.mesh).unwrap_or_default();
    let is_whole = mesh.indices.len() == count as usize && [0, mesh.positions.len()].contains(&mesh.vertex_color.len());
    if !is_whole {
        return Err(refused(0, "vertices or faces were lost while the file was read"));
    }
    Ok(Parsed {
        positions: mesh.positions.as_chunks().0.iter().map(position).collect(),
        colors: colors(mesh.vertex_color.as_chunks().0),
        texcoords: mesh.texcoords.as_chunks().0.iter().map(texcoord).collect(),
        normals: mesh.normals.as_chunks().0.iter().map(unit).collect(),
        corners: corners(&mesh, &faces),
        faces,
        groups,
    })
}

/// The lines of a file before `tobj` reads them.
#[derive(Default)]
struct Scan {
    /// The lines for `tobj`; the others are empty.
    text: String,
    /// Numbers of positions, texture coordinates and normals.
    counts: [u32; 3],
    corners: u32,
    faces: Vec<Face>,
    groups: Groups,
}

impl Scan {
    fn statement(&mut self, line: u32, content: &str, colored: bool, tally: &mut Tally) -> Result<(), &'static str> {
        let (key, rest) = text::keyword(content);
        let data = text::without_comment(rest);
        match key {
            "v" => self.counts[0] += 1,
            "vt" => self.counts[1] += 1,
            "vn" => self.counts[2] += 1,
            "f" => self.face(line, data)?,
            _ if key.is_empty() || key.starts_with('#') || self.groups.statement(line, key, rest) => return Ok(()),
            "p" | "l" => {
                tally.add(line, "points and lines have no surface and are left out");
                return Ok(());
            }
            _ => {
                tally.add(line, "an unknown statement is skipped; of free-form surfaces export polygons");
                return Ok(());
            }
        }
        self.text.extend([key, " ", data]);
        if key == "v" {
            let mut words = data.split_whitespace().skip(3).map(str::parse::<f64>);
            match [words.next(), words.next(), words.next()] {
                [None, ..] if colored => self.text.push_str(NO_COLOR),
                // `tobj` divides by the weight of a vertex.
                [Some(weight), None, _] if colored || weight != Ok(1.0) => {
                    return Err("the vertex has a fourth number, a weight, which polygon meshes have not");
                }
                [Some(r), Some(g), Some(b)] if [&r, &g, &b].iter().any(|v| v.is_err()) => {
                    return Err("the colour of the vertex is not three numbers");
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Checks the indices of a face. In `tobj`, a wrong one is an error without a line, and a corner without a texture
    /// coordinate or normal gets that of the corner before.
    fn face(&mut self, line: u32, data: &str) -> Result<(), &'static str> {
        let (mut has, mut count) = (None, 0);
        for corner in data.split_whitespace() {
            let mut given = [false; 3];
            for (list, field) in corner.split('/').enumerate().filter(|(_, field)| !field.is_empty()) {
                let index = field.parse::<i64>().map_err(|_| "an index of the face is not a whole number")?;
                let seen = *self.counts.get(list).ok_or("a corner of the face has more than three indices")?;
                // Some exporters write indices of texture coordinates and normals into a file without any.
                given[list] = list == 0 || seen > 0;
                if given[list] && (index == 0 || index.unsigned_abs() > seen.into()) {
                    return Err("the face has an index that no line before it defines");
                }
            }
            if !given[0] || has.is_some_and(|has| has != given) {
                return Err("the corners of the face have different kinds of indices");
            }
            has = Some(given);
            count += 1;
        }
        let Some([_, texcoord, normal]) = has.filter(|_| count >= 3) else {
            return Err("the face has fewer than three corners");
        };
        let Groups { smoothing, object, material, .. } = self.groups;
        let has = [texcoord, normal];
        self.faces.push(Face { first: self.corners, count, line, smoothing, object, material, has });
        self.corners += count;
        Ok(())
    }
}

/// Is it a vertex of six numbers or more?
fn has_color(line: &str) -> bool {
    let (key, rest) = text::keyword(line);
    key == "v" && text::without_comment(rest).split_whitespace().nth(5).is_some()
}

fn corners(mesh: &tobj::Mesh, faces: &[Face]) -> Vec<Corner> {
    let optional = |has: bool, list: &[u32], i: usize| list.get(i).copied().filter(|_| has).unwrap_or(NONE);
    let corner = |face: &Face, i: usize| Corner {
        position: mesh.indices[i],
        texcoord: optional(face.has[0], &mesh.texcoord_indices, i),
        normal: optional(face.has[1], &mesh.normal_indices, i),
    };
    let range = |face: &Face| face.first as usize..(face.first + face.count) as usize;
    faces.iter().flat_map(|face| range(face).map(move |i| corner(face, i))).collect()
}

fn position(p: &[f64; 3]) -> [f64; 3] {
    if p.iter().all(|v| v.abs() <= FARTHEST) { *p } else { [f64::NAN; 3] }
}

/// Zero where it cannot be used.
fn texcoord(uv: &[f64; 2]) -> [f32; 2] {
    if uv.iter().all(|v| v.abs() <= 1e6) { uv.map(|v| v as f32) } else { [0.0; 2] }
}

fn unit(normal: &[f64; 3]) -> [f32; 3] {
    let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length.is_finite() && length > 1e-30 { normal.map(|v| (v / length) as f32) } else { [0.0; 3] }
}

/// Colours from 0 to 1: values above 2 mean that all are bytes. White where there is none.
fn colors(colors: &[[f64; 3]]) -> Vec<[f32; 3]> {
    // Negative values, and those that are no numbers, are black.
    let channel = |v: f64| if v >= 0.0 { v as f32 } else { 0.0 };
    let largest = colors.iter().flatten().map(|v| channel(*v)).filter(|v| v.is_finite()).fold(0.0, f32::max);
    let scale = if largest > 2.0 { 1.0 / 255.0 } else { 1.0 };
    let scaled = |v: f64| if channel(v).is_finite() { (channel(v) * scale).min(1.0) } else { 1.0 };
    colors.iter().map(|color| color.map(scaled)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(source: &str) -> Parsed {
        read(source.into(), Path::new("a.obj"), u64::MAX, &mut Tally::default())
            .unwrap_or_else(|e| panic!("{e}\n{source}"))
    }

    /// Corners without a texture coordinate or normal keep none, although `tobj` repeats those of the corner before.
    #[test]
    fn faces_with_and_without_texture_coordinates_may_follow_each_other() {
        let p = parsed(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 7 7\nvt 1 0.5\nvn 0 0 2\nvn 0 3 0\nf 1 2 3\nf -3/2/2 2/1/1 3/1/1\nf 1//2 2//1 3//2",
        );
        let value = |c: &Corner| {
            let texcoord = p.texcoords.get(c.texcoord as usize).map(|uv| uv[0]);
            (p.positions[c.position as usize][0], texcoord, p.normals.get(c.normal as usize).map(|n| n[1]))
        };
        let values: Vec<_> = p.corners.iter().map(value).collect();
        let (one, seven) = (Some(1.0), Some(7.0));
        assert_eq!(values[..3], [(0.0, None, None), (1.0, None, None), (0.0, None, None)]);
        assert_eq!(values[3..6], [(0.0, one, one), (1.0, seven, Some(0.0)), (0.0, seven, Some(0.0))]);
        assert_eq!(values[6..], [(0.0, None, one), (1.0, None, Some(0.0)), (0.0, None, one)]);
    }

    #[test]
    fn polygons_stay_whole() {
        let p = parsed("v 0 0 0\nv 1 0 0\nf 1 1 1 1 1\nf 2 1 2\nf -1 -1 -1 -1\n");
        let ranges: Vec<(u32, u32)> = p.faces.iter().map(|f| (f.first, f.count)).collect();
        assert_eq!((ranges, p.corners.len()), (vec![(0, 5), (5, 3), (8, 4)], 12));
        assert_eq!(p.positions[p.corners[5].position as usize], [1.0, 0.0, 0.0]);
    }

    #[test]
    fn coordinates_keep_all_digits() {
        let p = parsed("v 5000000.123456789 0 0\nv 0 1e-20 0\nv 0 0 4.9e-1\nf 1 2 3\n");
        assert_eq!(p.positions, [[5000000.123456789, 0.0, 0.0], [0.0, 1e-20, 0.0], [0.0, 0.0, 0.49]]);
    }

    #[test]
    fn lines_that_tobj_refuses_or_misreads_are_refused_with_their_number() {
        let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n# six\n";
        for line in [
            "f 1 2 4",
            "f 0 1 2",
            "f 1 2 -4",
            "f -9223372036854775808 1 2",
            "f 1/2 2/1 3/1",
            "f 1/-9223372036854775807 2/1 3/1",
            "f 1//0 2//1 3//1",
            "f 1/1/1/1 2 3",
            "f 1/1 2 3",
            "f /1 /1 /1",
            "f 1 2",
            "f",
            "f a b c",
            "v 1,5 0 0",
            "v 1.#QNAN 0 0",
            "v 1 2",
            "v 1 2 3 0.5",
            "v 1 2 3 4 5",
            "v 1 2 3 4 5 x",
            "v 1 2 3 4 5 6 7",
            "vt",
            "vt 1",
            "vn 1 2",
        ] {
            let text = format!("{start}{line}\nf 1 2 3\n");
            let error = read(text, Path::new("a.obj"), u64::MAX, &mut Tally::default()).expect_err(line);
            assert_eq!(error.place, "line 7", "{line}: {error}");
        }
    }
}
