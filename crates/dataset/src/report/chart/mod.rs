//! Charts as SVG: small, without a library, for a page that contains their styles.

pub(crate) mod bars;
pub(crate) mod counts;
mod scale;

pub(crate) use scale::{label, power_of_ten};

use maud::{Markup, PreEscaped, Render, html};

/// Colours of the page and of the charts, for light and dark surroundings.
pub(crate) const PALETTE: &str = include_str!("../palette.css");
/// Styles of the parts of a chart.
pub(crate) const STYLE: &str = include_str!("../chart.css");
/// Number of colours of the palette for series.
pub(crate) const COLORS: usize = 6;

/// A finished chart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Description as text, for screen readers.
    pub(crate) title: String,
    width: f64,
    height: f64,
    body: String,
}

impl Chart {
    /// An empty chart with its width and height [px].
    pub(crate) fn new(title: &str, width: f64, height: f64) -> Self {
        Self { title: title.into(), width, height, body: String::new() }
    }

    fn add(&mut self, element: Markup) {
        self.body += &element.into_string();
    }

    fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let [[x1, y1], [x2, y2]] = [from, to].map(|end| end.map(tenths));
        self.add(html! { line class=(class) x1=(x1) y1=(y1) x2=(x2) y2=(y2) {} });
    }

    fn rect(&mut self, class: &str, at: [f64; 2], size: [f64; 2], hint: &str) {
        let [[x, y], [w, h]] = [at, size].map(|pair| pair.map(tenths));
        self.add(html! {
            rect class=(class) x=(x) y=(y) width=(w) height=(h) { @if !hint.is_empty() { title { (hint) } } }
        });
    }

    /// Text with its anchor: `start`, `middle` or `end`.
    fn text(&mut self, class: &str, at: [f64; 2], anchor: &str, text: &str) {
        let [x, y] = at.map(tenths);
        self.add(html! { text class=(class) x=(x) y=(y) text-anchor=(anchor) { (text) } });
    }
}

/// The chart as part of a page that contains the styles.
impl Render for Chart {
    fn render(&self) -> Markup {
        html! {
            svg class="chart" viewBox={ "0 0 " (self.width) " " (self.height) } role="img" aria-label=(self.title) {
                (PreEscaped(&self.body))
            }
        }
    }
}

fn tenths(v: f64) -> String {
    format!("{v:.1}")
}

/// A text with at most `longest` characters. An ellipsis replaces the rest.
pub(crate) fn shortened(text: &str, longest: usize) -> String {
    match text.char_indices().nth(longest) {
        None => text.into(),
        Some(_) => text.chars().take(longest.saturating_sub(1)).chain(['\u{2026}']).collect(),
    }
}

/// The text of a page or a chart. Control characters of names, which neither HTML nor XML allows, are left out.
pub(crate) fn finished(markup: Markup) -> String {
    let is_bad = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{fffe}' | '\u{ffff}');
    markup.into_string().replace(is_bad, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_out_of_a_chart() {
        let mut chart = Chart::new("<script>\"&'", 100.0, 50.0);
        chart.text("name", [0.0, 0.0], "start", "</text><script>alert(1)</script>\u{1}");
        chart.rect("fill", [1.0, 2.0], [3.0, 4.0], "a < b");
        let text = finished(chart.render());
        assert!(!text.contains("<script"), "{text}");
        roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
    }

    #[test]
    fn long_names_end_in_an_ellipsis() {
        assert_eq!(shortened("abc", 3), "abc");
        assert_eq!(shortened("\u{e4}bcd", 3), "\u{e4}b\u{2026}");
    }
}
