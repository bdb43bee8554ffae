//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-sampling --test it MODULE::NAME`.

mod sampler;
mod warps;
