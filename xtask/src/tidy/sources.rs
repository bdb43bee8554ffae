//! Rules for single files: headers, lengths, unsafe code, and traces of the machine a file was written on.

/// Files longer than this should be split; much longer ones must be.
const LONG: usize = 600;
const TOO_LONG: usize = 700;

/// Folders whose crates may contain unsafe code, if each use states why it is sound.
const MAY_BE_UNSAFE: [&str; 3] = ["crates/bvh/", "crates/denoise/", "crates/capi/"];

/// Words of functions that C calls: the header states what their callers promise.
const OF_C: [&str; 2] = ["#[unsafe(no_mangle)]", "unsafe extern \"C\" fn "];

/// The modules that open files: the door for those that are read; the writer, which opens folders to sync them and leftovers
/// to lock them; the lock files.
const MAY_OPEN: [&str; 3] =
    ["crates/io/src/files/input.rs", "crates/io/src/files/partial.rs", "crates/io/src/files/lock.rs"];

/// The calls that open a file to read it.
const OPENERS: [&str; 5] = ["File::open", "File::options", "OpenOptions", "fs::read(", "fs::read_to_string"];

/// The findings in one file.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Findings {
    /// Violations.
    pub(crate) faults: Vec<String>,
    /// Not a fault, but printed.
    pub(crate) warnings: Vec<String>,
}

/// Checks a tracked text file, named relative to the root with forward slashes.
pub(crate) fn check(name: &str, text: &str) -> Findings {
    let mut found = Findings::default();
    machine_traces(name, text, &mut found);
    if name == "Cargo.lock" {
        foreign_sources(text, &mut found);
    }
    if name.ends_with(".rs") {
        header_and_length(name, text, &mut found);
        unsafe_code(name, text, &mut found);
        opened_files(name, text, &mut found);
    }
    found
}

fn header_and_length(name: &str, text: &str, found: &mut Findings) {
    if !text.starts_with("//! ") {
        found.faults.push(format!("{name}: does not begin with a `//!` line that describes it"));
    }
    let lines = text.lines().count();
    if lines > TOO_LONG {
        found.faults.push(format!("{name}: {lines} lines; split it, one idea per file"));
    } else if lines > LONG {
        found.warnings.push(format!("{name}: {lines} lines, more than {LONG}"));
    }
}

fn unsafe_code(name: &str, text: &str, found: &mut Findings) {
    let code = without_comments_and_strings(text);
    let home = MAY_BE_UNSAFE.iter().any(|folder| name.starts_with(folder));
    let is_root = name.starts_with("crates/") && (name.ends_with("/src/lib.rs") || name.ends_with("/src/main.rs"));
    if is_root && !home && !code.contains("#![forbid(unsafe_code)]") {
        found.faults.push(format!("{name}: lacks `#![forbid(unsafe_code)]`"));
    }
    let lines: Vec<&str> = text.lines().collect();
    for (i, line) in code.lines().enumerate().filter(|(_, line)| has_word(line, "unsafe")) {
        let place = format!("{name}:{}", i + 1);
        if !home {
            found.faults.push(format!("{place}: unsafe code; only bvh, denoise and capi may have it"));
        } else if !line.contains("fn(") && !is_of_c(lines.get(i).copied()) && !explained(&lines, i) {
            found.faults.push(format!("{place}: unsafe without a SAFETY line with the reason"));
        }
    }
}

/// Files are read through `InputFiles` alone, which checks, bounds and records them. Tests may do as they like.
fn opened_files(name: &str, text: &str, found: &mut Findings) {
    let is_source = name.starts_with("crates/") && name.contains("/src/") && !name.starts_with("crates/testkit/");
    if !is_source || name.ends_with("_tests.rs") || MAY_OPEN.contains(&name) {
        return;
    }
    let code = without_comments_and_strings(text);
    let code = code.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    for (i, line) in code.lines().enumerate() {
        let imported = line.trim_start().starts_with("use std::fs::")
            && ["read", "read_to_string"].iter().any(|function| has_word(line, function));
        if imported || OPENERS.iter().any(|opener| line.contains(opener)) {
            found.faults.push(format!("{name}:{}: opens a file; only {} may", i + 1, MAY_OPEN.join(" and ")));
        }
    }
}

fn is_of_c(line: Option<&str>) -> bool {
    line.is_some_and(|line| OF_C.iter().any(|word| line.contains(word)))
}

/// Does the line, or what stands right above it without a blank line between, mention safety?
fn explained(lines: &[&str], i: usize) -> bool {
    let says = |line: &&str| line.contains("SAFETY:") || line.contains("# Safety");
    let above = lines.iter().take(i).rev().take(12).take_while(|line| !line.trim().is_empty());
    lines.get(i).is_some_and(says) || above.copied().any(|line| says(&line))
}

fn has_word(line: &str, word: &str) -> bool {
    line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == word)
}

/// The text with comments, strings and character literals blanked out, line by line the same.
pub(super) fn without_comments_and_strings(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let mut out = String::with_capacity(text.len());
    let mut i = 0;
    while i < chars.len() {
        let start = i;
        match at(i) {
            '/' if at(i + 1) == '/' => i += chars[i..].iter().take_while(|&&c| c != '\n').count(),
            '/' if at(i + 1) == '*' => {
                let mut depth = 0;
                loop {
                    match (at(i), at(i + 1)) {
                        ('/', '*') => (depth, i) = (depth + 1, i + 2),
                        ('*', '/') => (depth, i) = (depth - 1, i + 2),
                        _ => i += 1,
                    }
                    if depth == 0 || i >= chars.len() {
                        break;
                    }
                }
            }
            'r' if matches!(at(i + 1), '"' | '#') && !(i > 0 && at(i - 1).is_alphanumeric()) => {
                let hashes = chars[i + 1..].iter().take_while(|&&c| c == '#').count();
                if at(i + 1 + hashes) == '"' {
                    let closes = |j: usize| at(j) == '"' && (1..=hashes).all(|h| at(j + h) == '#');
                    i += 2 + hashes;
                    while i < chars.len() && !closes(i) {
                        i += 1;
                    }
                    i += 1 + hashes;
                } else {
                    i += 1;
                    out.push('r');
                    continue;
                }
            }
            '"' => {
                i += 1;
                while i < chars.len() && at(i) != '"' {
                    i += if at(i) == '\\' { 2 } else { 1 };
                }
                i += 1;
            }
            // A character literal, not a lifetime.
            '\'' if at(i + 1) == '\\' || at(i + 2) == '\'' => {
                i += if at(i + 1) == '\\' { 3 } else { 2 };
                while i < chars.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            c => {
                out.push(c);
                i += 1;
                continue;
            }
        }
        let gone = &chars[start..i.min(chars.len())];
        out.extend(gone.iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
    }
    out
}

/// Absolute paths of one machine, and settings that redirect package managers. The patterns are
/// joined here, so that this file does not find itself.
fn machine_traces(name: &str, text: &str, found: &mut Findings) {
    let folders = ["home", "root", "work", "Users"].map(|folder| format!("/{folder}/"));
    let settings =
        [["index", "-url"], ["replace", "-with"], ["sparse+", "http"], ["registry", " ="]].map(|p| p.concat());
    for (i, line) in text.lines().enumerate() {
        let begins_a_path = |at: usize| {
            let before = line[..at].chars().next_back();
            before.is_none_or(|c| c.is_whitespace() || "\"'`(=:<,>[".contains(c))
        };
        if folders.iter().any(|folder| line.match_indices(folder.as_str()).any(|(at, _)| begins_a_path(at))) {
            found.faults.push(format!("{name}:{}: an absolute path of one machine", i + 1));
        }
        if settings.iter().any(|setting| line.contains(setting.as_str())) {
            found.faults.push(format!("{name}:{}: a package registry other than the usual one", i + 1));
        }
    }
}

/// Everything in the lock file comes from crates.io.
fn foreign_sources(lock: &str, found: &mut Findings) {
    let source = |line: &&str| line.starts_with("source = ");
    let usual = "\"registry+https://github.com/rust-lang/crates.io-index\"";
    for line in lock.lines().filter(source).filter(|line| !line.ends_with(usual)) {
        found.faults.push(format!("Cargo.lock: {line}: not from crates.io"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(name: &str, text: &str) -> Vec<String> {
        check(name, text).faults
    }

    #[test]
    fn files_open_with_what_they_are() {
        assert!(faults("crates/x/src/a.rs", "//! About a.\nfn a() {}\n").is_empty());
        assert_eq!(faults("crates/x/src/a.rs", "fn a() {}\n").len(), 1);
        assert_eq!(faults("crates/x/src/a.rs", "").len(), 1);
        assert!(faults("notes.md", "fn a() {}\n").is_empty());
    }

    #[test]
    fn long_files_are_warned_of_and_too_long_ones_refused() {
        let file = |lines: usize| format!("//! Long.\n{}", "\n".repeat(lines - 1));
        assert_eq!(check("a.rs", &file(600)), Findings::default());
        assert_eq!((check("a.rs", &file(601)).warnings.len(), check("a.rs", &file(700)).faults.len()), (1, 0));
        assert_eq!(check("a.rs", &file(701)).faults.len(), 1);
    }

    #[test]
    fn unsafe_code_has_its_places_and_its_reasons() {
        let bare = "//! X.\nfn f() {\n    unsafe { g() }\n}\n";
        let reasoned = "//! X.\nfn f() {\n    // SAFETY: g is fine.\n    unsafe { g() }\n}\n";
        let documented = "//! X.\n/// F.\n///\n/// # Safety\n/// AVX2.\n#[inline]\nunsafe fn f() {}\n";
        assert_eq!(
            faults("crates/film/src/a.rs", reasoned),
            ["crates/film/src/a.rs:4: unsafe code; only bvh, denoise and capi may have it"]
        );
        assert_eq!(faults("crates/bvh/src/a.rs", bare).len(), 1);
        assert!(faults("crates/bvh/src/a.rs", reasoned).is_empty());
        assert!(faults("crates/denoise/src/a.rs", documented).is_empty());
        let stale = "//! X.\n// SAFETY: of something else.\n\nfn f() {\n    unsafe { g() }\n}\n";
        assert_eq!(faults("crates/bvh/src/a.rs", stale).len(), 1);
    }

    #[test]
    fn files_are_opened_in_one_place_and_in_tests() {
        let bare = "//! X.\nfn f() {\n    let a = std::fs::read(p);\n}\n";
        assert_eq!(faults("crates/io/src/formats/exr.rs", bare).len(), 1);
        assert_eq!(faults("crates/dunkelfeld/src/a.rs", "//! X.\nuse std::fs::{read, write};\n").len(), 1);
        assert_eq!(faults("crates/io/src/a.rs", "//! X.\nfn f() { fs::File::open(p); fs::read_dir(p); }\n").len(), 1);
        for elsewhere in
            ["crates/io/src/files/input.rs", "crates/io/tests/a.rs", "tests/a.rs", "crates/testkit/src/a.rs"]
        {
            assert!(faults(elsewhere, bare).is_empty(), "{elsewhere}");
        }
        let tested = "//! X.\n// File::open\n#[cfg(test)]\nmod tests {\n    fn f() { fs::read(p); }\n}\n";
        assert!(faults("crates/io/src/formats/exr.rs", tested).is_empty());
    }

    #[test]
    fn crate_roots_forbid_unsafe_code() {
        assert!(faults("crates/film/src/lib.rs", "//! X.\n#![forbid(unsafe_code)]\n").is_empty());
        assert_eq!(faults("crates/film/src/lib.rs", "//! X.\n").len(), 1);
        assert_eq!(faults("crates/cli/src/main.rs", "//! X.\n// #![forbid(unsafe_code)]\n").len(), 1);
        assert!(faults("crates/bvh/src/lib.rs", "//! X.\n").is_empty());
    }

    #[test]
    fn words_in_comments_and_strings_are_not_code() {
        let text = "//! On unsafe code.\n/* unsafe /* nested unsafe */ unsafe */\nconst A: &str = \"unsafe \\\" unsafe\";\n\
                    const B: &str = r#\"unsafe \" unsafe\"#;\nconst C: char = '\"';\nfn f<'a>(x: &'a str) {}\n\
                    const D: char = '\\'';\nconst E: &str = \"unsafe\nunsafe\";\n";
        assert_eq!(faults("crates/film/src/a.rs", text), Vec::<String>::new());
        assert_eq!(without_comments_and_strings(text).lines().count(), text.lines().count());
        let code = format!("{text}fn g() {{ unsafe {{ f() }} }}\n");
        assert_eq!(faults("crates/film/src/a.rs", &code).len(), 1);
        assert!(
            faults("crates/film/src/a.rs", "//! X.\nfn unsafe_looking(r: u8, raw: u8) -> u8 { r#fn(r) }\n").is_empty()
        );
    }

    #[test]
    fn traces_of_a_machine_are_found() {
        for folder in ["home", "root", "work", "Users"] {
            assert_eq!(faults("a.md", &format!("see /{folder}/me/file")).len(), 1, "{folder}");
            assert_eq!(faults("a.toml", &format!("path = \"/{folder}/me\"")).len(), 1, "{folder}");
            assert!(faults("a.md", &format!("https://example.com/{folder}/page and crates/{folder}/src")).is_empty());
        }
        assert_eq!(faults("pip.conf", &format!("index{} = https://example.com", "-url")).len(), 1);
    }

    #[test]
    fn the_lock_file_has_one_source() {
        let usual = "source = \"registry+https://github.com/rust-lang/crates.io-index\"\n";
        assert!(faults("Cargo.lock", usual).is_empty());
        assert_eq!(faults("Cargo.lock", "source = \"git+https://example.com/x\"\n").len(), 1);
    }
}
