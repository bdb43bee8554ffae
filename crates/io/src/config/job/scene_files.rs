//! `scene` of a job: its files, their units and axes, and their common scene.

use super::{Job, check};
use crate::error::InputError;
use crate::import::load_scene;
use crate::import::options::{ImportOptions, Imported, UpAxis};
use crate::loader::Limits;
use crate::toml_file::TomlFile;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::path::{Path, PathBuf};

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

impl Job {
    /// The first scene file, or the job's own file if the scene is empty: for messages.
    pub fn scene_path(&self) -> &Path {
        self.scene.files().first().map_or_else(|| self.source.path(), |file| file.path.as_path())
    }

    /// Options for reading the scene files, without those of a single file.
    pub fn import_options(&self) -> ImportOptions {
        let mut limits = Limits::default();
        if let Some(bytes) = self.import.texture_memory {
            limits.total_image_bytes = bytes;
            limits.image_bytes = bytes.max(limits.image_bytes);
        }
        let super::ImportSettings { emissive_unit, unit, scale, up, .. } = self.import;
        let animation_time = self.import.animation_time;
        ImportOptions { limits, emissive_unit, unit, scale, up, animation_time, ..ImportOptions::default() }
    }

    /// Reads all scene files into one scene, in the order of the job. The memory limit of images holds for all of them
    /// together.
    ///
    /// # Errors
    /// If a file cannot be used. If it does not exist, the error points at the line of the job.
    pub fn load_scene(&self) -> Result<Imported, InputError> {
        let mut options = self.import_options();
        let mut all: Option<Imported> = None;
        for file in self.scene.files() {
            let own = ImportOptions {
                unit: file.unit.or(options.unit),
                scale: file.scale.or(options.scale),
                up: file.up.or(options.up),
                ..options
            };
            let mut imported = load_scene(&file.path, &own).map_err(|e| self.scene_error(e))?;
            if !file.prefix.is_empty() {
                imported.scene.prefix_names(&file.prefix);
            }
            let images: u64 = imported.scene.images.iter().map(|image| image.texels.bytes() as u64).sum();
            options.limits.total_image_bytes = options.limits.total_image_bytes.saturating_sub(images);
            match &mut all {
                None => all = Some(imported),
                Some(all) => {
                    all.scene.append(imported.scene);
                    all.warnings.extend(imported.warnings);
                    all.inputs.extend(&imported.inputs);
                }
            }
        }
        Ok(all.unwrap_or_default())
    }

    /// An error of reading a file of [`Job::scene`]. If the file does not exist, the error points at the line of the job.
    pub fn scene_error(&self, error: InputError) -> InputError {
        let position = self.scene.files().iter().position(|file| file.path == error.file);
        let Some(i) = position.filter(|_| ["file", "file name"].contains(&error.place.as_str())) else { return error };
        let name = error.file.display().to_string();
        let problem = if error.problem.contains(&name) { error.problem } else { format!("{name}: {}", error.problem) };
        let number = i.to_string();
        let keys: [&[&str]; 4] = [&["scene", &number, "file"], &["scene", &number], &["scene", "file"], &["scene"]];
        let key = keys.into_iter().find(|key| self.source.has_key(key)).unwrap_or(&["scene"]);
        self.source.error_at_key(key, problem, error.help)
    }
}
