//! The keys of studies on their page, the shipped study, and cameras of a job that a study changes.

use super::*;
use crate::defects::Defect;
use crate::placement::Placement;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;

/// The keys of a table, as its error about an unknown key lists them.
fn keys<T: DeserializeOwned>() -> BTreeSet<String> {
    let error = toml::from_str::<T>("no-such-key = 1").err().expect("an unknown key").to_string();
    let list = error.split_once("expected one of ").expect("a list").1;
    list.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[test]
fn the_page_has_every_key_and_no_other() {
    let page = include_str!("../../../../docs/datasets.md");
    let section = |title: &str| {
        let from = page.find(&format!("\n{title}\n")).unwrap_or_else(|| panic!("{title}")) + title.len() + 2;
        let end = page[from..].find("\n## ").into_iter().chain(page[from..].find("\n### ")).min();
        &page[from..end.map_or(page.len(), |end| from + end)]
    };
    let listed = |title: &str, header: &str| -> BTreeSet<String> {
        let text = section(title);
        let table = &text[text.find(header).unwrap_or_else(|| panic!("{title}: {header}"))..];
        let rows = table.lines().skip(2).take_while(|line| line.starts_with('|'));
        rows.flat_map(|row| row.split('|').nth(1).unwrap_or("").split('`').skip(1).step_by(2))
            .map(str::to_owned)
            .collect()
    };
    let tables = ["draw", "images", "labels", "label", "place", "defect"].map(str::to_owned);
    let mut study = keys::<StudySettings>();
    tables.iter().for_each(|table| assert!(study.remove(table), "{table}"));
    assert_eq!(listed("## `[study]`", "| key |"), study);
    assert_eq!(listed("### `[study.images]`", "| key |"), keys::<ImageSettings>());
    assert_eq!(listed("### `[study.labels]`", "| key |"), keys::<LabelSettings>());
    assert_eq!(listed("### `[[study.place]]`", "| key |"), keys::<Placement>());
    let kinds = listed("## Defects", "| kind |");
    let mut all: BTreeSet<String> = ["kind", "on", "name", "category", "count"].map(str::to_owned).into();
    for kind in &kinds {
        let row = page.lines().find(|line| line.starts_with(&format!("| `{kind}` |"))).expect("a row");
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let sizes = ["length", "width", "depth"].into_iter().zip(&cells[3..6]).filter(|(_, cell)| **cell != "-");
        let other: Vec<&str> = cells[6].split('`').skip(1).step_by(2).collect();
        let on_page: BTreeSet<&str> = sizes.map(|(key, _)| key).chain(other.iter().copied()).collect();
        // The error about an unknown key lists those of the kind.
        let help = Defect::read(kind, &toml::toml! { no-such-key = 1 }).expect_err("an unknown key").help;
        let known = help.split_once("known keys: ").expect("a list").1;
        assert_eq!(on_page, known.split(", ").filter(|key| *key != "none").collect(), "{kind}");
        all.extend(other.into_iter().map(str::to_owned));
    }
    assert_eq!(listed("## Defects", "| key |"), all);
    assert_eq!(kinds.len(), 15);
    // Each distribution of the page can be read.
    let distributions = section("## Distributions");
    let mut count = 0;
    for line in distributions.lines().filter(|line| line.starts_with("| `{")) {
        let text = line.split('`').nth(1).expect("a table");
        let example = ["mean, deviation", "median, factor"].iter().fold(text.to_owned(), |t, w| t.replace(w, "3, 2"));
        let example = example.replace("[a, b]", "[1, 2]").replace("min = a, max = b", "min = 1, max = 9");
        let example = example.replace("[x, y, z]", "[\"x\", \"y\", \"z\"]").replace("repeat = n", "repeat = 5");
        let mut table: Table = format!("v = {example}").parse().unwrap_or_else(|e| panic!("{example}: {e}"));
        let value = table.remove("v").expect("a value");
        assert!(matches!(Template::parse(value), Ok(Template::Drawn(_))), "{example}");
        count += 1;
    }
    assert_eq!(count, crate::distribution::KINDS.len());
}

#[test]
fn the_shipped_study_is_read() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../scenes/studies/symbols.toml");
    let study = Study::open(path).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    study.check_jobs(20).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    let [a, b] = [0, 1].map(|index| study.job(index).expect("a job"));
    assert_ne!(a.seed, b.seed, "each image has its own device");
    assert_eq!(a, study.job(0).expect("a job"));
    let table: Table = a.text.parse().expect("TOML");
    let lights = table["light"].as_array().expect("lights");
    assert!(lights.iter().all(|light| light["power"] == lights[0]["power"]), "one supply: {lights:?}");
    assert!(table["budget"].get("time").is_none(), "the budget of the study replaces that of the job");
}
