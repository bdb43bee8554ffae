//! The statements of an OBJ file as plain lists; faults are tallied with their line numbers, never fatal.

use super::tally::Tally;
use super::text;
use std::collections::HashMap;

/// Stands for "no texture coordinate" and "no normal".
pub(super) const NONE: u32 = u32::MAX;

/// Coordinates beyond this are taken for damage: their squares leave the range of f32.
const FARTHEST: f64 = 1e15;

/// What an OBJ file says, indices resolved and checked.
#[derive(Debug, Default)]
pub(super) struct Parsed {
    /// Positions; not finite where the file's were unusable.
    pub positions: Vec<[f64; 3]>,
    /// Vertex colours as written, if any vertex has one; white where a vertex has none.
    pub colors: Vec<[f32; 3]>,
    /// Texture coordinates, v up.
    pub texcoords: Vec<[f32; 2]>,
    /// Normals as written; the zero vector where unusable.
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

/// Reads the statements. The text must be shorter than 4 GiB, so that u32 indices suffice; the loader's limits see to it.
pub(super) fn parse(source: &str, tally: &mut Tally) -> Parsed {
    let mut reader = Reader::new(tally);
    for (line, content) in text::lines(source) {
        reader.statement(line, &content);
    }
    reader.finish()
}

struct Reader<'a> {
    parsed: Parsed,
    tally: &'a mut Tally,
    object_ids: HashMap<String, u32>,
    material_ids: HashMap<String, u32>,
    /// Names in force.
    o: String,
    g: String,
    object: u32,
    material: u32,
    smoothing: u32,
}

impl<'a> Reader<'a> {
    fn new(tally: &'a mut Tally) -> Self {
        let parsed = Parsed { objects: vec![String::new()], materials: vec![String::new()], ..Parsed::default() };
        Self {
            parsed,
            tally,
            object_ids: HashMap::from([(String::new(), 0)]),
            material_ids: HashMap::from([(String::new(), 0)]),
            o: String::new(),
            g: String::new(),
            object: 0,
            material: 0,
            smoothing: 0,
        }
    }

    fn statement(&mut self, line: u32, content: &str) {
        let (key, rest) = text::keyword(content);
        if key.is_empty() || key.starts_with('#') {
            return;
        }
        let data = text::without_comment(rest);
        match key {
            "v" => self.vertex(line, data),
            "vt" => self.texcoord(line, data),
            "vn" => self.normal(line, data),
            "f" | "fo" => self.face(line, data),
            "o" => {
                self.o = data.to_string();
                self.g.clear();
                self.name_object();
            }
            "g" => {
                self.g = data.split_whitespace().collect::<Vec<_>>().join(" ");
                self.name_object();
            }
            "s" => self.smoothing = smoothing_group(data),
            // Names may hold spaces and even '#'; the lookup sorts that out.
            "usemtl" => self.material = intern(&mut self.material_ids, &mut self.parsed.materials, rest),
            "mtllib" => self.parsed.libraries.push((line, rest.to_string())),
            "p" | "l" => self.tally.add(line, "points and lines have no surface and are left out"),
            "vp" | "cstype" | "deg" | "bmat" | "step" | "curv" | "curv2" | "surf" | "parm" | "trim" | "hole"
            | "scrv" | "sp" | "end" | "con" => {
                self.tally.add(line, "free-form curves and surfaces are not read; export polygons")
            }
            "call" | "csh" => self.tally.add(line, "`call` and `csh` statements are never carried out"),
            // Display hints, and data of other programs that no image shows.
            "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "maplib" | "usemap" | "shadow_obj" | "trace_obj"
            | "ctech" | "stech" | "vw" => {}
            _ => {
                let shown: String = key.chars().take(20).collect();
                self.tally.add(line, &format!("the unknown statement `{shown}` is skipped"));
            }
        }
    }

    fn vertex(&mut self, line: u32, data: &str) {
        let mut values = [0.0; 7];
        let count = self.numbers(line, data, &mut values);
        let usable = count >= 3 && values[..3].iter().all(|v| v.abs() <= FARTHEST);
        if !usable {
            self.tally.add(line, "the vertex is not three usable numbers; faces that use it are dropped");
        }
        self.parsed.positions.push(if usable { [values[0], values[1], values[2]] } else { [f64::NAN; 3] });
        // Four values are x y z w, with a weight that only curves use; six or more are x y z r g b.
        if count >= 6 {
            let color = [values[3], values[4], values[5]].map(|v| if v >= 0.0 { v as f32 } else { 0.0 });
            self.parsed.colors.resize(self.parsed.positions.len() - 1, [f32::NAN; 3]);
            self.parsed.colors.push(color);
        }
    }

    fn texcoord(&mut self, line: u32, data: &str) {
        let mut values = [0.0; 3];
        let count = self.numbers(line, data, &mut values);
        let usable = count >= 1 && values[..2].iter().all(|v| v.abs() <= 1e6);
        if !usable {
            self.tally.add(line, "the texture coordinate is not usable and was set to 0");
        }
        self.parsed.texcoords.push(if usable { [values[0] as f32, values[1] as f32] } else { [0.0; 2] });
    }

    fn normal(&mut self, line: u32, data: &str) {
        let mut values = [0.0; 3];
        let count = self.numbers(line, data, &mut values);
        let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
        let usable = count == 3 && length.is_finite() && length > 1e-30;
        if !usable {
            self.tally.add(line, "the normal has no direction; it is computed from the faces instead");
        }
        self.parsed.normals.push(if usable { values.map(|v| (v / length) as f32) } else { [0.0; 3] });
    }

    /// Reads numbers into `values` and tells how many there were; a word that is none ends the list.
    fn numbers(&mut self, line: u32, data: &str, values: &mut [f64]) -> usize {
        let mut count = 0;
        for (slot, word) in values.iter_mut().zip(data.split_whitespace()) {
            let Some((value, broken)) = text::number(word) else { break };
            if broken {
                self.tally.add(line, "a number is misspelled; what could be read of it is used");
            }
            *slot = value;
            count += 1;
        }
        count
    }

    fn face(&mut self, line: u32, data: &str) {
        let first = self.parsed.corners.len();
        for word in data.split_whitespace() {
            match self.corner(line, word) {
                Some(corner) => self.parsed.corners.push(corner),
                None => {
                    self.parsed.dropped_faces += 1;
                    self.parsed.corners.truncate(first);
                    return;
                }
            }
        }
        let count = self.parsed.corners.len() - first;
        if count < 3 {
            self.tally.add(line, "the face has fewer than three corners and is dropped");
            self.parsed.dropped_faces += 1;
            self.parsed.corners.truncate(first);
            return;
        }
        self.parsed.faces.push(Face {
            first: first as u32,
            count: count as u32,
            line,
            smoothing: self.smoothing,
            object: self.object,
            material: self.material,
        });
    }

    /// A corner `v`, `v/t`, `v//n` or `v/t/n`. Negative indices count back from here; positive ones may point ahead and
    /// are checked at the end.
    fn corner(&mut self, line: u32, word: &str) -> Option<Corner> {
        let mut fields = word.split('/');
        let position = match resolve(fields.next().unwrap_or(""), self.parsed.positions.len()) {
            Index::At(i) => i,
            _ => {
                self.tally.add(line, "the face has an index that names no vertex and is dropped");
                return None;
            }
        };
        let mut optional =
            |field: Option<&str>, count: usize, what: &str| match field.map_or(Index::Absent, |f| resolve(f, count)) {
                Index::At(i) => i,
                Index::Absent => NONE,
                Index::Bad => {
                    self.tally.add(line, what);
                    NONE
                }
            };
        let texcoord = optional(fields.next(), self.parsed.texcoords.len(), NO_TEXCOORD);
        let normal = optional(fields.next(), self.parsed.normals.len(), NO_NORMAL);
        Some(Corner { position, texcoord, normal })
    }

    /// `o` names an object; a `g` inside it, if named differently, is an object of its own.
    fn name_object(&mut self) {
        let name = match (self.o.as_str(), self.g.as_str()) {
            (o, "" | "default") => o.to_string(),
            ("", g) => g.to_string(),
            (o, g) if o == g => g.to_string(),
            (o, g) => format!("{o}/{g}"),
        };
        self.object = intern(&mut self.object_ids, &mut self.parsed.objects, &name);
    }

    /// Checks the indices that pointed ahead, and fills in the colours that vertices lack.
    fn finish(self) -> Parsed {
        let Self { mut parsed, tally, .. } = self;
        let (positions, texcoords, normals) = (parsed.positions.len(), parsed.texcoords.len(), parsed.normals.len());
        let corners = &mut parsed.corners;
        let dropped = &mut parsed.dropped_faces;
        parsed.faces.retain(|face| {
            let range = face.first as usize..(face.first + face.count) as usize;
            for corner in corners.get_mut(range).unwrap_or_default() {
                if corner.position as usize >= positions {
                    tally.add(face.line, "the face has an index that names no vertex and is dropped");
                    *dropped += 1;
                    return false;
                }
                if corner.texcoord != NONE && corner.texcoord as usize >= texcoords {
                    tally.add(face.line, NO_TEXCOORD);
                    corner.texcoord = NONE;
                }
                if corner.normal != NONE && corner.normal as usize >= normals {
                    tally.add(face.line, NO_NORMAL);
                    corner.normal = NONE;
                }
            }
            true
        });
        if !parsed.colors.is_empty() {
            parsed.colors.resize(positions, [f32::NAN; 3]);
            let largest = parsed.colors.iter().flatten().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
            // A little above one is rounding or a bright light; bytes go far beyond.
            let scale = if largest > 2.0 { 1.0 / 255.0 } else { 1.0 };
            if largest > 2.0 {
                tally.note("vertex colours exceed 2 and are taken to run from 0 to 255");
            }
            for color in &mut parsed.colors {
                *color = color.map(|v| if v.is_finite() { (v * scale).min(1.0) } else { 1.0 });
            }
        }
        parsed
    }
}

const NO_TEXCOORD: &str = "an index names no texture coordinate and is ignored";
const NO_NORMAL: &str = "an index names no normal; it is computed from the faces instead";

enum Index {
    At(u32),
    Absent,
    Bad,
}

/// From OBJ's counting (from 1, or back from -1) to ours (from 0).
fn resolve(field: &str, count: usize) -> Index {
    if field.is_empty() {
        return Index::Absent;
    }
    let index = match field.parse::<i64>() {
        Ok(i) if i > 0 => i - 1,
        Ok(i) if i < 0 => count as i64 + i,
        _ => -1,
    };
    match u32::try_from(index) {
        Ok(i) if i != NONE => Index::At(i),
        _ => Index::Bad,
    }
}

fn smoothing_group(data: &str) -> u32 {
    match data.split_whitespace().next().unwrap_or("off") {
        "on" => 1,
        word => word.parse().unwrap_or(0),
    }
}

fn intern(ids: &mut HashMap<String, u32>, names: &mut Vec<String>, name: &str) -> u32 {
    if let Some(id) = ids.get(name) {
        return *id;
    }
    let id = names.len() as u32;
    names.push(name.to_string());
    ids.insert(name.to_string(), id);
    id
}
