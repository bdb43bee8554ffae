//! The frame of a report: one page that needs no other file, with no script, style, font or picture from other sources.

use super::chart::{Chart, PALETTE, STYLE, finished};
use super::maps::Map;
use super::table::Table;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const CSS: &str = include_str!("page.css");
const JS: &str = include_str!("page.js");
/// The content security policy of the page: a browser loads nothing from other sources.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The mark of the pages of this program, before its version.
const GENERATOR: &str = "dunkelfeld ";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Does a file begin with the mark of a page of this program?
pub(crate) fn is_page(head: &str) -> bool {
    head.contains(&format!("<meta name=\"generator\" content=\"{GENERATOR}"))
}

/// A page of sections.
pub(crate) fn page(title: &str, sections: &[Markup]) -> String {
    finished(html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content={ (GENERATOR) (VERSION) };
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                title { (title) }
                style { (PreEscaped(PALETTE)) (PreEscaped(CSS)) (PreEscaped(STYLE)) }
            }
            body {
                @for section in sections { (section) }
                script { (PreEscaped(JS)) }
            }
        }
    })
}

/// The head of a page: its heading, a line of facts, and the button that changes between light and dark.
pub(crate) fn head(heading: &str, facts: &str) -> Markup {
    html! {
        header {
            div { h1 { (heading) } p { (facts) } }
            button id="theme" type="button" { "light / dark" }
        }
    }
}

/// The main findings: a figure and its description. Empty if there are none.
pub(crate) fn tiles(tiles: &[(String, String)]) -> Markup {
    html! {
        @if !tiles.is_empty() {
            div.tiles { @for (figure, words) in tiles { div.tile { b { (figure) } span { (words) } } } }
        }
    }
}

/// Names and values, those without a value left out.
pub(crate) fn facts(facts: &[(&str, String)]) -> Markup {
    html! { dl { @for (name, value) in facts.iter().filter(|f| !f.1.is_empty()) { dt { (name) } dd { (value) } } } }
}

/// A picture with its caption.
pub(crate) fn picture(id: Option<&str>, uri: &str, [width, height]: [u32; 2], caption: &str) -> Markup {
    html! {
        figure {
            img id=[id] src=(uri) alt=(caption) width=(width) height=(height);
            figcaption { (caption) }
        }
    }
}

/// Charts side by side.
pub(crate) fn charts<'a>(charts: impl IntoIterator<Item = &'a Chart>) -> Markup {
    html! { div.charts { @for chart in charts { figure { (chart) } } } }
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
