//! `scene` of a job: its files, their units and axes, and their common scene.

use super::check;
use crate::import::options::UpAxis;
use crate::toml_file::TomlFile;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::path::PathBuf;

/// Most files of a scene.
const MOST_FILES: usize = 256;
/// The scene without a file.
const NONE: &str = "none";

/// The files of a scene, in the order of the job. Empty for `scene = "none"`, and before a job is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFiles(Vec<SceneFile>);

/// A file of a scene. An absent value is that of `[import]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// The file.
    #[serde(rename = "file", deserialize_with = "file_path")]
    pub path: PathBuf,
    /// Length \[m\] of the unit of its coordinates, written as `"mm"`.
    #[serde(default, deserialize_with = "check::length_unit")]
    pub unit: Option<f64>,
    /// A factor of all its lengths, above zero.
    #[serde(default, deserialize_with = "check::import_scale")]
    pub scale: Option<f64>,
    /// Its upward axis.
    pub up: Option<UpAxis>,
    /// A text before the names of its objects, materials, lights and cameras.
    #[serde(default)]
    pub prefix: String,
}

impl SceneFiles {
    /// The files.
    pub fn files(&self) -> &[SceneFile] {
        &self.0
    }

    pub(super) fn resolve(&mut self, file: &TomlFile) {
        for scene in &mut self.0 {
            scene.path = file.resolve(&scene.path);
        }
    }
}

fn file_path<'de, D: Deserializer<'de>>(d: D) -> Result<PathBuf, D::Error> {
    path(&String::deserialize(d)?)
}

fn path<E: Error>(text: &str) -> Result<PathBuf, E> {
    if text.is_empty() {
        return Err(E::custom("the scene's path is empty; name a .glb, .gltf, .obj, .stl or .ply file"));
    }
    Ok(PathBuf::from(text))
}

/// A file as a path, or as a table.
struct Written(SceneFile);

impl<'de> Deserialize<'de> for Written {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct FileVisitor;
        impl<'de> Visitor<'de> for FileVisitor {
            type Value = Written;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a path such as \"part.glb\", or { file = \"part.stl\", unit = \"mm\" }")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Written, E> {
                Ok(Written(SceneFile { path: path(text)?, ..SceneFile::default() }))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Written, A::Error> {
                SceneFile::deserialize(MapAccessDeserializer::new(map)).map(Written)
            }
        }
        d.deserialize_any(FileVisitor)
    }
}

impl<'de> Deserialize<'de> for SceneFiles {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct FilesVisitor;
        impl<'de> Visitor<'de> for FilesVisitor {
            type Value = SceneFiles;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the path of a scene file in quotes, \"none\", or a list of files")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<SceneFiles, E> {
                match text {
                    NONE => Ok(SceneFiles::default()),
                    _ => Ok(SceneFiles(vec![SceneFile { path: path(text)?, ..SceneFile::default() }])),
                }
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<SceneFiles, A::Error> {
                let files = Vec::<Written>::deserialize(SeqAccessDeserializer::new(seq))?;
                if files.is_empty() || files.len() > MOST_FILES {
                    let problem = format!("the list has {} files", files.len());
                    let help = format!("name 1 to {MOST_FILES} files, or write \"none\" for an empty scene");
                    return Err(A::Error::custom(format!("{problem}; {help}")));
                }
                Ok(SceneFiles(files.into_iter().map(|Written(file)| file).collect()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SceneFiles, A::Error> {
                SceneFile::deserialize(MapAccessDeserializer::new(map)).map(|file| SceneFiles(vec![file]))
            }
        }
        d.deserialize_any(FilesVisitor)
    }
}
