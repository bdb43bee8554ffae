//! From a description to a compiled scene: validation, lints, effects, compilation.

mod ablation;
pub mod builder;
pub mod compile;
pub mod effects;
pub mod fingerprint;
mod lints;
pub mod report;
mod validate;
