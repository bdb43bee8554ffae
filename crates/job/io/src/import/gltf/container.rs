//! The outermost layer of a glTF asset: the GLB container or bare JSON, extensions, buffers.

use super::document::{Document, old_version};
use crate::error::InputError;
use crate::import::guard::guarded;
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use gltf::binary::Glb;
use std::ops::Range;
use std::path::Path;

const GLB_MAGIC: &[u8; 4] = b"glTF";
/// Header of the file.
const FILE_HEADER: usize = 12;
/// Header of a chunk: its length and its type.
const CHUNK_HEADER: usize = 8;

/// Supported extensions.
const SUPPORTED: &[&str] = &[
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
        let file = loader.read_scene()?;
        let path = loader.scene_file();
        let parts = guarded(path, "GLB header", || split(&file, path))?;
        let json = file.get(parts.json).unwrap_or_default();
        let objects = loader.limits().json_objects;
        let document = guarded(path, "JSON", || Document::read(json, path, objects))?;
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

fn damaged(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> InputError {
    InputError::new(path, place, problem, "export or copy the file again: it is damaged or cut short")
}

/// Finds JSON and binary chunk; a file of bare JSON has only JSON.
fn split(file: &[u8], path: &Path) -> Result<Parts, InputError> {
    let is_glb = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    if file.is_empty() {
        return Err(damaged(path, "the file", "is empty"));
    }
    if !file.starts_with(GLB_MAGIC) {
        let json = without_mark(file, 0..file.len());
        if is_glb && !file[json.clone()].trim_ascii_start().starts_with(b"{") {
            let start = file[..file.len().min(4)].escape_ascii();
            return Err(damaged(path, "GLB header", format!("the file begins with \"{start}\" instead of \"glTF\"")));
        }
        return Ok(Parts { json, binary: None });
    }
    let fail = |problem: String| Err(damaged(path, "GLB header", problem));
    let (Some(version), Some(length)) = (u32_at(file, 4), u32_at(file, 8)) else {
        return fail(format!("the header needs 12 bytes, the file has {}", file.len()));
    };
    if version != 2 {
        return Err(old_version(path, "GLB header", &version.to_string()));
    }
    // `Glb::from_slice` panics at a length below that of the header.
    if (length as usize) < FILE_HEADER + CHUNK_HEADER {
        return fail(format!("by its header the file has {length} bytes, too few for header and JSON chunk"));
    }
    let Some(whole) = file.get(..length as usize) else {
        let present = file.len();
        return fail(format!("by its header the file has {length} bytes, but it has {present}: it is cut short"));
    };
    let glb = Glb::from_slice(whole).map_err(|e| {
        damaged(path, "GLB chunks", format!("the file does not consist of JSON and one binary chunk: {e}"))
    })?;
    let start = FILE_HEADER + CHUNK_HEADER;
    let json = start..start + glb.json.len();
    let binary = glb.bin.map(|bin| json.end + CHUNK_HEADER..json.end + CHUNK_HEADER + bin.len());
    Ok(Parts { json: without_mark(file, json), binary })
}

/// JSON without the byte order mark that some programs write before it.
fn without_mark(file: &[u8], json: Range<usize>) -> Range<usize> {
    let is_marked = file[json.clone()].starts_with(b"\xef\xbb\xbf");
    if is_marked { json.start + 3..json.end } else { json }
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
    let mut buffers = Vec::with_capacity(document.root.buffers.len());
    for (i, buffer) in document.root.buffers.iter().enumerate() {
        let data = match &buffer.uri {
            Some(uri) => {
                let bytes = loader.load_uri(uri, Role::Buffer);
                BufferData::Loaded(bytes.map_err(|e| InputError { place: format!("buffer {i}, {}", e.place), ..e })?)
            }
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
