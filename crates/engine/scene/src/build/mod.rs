//! Compilation of a description to a scene: validation, lints, effects.

mod ablation;
mod append;
mod area_lights;
mod bake;
pub mod builder;
pub mod cache;
pub mod compile;
pub mod effects;
pub mod error;
pub mod fingerprint;
pub mod lints;
mod placed;
pub mod report;
mod validate;
