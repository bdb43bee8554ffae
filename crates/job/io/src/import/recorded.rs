//! The files of a scene, for its owner: of one that was read, and of one that was refused.

use crate::error::InputError;
use crate::import::options::Imported;
use crate::loader::AssetLoader;

/// Adds the files that were read or requested to a scene, or to the error that refuses it.
pub(crate) fn recorded(loader: AssetLoader, result: Result<Imported, InputError>) -> Result<Imported, InputError> {
    let inputs = loader.into_inputs();
    match result {
        Ok(imported) => Ok(Imported { inputs, ..imported }),
        Err(e) => Err(e.with_read_files(inputs.iter().map(|file| file.identity.path()))),
    }
}

#[cfg(test)]
#[cfg(all(feature = "gltf", feature = "obj"))]
mod tests {
    use crate::import::{ImportOptions, load_scene};
    use crate::job::Job;
    use std::fs;

    /// A triangle whose buffer has half of its bytes.
    const GLTF: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "a.bin", "byteLength": 36}]}"#;

    /// Any of the files that were read may have the fault: the error contains them all.
    #[test]
    fn an_error_contains_the_files_that_were_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("a.gltf"), GLTF).expect("writable");
        let files = |name: &str| -> Vec<String> {
            let error = load_scene(&path(name), &ImportOptions::default()).expect_err("the buffer is too short");
            let names = error.read_files().map(|file| file.file_name().expect("a name").to_string_lossy().into_owned());
            names.collect()
        };
        assert_eq!(files("a.gltf"), ["a.gltf", "a.bin"], "a file that is missing");
        fs::write(path("a.bin"), [0; 18]).expect("writable");
        assert_eq!(files("a.gltf"), ["a.gltf", "a.bin"]);
        // Of a job with several scenes, those before too.
        fs::write(path("b.obj"), "mtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n").expect("writable");
        fs::write(path("b.mtl"), "newmtl m\nKd 1 0 0\n").expect("writable");
        let text = "scene = [{ file = 'b.obj', prefix = 'b' }, { file = 'a.gltf', prefix = 'a' }]\n";
        let error = Job::from_text(path("job.toml"), text).expect("a job").load_scene().expect_err("the second scene");
        for name in ["b.obj", "b.mtl", "a.gltf", "a.bin"] {
            assert!(error.read_files().any(|file| file == path(name)), "{name}: {:?}", error.read);
        }
        // A scene that can be read has the same list.
        let bytes: Vec<u8> =
            [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        fs::write(path("a.bin"), bytes).expect("writable");
        let imported = load_scene(&path("a.gltf"), &ImportOptions::default()).expect("a triangle");
        assert_eq!(imported.inputs.iter().count(), 2);
    }
}
