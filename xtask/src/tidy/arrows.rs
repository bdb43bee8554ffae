//! Dependencies between crates: the crate table of ARCHITECTURE.md against the manifests.

use std::collections::BTreeMap;

use serde_json::Value;

/// Third-party crates that belong to certain folders only.
const HOMES: [(&str, &[&str]); 27] = [
    ("axum", &["view"]),
    ("hyper-util", &["view"]),
    ("tokio", &["view"]),
    ("tokio-stream", &["view"]),
    ("thread-priority", &["render"]),
    ("rayon", &["render", "dunkelfeld", "studies", "bvh", "dataset", "io", "sensor"]),
    ("obvhs", &["bvh"]),
    ("rustc-hash", &["geometry", "integrator"]),
    ("maud", &["report", "studies", "dataset"]),
    ("annotate-snippets", &["io"]),
    ("clap", &["cli"]),
    ("ctrlc", &["cli"]),
    ("indicatif", &["cli"]),
    ("image", &["dataset", "io"]),
    ("gltf", &["io"]),
    ("tobj", &["io"]),
    ("stl_io", &["io"]),
    ("ply-rs-bw", &["io"]),
    ("exr", &["io"]),
    ("png", &["io"]),
    ("tiff", &["io"]),
    ("toml", &["dataset", "io", "view"]),
    ("toml_edit", &["dataset"]),
    ("rustix", &["io", "render"]),
    ("signal-hook", &["cli"]),
    ("tempfile", &["io"]),
    ("libloading", &["denoise"]),
];

/// A crate and what it uses outside of its tests and benches.
#[derive(Clone, Debug)]
pub(crate) struct Package {
    name: String,
    /// The folder under `crates/`; none for what lies elsewhere.
    folder: Option<String>,
    uses: Vec<String>,
}

/// Reads the packages from `cargo metadata --no-deps`. Development dependencies are left out: they reach no user.
pub(crate) fn packages(metadata: &Value) -> Result<Vec<Package>, String> {
    let list = metadata["packages"].as_array().ok_or("cargo metadata lists no packages")?;
    let package = |p: &Value| {
        let name = p["name"].as_str()?.to_owned();
        let manifest = p["manifest_path"].as_str()?.replace('\\', "/");
        let folder = manifest.strip_suffix("/Cargo.toml").and_then(|m| {
            let (above, folder) = m.rsplit_once('/')?;
            above.ends_with("/crates").then(|| folder.to_owned())
        });
        let dependencies = p["dependencies"].as_array()?.iter();
        let uses = dependencies.filter(|d| d["kind"].as_str() != Some("dev"));
        let uses = uses.filter_map(|d| d["name"].as_str().map(str::to_owned)).collect();
        Some(Package { name, folder, uses })
    };
    list.iter().map(|p| package(p).ok_or_else(|| "cargo metadata has an odd package".to_owned())).collect()
}

/// A row of the crate table: the level, and which folders may be used.
#[derive(Debug, PartialEq)]
struct Row {
    level: Option<u32>,
    may_use: Vec<String>,
}

/// Reads the rows `| level | `folder` | what | may use |` of the table with that head. `all above` stands for every folder
/// of a lower level.
fn table(architecture: &str) -> BTreeMap<String, Row> {
    let mut rows = BTreeMap::new();
    let mut inside = false;
    for line in architecture.lines() {
        let cells: Vec<&str> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
        inside = line.starts_with('|') && (inside || cells[..2.min(cells.len())] == ["level", "folder"]);
        if !inside {
            continue;
        }
        let [level, folder, .., may_use] = cells[..] else { continue };
        let Some(folder) = folder.strip_prefix('`').and_then(|f| f.strip_suffix('`')) else { continue };
        // A crate outside of the levels, for tests only, has a dash.
        let level = match level.parse() {
            Ok(level) => Some(level),
            Err(_) if level == "-" => None,
            Err(_) => continue,
        };
        let may_use = may_use.split(',').map(|n| n.trim().trim_matches('`').to_owned());
        rows.insert(folder.to_owned(), Row { level, may_use: may_use.filter(|n| !n.is_empty() && n != "-").collect() });
    }
    let below = |level: Option<u32>| -> Vec<String> {
        rows.iter().filter(|(_, r)| r.level.is_some() && r.level < level).map(|(f, _)| f.clone()).collect()
    };
    let expanded: Vec<_> =
        rows.iter().filter(|(_, r)| r.may_use == ["all above"]).map(|(f, r)| (f.clone(), below(r.level))).collect();
    for (folder, may_use) in expanded {
        if let Some(row) = rows.get_mut(&folder) {
            row.may_use = may_use;
        }
    }
    rows
}

/// All violations of the table and of [`HOMES`].
pub(crate) fn check(architecture: &str, packages: &[Package]) -> Vec<String> {
    let rows = table(architecture);
    let mut faults = Vec::new();
    for (folder, row) in &rows {
        for used in &row.may_use {
            let Some(other) = rows.get(used) else {
                faults.push(format!("ARCHITECTURE.md: `{folder}` may use `{used}`, which has no row in the table"));
                continue;
            };
            if other.level.is_none() || other.level >= row.level {
                faults.push(format!("ARCHITECTURE.md: `{folder}` may use `{used}`, which does not stand above it"));
            }
        }
        if !packages.iter().any(|p| p.folder.as_deref() == Some(folder)) {
            faults.push(format!("ARCHITECTURE.md: there is no crates/{folder}"));
        }
    }
    if rows.get("emva1288").is_some_and(|r| r.may_use.iter().any(|u| u == "sensor")) {
        faults.push(
            "ARCHITECTURE.md: `emva1288` never uses `sensor`: the one must be able to check the other".to_owned(),
        );
    }
    let folder_of = |name: &str| packages.iter().find(|p| p.name == name).and_then(|p| p.folder.as_deref());
    for package in packages {
        // Crates outside of crates/ are for developers. No crate depends on them.
        let Some(folder) = package.folder.as_deref() else { continue };
        let Some(row) = rows.get(folder) else {
            faults.push(format!("crates/{folder}: has no row in the crate table of ARCHITECTURE.md"));
            continue;
        };
        let expected = if folder == "dunkelfeld" { folder.to_owned() } else { format!("dunkelfeld-{folder}") };
        if package.name != expected {
            faults.push(format!("crates/{folder}: is called {}, not {expected}", package.name));
        }
        for used in &package.uses {
            if let Some(other) = folder_of(used) {
                if !row.may_use.iter().any(|m| m == other) {
                    faults.push(format!(
                        "crates/{folder}: uses `{other}`, which the table of ARCHITECTURE.md does not allow"
                    ));
                }
            } else if let Some((_, homes)) = HOMES.iter().find(|(name, _)| name == used)
                && !homes.contains(&folder)
            {
                faults.push(format!("crates/{folder}: uses {used}, which belongs in {} only", homes.join(", ")));
            }
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "
| level | folder | what lives there | may use |
|---|---|---|---|
| 0 | `geometry` | shapes | - |
| 1 | `bvh` | boxes | geometry |
| 2 | `sensor` | a camera | `geometry` |
| 2 | `emva1288` | its judge | geometry |
| 3 | `dunkelfeld` | everything | all above |
| 4 | `cli` | words | dunkelfeld |
| - | `testkit` | tests | - |

| 1 | `x` | a table | of another kind |
";

    fn package(folder: &str, uses: &[&str]) -> Package {
        let name = if folder == "dunkelfeld" { folder.to_owned() } else { format!("dunkelfeld-{folder}") };
        Package { name, folder: Some(folder.to_owned()), uses: uses.iter().map(|&u| u.to_owned()).collect() }
    }

    fn good() -> Vec<Package> {
        vec![
            package("geometry", &["glam"]),
            package("bvh", &["dunkelfeld-geometry", "obvhs", "rayon"]),
            package("sensor", &["dunkelfeld-geometry"]),
            package("emva1288", &[]),
            package("dunkelfeld", &["dunkelfeld-bvh", "dunkelfeld-sensor", "rayon"]),
            package("cli", &["dunkelfeld", "clap"]),
            package("testkit", &["statrs"]),
            Package { name: "xtask".into(), folder: None, uses: vec!["png".into(), "dunkelfeld-cli".into()] },
        ]
    }

    /// The faults after one crate was replaced.
    fn with(changed: Package) -> Vec<String> {
        let mut all = good();
        all.retain(|p| p.folder != changed.folder);
        all.push(changed);
        check(TABLE, &all)
    }

    #[test]
    fn a_workspace_that_follows_the_table_is_accepted() {
        assert_eq!(check(TABLE, &good()), Vec::<String>::new());
    }

    #[test]
    fn arrows_that_the_table_lacks_are_named() {
        let faults = with(package("emva1288", &["dunkelfeld-sensor"]));
        assert_eq!(faults, ["crates/emva1288: uses `sensor`, which the table of ARCHITECTURE.md does not allow"]);
        assert_eq!(with(package("cli", &["dunkelfeld", "dunkelfeld-bvh"])).len(), 1);
        assert_eq!(with(package("dunkelfeld", &["dunkelfeld-testkit"])).len(), 1, "testkit is for tests only");
    }

    #[test]
    fn third_party_crates_stay_at_home() {
        let faults = with(package("geometry", &["rayon"]));
        assert_eq!(
            faults,
            [
                "crates/geometry: uses rayon, which belongs in render, dunkelfeld, studies, bvh, dataset, io, sensor only"
            ]
        );
        assert_eq!(with(package("dunkelfeld", &["png", "clap"])).len(), 2);
    }

    #[test]
    fn the_table_itself_must_make_sense() {
        let upward = TABLE.replace("boxes | geometry |", "boxes | dunkelfeld |");
        assert!(check(&upward, &good()).iter().any(|f| f.contains("does not stand above it")));
        let sideways = TABLE.replace("its judge | geometry |", "its judge | sensor |");
        assert!(check(&sideways, &good()).iter().any(|f| f.contains("never uses")));
        let missing = TABLE.replace("| 2 | `sensor` | a camera | `geometry` |\n", "");
        let faults = check(&missing, &good());
        assert!(
            faults.iter().any(|f| f == "crates/sensor: has no row in the crate table of ARCHITECTURE.md"),
            "{faults:?}"
        );
        let extra = TABLE.replace("| 4 |", "| 1 | `film` | sums | - |\n| 4 |");
        assert!(check(&extra, &good()).iter().any(|f| f == "ARCHITECTURE.md: there is no crates/film"));
    }

    #[test]
    fn folders_name_their_crates() {
        let renamed = Package { name: "sensor".into(), ..package("sensor", &[]) };
        let mut all = good();
        all.retain(|p| p.folder.as_deref() != Some("sensor"));
        all.push(renamed);
        assert!(check(TABLE, &all).contains(&"crates/sensor: is called sensor, not dunkelfeld-sensor".to_owned()));
    }

    #[test]
    fn metadata_is_read_without_development_dependencies() {
        let metadata = serde_json::json!({ "packages": [{
            "name": "dunkelfeld-film",
            "manifest_path": "/somewhere/crates/film/Cargo.toml",
            "dependencies": [
                { "name": "glam", "kind": null },
                { "name": "statrs", "kind": "dev" },
                { "name": "cc", "kind": "build" },
            ],
        }, { "name": "xtask", "manifest_path": "/somewhere/xtask/Cargo.toml", "dependencies": [] }] });
        let read = packages(&metadata).expect("well formed");
        assert_eq!((read[0].folder.as_deref(), read[1].folder.as_deref()), (Some("film"), None));
        assert_eq!(read[0].uses, ["glam", "cc"]);
        assert!(packages(&serde_json::json!({ "packages": [{}] })).is_err());
        assert!(packages(&serde_json::json!({})).is_err());
    }
}
