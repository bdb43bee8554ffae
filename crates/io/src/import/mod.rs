//! Scene files of all formats. The extension selects the reader.

pub mod gltf;
pub mod ies;
mod image_store;
pub mod images;
pub mod libraries;
pub mod loader;
pub mod obj;
pub(crate) mod options;
mod tangents;
mod texel_budget;
mod warnings;

pub use crate::import::options::{EmissiveUnit, ImportOptions, Imported, LUMENS_PER_WATT};

use crate::error::InputError;
use std::path::Path;

/// Reads a scene file. The extension selects the reader (`.gltf`, `.glb`, `.obj`).
///
/// # Errors
/// If the extension is none of these, or the file cannot be used: the error names file, place and help.
pub fn load_scene(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "gltf" | "glb" => gltf::load_gltf(path, options),
        "obj" => obj::load_obj(path, options),
        _ => Err(InputError::new(
            path,
            "file name",
            match extension.as_str() {
                "" => "has no ending that names a scene format".into(),
                other => format!("\".{other}\" is not a scene format that can be read"),
            },
            "use glTF 2.0 (.gltf, .glb) or Wavefront OBJ (.obj)",
        )),
    }
}
