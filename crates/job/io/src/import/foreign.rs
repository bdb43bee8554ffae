//! Formats that are not read: the way from them to one that is.

use crate::error::InputError;
use std::path::Path;

/// Extensions of formats that are not read, the problem, and the way to a format that is.
const WAYS: [(&str, &str, &str); 5] = [
    (
        "blend",
        "is a Blender file, which only Blender reads",
        "open it in Blender and choose File > Export > glTF 2.0 (.glb), with Cameras and Punctual Lights in the section \
         Include",
    ),
    (
        "step stp stpz iges igs brep sldprt sldasm ipt iam catpart catproduct prt x_t x_b sat jt 3dm f3d fcstd",
        "is a CAD format, which has no triangles",
        "export the part from the CAD program as glTF (.glb) or STL with a fine tolerance; FreeCAD reads STEP and IGES \
         and writes both (File > Export)",
    ),
    (
        "3mf 3ds dae dxf off vrml wrl x3d",
        "is not a scene format that can be read",
        "open it in MeshLab or FreeCAD and export it as glTF, OBJ, PLY or STL",
    ),
    (
        "asc e57 las laz pcd pts ptx xyz",
        "is a format of points without faces, which cannot be rendered",
        "make a mesh of the points, for example in MeshLab or CloudCompare, and export it as PLY or STL",
    ),
    (
        "fbx usd usda usdc usdz abc",
        "is not a scene format that can be read",
        "import it in Blender (File > Import) and export it as glTF 2.0 (File > Export > glTF 2.0, .glb)",
    ),
];

/// The error about a file whose extension (in lower case, without the dot) no reader has.
pub(super) fn refusal(path: &Path, extension: &str) -> InputError {
    let known = WAYS.iter().find(|(extensions, ..)| extensions.split(' ').any(|known| known == extension));
    let (problem, help) = known.map_or(
        (
            "is not a scene format that can be read",
            "use glTF 2.0 (.gltf, .glb), Wavefront OBJ (.obj), STL (.stl) and PLY (.ply)",
        ),
        |(_, problem, help)| (*problem, *help),
    );
    let problem = match extension {
        "" => "has no ending that names a scene format".to_string(),
        _ => format!("\".{extension}\" {problem}"),
    };
    InputError::of_file(path, problem, help)
}
