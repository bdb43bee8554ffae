//! PLY meshes, text and binary, read by the crate `ply-rs-bw`. The code here checks the header, names the values, and
//! makes triangles of polygons.

use crate::error::InputError;
use crate::import::guard::guarded;
use crate::import::mesh_file::{Object, linear, origin, scene_of_meshes, without_mark};
use crate::import::options::{ImportOptions, Imported};
use crate::import::triangulate::{Outcome, Triangulator};
use crate::import::warnings::Warnings;
use crate::loader::AssetLoader;
use dunkelfeld_geometry::{DVec3, Mesh, Vec3, Vec4};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Header, Property, PropertyAccess, PropertyAccessResult};
use std::io::Cursor;
use std::path::Path;

/// Bytes of a face in memory, beside its corners.
const FACE: u64 = 64;
/// Reads a PLY file in its own units and axes; [`load_scene`](crate::import::load_scene) converts them.
///
/// | element | properties | becomes |
/// |---|---|---|
/// | `vertex` | `x`, `y`, `z` | positions, read as f64 |
/// | `vertex` | `nx`, `ny`, `nz` | normals; without them shading is flat |
/// | `vertex` | `red`, `green`, `blue` (or `r`, `g`, `b`, or `diffuse_red` and so on), `alpha` | vertex colours, encoded as sRGB: whole numbers of their range, or floating point from 0 to 1 |
/// | `face` | `vertex_indices` or `vertex_index` | polygons, also concave ones |
/// | `tristrips` | `vertex_indices` or `vertex_index` | strips of triangles; -1 ends a strip |
///
/// Other elements and properties are skipped; textures and colours of faces with a warning. The file is one object with
/// one material of the file's name.
///
/// # Errors
/// If the file cannot be read, is no PLY, is cut off, is beyond the limits, or has no face.
pub fn load_ply(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let loader = AssetLoader::new(path, options.limits);
    let bytes = loader.read_scene()?;
    let mut warnings = Warnings::new(path);
    let parsed = guarded(path, "the file", || {
        read(without_mark(&bytes, path)?, path, options.limits.geometry_bytes, &mut warnings)
    })?;
    drop(bytes);
    let colored = parsed.has_colors;
    let object = assemble(parsed, path, &mut warnings)?;
    Ok(scene_of_meshes(path, vec![object], colored, warnings, loader))
}

/// The content of a file.
#[derive(Default)]
struct Parsed {
    vertices: Vec<Vertex>,
    faces: Vec<Face>,
    strips: Vec<Face>,
    has_normals: bool,
    has_colors: bool,
}

fn read(bytes: &[u8], path: &Path, most: u64, warnings: &mut Warnings) -> Result<Parsed, InputError> {
    let fault = |e: ParseError| {
        let place = e.line().map_or_else(|| "the file".to_string(), |line| format!("line {line}"));
        let problem = format!("cannot be read as PLY: {}", first_line(&e.to_string()));
        InputError::new(path, place, problem, "export the mesh again as binary PLY, or as glTF")
    };
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(fault)?;
    check_sizes(&header, bytes.len() as u64, path, most)?;
    warn_of_lost_looks(&header, warnings);
    let mut parsed = Parsed::default();
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => {
                let has = |names: [&str; 3]| names.iter().all(|name| element.properties.contains_key(*name));
                let colors =
                    [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
                if !has(["x", "y", "z"]) {
                    let problem = "its vertices have no coordinates `x`, `y` and `z`";
                    return Err(InputError::of_file(path, problem, "export the mesh again"));
                }
                parsed.has_normals = has(["nx", "ny", "nz"]);
                parsed.has_colors = colors.into_iter().any(has);
                let vertices = Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header);
                parsed.vertices = vertices.map_err(fault)?;
            }
            "face" | "tristrips" => {
                let faces = Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header);
                let faces = faces.map_err(fault)?;
                if element.name == "face" { parsed.faces = faces } else { parsed.strips = faces }
            }
            _ => {
                Parser::<Skipped>::new().read_payload_for_element(&mut reader, element, &header).map_err(fault)?;
            }
        }
    }
    Ok(parsed)
}

/// Warns of textures and colours that are not read.
fn warn_of_lost_looks(header: &Header, warnings: &mut Warnings) {
    let file = header.comments.iter().find(|c| c.to_ascii_lowercase().starts_with("texturefile"));
    let is_coordinate = |name: &String| name.starts_with("tex") || ["s", "t", "u", "v"].contains(&name.as_str());
    if file.is_some() || header.elements.values().flat_map(|e| e.properties.keys()).any(is_coordinate) {
        let file = file.map(|comment| format!(" (`{comment}`)")).unwrap_or_default();
        let message =
            format!("its texture{file} is not read; if it should have one, export it as glTF or OBJ with MTL");
        warnings.push("the header", message);
    }
    let mut parts = header.elements.values().filter(|e| !["vertex", "edge"].contains(&e.name.as_str()));
    if parts.any(|e| e.properties.keys().any(|name| name == "r" || name.ends_with("red"))) {
        let message = "the colours of its faces are not read; move them to the vertices (in MeshLab: Transfer Color: \
                       Face to Vertex), or export it as glTF";
        warnings.push("the header", message);
    }
}

/// Refuses numbers of elements that the file cannot hold, or whose memory exceeds the limit.
fn check_sizes(header: &Header, bytes: u64, path: &Path, most: u64) -> Result<(), InputError> {
    let mut memory = 0u64;
    for ElementDef { name, count, properties } in header.elements.values() {
        let count = *count as u64;
        // Each property takes at least one byte.
        let fits = count.checked_mul(properties.len() as u64).is_some_and(|size| size <= bytes);
        if count > 0 && (properties.is_empty() || !fits) {
            let problem = format!("its header announces {count} elements \"{name}\", more than the file can hold");
            return Err(InputError::new(path, "the header", problem, "copy or export the file again"));
        }
        let size = match name.as_str() {
            // As read, and as a mesh.
            "vertex" => size_of::<Vertex>() as u64 + 40,
            "face" | "tristrips" => FACE,
            _ => 0,
        };
        memory = memory.saturating_add(count.saturating_mul(size));
    }
    if memory <= most {
        return Ok(());
    }
    let problem = format!("its mesh may need more than {} MiB", most >> 20);
    Err(InputError::new(path, "the header", problem, "reduce the mesh, or raise the import limits"))
}

fn assemble(parsed: Parsed, path: &Path, warnings: &mut Warnings) -> Result<Object, InputError> {
    let places: Vec<DVec3> = parsed.vertices.iter().map(|v| DVec3::from_array(v.position)).collect();
    let origin = origin(places.iter().copied());
    let mut mesh = Mesh::default();
    let (mut unusable, mut without_area) = (0, 0);
    let mut triangulator = Triangulator::default();
    let (mut points, mut ears) = (Vec::new(), Vec::new());
    for face in &parsed.faces {
        points.clear();
        points.extend(face.corners.iter().map_while(|i| places.get(*i as usize)).filter(|p| p.is_finite()));
        if points.len() < face.corners.len() || points.len() < 3 {
            unusable += 1;
            continue;
        }
        ears.clear();
        match triangulator.triangulate(&points, &mut ears) {
            Outcome::Done => {}
            Outcome::Degenerate => without_area += 1,
            Outcome::TooLarge => unusable += 1,
        }
        let corner = |i: u32| face.corners.get(i as usize).copied();
        let triangles = ears.iter().filter_map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?]));
        mesh.triangles.extend(triangles);
    }
    for strip in parsed.strips.iter().flat_map(|strip| strip.corners.split(|i| *i == END_OF_STRIP)) {
        for (k, corners) in strip.windows(3).enumerate() {
            let &[a, b, c] = corners else { continue };
            let usable = |i: u32| places.get(i as usize).is_some_and(|p| p.is_finite());
            if ![a, b, c].into_iter().all(usable) {
                unusable += 1;
            } else if a != b && b != c && a != c {
                // Every other triangle of a strip winds the other way.
                mesh.triangles.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
            }
        }
    }
    for (count, what) in [(unusable, "cannot be used"), (without_area, "have no area")] {
        if count > 0 {
            warnings.push("faces", format!("{count} of them {what} and are dropped"));
        }
    }
    if mesh.triangles.is_empty() {
        let (problem, help) = match (parsed.vertices.len(), unusable + without_area) {
            (0, _) => ("holds no vertices".into(), "export the mesh again"),
            (n, 0) => (
                format!("holds {n} points but no face"),
                "a point cloud cannot be rendered; make a mesh of it, for example in MeshLab or CloudCompare",
            ),
            (_, n) => (format!("holds {n} faces, of which none can be used"), "export the mesh again"),
        };
        return Err(InputError::of_file(path, problem, help));
    }
    // A vertex that no face uses may be no number.
    let finite = |p: DVec3| if p.is_finite() { (p - origin).as_vec3() } else { Vec3::ZERO };
    mesh.positions = places.iter().map(|p| finite(*p)).collect();
    if parsed.has_normals {
        let unit = |v: &Vertex| Vec3::from_array(v.normal).normalize_or_zero();
        mesh.normals = parsed.vertices.iter().map(unit).collect();
    }
    if parsed.has_colors {
        mesh.colors = parsed.vertices.iter().map(Vertex::linear_color).collect();
    }
    Ok(Object { name: String::new(), mesh, origin })
}

/// Messages of the crate begin with a line number, and repeat the whole line of the file in further lines.
fn first_line(message: &str) -> &str {
    let line = message.lines().next().unwrap_or_default().trim_end_matches(['.', ':']);
    line.split_once(": ").filter(|(head, _)| head.starts_with("Line ")).map_or(line, |(_, rest)| rest)
}

/// A vertex as read.
#[derive(Clone, Copy)]
struct Vertex {
    position: [f64; 3],
    normal: [f32; 3],
    color: [f32; 4],
}

impl Vertex {
    /// Colours are encoded as sRGB, alpha is linear.
    fn linear_color(&self) -> Vec4 {
        let [r, g, b, a] = self.color.map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 1.0 });
        Vec4::new(linear(r), linear(g), linear(b), a)
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: [0.0; 3], normal: [0.0; 3], color: [1.0; 4] }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some((value, range)) = scalar(&property) else { return PropertyAccessResult::Ignored };
        match name {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            "nx" => self.normal[0] = value as f32,
            "ny" => self.normal[1] = value as f32,
            "nz" => self.normal[2] = value as f32,
            "red" | "r" | "diffuse_red" => self.color[0] = (value / range) as f32,
            "green" | "g" | "diffuse_green" => self.color[1] = (value / range) as f32,
            "blue" | "b" | "diffuse_blue" => self.color[2] = (value / range) as f32,
            "alpha" => self.color[3] = (value / range) as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// A number, and the value that is white as a colour.
fn scalar(property: &Property) -> Option<(f64, f64)> {
    Some(match property {
        Property::Char(v) => (f64::from(*v), 127.0),
        Property::UChar(v) => (f64::from(*v), 255.0),
        Property::Short(v) => (f64::from(*v), 32_767.0),
        Property::UShort(v) => (f64::from(*v), 65_535.0),
        // Colours of this type have the values of bytes in all known files.
        Property::Int(v) => (f64::from(*v), 255.0),
        Property::UInt(v) => (f64::from(*v), 255.0),
        Property::Float(v) => (f64::from(*v), 1.0),
        Property::Double(v) => (*v, 1.0),
        _ => return None,
    })
}

/// Between strips, the index -1 as an unsigned number.
const END_OF_STRIP: u32 = u32::MAX;

/// The corners of a polygon or strip. A negative index becomes one beyond all vertices.
struct Face {
    corners: Vec<u32>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !["vertex_indices", "vertex_index"].contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        let signed = |v: i32| u32::try_from(v).unwrap_or(END_OF_STRIP);
        self.corners = match property {
            Property::ListChar(list) => list.into_iter().map(|v| signed(v.into())).collect(),
            Property::ListUChar(list) => list.into_iter().map(u32::from).collect(),
            Property::ListShort(list) => list.into_iter().map(|v| signed(v.into())).collect(),
            Property::ListUShort(list) => list.into_iter().map(u32::from).collect(),
            Property::ListInt(list) => list.into_iter().map(signed).collect(),
            Property::ListUInt(list) => list,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element that is not used.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
