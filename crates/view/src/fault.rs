//! Refusals and errors, as the page shows them.

use dunkelfeld::Error;
use serde::Serialize;

/// A refusal: the answer of a request that cannot be met.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Fault {
    pub(crate) problem: String,
    pub(crate) place: Option<String>,
    pub(crate) help: Option<String>,
    /// Is there no picture yet? The same request is answered later.
    #[serde(skip)]
    pub(crate) is_early: bool,
}

impl Fault {
    pub(crate) fn new(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self { problem: problem.into(), place: None, help: Some(help.into()), is_early: false }
    }

    /// A request about a picture before the first one.
    pub(crate) fn no_picture() -> Self {
        Self { is_early: true, ..Self::new("there is no picture yet", "wait for the first one") }
    }

    /// A request about the scene of the picture, which the thread that renders no longer has.
    pub(crate) fn earlier_scene() -> Self {
        Self::new("the picture is that of the scene before its change", "wait for the next picture")
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.problem)?;
        match &self.help {
            Some(help) => write!(f, "\n  help: {help}"),
            None => Ok(()),
        }
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let text = error.to_string();
        match text.split_once("\n  help: ") {
            Some((problem, help)) => Self::new(problem, help),
            None => Self { problem: text, place: None, help: None, is_early: false },
        }
    }
}
