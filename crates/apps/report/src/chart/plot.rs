//! Curves and points on two axes, each linear or logarithmic: measured values and models.

use super::scale::Scale;
use super::{COLORS, Chart};
use crate::words::label;

/// Size of the chart, and the edges of its plane \[px\].
const SIZE: [f64; 2] = [430.0, 330.0];
const LEFT: f64 = 72.0;
const RIGHT: f64 = 418.0;
const BOTTOM: f64 = 278.0;
/// Upper bound of the width of a character \[px\].
const WIDTH: f64 = 7.6;

/// Title and direction of an axis.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a> {
    /// Its title.
    pub label: &'a str,
    /// Is it logarithmic?
    pub is_log: bool,
    /// Is zero part of a linear axis for any values?
    pub has_zero: bool,
}

/// The style of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A dot at each point.
    Points,
    /// A line in the colour of the trace.
    Line,
    /// A dashed line, for a model.
    Dashed,
}

/// Points or a curve.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Index of the colour in the palette.
    pub color: usize,
    /// Its name in the legend.
    pub name: String,
    /// Its style.
    pub style: Style,
    /// Pairs of x and y, in the order of a line.
    pub points: Vec<[f64; 2]>,
}

/// Draws the chart with a horizontal and a vertical axis. Points that an axis cannot show (not finite, or not positive on a logarithmic one) are left out.
pub fn draw(name: &str, title: &str, [x, y]: [Axis<'_>; 2], traces: &[Trace]) -> Chart {
    let mut chart = Chart::new(name, title, SIZE[0], SIZE[1]);
    let top = legend(&mut chart, traces) + 6.0;
    let fits = |axis: &Axis<'_>, v: f64| v.is_finite() && (!axis.is_log || v > 0.0);
    let points = || traces.iter().flat_map(|t| &t.points).filter(|p| fits(&x, p[0]) && fits(&y, p[1]));
    let [xs, ys] = [(x, 0, LEFT, RIGHT), (y, 1, BOTTOM, top)].map(|(axis, i, from, to)| {
        let values = points().map(move |p| p[i]);
        let zero = axis.has_zero.then_some(0.0);
        if axis.is_log { Scale::log(values, from, to) } else { Scale::span(values.chain(zero), from, to) }
    });
    for tick in xs.ticks() {
        chart.line("grid", [xs.place(tick), BOTTOM], [xs.place(tick), top]);
        let text = label(tick);
        let end = xs.place(tick) + 0.5 * WIDTH * text.chars().count() as f64;
        // If a label centred at its tick would extend beyond the chart, it is aligned to the edge.
        match end <= SIZE[0] {
            true => chart.text("tick", [xs.place(tick), BOTTOM + 19.0], "middle", &text),
            false => chart.text("tick", [SIZE[0] - 1.0, BOTTOM + 19.0], "end", &text),
        }
    }
    for tick in ys.ticks() {
        chart.line("grid", [LEFT, ys.place(tick)], [RIGHT, ys.place(tick)]);
        chart.text("tick", [LEFT - 7.0, ys.place(tick) + 4.5], "end", &label(tick));
    }
    for trace in traces {
        let usable = trace.points.iter().filter(|p| fits(&x, p[0]) && fits(&y, p[1]));
        let places: Vec<[f64; 2]> = usable.clone().map(|p| [xs.place(p[0]), ys.place(p[1])]).collect();
        let color = trace.color % COLORS;
        let style = match (trace.style, places.len()) {
            // A line between equal points would be invisible.
            (Style::Line, 1) => Style::Points,
            (style, _) => style,
        };
        match style {
            Style::Line => chart.path(&format!("line s{color}"), &places),
            Style::Dashed => chart.path("line dashed", &places),
            Style::Points => {
                for (p, at) in usable.zip(&places) {
                    let hint = format!("{}: {}, {}", trace.name, label(p[0]), label(p[1]));
                    chart.circle(&format!("mark s{color}"), *at, 3.2, &hint);
                }
            }
        }
    }
    chart.line("axis", [LEFT, BOTTOM], [RIGHT, BOTTOM]);
    chart.line("axis", [LEFT, BOTTOM], [LEFT, top]);
    chart.text("label", [(LEFT + RIGHT) / 2.0, BOTTOM + 43.0], "middle", x.label);
    chart.upright("label", [14.0, (BOTTOM + top) / 2.0], y.label);
    chart
}

/// Names of the traces with a sample of each, in rows. Returns the height.
fn legend(chart: &mut Chart, traces: &[Trace]) -> f64 {
    let (mut left, mut y) = (LEFT, 16.0);
    for t in traces {
        let length = 30.0 + WIDTH * t.name.chars().count() as f64 + 14.0;
        if left + length > SIZE[0] && left > LEFT {
            (left, y) = (LEFT, y + 20.0);
        }
        let color = t.color % COLORS;
        let ends = [[left, y - 5.0], [left + 22.0, y - 5.0]];
        match t.style {
            Style::Points => chart.circle(&format!("mark s{color}"), [left + 11.0, y - 5.0], 4.0, ""),
            Style::Line => chart.path(&format!("line s{color}"), &ends),
            Style::Dashed => chart.path("line dashed", &ends),
        }
        chart.text("name", [left + 28.0, y], "start", &t.name);
        left += length;
    }
    y + 8.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(label: &str, is_log: bool) -> Axis<'_> {
        Axis { label, is_log, has_zero: true }
    }

    #[test]
    fn charts_of_any_values_stay_within_their_area() {
        let trace =
            |style, points: &[[f64; 2]]| Trace { color: 9, name: "a < b".into(), style, points: points.to_vec() };
        let odd = [[1.0, 0.0], [f64::NAN, 1.0], [2.0, f64::INFINITY], [-4.0, 1e-9], [3.0, -7.0]];
        for is_log in [false, true] {
            let all = [trace(Style::Points, &odd), trace(Style::Line, &[]), trace(Style::Dashed, &odd[..1])];
            let text = draw("x", "t & u", [axis("x", is_log), axis("y", !is_log)], &all).file();
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            let document = roxmltree::Document::parse(&text).expect("well-formed");
            let numbers = ["x", "y", "x1", "y2", "cx", "cy"].map(|name| {
                document.descendants().filter_map(move |n| n.attribute(name)?.parse::<f64>().ok()).collect::<Vec<_>>()
            });
            assert!(numbers.iter().flatten().all(|v| (0.0..=SIZE[0]).contains(v)), "{text}");
        }
    }

    #[test]
    fn points_lie_at_their_coordinates() {
        let points = vec![[0.0, 10.0], [50.0, 20.0], [100.0, 30.0]];
        let t = Trace { color: 0, name: "t".into(), style: Style::Points, points };
        let text = draw("x", "", [axis("x", false), Axis { has_zero: false, ..axis("y", false) }], &[t]).file();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        let circles = document.descendants().filter(|n| n.has_tag_name("circle")).skip(1);
        let at: Vec<[f64; 2]> = circles
            .map(|n| ["cx", "cy"].map(|a| n.attribute(a).and_then(|v| v.parse().ok()).expect("a number")))
            .collect();
        assert_eq!(at.len(), 3);
        for i in [0, 1] {
            assert!((at[0][i] + at[2][i] - 2.0 * at[1][i]).abs() < 0.2, "{at:?}");
        }
        assert!(at[0][0] < at[2][0] && at[0][1] > at[2][1]);
    }
}
