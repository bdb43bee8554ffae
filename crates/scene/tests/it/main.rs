//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-scene --test it MODULE::NAME`.

mod build;
mod camera_lanes;
mod cameras;
mod cover_lanes;
mod covers;
mod distortion;
mod hazards;
mod irradiance;
mod light_lanes;
mod lights;
mod media;
mod nesting;
mod normal_differential;
mod shading;
mod surface_lanes;
