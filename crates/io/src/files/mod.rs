//! Opening, writing, locking and naming of files.

pub mod atomic;
#[cfg(test)]
mod fault_tests;
pub(crate) mod faults;
pub mod input;
pub mod lock;
pub mod names;
pub mod new_folder;
pub(crate) mod partial;
pub mod private_file;
pub mod process;
pub mod results;
mod role;
