//! STL meshes, text and binary, read by the crate `stl_io`. The code here selects the form and divides a text into its
//! solids.

use crate::error::InputError;
use crate::import::guard::guarded;
use crate::import::mesh_file::{Object, after_mark, scene_of_meshes, without_mark};
use crate::import::options::{ImportOptions, Imported};
use crate::import::warnings::Warnings;
use crate::loader::AssetLoader;
use dunkelfeld_geometry::{DVec3, Mesh, Vec3};
use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

/// Bytes of a binary file before its triangles: a free text of 80 bytes and the number of triangles.
const HEADER: usize = 84;
/// Bytes of a triangle of a binary file.
const TRIANGLE: usize = 50;
/// Most bytes of a triangle in memory: three vertices of its own, and its indices.
const TRIANGLE_IN_MEMORY: u64 = 48;
/// A text has no zero byte at its start; a binary file nearly always has.
const START: usize = 512;

/// Reads an STL file in its own units and axes; [`load_scene`](crate::import::load_scene) converts them.
///
/// A file is one object of the file's name. A text with several solids has an object for each, with the name of the
/// solid. Vertices with equal coordinates are shared. Shading is flat: the format has no normals of vertices, and the
/// normals of triangles follow from the order of their corners. All objects have one grey material of the file's name.
///
/// # Errors
/// If the file cannot be read, is no STL, is cut off, is beyond the limits, or contains no triangle.
pub fn load_stl(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let loader = AssetLoader::new(path, options.limits);
    let mut bytes = loader.read_scene()?;
    let most = options.limits.geometry_bytes;
    let mut warnings = Warnings::new(path);
    let objects = guarded(path, "the file", || match announced(&bytes) {
        Some(count) => binary(&mut bytes, count, path, most, &mut warnings).map(|mesh| vec![(String::new(), mesh)]),
        None => text(&bytes, path, most),
    })?;
    let objects: Vec<Object> = objects
        .into_iter()
        .filter(|(_, mesh)| !mesh.triangles.is_empty())
        .map(|(name, mesh)| Object { name, mesh, origin: DVec3::ZERO })
        .collect();
    if objects.is_empty() {
        return Err(InputError::of_file(path, "holds no triangles", "export the part again as a mesh"));
    }
    Ok(scene_of_meshes(path, objects, false, warnings, loader))
}

/// The number of triangles that a binary file announces; `None` for a text.
fn announced(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER - 4..HEADER).and_then(|b| <[u8; 4]>::try_from(b).ok());
    let count = count.map(|b| u32::from_le_bytes(b) as usize);
    // Some programs begin the header of a binary file with "solid", so the length decides first.
    if count.is_some_and(|n| n.checked_mul(TRIANGLE).is_some_and(|size| size + HEADER == bytes.len())) {
        return count;
    }
    let start = bytes.get(..START.min(bytes.len())).unwrap_or_default();
    let start = after_mark(start)?;
    let word = start.trim_ascii_start().get(..5).unwrap_or_default();
    let is_text = word.eq_ignore_ascii_case(b"solid") && !start.contains(&0);
    if is_text { None } else { Some(count.unwrap_or(0)) }
}

fn binary(bytes: &mut [u8], count: usize, path: &Path, most: u64, warnings: &mut Warnings) -> Result<Mesh, InputError> {
    let Some(rest) = bytes.len().checked_sub(HEADER) else {
        let problem = "is too short, and no STL file";
        return Err(InputError::of_file(path, problem, "export the part again as STL or glTF"));
    };
    let complete = rest / TRIANGLE;
    if complete < count {
        let problem = format!("its header announces {count} triangles, but it ends after {complete}");
        let help = "copy or export the file again; if it is another format, give it the ending of that format";
        return Err(InputError::of_file(path, problem, help));
    }
    if rest > count * TRIANGLE {
        let more = rest - count * TRIANGLE;
        warnings.push("the file", format!("has {more} B after its last triangle; they are ignored"));
    }
    check_size(count, path, most)?;
    // The crate takes a first line that begins with "solid" for a text.
    if let Some(first) = bytes.first_mut() {
        *first = b'\n';
    }
    collect(&mut Cursor::new(bytes), path, "")
}

/// The solids of a text with their names.
fn text(bytes: &[u8], path: &Path, most: u64) -> Result<Vec<(String, Mesh)>, InputError> {
    let text = String::from_utf8_lossy(without_mark(bytes, path)?);
    let text = if text.contains('\n') { text } else { text.replace('\r', "\n").into() };
    check_size(text.matches("vertex").count() / 3, path, most)?;
    let mut solids: Vec<(String, String)> = Vec::new();
    for line in text.lines().map(str::trim) {
        let word = line.split_whitespace().next().unwrap_or_default().to_ascii_lowercase();
        match (word.as_str(), solids.last_mut()) {
            ("solid", _) => {
                let name = line.get(word.len()..).unwrap_or_default().trim();
                solids.push((name.to_string(), "solid \n".into()));
            }
            // The file may end without this line, so that it is added to every solid below.
            ("endsolid" | "", _) | (_, None) => {}
            // The normal is not used, and that of a triangle without area is often no number.
            ("facet", Some((_, solid))) => solid.push_str("facet normal 0 0 0\n"),
            (_, Some((_, solid))) => {
                solid.push_str(&line.to_ascii_lowercase());
                solid.push('\n');
            }
        }
    }
    drop(text);
    let one = solids.len() == 1;
    solids
        .into_iter()
        .map(|(name, mut solid)| {
            solid.push_str("endsolid\n");
            let mesh = collect(&mut Cursor::new(solid.into_bytes()), path, &name)?;
            // The only solid often has the name of the program that wrote it.
            Ok((if one { String::new() } else { name }, mesh))
        })
        .collect()
}

fn check_size(triangles: usize, path: &Path, most: u64) -> Result<(), InputError> {
    if (triangles as u64).saturating_mul(TRIANGLE_IN_MEMORY) <= most {
        return Ok(());
    }
    let problem = format!("its {triangles} triangles may need more than {} MiB", most >> 20);
    Err(InputError::of_file(path, problem, "reduce the mesh, or raise the import limits"))
}

/// Reads all triangles. Vertices with equal coordinates become one.
fn collect<R: std::io::Read + std::io::Seek>(read: &mut R, path: &Path, solid: &str) -> Result<Mesh, InputError> {
    let mut mesh = Mesh::default();
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let fault = |e: std::io::Error, number: usize| {
        let of = if solid.is_empty() { String::new() } else { format!(" of solid \"{solid}\"") };
        let problem = format!("cannot be read: {e}");
        let help = "export the part again as binary STL, or as glTF";
        InputError::new(path, format!("triangle {number}{of}"), problem, help)
    };
    for triangle in stl_io::create_stl_reader(read).map_err(|e| fault(e, 1))? {
        let triangle = triangle.map_err(|e| fault(e, mesh.triangles.len() + 1))?;
        let corners = triangle.vertices.map(|vertex| {
            let place = Vec3::from_array(vertex.0);
            // Plus zero turns a negative zero into a positive one.
            let key = (place + Vec3::ZERO).to_array().map(f32::to_bits);
            *known.entry(key).or_insert_with(|| {
                mesh.positions.push(place);
                (mesh.positions.len() - 1) as u32
            })
        });
        mesh.triangles.push(corners);
    }
    Ok(mesh)
}
