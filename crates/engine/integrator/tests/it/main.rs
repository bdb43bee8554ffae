//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-integrator --test it MODULE::NAME`.

mod effects_bench;
mod estimate;
mod techniques;
mod wavefront;
