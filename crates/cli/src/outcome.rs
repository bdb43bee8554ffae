//! How a command ended, and how errors look.

use std::process::ExitCode;

/// How a command ended; the exit code says it to other programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// All is well.
    Done,
    /// There is a result, but something about it is wrong; it was said what.
    Flagged,
    /// The input or the usage is bad; nothing was written.
    BadInput,
    /// Interrupted; the best image so far was written.
    Interrupted,
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(match outcome {
            Outcome::Done => 0,
            Outcome::Flagged => 1,
            Outcome::BadInput => 2,
            Outcome::Interrupted => 130,
        })
    }
}

/// Prints an error with the line of the file it points into.
pub(crate) fn print_error(error: &dunkelfeld::Error) {
    eprintln!("error: {error}");
    let caret = error.caret();
    if !caret.is_empty() {
        eprintln!("{caret}");
    }
}

/// Prints to standard output; a reader that has gone (a closed pipe) is no error.
pub(crate) fn print(text: &str) {
    use std::io::Write;
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}
