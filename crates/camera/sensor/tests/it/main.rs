//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-sensor --test it MODULE::NAME`.

mod device;
mod exposure;
mod lens_blur;
mod matched;
mod poisson;
mod support;
