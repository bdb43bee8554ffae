//! The outermost layer of a glTF asset: the GLB container or bare JSON, extensions, buffers.

use super::document::{Document, old_version};
use crate::error::InputError;
use crate::import::guard::guarded;
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use gltf::binary::{ChunkType, Error as GlbError, Glb};
use gltf::json::accessor::sparse::Sparse;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

const GLB_MAGIC: &[u8; 4] = b"glTF";
/// In the `generator` of files that Blender wrote, which stands at the start of their JSON.
const BLENDER: &[u8] = b"Khronos glTF Blender I/O";
/// Bytes of the JSON that are searched for it.
const GENERATOR_AT_MOST: usize = 4096;
/// Header of the file.
const FILE_HEADER: usize = 12;
/// Header of a chunk: its length and its type.
const CHUNK_HEADER: usize = 8;

/// Supported extensions.
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
    /// Was the file exported by Blender?
    pub(super) from_blender: bool,
    file: Vec<u8>,
    buffers: Vec<BufferData>,
}

enum BufferData {
    /// Stored in the GLB file itself.
    Embedded(Range<usize>),
    Loaded(Vec<u8>),
    /// Without data: allowed where an extension supplies it.
    Absent,
}

impl Asset {
    /// Reads container, JSON and buffers.
    pub(super) fn load(loader: &AssetLoader, warnings: &mut Warnings) -> Result<Self, InputError> {
        let mut file = loader.read_scene()?;
        let path = loader.scene_file();
        let parts = guarded(path, "GLB header", || split(&mut file, path, warnings))?;
        let json = file.get(parts.json).unwrap_or_default();
        let objects = loader.limits().json_objects;
        let from_blender = json.windows(BLENDER.len()).take(GENERATOR_AT_MOST).any(|w| w == BLENDER);
        let document = guarded(path, "JSON", || Document::read(json, path, objects, warnings))?;
        check_extensions(&document, path, warnings)?;
        let buffers = load_buffers(&document, parts.binary, loader, warnings)?;
        Ok(Self { document, from_blender, file, buffers })
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

fn damaged(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> InputError {
    InputError::new(path, place, problem, "export or copy the file again: it is damaged or cut short")
}

/// Finds JSON and binary chunk; a file of bare JSON has only JSON. Other chunks of a GLB are left out.
fn split(file: &mut Vec<u8>, path: &Path, warnings: &mut Warnings) -> Result<Parts, InputError> {
    if !file.starts_with(GLB_MAGIC) {
        return bare_json(file, path);
    }
    check_header(file, path, warnings)?;
    if let Cow::Owned(kept) = without_other_chunks(file) {
        *file = kept;
    }
    let glb = Glb::from_slice(file).map_err(|e| glb_error(&e, file, path))?;
    let start = FILE_HEADER + CHUNK_HEADER;
    let json = start..start + glb.json.len();
    if json.is_empty() {
        return Err(damaged(path, "GLB chunk 0", "the JSON chunk is empty"));
    }
    let binary = glb.bin.map(|bin| json.end + CHUNK_HEADER..json.end + CHUNK_HEADER + bin.len());
    Ok(Parts { json: without_mark(file, json), binary })
}

fn bare_json(file: &[u8], path: &Path) -> Result<Parts, InputError> {
    if file.is_empty() {
        return Err(damaged(path, "file", "the file is empty"));
    }
    let json = without_mark(file, 0..file.len());
    let is_object = file.get(json.clone()).is_some_and(|json| json.trim_ascii_start().starts_with(b"{"));
    if !is_object && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
        let start = file[..file.len().min(4)].escape_ascii();
        return Err(damaged(path, "GLB header", format!("the file begins with \"{start}\" instead of \"glTF\"")));
    }
    Ok(Parts { json, binary: None })
}

/// Checks version and length, which `Glb::from_slice` requires, and removes bytes after the end.
fn check_header(file: &mut Vec<u8>, path: &Path, warnings: &mut Warnings) -> Result<(), InputError> {
    let fail = |problem: String| Err(damaged(path, "GLB header", problem));
    let (Some(version), Some(length)) = (u32_at(file, 4), u32_at(file, 8)) else {
        return fail(format!("the header needs 12 bytes, the file has {}", file.len()));
    };
    if version != 2 {
        return Err(old_version(path, "GLB header", &version.to_string()));
    }
    let (length, present) = (length as usize, file.len());
    if length > present {
        return fail(format!("by its header the file has {length} bytes, but it has {present}: it is cut short"));
    }
    if length < FILE_HEADER + CHUNK_HEADER {
        return fail(format!("by its header the file has {length} bytes, too few for header and JSON chunk"));
    }
    if length < present {
        warnings.push("GLB header", format!("{} bytes after the end are ignored", present - length));
        file.truncate(length);
    }
    Ok(())
}

/// The file without chunks after the first one, except the first binary chunk, and without a rest that is too short for
/// a chunk. By the format, programs ignore these. `Glb::from_slice` refuses them.
fn without_other_chunks(file: &[u8]) -> Cow<'_, [u8]> {
    let chunk_end = |start: usize| Some(start + CHUNK_HEADER + u32_at(file, start)? as usize);
    let is_binary = |start: usize| file.get(start + 4..start + 8) == Some(b"BIN\0");
    let Some(json_end) = chunk_end(FILE_HEADER).filter(|end| *end < file.len()) else { return file.into() };
    if is_binary(json_end) {
        return file.into();
    }
    let mut start = json_end;
    while file.len() - start >= CHUNK_HEADER && !is_binary(start) {
        match chunk_end(start).filter(|end| *end <= file.len()) {
            Some(end) => start = end,
            None => return file.into(),
        }
    }
    let binary = if is_binary(start) { &file[start..] } else { &[] };
    let mut kept = [&file[..json_end], binary].concat();
    let length = kept.len() as u32;
    if let Some(field) = kept.get_mut(8..FILE_HEADER) {
        field.copy_from_slice(&length.to_le_bytes());
    }
    kept.into()
}

/// The crate's error about a container with a valid header.
fn glb_error(e: &gltf::Error, file: &[u8], path: &Path) -> InputError {
    let first = |kind: [u8; 4]| {
        let name = kind.escape_ascii();
        damaged(path, "GLB chunk 0", format!("the first chunk has the type \"{name}\", where \"JSON\" belongs"))
    };
    match e {
        gltf::Error::Binary(GlbError::ChunkLength { ty, length, length_read }) => {
            let number = if matches!(ty, ChunkType::Json) { 0 } else { 1 };
            let problem = format!("the chunk should have {length} bytes, but {length_read} are left");
            damaged(path, format!("GLB chunk {number}"), problem)
        }
        gltf::Error::Binary(GlbError::UnknownChunkType(kind)) if file.get(16..20) == Some(kind) => first(*kind),
        gltf::Error::Binary(GlbError::ChunkType(ChunkType::Bin)) => first(*b"BIN\0"),
        other => damaged(path, "GLB chunk 1", format!("the chunks after the JSON cannot be read: {other}")),
    }
}

/// JSON without the byte order mark that some programs write before it.
fn without_mark(file: &[u8], json: Range<usize>) -> Range<usize> {
    const MARK: &[u8] = b"\xef\xbb\xbf";
    let is_marked = file.get(json.clone()).is_some_and(|json| json.starts_with(MARK));
    if is_marked { json.start + MARK.len()..json.end } else { json }
}

fn check_extensions(document: &Document, path: &Path, warnings: &mut Warnings) -> Result<(), InputError> {
    let known = |name: &str| SUPPORTED.contains(&name) || WITHOUT_EFFECT.contains(&name);
    if let Some(name) = document.root.extensions_required.iter().find(|n| !known(n)) {
        return Err(InputError::new(
            path,
            "extensionsRequired",
            format!("the file requires the extension {name}, which is not supported"),
            help_for(name),
        ));
    }
    for name in document.root.extensions_used.iter().filter(|n| !known(n)) {
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
    let mut buffers = Vec::with_capacity(document.root.buffers.len());
    for (i, buffer) in document.root.buffers.iter().enumerate() {
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
    let root = &document.root;
    let sparse = |s: &Sparse| [s.indices.buffer_view, s.values.buffer_view];
    let of_accessors = root
        .accessors
        .iter()
        .flat_map(|a| a.buffer_view.into_iter().chain(a.sparse.as_ref().map(sparse).into_iter().flatten()));
    let of_images = root.images.iter().filter_map(|i| i.buffer_view);
    let of_profiles = document.profiles.iter().filter_map(|p| p.buffer_view);
    let views = of_accessors.chain(of_images).chain(of_profiles);
    views.filter_map(|view| root.get(view)).map(|view| view.buffer.value()).collect()
}
