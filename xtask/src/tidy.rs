//! `cargo xtask tidy`: the rules of the repository that a compiler does not check.
//!
//! The rules are pure functions of texts. This file reads the tracked files and prints the faults.

mod citations;
mod layers;
mod paths;
mod sources;

use std::path::{Path, PathBuf};
use std::process::Command;

/// Largest file that may be tracked.
const MAX_BYTES: u64 = 2 * 1024 * 1024;

/// Checks everything.
///
/// # Errors
/// A list of all violations, one per line.
pub(crate) fn run() -> Result<(), String> {
    let root = PathBuf::from(output(Command::new("git").args(["rev-parse", "--show-toplevel"]))?.trim_end());
    let page = read(&root, "ARCHITECTURE.md")?;
    let mut faults = paths::check(&page, |path| root.join(path).exists());
    let metadata = ["metadata", "--no-deps", "--format-version", "1"];
    faults.extend(layers::check(&page, &output(Command::new("cargo").current_dir(&root).args(metadata))?)?);
    let bibliography = read(&root, citations::BIBLIOGRAPHY)?;
    let tracked = output(Command::new("git").arg("-C").arg(&root).args(["ls-files", "-z"]))?;
    let mut files = 0;
    for name in tracked.split('\0').filter(|n| !n.is_empty()) {
        let path = root.join(name);
        // Deleted in the working tree but still in the index: there is nothing to check.
        let Ok(about) = std::fs::metadata(&path) else { continue };
        files += 1;
        if about.len() > MAX_BYTES {
            faults.push(format!("{name}: {} bytes; tracked files have at most {MAX_BYTES}", about.len()));
        }
        let bytes = std::fs::read(&path).map_err(|e| format!("{name}: {e}"))?;
        let Ok(text) = String::from_utf8(bytes) else { continue };
        if text.contains('\0') {
            continue;
        }
        faults.extend(sources::check(name, &text));
        faults.extend(citations::check(name, &citations::cited(name, &text), &bibliography));
    }
    if faults.is_empty() {
        println!("tidy: {files} files, no faults");
        return Ok(());
    }
    Err(format!("{}\ntidy: {} faults", faults.join("\n"), faults.len()))
}

fn read(root: &Path, name: &str) -> Result<String, String> {
    std::fs::read_to_string(root.join(name)).map_err(|e| format!("{name}: {e}"))
}

fn output(command: &mut Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let result = command.output().map_err(|e| format!("{name} cannot be run: {e}"))?;
    if !result.status.success() {
        return Err(format!("{name} failed: {}", String::from_utf8_lossy(&result.stderr).trim()));
    }
    String::from_utf8(result.stdout).map_err(|_| format!("{name} answered in something that is not UTF-8"))
}
