//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-scene --test it MODULE::NAME`.

mod build;
mod cameras;
mod covers;
mod distortion;
mod hazards;
mod irradiance;
mod lights;
mod media;
mod nesting;
mod normal_differential;
mod rounded_edges;
mod shading;
