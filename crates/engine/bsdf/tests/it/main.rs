//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-bsdf --test it MODULE::NAME`.

mod common;
mod furnace;
mod limits;
mod mitsuba;
mod phase;
mod physics;
mod samplers;
mod sampling;
