//! The table of hard cases in `docs/numerics.md` against the code: every test that it names exists, and every test of these
//! families is named.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The names of the tests in a file.
fn tests(path: &str) -> BTreeSet<String> {
    let text = read(path);
    let after = text.split("#[test]").skip(1);
    after
        .filter_map(|rest| {
            let name = rest.split_once("fn ")?.1;
            Some(name.split('(').next()?.to_owned())
        })
        .collect()
}

/// The last column of every row: the names between backticks, as file and test.
fn named() -> Vec<(String, String)> {
    let page = read("docs/numerics.md");
    let rows = page.lines().filter(|l| l.starts_with("| ") && !l.starts_with("| case"));
    let cells = rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        assert_eq!(cells.len(), 3, "a row of three cells: {row}");
        cells[2].to_owned()
    });
    cells
        .flat_map(|cell| {
            let names: Vec<(String, String)> = cell
                .split('`')
                .skip(1)
                .step_by(2)
                .map(|name| {
                    let (place, test) = name.rsplit_once("::").unwrap_or_else(|| panic!("`{name}` names no test"));
                    let file = if place.ends_with(".rs") {
                        place.into()
                    } else {
                        format!("tests/facade/hard_cases/{place}.rs")
                    };
                    (file, test.to_owned())
                })
                .collect();
            assert!(!names.is_empty(), "nothing checks: {cell}");
            names
        })
        .collect()
}

#[test]
fn every_row_names_tests_that_exist_and_every_hard_case_has_its_row() {
    let named = named();
    assert!(named.len() > 60, "rows are read");
    for (file, test) in &named {
        assert!(tests(file).contains(test), "docs/numerics.md names {test}, which is no test of {file}");
    }
    let modules = read("tests/facade/hard_cases/mod.rs");
    let modules = modules.lines().filter_map(|l| l.strip_prefix("mod ")?.strip_suffix(';'));
    for module in modules.filter(|m| !["support", "table"].contains(m)) {
        let file = format!("tests/facade/hard_cases/{module}.rs");
        for test in tests(&file) {
            assert!(named.contains(&(file.clone(), test.clone())), "docs/numerics.md has no row for {module}::{test}");
        }
    }
}
