//! Options and results of the readers of scene files.

use crate::error::ImportWarning;
use crate::input::InputFiles;
use crate::loader::Limits;
use dunkelfeld_scene::SceneBuilder;

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
    /// The scene file and every file that it refers to, also those that could not be read.
    pub inputs: InputFiles,
}
