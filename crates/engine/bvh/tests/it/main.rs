//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-bvh --test it MODULE::NAME`.

mod agreement;
mod alpha_tested;
mod batches;
mod common;
mod degenerate;
mod instances;
mod ray_origins;
mod watertight;
