//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-denoise --test it MODULE::NAME`.

mod builtin;
mod oidn;
