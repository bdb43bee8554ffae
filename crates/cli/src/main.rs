//! The command line: parses, calls the library, prints, and says by its exit code how it went.

#![forbid(unsafe_code)]
#![allow(clippy::exit, reason = "this is the crate that exits")]

mod args;
mod bar;
mod commands;
mod emva_args;
mod interrupt;
mod memory_args;
mod outcome;
mod ptc_args;
mod words;

use clap::Parser;
use outcome::Outcome;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    // The budget counts from here: loading and building are part of the price.
    let started = Instant::now();
    let args = match args::Cli::try_parse() {
        Ok(args) => args,
        Err(e) => {
            // Help and version are no errors; everything else is bad usage.
            let code = if e.use_stderr() { Outcome::BadInput } else { Outcome::Done };
            let _ = e.print();
            return code.into();
        }
    };
    let result = match args.command {
        args::Command::Render(a) => commands::render::run(&a, started),
        args::Command::Merge(a) => commands::merge::run(&a, started),
        args::Command::Bench(a) => commands::bench::run(&a, started),
        args::Command::Denoise(a) => commands::denoise::run(&a),
        args::Command::Expose(a) => commands::expose::run(&a),
        args::Command::Emva(a) => commands::emva::run(&a),
        args::Command::Ptc(a) => commands::ptc::run(&a, started),
        args::Command::Inspect(a) => commands::inspect::run(&a),
        args::Command::Sensors(a) => commands::sensors::run(&a),
    };
    match result {
        Ok(outcome) => outcome.into(),
        Err(e) => {
            outcome::print_error(&e);
            Outcome::BadInput.into()
        }
    }
}
