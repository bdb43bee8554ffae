//! Loads the scene files of a job.

use super::Job;
use crate::error::InputError;
use crate::import::load_scene;
use crate::import::options::{ImportOptions, Imported};
use crate::loader::Limits;
use std::path::{Path, PathBuf};

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
            let mut imported = load_scene(&file.path, &own).map_err(|e| {
                // The files of the scenes before, and those of this one.
                let before = all.iter().flat_map(|all| all.inputs.iter()).map(|file| file.identity.path());
                let read = e.read.clone().unwrap_or_default();
                let error = self.scene_error(InputError { read: None, ..e });
                error.with_read_files(before.chain(read.0.iter().map(PathBuf::as_path)))
            })?;
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

    /// An error of reading a file of [`Job::scene`]. If it is about the file as a whole, it points at the line of the job.
    pub fn scene_error(&self, error: InputError) -> InputError {
        let position = self.scene.files().iter().position(|file| file.path == error.file);
        let Some(i) = position.filter(|_| error.is_of_file()) else { return error };
        let name = error.file.display().to_string();
        let problem = if error.problem.contains(&name) { error.problem } else { format!("{name}: {}", error.problem) };
        let number = i.to_string();
        let keys: [&[&str]; 4] = [&["scene", &number, "file"], &["scene", &number], &["scene", "file"], &["scene"]];
        let key = keys.into_iter().find(|key| self.source.has_key(key)).unwrap_or(&["scene"]);
        self.source.error_at_key(key, problem, error.help)
    }
}
