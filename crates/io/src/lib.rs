//! Files in, files out: the only crate that opens any.

#![forbid(unsafe_code)]

pub mod atomic;
pub mod checkpoint;
pub mod emva_descriptor;
pub mod error;
pub mod exr;
#[cfg(test)]
mod fault_tests;
mod faults;
pub mod gltf;
pub mod gray;
pub mod ies;
mod image_store;
pub mod images;
pub mod import;
mod import_options;
pub mod input;
pub mod job;
pub mod layers;
pub mod libraries;
pub mod loader;
pub mod lock;
pub mod names;
pub mod new_folder;
pub mod obj;
mod partial;
pub mod picture;
pub mod png;
pub mod process;
pub mod quantity;
pub mod results;
pub mod sensor_file;
mod texel_budget;
pub mod tiff;
pub mod toml_file;
pub mod visible;
mod warnings;

pub use error::{ImportWarning, InputError, SourceSpan};
