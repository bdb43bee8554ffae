//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-geometry --test it MODULE::NAME`.

mod samplers;
