//! TOML files into typed data, with errors that show line, caret and help. Job and sensor files use it.
//!
//! ```
//! use dunkelfeld_io::toml_file::TomlFile;
//!
//! #[derive(Debug, serde::Deserialize)]
//! struct Film {
//!     width: u32,
//! }
//!
//! let file = TomlFile::from_text("film.toml", "width = -1");
//! let error = file.parse::<Film>().expect_err("a film without width");
//! assert_eq!((error.place.as_str(), error.caret().contains("1 | width = -1")), ("width", true));
//! ```

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use crate::error::{InputError, SourceSpan};
use crate::input::{InputFiles, Role};
use crate::names::nearest_names;

/// Larger files are refused: settings need less than a megabyte.
const LARGEST: u64 = 1 << 20;

/// A TOML text and its file. Its errors contain the place in the text.
#[derive(Clone, Debug, Default)]
pub struct TomlFile {
    path: PathBuf,
    text: String,
    /// The places of all keys, read from the text when they are first needed.
    spans: OnceLock<Spans>,
    /// The two texts that this one was merged from: below, and above. Errors show their lines.
    merged: Option<Arc<[TomlFile; 2]>>,
}

impl PartialEq for TomlFile {
    fn eq(&self, other: &Self) -> bool {
        (&self.path, &self.text) == (&other.path, &other.text)
    }
}

impl Eq for TomlFile {}

impl TomlFile {
    /// Reads a file of at most 1 MiB, and records it as an input. A byte order mark at its start is left out.
    ///
    /// # Errors
    /// The file is missing, unreadable, not a regular file, too large, or not UTF-8.
    pub fn read(path: &Path, role: Role, inputs: &mut InputFiles) -> Result<Self, InputError> {
        let bytes = inputs.read(path, role, LARGEST).map_err(|fault| fault.at(path))?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let problem = format!("is not UTF-8 text (byte {})", e.utf8_error().valid_up_to());
            InputError::of_file(path, problem, "save the file as UTF-8")
        })?;
        Ok(Self::from_text(path, text))
    }

    /// A text that is already in memory; `path` is only for messages and for [`Self::resolve`].
    pub fn from_text(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        let mut text = text.into();
        if text.starts_with('\u{feff}') {
            text.drain(..'\u{feff}'.len_utf8());
        }
        Self { path: path.into(), text, spans: OnceLock::new(), merged: None }
    }

    /// The text with the keys of another one: tables are merged key by key, lists of tables (`[[light]]`) are extended,
    /// and every other value is replaced. Paths remain relative to the folder of this file. `prepare` may change both
    /// before.
    ///
    /// # Errors
    /// One of the texts is not TOML. Errors about the other one have its name as their file.
    pub fn with_overrides(
        &self,
        overrides: &Self,
        prepare: impl FnOnce(&mut Table, &mut Table),
    ) -> Result<Self, InputError> {
        let (mut root, mut above): (Table, Table) = (self.parse()?, overrides.parse()?);
        prepare(&mut root, &mut above);
        merge(&mut root, above);
        let text = toml::to_string(&root).map_err(|e| {
            let problem = format!("cannot be combined with {}: {e}", overrides.path.display());
            InputError::of_file(&self.path, problem, "check both texts")
        })?;
        let merged = Some(Arc::new([self.clone(), overrides.clone()]));
        Ok(Self { merged, ..Self::from_text(&self.path, text) })
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The origin of the text.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A path written in the file, relative to the file's own folder.
    pub fn resolve(&self, relative: impl AsRef<Path>) -> PathBuf {
        match self.path.parent() {
            Some(folder) => folder.join(relative),
            None => relative.as_ref().to_path_buf(),
        }
    }

    /// Deserializes the text. `T` and all types in it should be `deny_unknown_fields`.
    ///
    /// # Errors
    /// Bad TOML, unknown or missing keys, values of the wrong kind.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, InputError> {
        toml::from_str(&self.text).map_err(|e| self.refusal(&e, &[], ""))
    }

    /// An error of serde with its place. For an unknown key, `more` are keys that are known beside those in the message,
    /// and `of` describes the table.
    pub(crate) fn refusal(&self, e: &toml::de::Error, more: &[&str], of: &str) -> InputError {
        let message = Message::from_serde(e.message(), more, of);
        // An empty span means the whole file: the root table has no header.
        let span = e.span().filter(|range| !range.is_empty() || message.missing.is_none());
        let error = span.map(|range| self.error_at(range, &message.problem, &message.help));
        match (error, message.missing) {
            (Some(error), None) => error,
            // Only a key that is missing from a table has a header for the caret.
            (Some(mut error), Some(key)) if !error.place.starts_with("line ") => {
                error.place = join_place(&error.place, &key);
                error
            }
            (_, missing) => {
                let place = missing.unwrap_or_else(|| "the file".into());
                InputError::new(&self.path, place, message.problem, message.help)
            }
        }
    }

    /// An error about the part of the text at `range` (from [`Spanned::span`]); the place is the path of the key.
    pub fn error_at(&self, range: Range<usize>, problem: impl Into<String>, help: impl Into<String>) -> InputError {
        if let Some((file, range)) = self.merged.as_deref().and_then(|[below, above]| {
            let path = self.path_at(&range)?;
            let keys: Vec<&str> = path.iter().map(String::as_str).collect();
            // Lists of tables are extended, so that a number counts from those below.
            let is_in_list = keys.iter().any(|key| key.bytes().all(|b| b.is_ascii_digit()));
            let files: &[&Self] = if is_in_list { &[below] } else { &[above, below] };
            files.iter().find_map(|file| Some((*file, file.span_of(&keys)?)))
        }) {
            return file.error_at(range, problem, help);
        }
        let mut error = InputError::new(&self.path, self.place(&range), problem, help);
        error.source_span = Some(Box::new(SourceSpan { text: self.text.clone(), range }));
        error
    }

    /// An error about the value of a key: its path, with positions in arrays as numbers from 0 (`["light", "2", "name"]`).
    /// If there is no such key, it is about the table that lacks it.
    pub fn error_at_key(&self, path: &[&str], problem: impl Into<String>, help: impl Into<String>) -> InputError {
        match (0..path.len()).rev().find_map(|last| self.span_of(&path[..=last])) {
            Some(range) => self.error_at(range, problem, help),
            None => InputError::new(&self.path, path.join(", "), problem, help),
        }
    }

    /// Is there a value at the end of this path, as in [`Self::error_at_key`]?
    pub fn has_key(&self, path: &[&str]) -> bool {
        self.span_of(path).is_some()
    }

    /// The text of the value at the end of this path, as in [`Self::error_at_key`].
    pub fn text_at(&self, path: &[&str]) -> Option<&str> {
        self.text.get(self.span_of(path)?)
    }

    /// The paths of all values that are no tables.
    pub fn keys(&self) -> Vec<Vec<&str>> {
        let spans = self.spans();
        let is_leaf = |path: &&String| {
            let below = format!("{path}{BELOW}");
            !spans.range(below.clone()..).next().is_some_and(|(next, _)| next.starts_with(&below))
        };
        spans.keys().filter(is_leaf).map(|path| path.split(BELOW).collect()).collect()
    }

    fn span_of(&self, path: &[&str]) -> Option<Range<usize>> {
        self.spans().get(&path.join(BELOW)).map(|[_, value]| value.clone())
    }

    fn spans(&self) -> &Spans {
        self.spans.get_or_init(|| {
            let mut spans = Spans::new();
            if let Ok(root) = DeTable::parse(&self.text) {
                for (key, value) in root.get_ref() {
                    add_spans(key.get_ref().to_string(), key.span(), value, &mut spans);
                }
            }
            spans
        })
    }

    /// The path of the key whose key or value contains `range`, as for [`Self::error_at_key`].
    pub fn path_at(&self, range: &Range<usize>) -> Option<Vec<String>> {
        let holds = |span: &&Range<usize>| span.start <= range.start && range.end <= span.end;
        let length = |spans: &[Range<usize>; 2]| spans.iter().filter(holds).map(Range::len).min();
        // The span of a table is only its header, so that all paths are searched. Of equal spans the last one is the
        // innermost.
        let all = self.spans().iter().rev().filter_map(|(path, spans)| Some((length(spans)?, path)));
        let (_, path) = all.min_by_key(|(length, _)| *length)?;
        Some(path.split(BELOW).map(str::to_string).collect())
    }

    /// The path of the key whose key or value contains `range`: `[film] width`, `[[light]] 2, power`.
    fn place(&self, range: &Range<usize>) -> String {
        match self.path_at(range) {
            Some(path) => describe(&path),
            None => format!("line {}", self.text.get(..range.start).unwrap_or("").matches('\n').count() + 1),
        }
    }
}

/// The text of a value as TOML.
///
/// # Errors
/// A value that TOML cannot hold, such as one without a key.
pub fn toml_text(value: &impl Serialize) -> Result<String, String> {
    toml::to_string(value).map_err(|e| e.to_string())
}

/// Merges tables as [`TomlFile::with_overrides`].
pub fn merge(table: &mut Table, overrides: Table) {
    let are_tables = |list: &[Value]| list.iter().all(Value::is_table);
    for (key, value) in overrides {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(value)) => merge(below, value),
            (Some(Value::Array(list)), Value::Array(more)) if are_tables(list) && are_tables(&more) => {
                list.extend(more)
            }
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// The ranges of the key and of the value at each path.
type Spans = BTreeMap<String, [Range<usize>; 2]>;

/// Separates the keys of a path.
const BELOW: &str = "\u{1f}";

/// Adds the ranges of a key and its value, and those of all values in it.
fn add_spans(path: String, key: Range<usize>, value: &Spanned<DeValue<'_>>, spans: &mut Spans) {
    let below = |key: &str| [path.as_str(), key].join(BELOW);
    match value.get_ref() {
        DeValue::Table(table) => {
            table.iter().for_each(|(key, value)| add_spans(below(key.get_ref()), key.span(), value, spans));
        }
        DeValue::Array(items) => {
            let items = items.iter().enumerate();
            items.for_each(|(i, item)| add_spans(below(&i.to_string()), item.span(), item, spans));
        }
        _ => {}
    }
    spans.insert(path, [key, value.span()]);
}

/// A key path as in the file.
fn describe(path: &[String]) -> String {
    let number = path.get(1).and_then(|step| step.parse::<usize>().ok()).map(|i| i + 1);
    match (path, number) {
        ([table, _], Some(number)) => format!("[[{table}]] {number}"),
        ([table, _, key, ..], Some(number)) => format!("[[{table}]] {number}, {key}"),
        ([table, key, ..], _) => format!("[{table}] {key}"),
        _ => path.concat(),
    }
}

fn join_place(table: &str, key: &str) -> String {
    // A table inside of another one has a place such as `[lens] filter`.
    if table.starts_with('[') { format!("{table}, {key}") } else { format!("[{table}] {key}") }
}

/// The errors of serde and toml, as a problem and help.
pub(crate) struct Message {
    pub(crate) problem: String,
    pub(crate) help: String,
    /// The key that is missing, if one is.
    missing: Option<String>,
}

impl Message {
    fn from_serde(message: &str, more: &[&str], of: &str) -> Self {
        let message = message.trim_end().replace('\n', "; ");
        for (start, what, more, of) in [("unknown field ", "key", more, of), ("unknown variant ", "value", &[], "")] {
            if let Some(rest) = message.strip_prefix(start) {
                // "`name`, expected `a` or `b`", "`name`, expected one of `a`, `b`" or "`name`, there are no fields".
                let mut ticked = rest.split('`').skip(1).step_by(2);
                let name = ticked.next().unwrap_or_default();
                let unknown = Self::unknown(what, name, &ticked.chain(more.iter().copied()).collect::<Vec<_>>());
                return Self { problem: unknown.problem + of, ..unknown };
            }
        }
        if let Some(key) = message.strip_prefix("missing field ").map(|k| k.trim_matches('`').to_string()) {
            return Self {
                problem: format!("the key `{key}` is missing"),
                help: format!("add `{key} = ...`"),
                missing: Some(key),
            };
        }
        for (start, problem) in [("invalid type: ", "does not belong here"), ("invalid value: ", "is out of range")] {
            let Some((found, wanted)) = message.strip_prefix(start).and_then(|m| m.split_once(", expected ")) else {
                continue;
            };
            let too_large = found.strip_suffix(" as i128").or(found.strip_suffix(" as u128"));
            let (found, problem) = too_large.map_or((found, problem), |number| (number, "is out of range"));
            // Two brackets around a section that exists once make a list of a value that was intended for its first
            // key.
            let brackets = match found {
                "map" if wanted.contains("sequence") => {
                    ", or double brackets around the name of a section that there may be several times, as in [[light]]"
                }
                "map" => ", or single brackets around the name of a section that there is once",
                _ => "",
            };
            let (problem, help) = (format!("{found} {problem}"), format!("write {}{brackets}", in_words(wanted)));
            return Self { problem, help, missing: None };
        }
        if ["escape", "unicode"].iter().any(|word| message.contains(word)) {
            let help =
                r"put a path in 'single quotes', or write `/` or `\\`: in double quotes a back slash begins an escape";
            return Self { problem: message, help: help.into(), missing: None };
        }
        // Messages of our own value types contain their help after a semicolon.
        if let Some((problem, help)) = message.split_once("; ") {
            return Self { problem: problem.into(), help: help.into(), missing: None };
        }
        Self { problem: message, help: "correct the TOML there".into(), missing: None }
    }

    /// A name that is none of the known ones.
    pub(crate) fn unknown(what: &str, name: &str, known: &[&str]) -> Self {
        let list = if known.is_empty() { "none".to_string() } else { known.join(", ") };
        let help = match nearest_names(name, known.iter().copied()).first() {
            Some(near) => format!("did you mean `{near}`? known {what}s: {list}"),
            None => format!("known {what}s: {list}"),
        };
        Self { problem: format!("unknown {what} `{name}`"), help, missing: None }
    }
}

/// The name for users of a kind of value of serde.
fn in_words(wanted: &str) -> String {
    match wanted {
        "u8" => format!("a whole number from 0 to {}", u8::MAX),
        "u16" => format!("a whole number from 0 to {}", u16::MAX),
        "u32" => format!("a whole number from 0 to {}", u32::MAX),
        // The range of TOML's integers ends here.
        "u64" | "usize" => format!("a whole number from 0 to {}", i64::MAX),
        "i32" | "i64" => "a whole number".into(),
        "f32" | "f64" => "a number".into(),
        "a boolean" => "true or false".into(),
        "a string" => "a text in quotes".into(),
        "a sequence" => "a list in brackets, [...]".into(),
        "a map" => "a table".into(),
        other if other.starts_with("struct ") => "a table".into(),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    struct Settings {
        scene: String,
        width: Option<u32>,
    }

    fn failure(text: &str) -> InputError {
        TomlFile::from_text("job.toml", text).parse::<Settings>().expect_err(text)
    }

    #[test]
    fn a_key_missing_from_the_whole_file_is_named() {
        for text in ["", "\n", "width = 3", "[film]\nwidth = 3"] {
            let error = failure(text);
            assert_eq!((error.place.as_str(), error.problem.as_str()), ("scene", "the key `scene` is missing"));
        }
    }

    #[test]
    fn a_byte_order_mark_is_left_out_and_moves_no_caret() {
        let text = "\u{feff}scene = \"a\"\nwidth = 7\n";
        let settings: Settings = TomlFile::from_text("job.toml", text).parse().expect("good TOML");
        assert_eq!((settings.scene.as_str(), settings.width), ("a", Some(7)));
        assert_eq!(failure("\u{feff}scene = 1").caret(), "  |\n1 | scene = 1\n  |         ^");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("job.toml");
        std::fs::write(&path, text).expect("writable");
        let file = TomlFile::read(&path, Role::Job, &mut InputFiles::new()).expect("readable");
        assert!(file.parse::<Settings>().is_ok());
    }

    #[test]
    fn a_file_that_cannot_be_read_is_an_error() {
        let read = |path: &Path| TomlFile::read(path, Role::Job, &mut InputFiles::new());
        let error = read(Path::new("no/such/job.toml")).expect_err("missing");
        assert!(error.problem.contains("cannot be read"), "{error}");
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert!(read(folder.path()).expect_err("a folder").problem.contains("folder"));
        let path = folder.path().join("latin1.toml");
        std::fs::write(&path, b"name = \"\xe4\"").expect("writable");
        assert!(read(&path).expect_err("Latin-1").problem.contains("UTF-8"));
    }
}
