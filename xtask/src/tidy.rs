//! `cargo xtask tidy`: the rules of the repository that a compiler does not check.
//!
//! The allowed dependencies are written once, in the crate table of ARCHITECTURE.md; the check reads them from there, so that the
//! page cannot drift from the code. The rules themselves are pure functions of texts, tested with made-up input; this
//! file gathers the real input and prints what they find.

mod arrows;
mod citations;
mod import_cycles;
mod module_tree;
mod paths;
mod prose;
mod sample_table;
mod sources;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Largest file that may be tracked.
const MAX_BYTES: u64 = 2 * 1024 * 1024;

/// Checks everything.
///
/// # Errors
/// A list of all violations, one per line.
pub(crate) fn run() -> Result<(), String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let metadata = output(Command::new(cargo).args(["metadata", "--format-version", "1", "--no-deps", "--offline"]))?;
    let metadata: serde_json::Value =
        serde_json::from_str(&metadata).map_err(|e| format!("cargo metadata cannot be read: {e}"))?;
    let root = metadata["workspace_root"].as_str().ok_or("cargo metadata names no workspace")?;
    let root = PathBuf::from(root);

    let mut faults = Vec::new();
    let architecture = read(&root, "ARCHITECTURE.md")?;
    faults.extend(arrows::check(&architecture, &arrows::packages(&metadata)?));
    faults.extend(paths::check(&architecture, |path| root.join(path).exists()));
    faults.extend(sample_table::check(&architecture, |path| root.join(path).is_file()));

    let bibliography = read(&root, citations::BIBLIOGRAPHY)?;
    let tracked = output(Command::new("git").arg("-C").arg(&root).args(["ls-files", "-z"]))?;
    let mut files = 0;
    let mut crates: BTreeMap<String, Vec<(String, String)>> = BTreeMap::new();
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
        let found = sources::check(name, &text);
        for warning in found.warnings {
            println!("warning: {warning}");
        }
        faults.extend(found.faults);
        faults.extend(prose::check(name, &text));
        faults.extend(citations::check(name, &citations::cited(name, &text), &bibliography));
        if let Some((folder, path)) = name.split_once("/src/").filter(|(_, path)| path.ends_with(".rs")) {
            crates.entry(folder.to_owned()).or_default().push((path.to_owned(), text));
        }
    }
    faults.extend(crates.iter().flat_map(|(folder, files)| import_cycles::check(folder, files)));
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
