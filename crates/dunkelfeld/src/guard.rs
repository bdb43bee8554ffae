//! Separates the files that a run writes from its inputs, and from each other.
//!
//! Readers record the files that they open in an [`InputFiles`]. Every command compares its outputs with it before its
//! work. Two names are one file if paths, resolved paths, or device and inode agree.

use dunkelfeld_io::input::{FileIdentity, FileKey, InputFile, InputFiles};
use dunkelfeld_render::Error;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Maximum number of alternative names that are tried.
const MAX_TRIED: u32 = 1000;

/// An output: its name in messages, as in `the image`, and its path.
pub type Output<'a> = (&'static str, &'a Path);

/// Checks whether an output is the same file as an input or another output.
///
/// # Errors
/// The first output that is such a file.
pub fn check_outputs(outputs: &[Output<'_>], inputs: &InputFiles) -> Result<(), Error> {
    let files: Vec<_> = outputs.iter().map(|&(what, path)| (what, FileIdentity::from_path(path))).collect();
    let mut known: HashMap<FileKey<'_>, &'static str> = HashMap::new();
    for (what, file) in &files {
        if let Some(input) = inputs.find(file) {
            return Err(replaces(what, file.path(), input));
        }
        if let Some(other) = file.keys().find_map(|key| known.get(&key)) {
            return Err(Error::Output {
                file: file.path().into(),
                problem: format!("is named for two outputs, {other} and {what}"),
                help: "give each its own file".into(),
            });
        }
        file.keys().for_each(|key| {
            known.insert(key, what);
        });
    }
    Ok(())
}

fn replaces(what: &str, path: &Path, input: &InputFile) -> Error {
    let role = input.role.name();
    let [path_as_named, input_as_named] = [path, input.identity.path()].map(|p| p.strip_prefix(".").unwrap_or(p));
    let is_other = path_as_named != input_as_named;
    let as_named = if is_other { format!(" as {}", input_as_named.display()) } else { String::new() };
    Error::Output {
        file: path.into(),
        problem: format!("is {role} that this run reads{as_named}, and is also {what}"),
        help: "write to another file; the input stays as it is".into(),
    }
}

/// The default name of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DefaultPath {
    /// The path.
    pub path: PathBuf,
    /// The reason for another name than the usual one, as a sentence; `None` for the usual one.
    pub reason: Option<String>,
}

/// The usual name of a file, or the next one that is neither an input nor another output: `a.png`, `a.render.png`,
/// `a.render.2.png`. `check` tests whether a name can be used.
pub fn free_file(usual: PathBuf, word: &str, check: impl Fn(&Path) -> Result<(), Error>) -> DefaultPath {
    let other = |number: u32| {
        let mut name = usual.file_stem().unwrap_or_default().to_os_string();
        name.push(if number == 1 { format!(".{word}") } else { format!(".{word}.{number}") });
        if let Some(ending) = usual.extension() {
            name.push(".");
            name.push(ending);
        }
        usual.with_file_name(name)
    };
    first_free(usual.clone(), other, check)
}

/// The usual name, or the first of the names of `other`, from 1 on, that `check` allows.
pub fn first_free(
    usual: PathBuf,
    other: impl Fn(u32) -> PathBuf,
    check: impl Fn(&Path) -> Result<(), Error>,
) -> DefaultPath {
    let problem = match check(&usual) {
        Err(Error::Output { problem, .. }) => problem,
        // Any other fault is reported when the output is checked as a whole.
        Ok(()) | Err(_) => return DefaultPath { path: usual, reason: None },
    };
    // If so many names are in use, a later check refuses the usual one.
    let path = (1..=MAX_TRIED).map(other).find(|path| check(path).is_ok()).unwrap_or_else(|| usual.clone());
    let reason = format!("{} {problem}; {} is written instead", usual.display(), path.display());
    DefaultPath { path, reason: Some(reason) }
}
