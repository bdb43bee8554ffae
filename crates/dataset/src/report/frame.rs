//! The frame of the page: it needs no other file, with no script, style, font or picture from other sources.

use super::chart::{Chart, PALETTE, STYLE, finished};
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

const CSS: &str = include_str!("page.css");
const JS: &str = include_str!("page.js");
/// The content security policy of the page: a browser loads nothing from other sources.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// A page of sections.
pub(crate) fn frame(title: &str, sections: &[Markup]) -> String {
    finished(html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content={ "dunkelfeld " (env!("CARGO_PKG_VERSION")) };
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

/// Charts side by side. Empty if there are none.
pub(crate) fn charts<'a>(charts: impl IntoIterator<Item = &'a Chart>) -> Markup {
    let mut charts = charts.into_iter().peekable();
    html! { @if charts.peek().is_some() { div.charts { @for chart in charts { figure { (chart) } } } } }
}

/// A table with its name, its headings, and its rows in HTML. The first column has text, the others have numbers.
pub(crate) fn table(name: &str, headings: &[(&str, &str)], rows: impl Render) -> Markup {
    html! {
        // A table of few columns across the whole page is hard to read.
        div.scroll.slim[headings.len() < 6] {
            table id={ "table-" (name) } {
                thead {
                    tr {
                        @for (i, (heading, unit)) in headings.iter().enumerate() {
                            th.n[i > 0] scope="col" { (heading) @if !unit.is_empty() { " " small { (unit) } } }
                        }
                    }
                }
                tbody { (rows) }
            }
        }
    }
}
