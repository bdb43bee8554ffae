//! `dunkelfeld dataset` as its users have it: a small study, its files, and what happens when a run is killed, repeated or
//! shared by two processes.
//!
//! Replay: `cargo test --workspace --test it dataset::NAME`.

mod bench;
mod content;
mod faults;
mod layouts;
mod refusals;
mod runs;
mod set_files;
