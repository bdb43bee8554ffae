//! Charts as SVG: small, without a library, the same in the page and as separate files.

pub(crate) mod bars;
pub(crate) mod dots;
pub(crate) mod lines;
pub(crate) mod plot;
mod scale;

pub(crate) use scale::power_of_ten;

use std::fmt::Write;

/// Colours of the page and of the charts, for light and dark surroundings.
pub(crate) const PALETTE: &str = include_str!("../palette.css");
/// Styles of the parts of a chart.
pub(crate) const STYLE: &str = include_str!("../chart.css");

/// A finished chart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Name of its file, without ending.
    pub(crate) name: String,
    /// Description as text, for screen readers.
    pub(crate) title: String,
    width: f64,
    height: f64,
    body: String,
}

impl Chart {
    /// An empty chart with its width and height [px].
    pub(crate) fn new(name: &str, title: &str, width: f64, height: f64) -> Self {
        Self { name: name.into(), title: title.into(), width, height, body: String::new() }
    }

    /// The chart as part of a page that contains the styles.
    pub(crate) fn inline(&self) -> String {
        format!(
            "<svg class=\"chart\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{}</svg>",
            self.width,
            self.height,
            escape(&self.title),
            self.body
        )
    }

    /// The chart as a separate file.
    pub(crate) fn file(&self) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\">\n\
             <title>{}</title>\n<style>{PALETTE}{STYLE}</style>\n<rect class=\"paper\" width=\"{w}\" height=\"{h}\"/>\n{}</svg>\n",
            escape(&self.title),
            self.body,
            w = self.width,
            h = self.height,
        )
    }

    fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let ([x1, y1], [x2, y2]) = (from, to);
        let _ =
            write!(self.body, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
    }

    fn path(&mut self, class: &str, points: &[[f64; 2]]) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(self.body, "<polyline class=\"{class}\" points=\"{}\"/>", points.join(" "));
    }

    fn rect(&mut self, class: &str, at: [f64; 2], size: [f64; 2], hint: &str) {
        let ([x, y], [w, h]) = (at, size);
        let _ = write!(
            self.body,
            "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\">{}</rect>",
            hint_element(hint)
        );
    }

    /// Text with its anchor: `start`, `middle` or `end`.
    fn text(&mut self, class: &str, at: [f64; 2], anchor: &str, text: &str) {
        let [x, y] = at;
        let _ = write!(
            self.body,
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
            escape(text)
        );
    }

    /// Text that runs upwards.
    fn upright(&mut self, class: &str, at: [f64; 2], text: &str) {
        let [x, y] = at;
        let _ = write!(
            self.body,
            "<text class=\"{class}\" transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escape(text)
        );
    }

    /// The mark of a series: shapes differ, so that series differ without colour.
    fn mark(&mut self, series: usize, hollow: bool, at: [f64; 2], hint: &str) {
        let [x, y] = at;
        let points = |list: &[[f64; 2]]| {
            let points: Vec<String> = list.iter().map(|[dx, dy]| format!("{:.1},{:.1}", x + dx, y + dy)).collect();
            format!("<polygon points=\"{}\"", points.join(" "))
        };
        let shape = match series % 4 {
            0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\""),
            1 => points(&[[-4.5, -4.5], [4.5, -4.5], [4.5, 4.5], [-4.5, 4.5]]),
            2 => points(&[[0.0, -6.0], [5.6, 4.2], [-5.6, 4.2]]),
            _ => points(&[[0.0, -6.2], [6.2, 0.0], [0.0, 6.2], [-6.2, 0.0]]),
        };
        let (class, name) = (if hollow { "hollow" } else { "mark" }, shape.split(' ').next().unwrap_or("<circle"));
        let _ = write!(
            self.body,
            "{shape} class=\"{class} s{}\">{}</{}>",
            series % COLORS,
            hint_element(hint),
            name.trim_start_matches('<')
        );
    }

    /// Names of series with their marks, in a row that wraps at the chart's right edge, and the name of the dashed line if
    /// there is one. Returns its height.
    fn legend(&mut self, left: f64, entries: &[(usize, String)], dashed: &str) -> f64 {
        let (mut x, mut y) = (left, 16.0);
        for (series, name) in entries {
            let length = 22.0 + 8.0 * name.chars().count() as f64 + 16.0;
            if x + length > self.width && x > left {
                (x, y) = (left, y + 22.0);
            }
            self.mark(*series, *series == HOLLOW, [x + 6.0, y - 5.0], "");
            self.text("name", [x + 18.0, y], "start", name);
            x += length;
        }
        if !dashed.is_empty() {
            let length = 38.0 + 8.0 * dashed.chars().count() as f64;
            if x + length > self.width && x > left {
                (x, y) = (left, y + 22.0);
            }
            self.line("slope", [x, y - 5.0], [x + 30.0, y - 5.0]);
            self.text("note", [x + 36.0, y], "start", dashed);
        }
        y + 12.0
    }
}

/// Number of colours of the palette for series.
const COLORS: usize = 6;
/// The series with hollow marks: the reference of a comparison.
pub(crate) const HOLLOW: usize = 4;

fn hint_element(hint: &str) -> String {
    if hint.is_empty() { String::new() } else { format!("<title>{}</title>", escape(hint)) }
}

/// Text escaped for HTML and SVG, in elements and in attributes.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            // Control characters are not allowed in either.
            c if c.is_control() && c != '\n' => {}
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_out_of_a_chart() {
        let mut chart = Chart::new("x", "<script>\"&'", 100.0, 50.0);
        chart.text("name", [0.0, 0.0], "start", "</text><script>alert(1)</script>\u{1}");
        chart.mark(3, true, [1.0, 2.0], "a < b");
        for text in [chart.file(), chart.inline()] {
            assert!(!text.contains("<script"), "{text}");
            roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
        }
    }
}
