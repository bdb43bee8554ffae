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
/// Formats that Blender reads without an extension.
const OF_BLENDER: &[&str] = &["fbx", "usd", "usda", "usdc", "usdz", "abc"];
/// Meshes that MeshLab or FreeCAD reads.
const MESHES: &[&str] = &["3mf", "3ds", "dae", "dxf", "off", "vrml", "wrl", "x3d"];
/// Points without faces.
const POINTS: &[&str] = &["asc", "e57", "las", "laz", "pcd", "pts", "ptx", "xyz"];

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
            "open it in MeshLab or FreeCAD and export it as glTF, OBJ, PLY or STL".into(),
        ),
        other if POINTS.contains(&other) => (
            format!("\".{other}\" is a format of points without faces, which cannot be rendered"),
            "make a mesh of the points, for example in MeshLab or CloudCompare, and export it as PLY or STL".into(),
        ),
        other if OF_BLENDER.contains(&other) => (
            format!("\".{other}\" is not a scene format that can be read"),
            "import it in Blender (File > Import) and export it as glTF 2.0 (File > Export > glTF 2.0, .glb)".into(),
        ),
        other => (format!("\".{other}\" is not a scene format that can be read"), format!("use {formats}")),
    };
    InputError::of_file(path, problem, help)
}
