//! The outermost layer of a glTF asset: the GLB container or bare JSON, versions, extensions, buffers.

use super::schema::{Accessor, Document, Preamble};
use crate::error::{InputError, SourceSpan};
use crate::input::Role;
use crate::loader::AssetLoader;
use crate::warnings::Warnings;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

const GLB_MAGIC: &[u8; 4] = b"glTF";
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;
/// Header of the file, and header of the first chunk.
const LEAST_GLB: usize = 12 + 8;

/// Extensions that are honoured.
const SUPPORTED: &[&str] = &[
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Extensions that do not change a still picture.
const WITHOUT_EFFECT: &[&str] =
    &["FB_ngon_encoding", "KHR_animation_pointer", "KHR_xmp", "KHR_xmp_json_ld", "EXT_mesh_manifold"];

/// A glTF asset whose JSON is parsed and whose buffers are in memory.
pub(super) struct Asset {
    /// The JSON.
    pub(super) document: Document,
    file: Vec<u8>,
    buffers: Vec<BufferData>,
}

enum BufferData {
    /// In the GLB file itself.
    Embedded(Range<usize>),
    Loaded(Vec<u8>),
    /// Without data: allowed where an extension supplies it.
    Absent,
}

impl Asset {
    /// Reads container, JSON and buffers.
    pub(super) fn load(loader: &AssetLoader, warnings: &mut Warnings) -> Result<Self, InputError> {
        let file = loader.read_scene()?;
        let path = loader.scene_file();
        let parts = split(&file, path, warnings)?;
        let json = file.get(parts.json).unwrap_or_default();
        let document = parse(json, path, loader.limits().json_objects, warnings)?;
        check_extensions(&document, path, warnings)?;
        let buffers = load_buffers(&document, parts.binary, loader, warnings)?;
        Ok(Self { document, file, buffers })
    }

    /// A buffer's bytes, or `None` if it does not exist or has no data.
    pub(super) fn buffer(&self, index: usize) -> Option<&[u8]> {
        match self.buffers.get(index)? {
            BufferData::Embedded(range) => self.file.get(range.clone()),
            BufferData::Loaded(bytes) => Some(bytes),
            BufferData::Absent => None,
        }
    }

    /// Bytes of all buffers together.
    pub(super) fn buffer_bytes(&self) -> u64 {
        (0..self.buffers.len()).filter_map(|i| self.buffer(i)).map(|b| b.len() as u64).sum()
    }
}

struct Parts {
    json: Range<usize>,
    binary: Option<Range<usize>>,
}

fn u32_at(bytes: &[u8], offset: usize) -> Option<u32> {
    bytes.get(offset..)?.first_chunk().map(|b| u32::from_le_bytes(*b))
}

/// Finds JSON and binary chunk; bare JSON is all JSON.
fn split(file: &[u8], path: &Path, warnings: &mut Warnings) -> Result<Parts, InputError> {
    let fail = |place: &str, problem: String| {
        Err(InputError::new(path, place, problem, "export or copy the file again: it is damaged or cut short"))
    };
    if !file.starts_with(GLB_MAGIC) {
        if file.is_empty() {
            return fail("file", "the file is empty".into());
        }
        let json = without_mark(file, 0..file.len());
        let is_object = file[json].trim_ascii_start().starts_with(b"{");
        if !is_object && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
            let start = file[..file.len().min(4)].escape_ascii();
            return fail("GLB header", format!("the file begins with \"{start}\" instead of \"glTF\""));
        }
        return Ok(Parts { json: without_mark(file, 0..file.len()), binary: None });
    }
    let (Some(version), Some(length)) = (u32_at(file, 4), u32_at(file, 8)) else {
        return fail("GLB header", format!("the header needs 12 bytes, the file has {}", file.len()));
    };
    if version != 2 {
        return Err(old_version(path, "GLB header", &version.to_string()));
    }
    let length = length as usize;
    if length > file.len() {
        return fail(
            "GLB header",
            format!("the header says that the file has {length} bytes, but it has {}: it is cut short", file.len()),
        );
    }
    if length < LEAST_GLB {
        let problem = format!("the header says that the file has {length} bytes, too few for header and JSON chunk");
        return fail("GLB header", problem);
    }
    if length < file.len() {
        warnings.push("GLB header", format!("{} bytes after the end are ignored", file.len() - length));
    }
    let file = &file[..length];
    let mut parts = Parts { json: 0..0, binary: None };
    let mut offset = 12;
    for number in 0.. {
        let place = format!("GLB chunk {number}");
        if offset + 8 > length {
            break;
        }
        let (Some(size), Some(kind)) = (u32_at(file, offset), u32_at(file, offset + 4)) else { break };
        let start = offset + 8;
        let end = start + size as usize;
        if end > length {
            return fail(&place, format!("the chunk should have {size} bytes, but {} are left", length - start));
        }
        match (number, kind) {
            (0, CHUNK_JSON) if size == 0 => return fail(&place, "the JSON chunk is empty".into()),
            (0, CHUNK_JSON) => parts.json = without_mark(file, start..end),
            (0, other) => {
                let name = other.to_le_bytes().escape_ascii().to_string();
                return fail(&place, format!("the first chunk has the type \"{name}\", where \"JSON\" belongs"));
            }
            (_, CHUNK_BIN) if parts.binary.is_none() => parts.binary = Some(start..end),
            _ => {}
        }
        offset = end;
    }
    Ok(parts)
}

/// JSON without the byte order mark that some programs write before it.
fn without_mark(file: &[u8], json: Range<usize>) -> Range<usize> {
    const MARK: &[u8] = b"\xef\xbb\xbf";
    let is_marked = file.get(json.clone()).is_some_and(|json| json.starts_with(MARK));
    if is_marked { json.start + MARK.len()..json.end } else { json }
}

fn parse(json: &[u8], path: &Path, objects: usize, warnings: &mut Warnings) -> Result<Document, InputError> {
    // A parsed object needs some hundred bytes where "{}," has three.
    let count = json.iter().filter(|b| **b == b'{').count();
    if count > objects {
        return Err(InputError::new(
            path,
            "JSON",
            format!("the file has {count} objects, more than the {objects} allowed"),
            "merge meshes and nodes on export, or raise the import limits",
        ));
    }
    let syntax = |e: serde_json::Error| syntax_error(json, path, &e);
    let preamble: Preamble = serde_json::from_slice(json).map_err(syntax)?;
    let asset = preamble.asset.unwrap_or_default();
    let version = asset.version.unwrap_or_else(|| {
        warnings.push("asset.version", "the version is missing; the file is read as glTF 2.0");
        "2.0".into()
    });
    if !version.starts_with(|c: char| c.is_ascii_digit()) {
        let problem = match version.trim() {
            "" => "the version is an empty text".to_string(),
            other => format!("\"{other}\" is no version"),
        };
        return Err(InputError::new(path, "asset.version", problem, "write \"2.0\", or export the scene as glTF 2.0"));
    }
    if version.split('.').next() != Some("2") {
        return Err(old_version(path, "asset.version", &version));
    }
    if let Some(least) = asset.min_version.filter(|v| v != "2.0") {
        return Err(InputError::new(
            path,
            "asset.minVersion",
            format!("the file needs glTF {least}, this program reads 2.0"),
            "export as glTF 2.0",
        ));
    }
    serde_json::from_slice(json).map_err(syntax)
}

fn old_version(path: &Path, place: &str, version: &str) -> InputError {
    InputError::new(
        path,
        place,
        format!("this is glTF version {version}, but only 2.0 is read"),
        "export the scene as glTF 2.0",
    )
}

/// Turns the parser's line and column into a span; of a one-line file only the surroundings are kept.
fn syntax_error(json: &[u8], path: &Path, e: &serde_json::Error) -> InputError {
    let text = e.to_string();
    let problem = text.split(" at line ").next().unwrap_or(&text).to_owned();
    let line_number = e.line().max(1);
    let mut error = InputError::new(
        path,
        format!("JSON, line {line_number}, column {}", e.column()),
        problem,
        "correct the JSON, or export the file again",
    );
    let line = json.split(|b| *b == b'\n').nth(line_number - 1).unwrap_or_default();
    let column = e.column().saturating_sub(1).min(line.len());
    // Long lines, of data URIs above all, would bury the message.
    let (from, to) = (column.saturating_sub(60), (column + 60).min(line.len()));
    let before = String::from_utf8_lossy(&line[from..column]).into_owned();
    let after = String::from_utf8_lossy(&line[column..to]).into_owned();
    // Empty lines in front make the caret's line number right; beyond reason they are left out.
    let padding = if line_number <= 100_000 { "\n".repeat(line_number - 1) } else { String::new() };
    let start = padding.len() + before.len();
    error.source_span =
        Some(Box::new(SourceSpan { text: format!("{padding}{before}{after}"), range: start..start + 1 }));
    error
}

fn check_extensions(document: &Document, path: &Path, warnings: &mut Warnings) -> Result<(), InputError> {
    let known = |name: &str| SUPPORTED.contains(&name) || WITHOUT_EFFECT.contains(&name);
    if let Some(name) = document.extensions_required.iter().find(|n| !known(n)) {
        return Err(InputError::new(
            path,
            "extensionsRequired",
            format!("the file requires the extension {name}, which is not supported"),
            help_for(name),
        ));
    }
    for name in document.extensions_used.iter().filter(|n| !known(n)) {
        warnings.push("extensionsUsed", format!("the extension {name} is not supported and is ignored"));
    }
    Ok(())
}

fn help_for(extension: &str) -> &'static str {
    match extension {
        "KHR_draco_mesh_compression" => "export again without Draco mesh compression",
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => "export again without meshopt compression",
        "KHR_texture_basisu" => "export again with PNG or JPEG textures instead of KTX2",
        "EXT_texture_avif" | "MSFT_texture_dds" => "export again with PNG or JPEG textures",
        _ => "export again without this extension, or remove it from extensionsRequired to load the rest",
    }
}

fn load_buffers(
    document: &Document,
    mut binary: Option<Range<usize>>,
    loader: &AssetLoader,
    warnings: &mut Warnings,
) -> Result<Vec<BufferData>, InputError> {
    let used = used_buffers(document);
    let mut buffers = Vec::with_capacity(document.buffers.len());
    for (i, buffer) in document.buffers.iter().enumerate() {
        let data = match &buffer.uri {
            Some(uri) => match loader.load_uri(uri, Role::Buffer) {
                Ok(bytes) => BufferData::Loaded(bytes),
                Err(e) if !used.contains(&i) => {
                    let message = format!("{}; nothing uses the buffer, which is left out", e.problem);
                    warnings.push(format!("buffer {i}, {}", e.place), message);
                    buffers.push(BufferData::Absent);
                    continue;
                }
                Err(e) => return Err(InputError { place: format!("buffer {i}, {}", e.place), ..e }),
            },
            None => match binary.take().filter(|_| i == 0) {
                Some(range) => BufferData::Embedded(range),
                None => BufferData::Absent,
            },
        };
        let length = match &data {
            BufferData::Embedded(range) => range.len() as u64,
            BufferData::Loaded(bytes) => bytes.len() as u64,
            BufferData::Absent => buffer.byte_length.0,
        };
        if length < buffer.byte_length.0 {
            let promised = buffer.byte_length.0;
            warnings.push(format!("buffer {i}"), format!("it has {length} of the {promised} bytes it should have"));
        }
        buffers.push(data);
    }
    Ok(buffers)
}

/// Buffers that an accessor, an image or a light profile reads.
fn used_buffers(document: &Document) -> BTreeSet<usize> {
    let sparse = |a: &Accessor| a.sparse.as_ref().map(|s| [s.indices.buffer_view, s.values.buffer_view]);
    let accessors = document.accessors.iter();
    let of_accessors = accessors.flat_map(|a| a.buffer_view.into_iter().chain(sparse(a).into_iter().flatten()));
    let of_images = document.images.iter().filter_map(|i| i.buffer_view);
    let profiles = document.extensions.profiles.as_ref().map_or(&[][..], |p| &p.lights);
    let of_profiles = profiles.iter().filter_map(|p| p.buffer_view);
    let views = of_accessors.chain(of_images).chain(of_profiles);
    views.filter_map(|v| document.buffer_views.get(v.get())).map(|view| view.buffer.get()).collect()
}
