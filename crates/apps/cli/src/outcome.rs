//! The result of a command and its output: results to standard output, everything else to standard error.

use dunkelfeld::io::{visible, visible_json};
use std::io::{ErrorKind, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// The result of a command. The exit code passes it to other programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Outcome {
    /// Success.
    Done,
    /// There is a result, but it has a fault, which was printed.
    Flagged,
    /// The input or the usage is invalid. No file was written.
    BadInput,
    /// Interrupted; the best image so far was written.
    Interrupted,
}

impl Outcome {
    /// The exit code.
    pub(crate) const fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Flagged => 1,
            Self::BadInput => 2,
            Self::Interrupted => 130,
        }
    }
}

/// The name of the program, as the user called it.
static PROGRAM: OnceLock<String> = OnceLock::new();

/// Sets the name of the program, once.
pub(crate) fn set_program(name: &str) {
    PROGRAM.get_or_init(|| name.to_owned());
}

/// The name of the program.
pub(crate) fn program() -> &'static str {
    PROGRAM.get().map_or("dunkelfeld", String::as_str)
}

/// Are lines on standard error JSON objects?
static JSON: AtomicBool = AtomicBool::new(false);

/// From now on each line on standard error is a JSON object.
pub(crate) fn say_json() {
    JSON.store(true, Ordering::Relaxed);
}

/// Prints an error: the fault, the line of the file that contains it, and help.
pub(crate) fn print_error(error: &dunkelfeld::Error) {
    let (statement, help, caret) = (error.statement(), error.help(), error.caret());
    if JSON.load(Ordering::Relaxed) {
        let help = help.unwrap_or_default();
        let event = serde_json::json!({ "event": "error", "message": statement, "help": help, "place": caret });
        return write_line(&visible_json(&event.to_string()));
    }
    let lines = [format!("error: {statement}"), caret, help.map_or(String::new(), |help| format!("  help: {help}"))];
    say(&lines.into_iter().filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n"));
}

/// The first error of writing to standard output.
static FAILURE: OnceLock<std::io::Error> = OnceLock::new();

/// Prints to standard output. Terminal control characters in names are escaped. An error is stored for the end of the
/// command ([`output_failure`]).
pub(crate) fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    printed(out.write_all(visible(text).as_bytes()).and_then(|()| out.flush()));
}

/// Stores an error of printing to standard output. A closed pipe (EPIPE) is no failure: the rest is dropped, and the
/// command ends as usual.
pub(crate) fn printed(result: std::io::Result<()>) {
    match result {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            let _ = FAILURE.set(e);
        }
        _ => {}
    }
}

/// The error of a command whose standard output could not be written; `None` if all of it was.
pub(crate) fn output_failure() -> Option<dunkelfeld::Error> {
    let failure = FAILURE.get()?;
    Some(dunkelfeld::Error::Output {
        file: "standard output".into(),
        problem: format!("cannot be written: {failure}"),
        help: "redirect it to a file on a disk with room; files that the command names are written".into(),
    })
}

/// Prints a line to standard error. As JSON it is an event: of the kind that the line begins with, or a `note`.
pub(crate) fn say(line: &str) {
    if !JSON.load(Ordering::Relaxed) {
        return write_line(&visible(line));
    }
    let kinds = ["warning", "hazard", "note", "flagged", "interrupted", "error"];
    let known = line.split_once(": ").filter(|(kind, _)| kinds.contains(kind));
    let (kind, message) = known.unwrap_or(("note", line.trim()));
    write_line(&visible_json(&serde_json::json!({ "event": kind, "message": message }).to_string()));
}

/// Prints a JSON object to standard error.
pub(crate) fn say_object(object: &serde_json::Value) {
    write_line(&visible_json(&object.to_string()));
}

/// A closed pipe is no error here either (`eprintln!` would panic).
fn write_line(line: &str) {
    let _ = std::io::stderr().lock().write_all(format!("{line}\n").as_bytes());
}
