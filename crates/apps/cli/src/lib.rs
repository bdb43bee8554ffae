//! The command line: parses, calls the library, prints, and returns an exit code. The program and the Python package run it.

#![forbid(unsafe_code)]
#![allow(clippy::exit, reason = "this is the crate that exits")]

mod args;
mod bar;
mod choices;
mod commands;
mod interrupt;
mod key_flags;
mod outcome;
mod run_args;
#[cfg(feature = "studies")]
mod studies;
mod values;
mod words;

use clap::Parser;
use outcome::Outcome;
use std::ffi::OsString;
use std::io::Write;
use std::time::Instant;

/// Runs a command line, whose first argument is the name of the program, and gives the exit code: 0 success, 1 a result with a
/// fault, 2 bad input, 130 interrupted.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    // The budget begins here: it includes loading and building.
    let started = Instant::now();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    arguments.first().into_iter().for_each(|name| outcome::set_program(&name.to_string_lossy()));
    interrupt::survive_file_size_limit();
    let args = match args::Cli::try_parse_from(&arguments) {
        Ok(args) => args,
        Err(e) => {
            // Help and version are no errors; everything else is bad usage.
            if e.use_stderr() && wants_json(&arguments) {
                outcome::say_json();
                outcome::say(&e.to_string());
                return Outcome::BadInput.code();
            }
            let result = e.print();
            if e.use_stderr() {
                return Outcome::BadInput.code();
            }
            outcome::printed(result.and_then(|()| std::io::stdout().flush()));
            return end(Ok(Outcome::Done));
        }
    };
    let result = match args.command {
        args::Command::Render(a) => commands::render::run(&a, started),
        args::Command::Merge(a) => commands::merge::run(&a, started),
        #[cfg(feature = "studies")]
        args::Command::Bench(a) => studies::run_bench(&a),
        #[cfg(feature = "studies")]
        args::Command::Dataset(a) => studies::run_dataset(&a),
        args::Command::Denoise(a) => commands::denoise::run(&a),
        args::Command::Expose(a) => commands::expose::run(&a),
        #[cfg(feature = "studies")]
        args::Command::Emva(a) => studies::run_emva(&a),
        #[cfg(feature = "studies")]
        args::Command::Mtf(a) => studies::run_mtf(&a),
        #[cfg(feature = "studies")]
        args::Command::Ptc(a) => studies::run_photon_transfer(&a),
        #[cfg(feature = "view")]
        args::Command::View(a) => commands::view::run(&a),
        args::Command::Init(a) => commands::init::run(&a),
        args::Command::Inspect(a) => commands::inspect::run(&a),
        args::Command::Sensors(a) => commands::sensors::run(&a),
    };
    end(result)
}

/// Do these arguments, which may be invalid, contain `--progress json`?
fn wants_json(args: &[OsString]) -> bool {
    args.iter().any(|arg| arg == "--progress=json") || args.windows(2).any(|w| w[0] == "--progress" && w[1] == "json")
}

/// The exit code of a command, with the output of its errors.
fn end(result: Result<Outcome, dunkelfeld::Error>) -> u8 {
    match result.and_then(|outcome| outcome::output_failure().map_or(Ok(outcome), Err)) {
        Ok(outcome) => outcome.code(),
        Err(e) => {
            outcome::print_error(&e);
            Outcome::BadInput.code()
        }
    }
}
