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

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::input::Role;

    #[test]
    fn default_names_avoid_inputs_in_a_fixed_order() {
        let at = |name: &str| PathBuf::from("no/such/folder").join(name);
        let mut inputs = InputFiles::new();
        let choose = |inputs: &InputFiles| {
            free_file(at("a.png"), "render", |path| check_outputs(&[("the image", path)], inputs))
        };
        assert_eq!(choose(&inputs), DefaultPath { path: at("a.png"), reason: None });
        inputs.add(&at("a.png"), Role::Texture);
        let chosen = choose(&inputs);
        assert_eq!(chosen.path, at("a.render.png"));
        let reason = chosen.reason.expect("a reason");
        assert!(
            reason.contains("a.png is a texture") && reason.ends_with("a.render.png is written instead"),
            "{reason}"
        );
        inputs.add(&at("a.render.png"), Role::Texture);
        assert_eq!(choose(&inputs).path, at("a.render.2.png"));
        inputs.add(&at("a.render.2.png"), Role::Texture);
        assert_eq!(choose(&inputs).path, at("a.render.3.png"));
    }

    #[test]
    fn an_output_is_no_input_and_no_other_output() {
        let mut inputs = InputFiles::new();
        inputs.add(Path::new("x/a.png"), Role::Texture);
        let [a, b, c] = ["x/a.png", "x/b.png", "x/c.png"].map(Path::new);
        check_outputs(&[("the image", b), ("the EXR", c)], &inputs).expect("apart");
        let message = |outputs: &[Output<'_>]| check_outputs(outputs, &inputs).expect_err("not apart").to_string();
        let replaced = message(&[("the image", b), ("the EXR", a)]);
        assert!(
            replaced.contains("a texture") && replaced.contains("the EXR") && replaced.contains("help:"),
            "{replaced}"
        );
        let twice = message(&[("the image", b), ("the EXR", b)]);
        assert!(twice.contains("two outputs, the image and the EXR"), "{twice}");
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_to_no_file_yet_stand_for_what_they_lead_to() {
        let home = tempfile::tempdir().expect("a folder");
        let [image, link, chain] = ["a.png", "b.png", "c.png"].map(|name| home.path().join(name));
        std::os::unix::fs::symlink("a.png", &link).expect("linked");
        std::os::unix::fs::symlink(&link, &chain).expect("linked");
        let circle = home.path().join("circle");
        std::os::unix::fs::symlink("circle", &circle).expect("linked");
        for other in [&link, &chain] {
            let outputs = [("the image", image.as_path()), ("the EXR", other.as_path())];
            assert!(check_outputs(&outputs, &InputFiles::new()).is_err(), "{}", other.display());
            let mut inputs = InputFiles::new();
            inputs.add(other, Role::Texture);
            assert!(check_outputs(&outputs[..1], &inputs).is_err(), "{}", other.display());
        }
        check_outputs(&[("the image", &image), ("the EXR", &circle)], &InputFiles::new()).expect("apart");
    }
}
