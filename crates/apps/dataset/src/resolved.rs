//! The study in the folder of its set: it makes the same images from there.

use crate::study::Study;
use std::path::{Component, Path, PathBuf};
use toml_edit::{DocumentMut, Item, value};

/// The text of the study for the folder of a set, which exists. The first line names the original. The text has the `name`
/// of the study, which is part of the key of all draws. If the images need other files (`has_files`), it has the `folder`
/// that their paths refer to, relative to the set; without such a path the first line says so.
pub(crate) fn resolved_study(study: &Study, set: &Path, has_files: bool) -> String {
    let original = study.path().file_name().unwrap_or_default().to_string_lossy().replace(['\n', '\r'], " ");
    let folder = if has_files { way(set, study.folder()) } else { None };
    let mut text: DocumentMut = study.text().parse().unwrap_or_default();
    if let Some(table) = text.get_mut("study").and_then(Item::as_table_like_mut) {
        if table.get("name").is_none() {
            table.insert("name", value(study.name.as_str()));
        }
        if let Some(folder) = &folder {
            table.insert("folder", value(folder));
        }
    }
    let place = if has_files && folder.is_none() { "; its paths are relative to the folder of that study" } else { "" };
    format!("# The study of {original}{place}.\n{text}")
}

/// The relative path from a folder to another one, with slashes; both exist. `None` if they have no more than the root in
/// common: then the path would contain all of the absolute path.
fn way(from: &Path, to: &Path) -> Option<String> {
    let to = if to.as_os_str().is_empty() { Path::new(".") } else { to };
    let [from, to]: [PathBuf; 2] = [from.canonicalize().ok()?, to.canonicalize().ok()?];
    let names = |path: &Path| -> Option<Vec<String>> {
        let names = path.components().filter(|part| matches!(part, Component::Normal(_)));
        names.map(|part| part.as_os_str().to_str().map(str::to_owned)).collect()
    };
    let (from, to) = (names(&from)?, names(&to)?);
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return None;
    }
    let up = std::iter::repeat_n("..", from.len() - common);
    let parts: Vec<&str> = up.chain(to.iter().skip(common).map(String::as_str)).collect();
    Some(if parts.is_empty() { ".".into() } else { parts.join("/") })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stable_text::text_hash;
    use std::fs;

    #[test]
    fn ways_lead_back() {
        let root = tempfile::tempdir().expect("a folder");
        for name in ["a/b/c", "a/d"] {
            fs::create_dir_all(root.path().join(name)).expect("a folder");
        }
        let at = |name: &str| root.path().join(name);
        for (from, to, expected) in [
            ("a/b/c", "a/d", "../../d"),
            ("a/d", "a/b/c", "../b/c"),
            ("a", "a/b", "b"),
            ("a/b", "a", ".."),
            ("a", "a", "."),
        ] {
            assert_eq!(way(&at(from), &at(to)).as_deref(), Some(expected), "{from} to {to}");
            assert_eq!(at(from).join(expected).canonicalize().ok(), at(to).canonicalize().ok());
        }
        assert_eq!(way(&at("a"), Path::new("/")), None);
        assert_eq!(way(&at("a"), &at("none")), None);
    }

    #[test]
    fn a_resolved_study_has_the_jobs_of_the_original() {
        let root = tempfile::tempdir().expect("a folder");
        for name in ["studies", "jobs", "sets/one"] {
            fs::create_dir_all(root.path().join(name)).expect("a folder");
        }
        let at = |name: &str| root.path().join(name);
        fs::write(at("jobs/job.toml"), "scene = \"part.glb\"\n[film]\nwidth = 8\nheight = 8\n").expect("written");
        for (head, body) in [
            ("[study]\n# a comment\njob = \"../jobs/job.toml\"\n", "[sensor]\ngain = { uniform = [1, 2] }\n"),
            ("study = { job = \"../jobs/job.toml\" }\n", "sensor.gain = { uniform = [1, 2] }\n"),
            ("study.job = \"../jobs/job.toml\"\n", "sensor.gain = { uniform = [1, 2] }\n"),
        ] {
            fs::write(at("studies/bolts.toml"), format!("{head}{body}")).expect("written");
            let study = Study::open(at("studies/bolts.toml")).expect("a study");
            let text = resolved_study(&study, &at("sets/one"), true);
            assert!(text.starts_with("# The study of bolts.toml") && text.contains("\"../../studies\""), "{text}");
            assert_eq!(text.contains("# a comment"), head.contains("# a comment"));
            fs::write(at("sets/one/study.toml"), text).expect("written");
            let again = Study::open(at("sets/one/study.toml")).unwrap_or_else(|e| panic!("{e}"));
            for index in 0..4 {
                assert_eq!(study.job(index).expect("a job"), again.job(index).expect("a job"));
            }
            assert_eq!(again.job_path().canonicalize().ok(), at("jobs/job.toml").canonicalize().ok());
            // The hash of the text is that of the original, and finds an edited value.
            let hash = text_hash(study.text(), &study.name);
            assert_eq!(text_hash(again.text(), &study.name), hash);
            assert_ne!(text_hash(&again.text().replace("[1, 2]", "[1, 3]"), &study.name), hash);
        }
        // Without other files nothing but the name is added.
        fs::write(at("studies/alone.toml"), "scene = \"none\"\n[study]\nname = \"x\"\n").expect("written");
        let study = Study::open(at("studies/alone.toml")).expect("a study");
        let text = resolved_study(&study, &at("sets/one"), false);
        assert_eq!(text, "# The study of alone.toml.\nscene = \"none\"\n[study]\nname = \"x\"\n");
    }
}
