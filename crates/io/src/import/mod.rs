//! Scene files of all formats. The extension selects the reader.

// The importers share most of this module, and either may be left out.
#![cfg_attr(not(all(feature = "gltf", feature = "obj")), allow(dead_code, unused_imports, unreachable_patterns))]

#[cfg(feature = "gltf")]
pub mod gltf;
pub mod ies;
mod image_store;
pub mod images;
pub mod libraries;
pub mod loader;
#[cfg(feature = "obj")]
pub mod obj;
pub(crate) mod options;
#[cfg(any(feature = "gltf", feature = "obj"))]
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
        #[cfg(feature = "gltf")]
        "gltf" | "glb" => gltf::load_gltf(path, options),
        #[cfg(feature = "obj")]
        "obj" => obj::load_obj(path, options),
        #[cfg(not(all(feature = "gltf", feature = "obj")))]
        format @ ("gltf" | "glb" | "obj") => {
            let feature = if format == "obj" { "obj" } else { "gltf" };
            let problem = format!("is of a format that this program was built without: feature `{feature}`");
            let _ = options;
            Err(InputError::new(path, "file name", problem, format!("build it with `--features {feature}`")))
        }
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
