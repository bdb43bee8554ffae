//! The error of the page.

use std::fmt;
use std::path::{Path, PathBuf};

/// A file that the report cannot use: the file, the problem, and the help.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ReportError {
    /// The file or folder.
    pub(crate) file: PathBuf,
    pub(crate) problem: String,
    pub(crate) help: String,
}

impl ReportError {
    pub(crate) fn new(file: &Path, problem: impl fmt::Display, help: &str) -> Self {
        Self { file: file.into(), problem: problem.to_string(), help: help.into() }
    }
}

impl fmt::Display for ReportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; help: {}", self.file.display(), self.problem, self.help)
    }
}

impl std::error::Error for ReportError {}
