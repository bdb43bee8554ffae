//! Separates the files that a run writes from its inputs, and from each other.
//!
//! Readers record the files that they open in an [`InputFiles`]. Every command compares its outputs with it before its
//! work. Two names are one file if paths, resolved paths, or device and inode agree.

use dunkelfeld_io::input::{FileIdentity, FileKey, InputFile, InputFiles};
use dunkelfeld_render::Error;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

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

/// The usual name of a picture, or another one if that is an input or another output: `a.png`, `a.render.png`. `check` tests
/// whether a name can be used.
pub(crate) fn free_picture(usual: PathBuf, check: impl Fn(&Path) -> Result<(), Error>) -> DefaultPath {
    let Err(Error::Output { problem, .. }) = check(&usual) else {
        // Any other fault is reported when the output is checked as a whole.
        return DefaultPath { path: usual, reason: None };
    };
    let path = usual.with_extension("render.png");
    let reason = format!("{} {problem}; {} is written instead", usual.display(), path.display());
    DefaultPath { path, reason: Some(reason) }
}
