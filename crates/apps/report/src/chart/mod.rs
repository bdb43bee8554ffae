//! Charts as SVG: small, without a library, the same in the page and as separate files. Names and hints are escaped.

pub mod bars;
pub mod counts;
pub mod dots;
pub mod lines;
pub mod plot;
mod scale;

use maud::{Markup, PreEscaped, Render, html};

/// The style sheet of colours of the page and of the charts, for light and dark surroundings.
pub const PALETTE: &str = include_str!("palette.css");
/// The style sheet of the parts of a chart. It uses the colours of [`PALETTE`].
pub const STYLE: &str = include_str!("chart.css");

/// A finished chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Name of its file, without ending. Empty for a chart that is only part of a page.
    pub name: String,
    /// Description as text, for screen readers.
    pub title: String,
    width: f64,
    height: f64,
    body: String,
}

impl Chart {
    /// An empty chart with its width and height \[px\].
    fn new(name: &str, title: &str, width: f64, height: f64) -> Self {
        Self { name: name.into(), title: title.into(), width, height, body: String::new() }
    }

    /// The chart as a separate file: a document of SVG with its styles.
    pub fn file(&self) -> String {
        let (w, h) = (self.width, self.height);
        finished(html! {
            svg xmlns="http://www.w3.org/2000/svg" class="chart" viewBox={ "0 0 " (w) " " (h) } width=(w) height=(h)
                role="img" {
                title { (self.title) }
                style { (PreEscaped(PALETTE)) (PreEscaped(STYLE)) }
                rect class="paper" width=(w) height=(h) {}
                (PreEscaped(&self.body))
            }
        })
    }

    fn add(&mut self, element: Markup) {
        self.body += &element.into_string();
    }

    fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let [[x1, y1], [x2, y2]] = [from, to].map(|end| end.map(tenths));
        self.add(html! { line class=(class) x1=(x1) y1=(y1) x2=(x2) y2=(y2) {} });
    }

    fn path(&mut self, class: &str, points: &[[f64; 2]]) {
        self.add(html! { polyline class=(class) points=(places(points)) {} });
    }

    fn rect(&mut self, class: &str, at: [f64; 2], size: [f64; 2], hint: &str) {
        let [[x, y], [w, h]] = [at, size].map(|pair| pair.map(tenths));
        self.add(html! { rect class=(class) x=(x) y=(y) width=(w) height=(h) { (hint_element(hint)) } });
    }

    fn circle(&mut self, class: &str, at: [f64; 2], radius: f64, hint: &str) {
        let [x, y] = at.map(tenths);
        self.add(html! { circle cx=(x) cy=(y) r=(radius) class=(class) { (hint_element(hint)) } });
    }

    fn polygon(&mut self, class: &str, [x, y]: [f64; 2], corners: &[[f64; 2]], hint: &str) {
        let corners: Vec<[f64; 2]> = corners.iter().map(|[dx, dy]| [x + dx, y + dy]).collect();
        self.add(html! { polygon points=(places(&corners)) class=(class) { (hint_element(hint)) } });
    }

    /// Text with its anchor: `start`, `middle` or `end`.
    fn text(&mut self, class: &str, at: [f64; 2], anchor: &str, text: &str) {
        let [x, y] = at.map(tenths);
        self.add(html! { text class=(class) x=(x) y=(y) text-anchor=(anchor) { (text) } });
    }

    /// Text that runs upwards.
    fn upright(&mut self, class: &str, [x, y]: [f64; 2], text: &str) {
        let place = format!("translate({x:.1} {y:.1}) rotate(-90)");
        self.add(html! { text class=(class) transform=(place) text-anchor="middle" { (text) } });
    }

    /// The mark of a series: shapes differ, so that series differ without colour.
    fn mark(&mut self, series: usize, hollow: bool, at: [f64; 2], hint: &str) {
        let class = format!("{} s{}", if hollow { "hollow" } else { "mark" }, series % COLORS);
        match series % 4 {
            0 => self.circle(&class, at, 5.0, hint),
            1 => self.polygon(&class, at, &[[-4.5, -4.5], [4.5, -4.5], [4.5, 4.5], [-4.5, 4.5]], hint),
            2 => self.polygon(&class, at, &[[0.0, -6.0], [5.6, 4.2], [-5.6, 4.2]], hint),
            _ => self.polygon(&class, at, &[[0.0, -6.2], [6.2, 0.0], [0.0, 6.2], [-6.2, 0.0]], hint),
        }
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

/// Number of colours of the palette for series, and of those for categories. Larger indices begin again.
pub const COLORS: usize = 6;
/// The series with hollow marks: the reference of a comparison.
pub const HOLLOW: usize = 4;

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

fn hint_element(hint: &str) -> Markup {
    html! { @if !hint.is_empty() { title { (hint) } } }
}

fn tenths(v: f64) -> String {
    format!("{v:.1}")
}

fn places(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

/// The text of a page or a chart. Control characters and noncharacters of names, which neither HTML nor XML allows, are left out.
pub(crate) fn finished(markup: Markup) -> String {
    let is_bad = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{fffe}' | '\u{ffff}');
    markup.into_string().replace(is_bad, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_out_of_a_chart() {
        let mut chart = Chart::new("x", "<script>\"&'", 100.0, 50.0);
        chart.text("name", [0.0, 0.0], "start", "</text><script>alert(1)</script>\u{1}\u{fffe}\u{ffff}");
        chart.mark(3, true, [1.0, 2.0], "a < b");
        chart.rect("fill", [1.0, 2.0], [3.0, 4.0], "a < b");
        for text in [chart.file(), finished(chart.render())] {
            assert!(!text.contains("<script") && !text.contains(['\u{1}', '\u{fffe}', '\u{ffff}']), "{text}");
            roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
        }
    }
}
