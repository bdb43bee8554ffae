//! Formats that are not read: the way from them to one that is.

use crate::error::InputError;
use std::path::Path;

/// Formats of CAD programs. They describe surfaces exactly, without triangles.
const CAD: &[&str] = &[
    "step",
    "stp",
    "stpz",
    "iges",
    "igs",
    "brep",
    "sldprt",
    "sldasm",
    "ipt",
    "iam",
    "catpart",
    "catproduct",
    "prt",
    "x_t",
    "x_b",
    "sat",
    "jt",
    "3dm",
    "f3d",
    "fcstd",
];
/// Formats that Blender reads.
const MESHES: &[&str] =
    &["fbx", "dae", "usd", "usda", "usdc", "usdz", "abc", "3ds", "3mf", "x3d", "wrl", "vrml", "off", "xyz", "dxf"];

/// The error about a file whose extension (in lower case, without the dot) no reader has.
pub(super) fn refusal(path: &Path, extension: &str) -> InputError {
    let formats = "glTF 2.0 (.gltf, .glb), Wavefront OBJ (.obj), STL (.stl) and PLY (.ply)";
    let (problem, help) = match extension {
        "" => ("has no ending that names a scene format".to_string(), format!("use {formats}")),
        "blend" => (
            "is a Blender file, which only Blender reads".into(),
            "open it in Blender and choose File > Export > glTF 2.0 (.glb), with Cameras and Punctual Lights in the \
             section Include"
                .into(),
        ),
        other if CAD.contains(&other) => (
            format!("\".{other}\" is a CAD format, which has no triangles"),
            "export the part from the CAD program as glTF (.glb) or STL with a fine tolerance; FreeCAD reads STEP and \
             IGES and writes both (File > Export)"
                .into(),
        ),
        other if MESHES.contains(&other) => (
            format!("\".{other}\" is not a scene format that can be read"),
            "import it in Blender (File > Import) and export it as glTF 2.0 (File > Export > glTF 2.0, .glb)".into(),
        ),
        other => (format!("\".{other}\" is not a scene format that can be read"), format!("use {formats}")),
    };
    InputError::new(path, "file name", problem, help)
}
