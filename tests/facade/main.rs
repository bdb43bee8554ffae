//! The tests of the engine through its facade, in one program: `cargo test -p dunkelfeld --test it MODULE::NAME`.

mod captures;
mod checkpoints;
mod covers;
mod denoising;
mod docs;
mod expose;
mod exposure_noise;
mod finish;
mod hard_cases;
mod hidden;
mod invariants;
mod job_cameras;
mod keys;
mod lens;
mod lens_image;
mod light_groups;
mod media;
mod motion;
mod outputs;
mod project;
mod references;
mod rounded_edges;
mod support;
mod surfaces;
mod transport;
