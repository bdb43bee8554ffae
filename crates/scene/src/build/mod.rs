//! Compilation of a description to a scene: validation, lints, effects.

mod ablation;
mod append;
pub mod builder;
pub mod compile;
pub mod effects;
pub mod fingerprint;
pub mod lints;
pub mod report;
mod validate;
