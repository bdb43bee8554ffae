//! The page of a study: the frame of all reports, with maps, and tables that are also files.

use super::maps::Map;
use super::table::Table;
use dunkelfeld::Error;
use dunkelfeld::outputs::save_text;
use dunkelfeld_report::chart::Chart;
use maud::{Markup, html};
use std::path::{Path, PathBuf};

/// Pairs of charts, and maps.
const STYLE: &str = include_str!("style.css");

/// A page of sections.
pub(crate) fn page(title: &str, sections: &[Markup]) -> String {
    dunkelfeld_report::page::page(title, STYLE, sections)
}

/// Writes a page, tables as CSV and charts into a folder. Returns the files, the page first. Tables and charts are named
/// without ending.
pub(crate) fn write<'a>(
    folder: &Path,
    page: &str,
    tables: impl IntoIterator<Item = (&'static str, String)>,
    charts: impl IntoIterator<Item = &'a Chart>,
) -> Result<Vec<PathBuf>, Error> {
    let page = std::iter::once(("report.html".to_string(), page.to_string()));
    let tables = tables.into_iter().map(|(name, csv)| (format!("{name}.csv"), csv));
    let charts = charts.into_iter().map(|chart| (format!("{}.svg", chart.name), chart.file()));
    let mut files = Vec::new();
    for (name, text) in page.chain(tables).chain(charts) {
        let path = folder.join(name);
        save_text(&path, &text)?;
        files.push(path);
    }
    Ok(files)
}

/// Maps side by side.
pub(crate) fn maps<'a>(maps: impl IntoIterator<Item = &'a Map>) -> Markup {
    html! { div.maps { @for map in maps { (map) } } }
}

/// A table with the name of its file, unless it is empty.
pub(crate) fn with_file(table: &Table) -> Markup {
    html! {
        @if !table.rows.is_empty() {
            (table)
            p.faint { "The same numbers in " code { (table.name) ".csv" } "." }
        }
    }
}
