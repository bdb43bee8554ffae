//! Rules for single files: calls that open files, and traces of the machine a file was written on.

/// The modules that open files: the door for those that are read; the writer, which opens folders to sync them and leftovers
/// to lock them; the lock files.
const MAY_OPEN: [&str; 3] =
    ["crates/job/files/src/input.rs", "crates/job/files/src/partial.rs", "crates/job/files/src/lock.rs"];

/// The calls that open a file to read it.
const OPENERS: [&str; 6] =
    ["File::open", "File::options", "OpenOptions", "fs::read(", "fs::read_to_string", "use std::fs::{read"];

/// The faults of a tracked text file, named relative to the root with forward slashes.
pub(crate) fn check(name: &str, text: &str) -> Vec<String> {
    let mut faults = machine_traces(name, text);
    faults.extend(opened_files(name, text));
    faults
}

/// Files are read through `InputFiles` alone, which checks, bounds and records them. Tests may do as they like.
fn opened_files(name: &str, text: &str) -> Vec<String> {
    let is_source = name.starts_with("crates/") && name.contains("/src/") && name.ends_with(".rs");
    if !is_source || name.starts_with("crates/testkit/") || name.ends_with("_tests.rs") || MAY_OPEN.contains(&name) {
        return Vec::new();
    }
    let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let opens = |line: &str| OPENERS.iter().any(|opener| line.split("//").next().unwrap_or_default().contains(opener));
    let lines = code.lines().enumerate().filter(|(_, line)| opens(line));
    lines.map(|(i, _)| format!("{name}:{}: opens a file; only {} may", i + 1, MAY_OPEN.join(" and "))).collect()
}

/// Absolute paths of one machine, and settings that redirect package managers. The patterns are
/// joined here, so that this file does not find itself.
fn machine_traces(name: &str, text: &str) -> Vec<String> {
    let folders = ["home", "root", "work", "Users"].map(|folder| format!("/{folder}/"));
    let settings =
        [["index", "-url"], ["replace", "-with"], ["sparse+", "http"], ["registry", " ="]].map(|p| p.concat());
    let mut faults = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let begins_a_path = |at: usize| {
            let before = line[..at].chars().next_back();
            before.is_none_or(|c| c.is_whitespace() || "\"'`(=:<,>[".contains(c))
        };
        if folders.iter().any(|folder| line.match_indices(folder.as_str()).any(|(at, _)| begins_a_path(at))) {
            faults.push(format!("{name}:{}: an absolute path of one machine", i + 1));
        }
        if settings.iter().any(|setting| line.contains(setting.as_str())) {
            faults.push(format!("{name}:{}: a package registry other than the usual one", i + 1));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_opened_in_one_place_and_in_tests() {
        let bare = "//! X.\nfn f() {\n    let a = std::fs::read(p);\n}\n";
        assert_eq!(check("crates/job/io/src/formats/exr.rs", bare).len(), 1);
        assert_eq!(check("crates/dunkelfeld/src/a.rs", "//! X.\nuse std::fs::{read, write};\n").len(), 1);
        assert_eq!(
            check("crates/job/io/src/a.rs", "//! X.\nfn f() { fs::File::open(p); fs::read_dir(p); }\n").len(),
            1
        );
        for elsewhere in
            ["crates/job/files/src/input.rs", "crates/job/io/tests/a.rs", "tests/a.rs", "crates/testkit/src/a.rs"]
        {
            assert!(check(elsewhere, bare).is_empty(), "{elsewhere}");
        }
        let tested = "//! X.\n// File::open\n#[cfg(test)]\nmod tests {\n    fn f() { fs::read(p); }\n}\n";
        assert!(check("crates/job/io/src/formats/exr.rs", tested).is_empty());
    }

    #[test]
    fn traces_of_a_machine_are_found() {
        for folder in ["home", "root", "work", "Users"] {
            assert_eq!(check("a.md", &format!("see /{folder}/me/file")).len(), 1, "{folder}");
            assert_eq!(check("a.toml", &format!("path = \"/{folder}/me\"")).len(), 1, "{folder}");
            assert!(check("a.md", &format!("https://example.com/{folder}/page and crates/{folder}/src")).is_empty());
        }
        assert_eq!(check("pip.conf", &format!("index{} = https://example.com", "-url")).len(), 1);
    }
}
