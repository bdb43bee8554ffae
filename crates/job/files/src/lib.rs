//! Opening of files with limits, atomic writing, locks, folders of results, checkpoints. Errors with file, place and help.

#![forbid(unsafe_code)]

pub mod atomic;
pub mod checkpoint;
pub mod error;
pub mod faults;
pub mod input;
pub mod lock;
pub mod new_folder;
mod partial;
pub mod private_file;
pub mod process;
pub mod results;
mod role;
pub mod visible;

pub use error::{ImportWarning, InputError, SourceSpan};
