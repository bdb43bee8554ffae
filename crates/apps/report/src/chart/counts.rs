//! Charts of counts: a histogram of numbers, and bars of names.

use super::scale::Scale;
use super::{COLORS, Chart};
use crate::bins::Bins;
use crate::words::{label, rounded, shortened};

/// Size of a histogram, and the edges of its plane \[px\].
const SIZE: [f64; 2] = [430.0, 250.0];
const LEFT: f64 = 52.0;
const RIGHT: f64 = 418.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 194.0;
/// Height of a bar with its gap \[px\].
const ROW: f64 = 24.0;
/// Maximum number of characters of a name of a bar.
const LONGEST: usize = 20;
/// The width of a character \[px\], on average.
const LETTER: f64 = 7.4;

/// A level across a histogram, with its name.
pub type Level<'a> = (f64, &'a str);

/// The colour of the bars of a histogram: an index in the palette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// A colour of series, which differs in light and dark surroundings.
    Series(usize),
    /// A colour of categories, the same in both and in images.
    Category(usize),
}

/// Draws a histogram. `heading` is above it, the title `axis` below it. `of` names the counted things, in the plural.
/// Levels outside of the bins are left out.
pub fn histogram(heading: &str, axis: &str, of: &str, fill: Fill, bins: &Bins, levels: &[Level<'_>]) -> Chart {
    let mut chart = Chart::new("", &format!("Histogram: {heading}"), SIZE[0], SIZE[1]);
    chart.text("heading", [0.0, 16.0], "start", &shortened(heading, 54));
    let x = Scale::exact(bins.is_log, bins.low, bins.high, LEFT, RIGHT);
    let y = Scale::linear(bins.counts.iter().map(|n| *n as f64), BOTTOM, TOP + 6.0);
    for tick in y.ticks().into_iter().filter(|t| t.fract() == 0.0) {
        chart.line("grid", [LEFT, y.place(tick)], [RIGHT, y.place(tick)]);
        chart.text("tick", [LEFT - 7.0, y.place(tick) + 4.5], "end", &label(tick));
    }
    let class = match fill {
        Fill::Series(color) => format!("fill s{}", color % COLORS),
        Fill::Category(color) => format!("fill k{}", color % COLORS),
    };
    for (i, count) in bins.counts.iter().enumerate().filter(|(_, n)| **n > 0) {
        let [from, to] = bins.edges(i);
        let (a, b, top) = (x.place(from), x.place(to), y.place(*count as f64).min(BOTTOM - 1.0));
        let gap = if b - a > 4.0 { 0.8 } else { 0.0 };
        let range = match bins.is_whole {
            true => label((from + 0.5).round()),
            false => format!("{} to {}", rounded(from), rounded(to)),
        };
        chart.rect(
            &class,
            [a + gap, top],
            [(b - a - 2.0 * gap).max(1.0), BOTTOM - top],
            &format!("{range}: {count} {of}"),
        );
    }
    // Labels that would overlap are left out.
    let mut free = f64::NEG_INFINITY;
    for tick in x.ticks().into_iter().filter(|t| !bins.is_whole || t.fract() == 0.0) {
        let text = label(tick);
        let half = 0.5 * LETTER * text.chars().count() as f64;
        let at = x.place(tick).min(SIZE[0] - half);
        if at - half > free {
            chart.line("axis", [x.place(tick), BOTTOM], [x.place(tick), BOTTOM + 4.0]);
            chart.text("tick", [at, BOTTOM + 19.0], "middle", &text);
            free = at + half + 6.0;
        }
    }
    chart.line("axis", [LEFT, BOTTOM], [RIGHT, BOTTOM]);
    for (at, name) in levels.iter().filter(|(at, _)| (bins.low..=bins.high).contains(at)) {
        chart.line("level", [x.place(*at), BOTTOM], [x.place(*at), TOP - 2.0]);
        chart.text("note", [x.place(*at) + 4.0, TOP + 7.0], "start", name);
    }
    chart.text("label", [(LEFT + RIGHT) / 2.0, BOTTOM + 43.0], "middle", &shortened(axis, 50));
    chart
}

/// Draws one bar per name, with its count at the end. `color` is that of a series, `of` names the counted things.
pub fn bars(heading: &str, of: &str, color: usize, rows: &[(String, u64)]) -> Chart {
    let longest = rows.iter().map(|r| r.0.chars().count().min(LONGEST)).max().unwrap_or(0) as f64;
    let left = 12.0 + 8.0 * longest;
    let mut chart = Chart::new("", &format!("Counts: {heading}"), SIZE[0], 34.0 + ROW * rows.len() as f64);
    chart.text("heading", [0.0, 16.0], "start", &shortened(heading, 54));
    let x = Scale::linear(rows.iter().map(|r| r.1 as f64), left, SIZE[0] - 56.0);
    let class = format!("fill s{}", color % COLORS);
    for (i, (name, count)) in rows.iter().enumerate() {
        let y = 28.0 + ROW * i as f64;
        let end = x.place(*count as f64);
        chart.text("name", [left - 10.0, y + 16.0], "end", &shortened(name, LONGEST));
        chart.rect(&class, [left, y + 3.0], [(end - left).max(1.0), ROW - 6.0], &format!("{name}: {count} {of}"));
        chart.text("count", [end + 6.0, y + 16.0], "start", &count.to_string());
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::finished;
    use maud::Render;

    fn widths(text: &str) -> Vec<f64> {
        let document = roxmltree::Document::parse(text).expect("well-formed");
        let rects = document.descendants().filter(|n| n.has_tag_name("rect"));
        rects.filter_map(|n| n.attribute("width")?.parse().ok()).collect()
    }

    #[test]
    fn histograms_of_any_numbers_are_well_formed() {
        for values in [vec![], vec![0.0], vec![3.0; 5], vec![-1e300, 1e300], vec![1e-9, 1e9, 2.0], vec![1.0, 2.0, 2.0]]
        {
            let bins = Bins::of(&values);
            let text =
                finished(histogram("h & <h>", "x [mm]", "images", Fill::Category(1), &bins, &[(1.0, "one")]).render());
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            assert_eq!(widths(&text).len(), bins.counts.iter().filter(|n| **n > 0).count(), "{values:?}");
        }
    }
}
