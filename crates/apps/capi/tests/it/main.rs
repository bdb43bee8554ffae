//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-capi --test it MODULE::NAME`.

mod c_api;
