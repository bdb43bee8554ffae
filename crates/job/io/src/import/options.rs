//! The options and the results of readers of scene files. All readers share them.

use crate::error::ImportWarning;
use crate::input::InputFiles;
use crate::loader::Limits;
use derive_setters::Setters;
use dunkelfeld_geometry::{DMat3, DVec3};
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Setters)]
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
    /// Length \[m\] of the unit of the file's coordinates, above zero; `None` means that of the format.
    #[setters(into)]
    pub unit: Option<f64>,
    /// A factor of all lengths beside the unit, above zero; `None` means 1.
    #[setters(into)]
    pub scale: Option<f64>,
    /// The upward axis of the file's coordinates; `None` means that of the format.
    #[setters(into)]
    pub up: Option<UpAxis>,
    /// Time \[s\] at which the first animation of a glTF file gives the pose of the nodes and their motion.
    pub animation_time: f64,
}

/// The axis of a file's coordinates that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// +y, as in the world.
    Y,
    /// +z, as in most CAD programs.
    Z,
}

impl UpAxis {
    /// The rotation that makes the axis +y and keeps +x.
    pub(crate) fn to_y(self) -> DMat3 {
        match self {
            Self::Y => DMat3::IDENTITY,
            Self::Z => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        }
    }
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
