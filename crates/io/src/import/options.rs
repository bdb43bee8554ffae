//! The options and the results of readers of scene files. All readers share them.

use crate::error::ImportWarning;
use crate::input::InputFiles;
use crate::loader::Limits;
use derive_setters::Setters;
use dunkelfeld_scene::SceneBuilder;

/// Luminous efficacy of monochromatic light at 540 THz [lm/W]: the defining constant K_cd (BIPM, 2019). Light in glTF
/// has photometric units. This factor converts them to radiometric ones in every channel, as if all light had the
/// wavelength of the eye's maximum. Ratios are preserved, and a job file can set absolute values.
pub const LUMENS_PER_WATT: f32 = 683.0;

/// The assumed unit of a file's emissive factors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EmissiveUnit {
    /// Candela per square metre, as in KHR_materials_emissive_strength; divided by [`LUMENS_PER_WATT`].
    #[default]
    Nit,
    /// W/(m^2 sr), without conversion.
    WattPerSteradianSquareMetre,
}

/// Options for reading a scene file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ImportOptions {
    /// Limits on read and allocated data.
    pub limits: Limits,
    /// Unit of emissive factors.
    pub emissive_unit: EmissiveUnit,
    /// Index of the glTF scene to load; `None` means the file's default, or all of it without a default.
    #[setters(into)]
    pub scene: Option<usize>,
}

/// A scene that was read, with its repairs and omissions.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    /// The scene.
    pub scene: SceneBuilder,
    /// Repairs and omissions, in the order of their detection.
    pub warnings: Vec<ImportWarning>,
    /// The scene file and every file that it refers to, also those that could not be read.
    pub inputs: InputFiles,
}
