//! Errors of unusable input, and warnings of repaired input.

use crate::visible::{visible_columns, visible_line};
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::path::{Path, PathBuf};

/// A place in a text, with the text, so that a message can show line and caret.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceSpan {
    /// The whole text of the file.
    pub text: String,
    /// Byte range of the offending part.
    pub range: std::ops::Range<usize>,
}

/// The place of a fault of a file as a whole.
const WHOLE: &str = "the file";

/// Input that cannot be used: the file, the place in it, the fault, and the help.
///
/// When displayed, terminal control characters are escaped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}\n  help: {}", self.statement(), visible_line(help))]
pub struct InputError {
    /// The file.
    pub file: PathBuf,
    /// The place in the file: `mesh 3 "lid", primitive 0`, `line 12`, `[film] width`.
    pub place: String,
    /// The fault, without a full stop.
    pub problem: String,
    /// The help: a correction by the user, without a full stop.
    pub help: String,
    /// The text around the place, for text files.
    pub source_span: Option<Box<SourceSpan>>,
    /// The files that were read or requested before a scene was refused, as far as they are known.
    pub read: Option<Box<ReadFiles>>,
}

/// Files that were read or requested before an error.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadFiles(pub Vec<PathBuf>);

impl InputError {
    /// An error without a text span.
    pub fn new(
        file: impl Into<PathBuf>,
        place: impl Into<String>,
        problem: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        Self {
            file: file.into(),
            place: place.into(),
            problem: problem.into(),
            help: help.into(),
            source_span: None,
            read: None,
        }
    }

    /// An error about a file as a whole.
    pub fn of_file(file: impl Into<PathBuf>, problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self::new(file, WHOLE, problem, help)
    }

    /// An error about a key of a table, as its place. The file and the table are not known yet.
    pub fn of_key(key: &str, problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self::new("", key, problem, help)
    }

    /// Is it about a file as a whole, such as one that is missing?
    pub fn is_of_file(&self) -> bool {
        self.place == WHOLE
    }

    /// File, place and fault, without the help.
    pub fn statement(&self) -> String {
        let file = self.file.to_string_lossy();
        format!("{}: {}: {}", visible_line(&file), visible_line(&self.place), visible_line(&self.problem))
    }

    /// The error in one line.
    pub fn in_one_line(&self) -> String {
        format!("{}; help: {}", self.statement(), visible_line(&self.help))
    }

    /// Adds files that were read or requested before.
    pub fn with_read_files<'a>(mut self, files: impl IntoIterator<Item = &'a Path>) -> Self {
        self.read.get_or_insert_default().0.extend(files.into_iter().map(Path::to_owned));
        self
    }

    /// The files that were read or requested before a scene was refused, as far as they are known.
    pub fn read_files(&self) -> impl Iterator<Item = &Path> {
        self.read.iter().flat_map(|read| &read.0).map(PathBuf::as_path)
    }

    /// The line with the offending part and a caret under it, as in compilers; empty without a span. Only the part of a
    /// long line around the caret is shown.
    pub fn caret(&self) -> String {
        let Some(SourceSpan { text, range }) = self.source_span.as_deref() else { return String::new() };
        let start = text.floor_char_boundary(range.start);
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let end = text.floor_char_boundary(range.end.clamp(start, line_end));
        let snippet = Snippet::source(text).annotation(AnnotationKind::Primary.span(start..end));
        let shown = Renderer::plain().render(&[Group::with_level(Level::ERROR).element(snippet)]);
        // The renderer replaces most control characters, but not those of C1.
        shown.lines().map(visible_columns).collect::<Vec<_>>().join("\n")
    }
}

/// A part of the input that was repaired or left out. When displayed, terminal control characters are escaped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportWarning {
    /// File and place.
    pub place: String,
    /// The problem and the repair.
    pub message: String,
}

impl std::fmt::Display for ImportWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", visible_line(&self.place), visible_line(&self.message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_stands_under_the_fault() {
        let text = "[film]\nwidth = \"wide\"\n".to_string();
        let range = text.find("\"wide\"").map(|s| s..s + 6).expect("present");
        let mut e = InputError::new("job.toml", "[film] width", "not a number", "write a whole number");
        e.source_span = Some(Box::new(SourceSpan { text, range }));
        assert_eq!(e.caret(), "  |\n2 | width = \"wide\"\n  |         ^^^^^^");
    }

    #[test]
    fn control_sequences_are_not_shown() {
        let bad = "\u{1b}[2J\n\u{202e}";
        let mut e = InputError::new(bad, bad, bad, bad);
        e.source_span = Some(Box::new(SourceSpan { text: "x = \"\u{1b}[2J\" # \u{9b}".into(), range: 4..9 }));
        let warning = ImportWarning { place: bad.into(), message: bad.into() };
        for shown in [e.to_string().replace("\n  help: ", ""), e.caret().replace('\n', ""), warning.to_string()] {
            assert!(!shown.contains(|c: char| c.is_control() || c == '\u{202e}'), "{shown:?}");
        }
        assert_eq!(e.caret().lines().nth(1), Some("1 | x = \"\u{241b}[2J\" # \u{fffd}"));
    }

    #[test]
    fn a_long_line_is_cut_around_the_caret() {
        let text = format!("{}\"nodes\"{}", "[1,2],".repeat(1000), ",[3,4]".repeat(1000));
        let mut e = InputError::new("a.gltf", "p", "x", "y");
        e.source_span = Some(Box::new(SourceSpan { text, range: 6000..6007 }));
        let caret = e.caret();
        let lines: Vec<&str> = caret.lines().collect();
        let from = lines[2].find('^').expect("a caret");
        assert_eq!((&lines[1][from..from + 7], &lines[2][from..]), ("\"nodes\"", "^^^^^^^"), "{caret}");
        assert!(lines[1].len() < 200, "{caret}");
    }

    #[test]
    #[allow(clippy::reversed_empty_ranges, reason = "a reversed span is one of the faults")]
    fn a_span_outside_the_text_does_not_panic() {
        for range in [0..0, 5..2, 100..200, 1..3] {
            let mut e = InputError::new("f", "p", "x", "y");
            e.source_span = Some(Box::new(SourceSpan { text: "äö\n".into(), range }));
            assert!(e.caret().contains('^'));
        }
    }
}
