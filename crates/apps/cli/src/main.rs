//! The program `dunkelfeld`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    dunkelfeld_cli::run(std::env::args_os()).into()
}
