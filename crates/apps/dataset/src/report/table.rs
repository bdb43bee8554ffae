//! Tables of the page.

use dunkelfeld_report::page::{self, Heading};
use maud::{Markup, Render, html};

/// A table of this many columns extends across the whole page. Fewer columns would be hard to read.
const WIDE: usize = 6;

/// A table with its name, its headings with their units, and its rows in HTML. The first column has text, the others have
/// numbers.
pub(crate) fn table(name: &str, headings: &[(&str, &str)], rows: impl Render) -> Markup {
    let headings = headings.iter().enumerate().map(|(i, &(text, unit))| Heading {
        text,
        unit,
        class: if i > 0 { "n" } else { "" },
    });
    html! { div.slim[headings.len() < WIDE] { (page::table(name, headings, rows)) } }
}
