//! Reading and writing of files: the only crate that opens files.
//!
//! | folder | contents |
//! |---|---|
//! | [`import`] | scenes: glTF, OBJ and MTL, STL, PLY, IES profiles, textures |
//! | [`formats`] | EXR, PNG, TIFF, JPEG, layers, checkpoints, EMVA 1288 descriptors |
//! | [`config`] | jobs and sensors in TOML, quantities with units |
//! | [`files`] | opening with limits, atomic writing, locks, folders of results |

#![forbid(unsafe_code)]

pub mod config;
pub mod error;
pub mod files;
pub mod formats;
pub mod import;
pub mod visible;

pub use config::{job, quantity, sensor_file, toml_file, toml_keys};
pub use error::{ImportWarning, InputError, SourceSpan};
pub use files::{atomic, input, lock, names, new_folder, private_file, process, results};
pub use formats::{checkpoint, emva_descriptor, exr, gray, jpeg, layers, picture, png, tiff};
#[cfg(feature = "gltf")]
pub use import::gltf;
#[cfg(feature = "obj")]
pub use import::obj;
#[cfg(feature = "ply")]
pub use import::ply;
#[cfg(feature = "stl")]
pub use import::stl;
pub use import::{ies, images, libraries, loader};
