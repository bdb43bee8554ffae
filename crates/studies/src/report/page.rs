//! The page of a study: the frame of all reports, with maps, and tables that are also files.

use super::maps::Map;
use super::table::Table;
use dunkelfeld_report::page::Extra;
use maud::{Markup, html};

/// Pairs of charts, maps, and the comparison of pictures.
const EXTRA: Extra = Extra { style: include_str!("style.css"), script: include_str!("slider.js") };

/// A page of sections.
pub(crate) fn page(title: &str, sections: &[Markup]) -> String {
    dunkelfeld_report::page::page(title, EXTRA, sections)
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
