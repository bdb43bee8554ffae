//! Keys that are flags, keywords and options: one row of `crates/job/io/src/config/keys.rs` gives all of them, and a flag has the
//! effect of the line in the job.
//!
//! Replay: `cargo test -p dunkelfeld --test it keys::NAME`. With `DUNKELFELD_UPDATE=1` the generated texts are written.

use dunkelfeld::io::{KEYS, Key, Kind, OF_FILM, OF_IMAGE, OF_RENDER, OF_STUDY};
use dunkelfeld::{Project, ProjectOptions};
use proptest::prelude::*;
use std::fmt::Write;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The type of a keyword in the stubs of Python.
fn python_type(key: &Key) -> String {
    match key.kind {
        Kind::Whole => "int".into(),
        Kind::Real => "float".into(),
        Kind::Time | Kind::Exposure | Kind::Length => "float | str".into(),
        Kind::Memory => "int | str".into(),
        Kind::Name(names) => {
            let names: Vec<String> = names.iter().map(|(name, _)| format!("\"{name}\"")).collect();
            format!("Literal[{}]", names.join(", "))
        }
        Kind::Sensor => "Sensor | str | os.PathLike[str]".into(),
        Kind::Psf | Kind::Input | Kind::Output => "str | os.PathLike[str]".into(),
    }
}

/// `_keys.py`: a dictionary of keywords for each kind of call.
fn stubs(keys: &[Key]) -> String {
    let mut text = String::from(
        "\"\"\"Keywords that are keys of a job. Made by tests/facade/keys.rs.\"\"\"\n\nfrom __future__ import annotations\n\n\
         import os\nfrom typing import TYPE_CHECKING, Literal, TypedDict\n\nif TYPE_CHECKING:\n    from ._native import Sensor\n",
    );
    for (class, what, flags) in [
        ("RenderKeys", "a render", OF_RENDER),
        ("StudyKeys", "a study", OF_STUDY),
        ("ImageKeys", "the exposure of an image", OF_IMAGE),
        ("FilmKeys", "the exposure of a film", OF_FILM),
    ] {
        // The first two arguments of an exposure are not repeated.
        let is_exposure = class != "RenderKeys" && class != "StudyKeys";
        let _ = write!(text, "\n\nclass {class}(TypedDict, total=False):\n    \"\"\"Keywords of {what}.\"\"\"\n\n");
        for key in keys.iter().filter(|key| !key.keyword.is_empty() && flags.contains(&key.flag)) {
            if !(is_exposure && ["sensor", "exposure"].contains(&key.keyword)) {
                let _ = writeln!(text, "    {}: {} | None", key.keyword, python_type(key));
            }
        }
    }
    text
}

/// The list of docs/library.md. A flag has the name of the last part of its key unless it is named.
fn list(keys: &[Key]) -> String {
    let row = |key: &Key| {
        let last = key.path.rsplit('.').next().unwrap_or_default().replace('_', "-");
        if last == key.flag { format!("`{}`", key.path) } else { format!("`{}` (`--{}`)", key.path, key.flag) }
    };
    format!("The keys: {}.\n", keys.iter().map(row).collect::<Vec<_>>().join(", "))
}

/// Compares a text with a part of a file, or writes it.
fn expect(file: &str, text: &str, part: impl Fn(&str) -> std::ops::Range<usize>) {
    let path = root().join(file);
    let mut whole = std::fs::read_to_string(&path).unwrap_or_default();
    let range = part(&whole);
    if std::env::var_os("DUNKELFELD_UPDATE").is_some() {
        whole.replace_range(range, text);
        std::fs::write(&path, whole).expect("writable");
    } else {
        assert_eq!(whole.get(range), Some(text), "{file}: run this test with DUNKELFELD_UPDATE=1");
    }
}

#[test]
fn stubs_and_pages_have_all_rows() {
    expect("crates/apps/python/python/dunkelfeld/_keys.py", &stubs(KEYS), |whole| 0..whole.len());
    expect("docs/library.md", &list(KEYS), |whole| {
        let from = whole.find("The keys: ").expect("a list");
        from..from + whole[from..].find("\n\n").expect("an end") + 1
    });
}

const JOB: &str = "scene = 'none'\ncamera = { look_at = [0, 0, 0], position = [0, 0.3, 0.4] }\n\
    film = { width = 24, height = 20 }\n[[object]]\nname = 'ball'\nkind = 'sphere'\ndiameter = '100mm'\n\
    [environment]\nradiance = 1\n";

/// A value of a key as on the command line, and as in the text of a job.
fn value(key: &Key, number: u32) -> (String, String) {
    let quoted = |text: String| (text.clone(), format!("\"{text}\""));
    match key.kind {
        Kind::Whole => (number.to_string(), number.to_string()),
        Kind::Real => (format!("{number}.5"), format!("{number}.5")),
        Kind::Time | Kind::Exposure => quoted(format!("{number}ms")),
        Kind::Length => quoted(format!("{number}mm")),
        Kind::Memory => quoted(format!("{number}GB")),
        Kind::Name(names) => quoted(names[number as usize % names.len()].0.to_owned()),
        Kind::Sensor => quoted(["imx250", "imx174", "imx183"][number as usize % 3].to_owned()),
        Kind::Psf => quoted("diffraction".to_owned()),
        Kind::Input | Kind::Output => quoted(format!("/tmp/{number}.png")),
    }
}

fn resolved(text: &str, keys: String) -> String {
    let options = ProjectOptions::default().with_keys(keys);
    match Project::from_text_with("job.toml", text, options) {
        Ok(project) => format!("{:?}\n{:?}", project.settings, project.outputs),
        Err(_) => "refused".into(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    /// Any subset of the flags of a render has the settings of a job with these lines.
    #[test]
    fn flags_are_lines_of_the_job(given in prop::collection::vec(prop::option::weighted(0.4, 1u32..50), KEYS.len())) {
        let (mut flags, mut lines) = (String::new(), String::new());
        for (key, number) in KEYS.iter().zip(&given) {
            let Some(number) = number.filter(|_| OF_RENDER.contains(&key.flag)) else { continue };
            let (flag, text) = value(key, number);
            flags += &key.line(&flag).expect("a value");
            let _ = writeln!(lines, "{} = {text}", key.path);
        }
        // The film of the job gives way to that of the lines.
        let film = if lines.contains("film.") { "" } else { "film = { width = 24, height = 20 }\n" };
        let text = JOB.replace("film = { width = 24, height = 20 }\n", &format!("{film}{lines}"));
        let without_film = JOB.replace("film = { width = 24, height = 20 }\n", film);
        prop_assert_eq!(resolved(&without_film, flags), resolved(&text, String::new()), "{}", lines);
    }
}
