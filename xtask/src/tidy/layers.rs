//! The layers: each crate uses only the crates that its row in `ARCHITECTURE.md` lists.

use serde_json::Value;
use std::collections::BTreeMap;

/// Dependencies that no crate of the engine or the camera may have, but for `render`, which opens its checkpoints.
const READERS: [&str; 4] = ["dunkelfeld-files", "dunkelfeld-io", "serde_json", "toml"];

/// A row of the table: the folder of a crate in `crates/`, its level, and the crates that it may use; `None` for all of lower levels.
struct Row<'a> {
    place: &'a str,
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
        let place = format!("crates/{}/Cargo.toml", row.place);
        if !package["manifest_path"].as_str().is_some_and(|path| path.ends_with(&place)) {
            faults.push(format!("`{folder}` is not at {place}, as its row in ARCHITECTURE.md says"));
        }
        let is_below_files = row.place.starts_with("engine/") || row.place.starts_with("camera/");
        // Dependencies of tests and of build scripts have a kind.
        let used = package["dependencies"].as_array().into_iter().flatten().filter(|d| d["kind"].is_null());
        for name in used.filter_map(|d| d["name"].as_str()) {
            if is_below_files && folder != "render" && READERS.contains(&name) {
                faults.push(format!("`{folder}` uses `{name}`; it parses no text and opens no file"));
            }
            let Some(other) = folder_of(name) else { continue };
            let is_lower = rows.get(other).is_some_and(|o| o.level < row.level);
            if !is_lower || row.uses.as_ref().is_some_and(|uses| !uses.contains(&other)) {
                faults.push(format!("`{folder}` uses `{name}`, which its row in ARCHITECTURE.md does not allow"));
            }
        }
    }
    Ok(faults)
}

/// The last part of the folder of a crate of the workspace.
fn folder_of(name: &str) -> Option<&str> {
    if name == "dunkelfeld" { Some(name) } else { name.strip_prefix("dunkelfeld-") }
}

/// The rows of the table by the last part of the folder. Its columns are level, folder, purpose, no part in, may use.
fn rows(page: &str) -> BTreeMap<&str, Row<'_>> {
    page.lines().filter_map(row).collect()
}

fn row(line: &str) -> Option<(&str, Row<'_>)> {
    let cells: Vec<&str> = line.split('|').map(str::trim).collect();
    let [_, level, place, _, _, uses, _] = cells[..] else { return None };
    let place = place.trim_matches('`');
    let uses = (uses != "all above").then(|| uses.split(", ").collect());
    Some((place.rsplit('/').next()?, Row { place, level: level.parse().ok()?, uses }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "| level | folder | purpose | no part in | may use |\n|---|---|---|---|---|\n\
        | 0 | `engine/film` | x | y | - |\n| 1 | `job/io` | x | y | film |\n| 2 | `dunkelfeld` | x | y | all above |\n";

    fn faults(place: &str, used: &str, kind: &str) -> usize {
        let name = place.rsplit('/').next().expect("a folder");
        let name = if name == "dunkelfeld" { name.to_owned() } else { format!("dunkelfeld-{name}") };
        let package = format!(
            r#"{{"name": "{name}", "manifest_path": "/a/crates/{place}/Cargo.toml",
                "dependencies": [{{"name": "{used}", "kind": {kind}}}]}}"#
        );
        check(PAGE, &format!(r#"{{"packages": [{package}]}}"#)).expect("JSON").len()
    }

    #[test]
    fn a_crate_uses_only_those_of_its_row() {
        assert_eq!(faults("job/io", "dunkelfeld-film", "null"), 0);
        assert_eq!(faults("dunkelfeld", "dunkelfeld-io", "null"), 0);
        assert_eq!(faults("job/io", "dunkelfeld", "null"), 1);
        assert_eq!(faults("job/io", "dunkelfeld", "\"dev\""), 0);
        assert_eq!(faults("engine/film", "dunkelfeld-io", "null"), 2, "a reader, and not in its row");
        assert_eq!(faults("engine/film", "toml", "null"), 1);
        assert_eq!(faults("apps/film", "dunkelfeld-lanes", "null"), 2, "another folder, and not in its row");
    }
}
