//! Developer tasks: `cargo xtask scenes [--check]`, `cargo xtask tidy`, `cargo xtask fuzz`, `cargo xtask blender`.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command-line tool for developers: printing is its output"
)]

mod blender;
mod fuzz;
mod scenes;
mod tidy;

use std::process::ExitCode;

const USAGE: &str = "usage: cargo xtask scenes [--check]   write scenes/inspection/, or check that it is up to date
       cargo xtask tidy               check the rules of the repository
       cargo xtask fuzz [TARGET...] [--seconds N] [--jobs N] [--asan] [--minimise]
                                      run fuzz targets, or shrink their corpora to what adds coverage
       cargo xtask blender            write out/dunkelfeld-blender.zip, the add-on for Blender";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match arguments[..] {
        ["scenes"] => scenes::run(false),
        ["scenes", "--check"] => scenes::run(true),
        ["tidy"] => tidy::run(),
        ["blender"] => blender::run(),
        ["fuzz", ref rest @ ..] => fuzz::run(rest),
        _ => Err(USAGE.to_owned()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
