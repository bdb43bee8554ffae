//! Refusals and errors, as the page shows them.

use dunkelfeld::Error;
use serde::Serialize;

/// A refusal: the answer of a request that cannot be met.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Fault {
    pub(crate) problem: String,
    pub(crate) place: Option<String>,
    pub(crate) help: Option<String>,
}

impl Fault {
    pub(crate) fn new(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self { problem: problem.into(), place: None, help: Some(help.into()) }
    }

    /// A request about the scene of the picture, which the thread that renders no longer has.
    pub(crate) fn earlier_scene() -> Self {
        Self::new("the picture is that of the scene before its change", "wait for the next picture")
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let text = error.to_string();
        match text.split_once("\n  help: ") {
            Some((problem, help)) => Self::new(problem, help),
            None => Self { problem: text, place: None, help: None },
        }
    }
}
