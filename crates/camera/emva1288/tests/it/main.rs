//! The tests of the crate from outside, in one program: `cargo test -p dunkelfeld-emva1288 --test it MODULE::NAME`.

mod whole_measurement;
