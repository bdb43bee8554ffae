//! The tests of the program from the command line, in one program: `cargo test -p dunkelfeld-cli --test it MODULE::NAME`.

mod bench;
mod cameras;
mod commands;
mod dataset;
mod denoise;
mod emva;
mod emva_commands;
mod expose;
mod inputs;
mod kills;
mod lab;
mod machine_faults;
mod markup;
mod memory;
mod messages;
mod mtf;
mod noise_bench;
mod parts;
mod ptc;
mod refusals;
mod snapshots;
