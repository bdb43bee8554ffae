//! The bench of the program's tests: a folder with small scenes, in which the program runs.

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use dunkelfeld_io::exr::{Channel, read_exr};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_dunkelfeld");

/// A folder with a scene as glTF, as OBJ, as a job, and one that overflows.
pub(crate) struct Bench {
    pub(crate) folder: TempDir,
}

impl Bench {
    pub(crate) fn new() -> Self {
        let bench = Self { folder: TempDir::new().expect("a temporary folder") };
        // A floor in the xz plane, a lamp above it that shines down, two cameras beside them.
        let floor: [[f32; 3]; 4] = [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]];
        let lamp = floor.map(|[x, _, z]| [0.3 * x, 1.0, -0.3 * z]);
        let mut buffer: Vec<u8> = floor.iter().chain(&lamp).flatten().flat_map(|v| v.to_le_bytes()).collect();
        buffer.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
        fs::write(bench.path("scene.bin"), buffer).expect("writable");
        bench.write("scene.gltf", SCENE_GLTF);
        bench.write("scene.mtl", "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n");
        bench.write("scene.obj", &obj("scene.mtl"));
        bench.write("bright.mtl", "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 1e30 1e30 1e30\n");
        bench.write("too bright.obj", &obj("bright.mtl"));
        bench.write("job.toml", "scene = \"scene.gltf\"\n[film]\nwidth = 20\nheight = 10\n[budget]\nspp = 3\n");
        bench
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("writable");
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn names(&self) -> BTreeSet<String> {
        let entries = fs::read_dir(self.folder.path()).expect("readable");
        entries.map(|e| e.expect("readable").file_name().to_string_lossy().into_owned()).collect()
    }

    /// Runs the program in the folder, with the words of a line as arguments.
    pub(crate) fn run(&self, line: &str) -> Assert {
        self.run_words(&line.split_whitespace().collect::<Vec<_>>())
    }

    pub(crate) fn run_words(&self, words: &[&str]) -> Assert {
        Command::new(PROGRAM).current_dir(self.folder.path()).args(words).assert()
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.read(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn floats(&self, name: &str, channel: &str) -> Vec<f32> {
        let layers = read_exr(&self.path(name)).expect("an EXR");
        match layers.channel(channel) {
            Some(Channel::F32(v)) => v.clone(),
            other => panic!("{name}: {channel}: {other:?}"),
        }
    }
}

fn obj(materials: &str) -> String {
    let floor = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\n";
    let lamp = "v -0.3 1 -0.3\nv 0.3 1 -0.3\nv 0.3 1 0.3\nv -0.3 1 0.3\n";
    format!("mtllib {materials}\n{floor}{lamp}o floor\nusemtl floor\nf 1 2 3 4\no lamp\nusemtl lamp\nf 5 6 7 8\n")
}

const SCENE_GLTF: &str = r#"{
  "asset": { "version": "2.0" },
  "extensionsUsed": ["KHR_materials_emissive_strength"],
  "scene": 0,
  "scenes": [{ "nodes": [0, 1, 2, 3] }],
  "nodes": [
    { "name": "floor", "mesh": 0 },
    { "name": "lamp", "mesh": 1 },
    { "name": "front", "camera": 0, "translation": [0, 0.5, 3] },
    { "name": "far", "camera": 0, "translation": [0, 0.5, 9] }
  ],
  "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.9, "znear": 0.01 } }],
  "meshes": [
    { "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 2, "material": 0 }] },
    { "primitives": [{ "attributes": { "POSITION": 1 }, "indices": 2, "material": 1 }] }
  ],
  "materials": [
    { "name": "grey", "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0 } },
    { "name": "lamp", "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1] }, "emissiveFactor": [1, 1, 1],
      "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 2000 } } }
  ],
  "accessors": [
    { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1] },
    { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-0.3, 1, -0.3], "max": [0.3, 1, 0.3] },
    { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" }
  ],
  "bufferViews": [
    { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
    { "buffer": 0, "byteOffset": 48, "byteLength": 48 },
    { "buffer": 0, "byteOffset": 96, "byteLength": 12 }
  ],
  "buffers": [{ "uri": "scene.bin", "byteLength": 108 }]
}"#;

pub(crate) fn stdout(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
}

pub(crate) fn stderr(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}
