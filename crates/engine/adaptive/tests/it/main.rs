//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-adaptive --test it MODULE::NAME`.

mod simulated_render;
mod two_valued;
