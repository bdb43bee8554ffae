//! The layers: each crate uses only the crates that its row in `ARCHITECTURE.md` lists.

use serde_json::Value;
use std::collections::BTreeMap;

/// Crates of the engine and of the camera, which parse no text. Of them only `render` opens files: its checkpoints.
const BELOW_FILES: [&str; 13] = [
    "lanes",
    "geometry",
    "sampling",
    "radiometry",
    "bvh",
    "bsdf",
    "film",
    "scene",
    "adaptive",
    "denoise",
    "sensor",
    "emva1288",
    "integrator",
];
/// Dependencies that no crate of the engine or the camera may have.
const READERS: [&str; 4] = ["dunkelfeld-files", "dunkelfeld-io", "serde_json", "toml"];

/// A row of the table: the level of a crate, and the crates that it may use; `None` for all of lower levels.
struct Row<'a> {
    level: u32,
    uses: Option<Vec<&'a str>>,
}

/// The crates that use another crate than those of their row. `metadata` is the output of `cargo metadata`.
pub(crate) fn check(page: &str, metadata: &str) -> Result<Vec<String>, String> {
    let metadata: Value = serde_json::from_str(metadata).map_err(|e| format!("cargo metadata: {e}"))?;
    let rows = rows(page);
    let mut faults = Vec::new();
    for package in metadata["packages"].as_array().into_iter().flatten() {
        let Some(folder) = package["name"].as_str().and_then(folder_of) else { continue };
        let Some(row) = rows.get(folder) else { continue };
        // Dependencies of tests and of build scripts have a kind.
        let used = package["dependencies"].as_array().into_iter().flatten().filter(|d| d["kind"].is_null());
        for name in used.filter_map(|d| d["name"].as_str()) {
            if BELOW_FILES.contains(&folder) && READERS.contains(&name) {
                faults.push(format!("crates/{folder} uses `{name}`; it parses no text and opens no file"));
            }
            let Some(other) = folder_of(name) else { continue };
            let is_lower = rows.get(other).is_some_and(|o| o.level < row.level);
            if !is_lower || row.uses.as_ref().is_some_and(|uses| !uses.contains(&other)) {
                faults.push(format!("crates/{folder} uses `{name}`, which its row in ARCHITECTURE.md does not allow"));
            }
        }
    }
    Ok(faults)
}

/// The folder of a crate of the workspace.
fn folder_of(name: &str) -> Option<&str> {
    if name == "dunkelfeld" { Some(name) } else { name.strip_prefix("dunkelfeld-") }
}

/// The rows of the table by folder. Its columns are level, folder, purpose, no part in, may use.
fn rows(page: &str) -> BTreeMap<&str, Row<'_>> {
    page.lines().filter_map(row).collect()
}

fn row(line: &str) -> Option<(&str, Row<'_>)> {
    let cells: Vec<&str> = line.split('|').map(str::trim).collect();
    let [_, level, folder, _, _, uses, _] = cells[..] else { return None };
    let uses = (uses != "all above").then(|| uses.split(", ").collect());
    Some((folder.trim_matches('`'), Row { level: level.parse().ok()?, uses }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "| level | folder | purpose | no part in | may use |\n|---|---|---|---|---|\n\
        | 0 | `film` | x | y | - |\n| 1 | `io` | x | y | film |\n| 2 | `dunkelfeld` | x | y | all above |\n";

    fn faults(name: &str, used: &str, kind: &str) -> usize {
        let package = format!(r#"{{"name": "{name}", "dependencies": [{{"name": "{used}", "kind": {kind}}}]}}"#);
        check(PAGE, &format!(r#"{{"packages": [{package}]}}"#)).expect("JSON").len()
    }

    #[test]
    fn a_crate_uses_only_those_of_its_row() {
        assert_eq!(faults("dunkelfeld-io", "dunkelfeld-film", "null"), 0);
        assert_eq!(faults("dunkelfeld", "dunkelfeld-io", "null"), 0);
        assert_eq!(faults("dunkelfeld-io", "dunkelfeld", "null"), 1);
        assert_eq!(faults("dunkelfeld-io", "dunkelfeld", "\"dev\""), 0);
        assert_eq!(faults("dunkelfeld-film", "dunkelfeld-io", "null"), 2, "a reader, and not in its row");
        assert_eq!(faults("dunkelfeld-film", "toml", "null"), 1);
    }
}
