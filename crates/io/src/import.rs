//! One door for scene files: options, the result, and the choice of reader by extension.

use crate::error::{ImportWarning, InputError};
use crate::loader::Limits;
use dunkelfeld_scene::SceneBuilder;
use std::path::Path;

/// Luminous efficacy of monochromatic light at 540 THz [lm/W]: the defining constant K_cd (BIPM, 2019). glTF gives light
/// in photometric units; they become radiometric by this factor in every channel, as if all light were at the eye's
/// peak. Ratios are kept, and a job file can set absolute values.
pub const LUMENS_PER_WATT: f32 = 683.0;

/// The unit that a file's emissive factors are taken to be in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EmissiveUnit {
    /// Candela per square metre, as KHR_materials_emissive_strength says; divided by [`LUMENS_PER_WATT`].
    #[default]
    Nit,
    /// W/(m^2 sr), taken as they are.
    WattPerSteradianSquareMetre,
}

/// How a scene file is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportOptions {
    /// Bounds on what is read and allocated.
    pub limits: Limits,
    /// Unit of emissive factors.
    pub emissive_unit: EmissiveUnit,
    /// Index of the glTF scene to load; `None` means the file's default, or all of it when it names none.
    pub scene: Option<usize>,
}

/// A scene that was read, and what had to be repaired or left out.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    /// The scene.
    pub scene: SceneBuilder,
    /// Repairs and omissions, in the order they were met.
    pub warnings: Vec<ImportWarning>,
}

/// Reads a scene file; the extension chooses the reader (`.gltf`, `.glb`, `.obj`).
///
/// # Errors
/// If the extension is none of these, or the file cannot be used: the error names file, place and mend.
pub fn load_scene(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "gltf" | "glb" => crate::gltf::load_gltf(path, options),
        "obj" => crate::obj::load_obj(path, options),
        _ => Err(InputError::new(
            path,
            "file name",
            format!("\".{extension}\" is not a scene format that can be read"),
            "use glTF 2.0 (.gltf, .glb) or Wavefront OBJ (.obj)",
        )),
    }
}

/// Collects warnings: the same one twice is kept once, and a file with thousands of faults does not bury its reader.
#[derive(Debug)]
pub(crate) struct Warnings {
    file: String,
    list: Vec<ImportWarning>,
    omitted: usize,
}

impl Warnings {
    /// More than anybody reads.
    const MOST: usize = 200;

    /// For the faults of `path`.
    pub(crate) fn new(path: &Path) -> Self {
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Self { file, list: Vec::new(), omitted: 0 }
    }

    /// Notes what was wrong at `place` and what was done about it.
    pub(crate) fn push(&mut self, place: impl std::fmt::Display, message: impl Into<String>) {
        let warning = ImportWarning { place: format!("{}: {place}", self.file), message: message.into() };
        if self.list.contains(&warning) {
        } else if self.list.len() < Self::MOST {
            self.list.push(warning);
        } else {
            self.omitted += 1;
        }
    }

    /// All of them, in order.
    pub(crate) fn finish(mut self) -> Vec<ImportWarning> {
        if self.omitted > 0 {
            let message = format!("{} further warnings are not listed", self.omitted);
            self.list.push(ImportWarning { place: self.file, message });
        }
        self.list
    }
}
