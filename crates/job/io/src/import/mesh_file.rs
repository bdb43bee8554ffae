//! Parts of the readers of meshes: the scene of a file that contains meshes only (STL and PLY), texts, and far origins.

use crate::error::InputError;
use crate::import::options::Imported;
use crate::import::warnings::Warnings;
use crate::loader::AssetLoader;
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Instance, Material, MeshPart, SceneBuilder};
use std::path::Path;

/// Reflectance of the material: the grey of OBJ faces without a material.
const GREY: f32 = 0.8;

/// The centre of the bounds, in whole metres, if a mesh lies far from the origin of its coordinates: f32 keeps its full
/// accuracy around it. Otherwise zero.
pub(crate) fn origin(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let finite = points.filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    let centre = (low + high) * 0.5;
    let is_far = low.x <= high.x && centre.abs().max_element() > 8.0 * (high - low).length();
    if is_far && centre.is_finite() { centre.round() } else { DVec3::ZERO }
}

/// The inverse of the transfer function of sRGB (IEC 61966-2-1).
pub(crate) fn linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The bytes after a byte order mark of UTF-8, which a text may begin with; `None` for a text in UTF-16.
pub(crate) fn after_mark(bytes: &[u8]) -> Option<&[u8]> {
    match bytes {
        [0xff, 0xfe, ..]
        | [0xfe, 0xff, ..]
        | [b'A'..=b'z', 0, b'!'..=b'z', 0, ..]
        | [0, b'A'..=b'z', 0, b'!'..=b'z', ..] => None,
        _ => Some(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
    }
}

/// [`after_mark`], or the error about UTF-16.
pub(crate) fn without_mark<'a>(bytes: &'a [u8], path: &Path) -> Result<&'a [u8], InputError> {
    let help = "save it as UTF-8 or ASCII (PowerShell: `Set-Content -Encoding ascii`)";
    after_mark(bytes).ok_or_else(|| InputError::of_file(path, "is a text in UTF-16, which is not read", help))
}

/// A mesh with its name and the origin of its coordinates in the file.
pub(crate) struct Object {
    /// Empty: the name of the file.
    pub name: String,
    pub mesh: Mesh,
    pub origin: DVec3,
}

/// The scene of the meshes. All have one material, whose name is that of the file. It is white if vertices have colours,
/// which multiply it.
pub(crate) fn scene_of_meshes(
    path: &Path,
    objects: Vec<Object>,
    colored: bool,
    warnings: Warnings,
    loader: AssetLoader,
) -> Imported {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut scene = SceneBuilder { name: stem.clone(), ..SceneBuilder::default() };
    let base_color = if colored { Rgb::WHITE } else { Rgb::splat(GREY) };
    let material =
        scene.add_material(Material { name: stem.clone(), base_color: base_color.into(), ..Material::default() });
    for (mesh, object) in objects.into_iter().enumerate() {
        let name = if object.name.is_empty() { stem.clone() } else { object.name };
        let part = MeshPart { name: name.clone(), mesh: object.mesh.into(), material, ..MeshPart::default() };
        scene.meshes.push(part);
        let to_world = DAffine3::from_translation(object.origin);
        scene.instances.push(Instance { name, meshes: vec![mesh], to_world, motion: Default::default() });
    }
    Imported { scene, warnings: warnings.finish(), inputs: loader.into_inputs() }
}
