//! The frame of a report: one page that needs no other file, with no script, style, font or picture from other sources.

use crate::chart::{Chart, PALETTE, STYLE, finished};
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

const CSS: &str = include_str!("page.css");
const JS: &str = include_str!("page.js");
/// The content security policy of the page: a browser loads nothing from other sources.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The mark of the pages of this program, before its version.
const GENERATOR: &str = "dunkelfeld ";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Does a file begin with the mark of a page of this program? `head` is its first part.
pub fn is_page(head: &str) -> bool {
    head.contains(&format!("<meta name=\"generator\" content=\"{GENERATOR}"))
}

/// A page of sections, as HTML. `style` has the rules of CSS of one kind of report, which replace earlier rules of the same
/// specificity. It is a part of the program and not escaped.
pub fn page(title: &str, style: &'static str, sections: &[Markup]) -> String {
    finished(html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content={ (GENERATOR) (VERSION) };
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                title { (title) }
                style { (PreEscaped(PALETTE)) (PreEscaped(CSS)) (PreEscaped(STYLE)) (PreEscaped(style)) }
            }
            body {
                @for section in sections { (section) }
                script { (PreEscaped(JS)) }
            }
        }
    })
}

/// The head of a page: its heading, a line of facts, and the button that changes between light and dark.
pub fn head(heading: &str, facts: &str) -> Markup {
    html! {
        header {
            div { h1 { (heading) } p { (facts) } }
            button id="theme" type="button" { "light / dark" }
        }
    }
}

/// The main findings: a figure and its description. Empty if there are none.
pub fn tiles(tiles: &[(String, String)]) -> Markup {
    html! {
        @if !tiles.is_empty() {
            div.tiles { @for (figure, words) in tiles { div.tile { b { (figure) } span { (words) } } } }
        }
    }
}

/// Names and values, those without a value left out.
pub fn facts(facts: &[(&str, String)]) -> Markup {
    html! { dl { @for (name, value) in facts.iter().filter(|f| !f.1.is_empty()) { dt { (name) } dd { (value) } } } }
}

/// A picture with its size \[px\] and its caption. `uri` is the address of an image, which contains its data.
pub fn picture(uri: &str, [width, height]: [u32; 2], caption: &str) -> Markup {
    html! {
        figure {
            img src=(uri) alt=(caption) width=(width) height=(height);
            figcaption { (caption) }
        }
    }
}

/// Charts side by side. Empty if there are none.
pub fn charts<'a>(charts: impl IntoIterator<Item = &'a Chart>) -> Markup {
    let mut charts = charts.into_iter().peekable();
    html! { @if charts.peek().is_some() { div.charts { @for chart in charts { figure { (chart) } } } } }
}

/// The heading of a column of a table.
#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    /// Its text.
    pub text: &'a str,
    /// The unit below the text. Empty for none.
    pub unit: &'a str,
    /// Its class for the style sheet of the report. Empty for none.
    pub class: &'a str,
}

impl<'a> Heading<'a> {
    /// A heading without a unit and without a class.
    pub const fn of(text: &'a str) -> Self {
        Self { text, unit: "", class: "" }
    }
}

impl Render for Heading<'_> {
    fn render(&self) -> Markup {
        let class = (!self.class.is_empty()).then_some(self.class);
        html! { th class=[class] scope="col" { (self.text) @if !self.unit.is_empty() { " " small { (self.unit) } } } }
    }
}

/// A table with its name, its headings, and its rows in HTML. A narrow page scrolls it sideways.
pub fn table<'a>(name: &str, headings: impl IntoIterator<Item = Heading<'a>>, rows: impl Render) -> Markup {
    html! {
        div.scroll {
            table id={ "table-" (name) } {
                thead { tr { @for heading in headings { (heading) } } }
                tbody { (rows) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_have_the_mark_of_the_program_and_their_own_style_last() {
        let style = ".own { color: red; }";
        let text = page("a <b>\u{fffe}", style, &[head("h & h", "facts")]);
        assert!(is_page(&text) && !is_page("<meta name=\"generator\" content=\"another program\">"));
        assert!(text.contains("<title>a &lt;b&gt;</title>") && text.contains(POLICY) && text.contains("h &amp; h"));
        // Rules of the report replace those of all reports.
        assert!(text.contains(&format!("{STYLE}{style}</style>")));
        assert_eq!(text.matches("<script").count(), 1);
        assert!(text.contains(&format!("{JS}</script>")));
    }
}
