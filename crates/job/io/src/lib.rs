//! Formats of files: scenes, images, jobs and sensors. `dunkelfeld-files` opens and writes the files themselves.
//!
//! | folder | contents |
//! |---|---|
//! | [`import`] | scenes: glTF, OBJ and MTL, STL, PLY, IES profiles, textures |
//! | [`formats`] | EXR, PNG, TIFF, JPEG, layers, EMVA 1288 descriptors |
//! | [`config`] | jobs and sensors in TOML, quantities with units |

#![forbid(unsafe_code)]

pub mod config;
pub mod formats;
pub mod import;
pub mod names;

pub use config::{job, keys, quantity, sensor_file, toml_file, toml_keys};
pub use dunkelfeld_files::{ImportWarning, InputError, SourceSpan};
pub use dunkelfeld_files::{
    atomic, checkpoint, error, input, lock, new_folder, private_file, process, results, visible,
};
pub use formats::{emva_descriptor, exr, gray, jpeg, layers, picture, png, tiff};
#[cfg(feature = "gltf")]
pub use import::gltf;
#[cfg(feature = "obj")]
pub use import::obj;
#[cfg(feature = "ply")]
pub use import::ply;
#[cfg(feature = "stl")]
pub use import::stl;
pub use import::{ies, images, libraries, loader};
