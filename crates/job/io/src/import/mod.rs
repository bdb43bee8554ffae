//! Scene files of all formats. The extension selects the reader.

// The importers share most of this module, and any of them may be left out.
#![cfg_attr(
    not(all(feature = "gltf", feature = "obj", feature = "stl", feature = "ply")),
    allow(dead_code, unused_imports, unreachable_patterns)
)]

mod foreign;
#[cfg(feature = "gltf")]
pub mod gltf;
mod guard;
pub mod ies;
mod image_store;
pub mod images;
pub mod libraries;
pub mod loader;
mod mesh_file;
#[cfg(feature = "obj")]
pub mod obj;
pub(crate) mod options;
#[cfg(feature = "ply")]
pub mod ply;
mod recorded;
#[cfg(feature = "stl")]
pub mod stl;
#[cfg(any(feature = "gltf", feature = "obj"))]
mod tangents;
mod texel_budget;
#[cfg(any(feature = "obj", feature = "ply"))]
mod triangulate;
mod warnings;

pub use crate::import::options::{EmissiveUnit, ImportOptions, Imported, LUMENS_PER_WATT, UpAxis};

use crate::error::InputError;
use dunkelfeld_geometry::Aabb;
use dunkelfeld_scene::MeshPart;
use std::path::Path;

/// Reads a scene file. The extension selects the reader (`.gltf`, `.glb`, `.obj`, `.stl`, `.ply`). Lengths of the file
/// become metres and its upward axis +y: by [`ImportOptions::unit`], [`ImportOptions::scale`] and [`ImportOptions::up`],
/// or as usual for the format: millimetres and z for STL and PLY, metres and y for the others.
///
/// # Errors
/// If the extension is none of these, or the file cannot be used: the error names file, place and help.
pub fn load_scene(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let mut imported: Imported = match extension.as_str() {
        #[cfg(feature = "gltf")]
        "gltf" | "glb" => gltf::load_gltf(path, options),
        #[cfg(feature = "obj")]
        "obj" => obj::load_obj(path, options),
        #[cfg(feature = "stl")]
        "stl" => stl::load_stl(path, options),
        #[cfg(feature = "ply")]
        "ply" => ply::load_ply(path, options),
        #[cfg(not(all(feature = "gltf", feature = "obj", feature = "stl", feature = "ply")))]
        format @ ("gltf" | "glb" | "obj" | "stl" | "ply") => {
            let feature = if format == "glb" { "gltf" } else { format };
            let problem = format!("is of a format that this program was built without: feature `{feature}`");
            Err(InputError::of_file(path, problem, format!("build it with `--features {feature}`")))
        }
        other => Err(foreign::refusal(path, other)),
    }?;
    let (unit, up) = match extension.as_str() {
        "stl" | "ply" => (1e-3, UpAxis::Z),
        _ => (1.0, UpAxis::Y),
    };
    if matches!(extension.as_str(), "stl" | "ply") && options.unit.or(options.scale).is_none() {
        // One of several small parts of a file is no sign of another unit, so that only the largest counts.
        let size = |part: &MeshPart| Aabb::from_points(part.mesh.positions.iter().copied()).size().max_element();
        let largest = imported.scene.meshes.iter_mut().max_by(|a, b| size(a).total_cmp(&size(b)));
        largest.into_iter().for_each(|part| part.is_unit_assumed = true);
    }
    let scale = options.unit.unwrap_or(unit) * options.scale.unwrap_or(1.0);
    let up = options.up.unwrap_or(up);
    if scale != 1.0 || up != UpAxis::Y {
        imported.scene.scale_and_turn(scale, up.to_y());
    }
    Ok(imported)
}
