//! The frame of a report: one page that needs no other file, with no script, style, font or picture from other sources.

use super::chart::{PALETTE, STYLE, escape};
use super::maps::{self, Map};

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

/// A page of sections, which are HTML already; the title is text.
pub(crate) fn page(title: &str, sections: &[String]) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"generator\" content=\"{GENERATOR}{VERSION}\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"/>\n<title>{}</title>\n\
         <style>\n{PALETTE}{CSS}{STYLE}</style>\n</head>\n<body>\n{}\n<script>\n{JS}</script>\n</body>\n</html>\n",
        escape(title),
        sections.join("\n")
    )
}

/// The head of a page: its heading, a line of facts, and the button that changes between light and dark. All arguments
/// are text.
pub(crate) fn head(heading: &str, facts: &str) -> String {
    format!(
        "<header><div><h1>{}</h1><p>{}</p></div>\
         <button id=\"theme\" type=\"button\">light / dark</button></header>",
        escape(heading),
        escape(facts)
    )
}

/// The main findings: a figure and its description, as text. Empty if there are none.
pub(crate) fn tiles(tiles: &[(String, String)]) -> String {
    let one = |(figure, words): &(String, String)| {
        format!("<div class=\"tile\"><b>{}</b><span>{}</span></div>", escape(figure), escape(words))
    };
    let all: String = tiles.iter().map(one).collect();
    if all.is_empty() { all } else { format!("<div class=\"tiles\">{all}</div>") }
}

/// A map with its scale and its caption.
pub(crate) fn map_figure(map: &Map) -> String {
    format!(
        "<figure><img src=\"{}\" alt=\"{caption}\" width=\"{}\" height=\"{}\"/><div class=\"scale\" style=\"background:{}\"></div>\
         <div class=\"ends\"><span>{}</span><span>{}</span></div><figcaption>{caption}</figcaption></figure>",
        map.uri,
        map.size[0],
        map.size[1],
        maps::gradient(map.is_signed),
        escape(&map.ends[0]),
        escape(&map.ends[1]),
        caption = escape(&map.caption)
    )
}
