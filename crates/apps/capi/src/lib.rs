//! The C interface of Dunkelfeld: a shared and a static library, and the header `dunkelfeld.h`, which cbindgen makes of this
//! crate. `crates/apps/capi/cbindgen.toml` has the rules for handles, errors, buffers and threads. Rust programs use the crate
//! `dunkelfeld`.
//!
//! Handles are keys of a table and are never followed as pointers, so that closed handles are errors. All unsafe code is in
//! `pointers`, and in the first lines of each function, which take over what the header says of its arguments.

#![allow(clippy::missing_safety_doc, reason = "the header states once what callers promise of pointers")]

pub mod cancel;
pub mod film;
mod film_data;
mod handles;
pub mod options;
mod pointers;
pub mod scene;
pub mod status;
pub mod version;
