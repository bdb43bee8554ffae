//! The result of a command and its output: results to standard output, everything else to standard error.

use dunkelfeld::io::visible;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::OnceLock;

/// The result of a command. The exit code passes it to other programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(outcome.code())
    }
}

/// Prints an error: the fault, the line of the file that contains it, and help.
pub(crate) fn print_error(error: &dunkelfeld::Error) {
    let text = format!("error: {error}");
    let (problem, help) = text.split_at(text.find("\n  help: ").unwrap_or(text.len()));
    let caret = error.caret();
    let lines = [problem, &caret, help.trim_start_matches('\n')];
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

/// Prints a line to standard error. A closed pipe is no error here either (`eprintln!` would panic).
pub(crate) fn say(line: &str) {
    let _ = std::io::stderr().lock().write_all(format!("{}\n", visible(line)).as_bytes());
}
