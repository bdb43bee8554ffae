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
/// Header of a chunk: its length and its type.
const CHUNK_HEADER: usize = 8;
/// Headers of the file and of its first chunk.
const HEADERS: usize = 12 + CHUNK_HEADER;

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
    /// A buffer without data is allowed where an extension supplies it.
    buffers: Vec<Option<Vec<u8>>>,
}

impl Asset {
    /// Reads container, JSON and buffers.
    pub(super) fn load(loader: &AssetLoader, warnings: &mut Warnings) -> Result<Self, InputError> {
        let mut file = loader.read_scene()?;
        let path = loader.scene_file();
        let (json, binary) = split(&file, path)?;
        let json = file.get(json).unwrap_or_default();
        // Some programs write a byte order mark before the JSON.
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        let objects = loader.limits().json_objects;
        let document = guarded(path, "JSON", || Document::read(json, path, objects))?;
        check_extensions(&document, path, warnings)?;
        let binary = binary.map(|range| {
            file.truncate(range.end);
            file.drain(..range.start);
            file
        });
        let buffers = load_buffers(&document, binary, loader, warnings)?;
        Ok(Self { document, buffers })
    }

    /// A buffer's bytes, or `None` if it does not exist or has no data.
    pub(super) fn buffer(&self, index: usize) -> Option<&[u8]> {
        self.buffers.get(index)?.as_deref()
    }

    /// Bytes of all buffers together.
    pub(super) fn buffer_bytes(&self) -> u64 {
        self.buffers.iter().flatten().map(|b| b.len() as u64).sum()
    }
}

/// The ranges of JSON and binary chunk; a file of bare JSON has only JSON.
fn split(file: &[u8], path: &Path) -> Result<(Range<usize>, Option<Range<usize>>), InputError> {
    let damaged = |problem: String| {
        let help = "export or copy the file again: it is damaged or cut short";
        InputError::new(path, "GLB header", problem, help)
    };
    let is_glb = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    if file.is_empty() {
        return Err(damaged("is empty".into()));
    }
    if !file.starts_with(GLB_MAGIC) {
        if is_glb && !file.trim_ascii_start().starts_with(b"{") {
            let start = file.get(..4).unwrap_or(file).escape_ascii();
            return Err(damaged(format!("the file begins with \"{start}\" instead of \"glTF\"")));
        }
        return Ok((0..file.len(), None));
    }
    let number = |at: usize| file.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b));
    if let Some(version) = number(4).filter(|version| *version != 2) {
        return Err(old_version(path, "GLB header", &version.to_string()));
    }
    let length = number(8).unwrap_or_default() as usize;
    // `Glb::from_slice` panics at a length below that of the header.
    let whole = file
        .get(..length)
        .filter(|whole| whole.len() >= HEADERS)
        .ok_or_else(|| damaged(format!("by its header the file has {length} bytes, but it has {}", file.len())))?;
    let glb = Glb::from_slice(whole)
        .map_err(|e| damaged(format!("the file does not consist of JSON and one binary chunk: {e}")))?;
    let json = HEADERS..HEADERS + glb.json.len();
    let binary = glb.bin.map(|bin| json.end + CHUNK_HEADER..json.end + CHUNK_HEADER + bin.len());
    Ok((json, binary))
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
    mut binary: Option<Vec<u8>>,
    loader: &AssetLoader,
    warnings: &mut Warnings,
) -> Result<Vec<Option<Vec<u8>>>, InputError> {
    let mut buffers = Vec::with_capacity(document.root.buffers.len());
    for (i, buffer) in document.root.buffers.iter().enumerate() {
        let data = match &buffer.uri {
            Some(uri) => {
                let bytes = loader.load_uri(uri, Role::Buffer);
                Some(bytes.map_err(|e| InputError { place: format!("buffer {i}, {}", e.place), ..e })?)
            }
            None => binary.take().filter(|_| i == 0),
        };
        let promised = buffer.byte_length.0;
        if let Some(length) = data.as_ref().map(Vec::len).filter(|length| (*length as u64) < promised) {
            warnings.push(format!("buffer {i}"), format!("it has {length} of the {promised} bytes it should have"));
        }
        buffers.push(data);
    }
    Ok(buffers)
}
