//! Noise against time: lines with error bars on two logarithmic axes, and the slope of a mean for comparison.

use super::Chart;
use super::scale::Scale;
use crate::words::label;

/// Size of the chart, and the edges of its plane \[px\].
const SIZE: [f64; 2] = [430.0, 345.0];
const LEFT: f64 = 68.0;
const RIGHT: f64 = 418.0;
const BOTTOM: f64 = 292.0;
/// Levels further below the lowest point than this factor are left out, because they would compress the points.
const FAR: f64 = 100.0;
/// Minimum distance of the names of two levels \[px\]. Of closer ones only the first has a name.
const NAME_HEIGHT: f64 = 14.0;

/// One point.
#[derive(Clone, Debug)]
pub struct Mark {
    /// The value on the horizontal axis. A point with a coordinate that is not positive is left out.
    pub x: f64,
    /// The value on the vertical axis.
    pub y: f64,
    /// One standard error of y.
    pub error: f64,
    /// The tooltip.
    pub hint: String,
}

/// A line of points.
#[derive(Clone, Debug)]
pub struct Series {
    /// Index of colour and shape in the palette.
    pub color: usize,
    /// Its name in the legend.
    pub name: String,
    /// Its points, in the order of the line.
    pub marks: Vec<Mark>,
}

/// Titles of the axes, and the drawings beside the points.
#[derive(Clone, Debug)]
pub struct Axes<'a> {
    /// The title of the horizontal axis.
    pub x: &'a str,
    /// The title of the vertical axis.
    pub y: &'a str,
    /// Levels across the plane, with their names.
    pub levels: Vec<(f64, String)>,
    /// The name of a dashed line of slope -1 through the first series.
    pub slope: &'a str,
}

/// Draws the chart. Both axes are logarithmic.
pub fn draw(name: &str, title: &str, axes: &Axes<'_>, series: &[Series]) -> Chart {
    let mut chart = Chart::new(name, title, SIZE[0], SIZE[1]);
    let names: Vec<_> = series.iter().map(|s| (s.color, s.name.clone())).collect();
    let top = chart.legend(LEFT, &names, axes.slope) + 8.0;
    let marks = || series.iter().flat_map(|s| &s.marks).filter(|m| m.x > 0.0 && m.y > 0.0);
    let x = Scale::log(marks().map(|m| m.x), LEFT, RIGHT);
    let reach = marks().flat_map(|m| [m.y, m.y + m.error, (m.y - m.error).max(0.3 * m.y)]);
    let lowest = marks().map(|m| m.y).fold(f64::INFINITY, f64::min);
    let near: Vec<&(f64, String)> = axes.levels.iter().filter(|(level, _)| *level * FAR > lowest).collect();
    let y = Scale::log(reach.chain(near.iter().map(|l| l.0)), BOTTOM, top);
    for tick in x.ticks() {
        chart.line("grid", [x.place(tick), BOTTOM], [x.place(tick), top]);
        chart.text("tick", [x.place(tick), BOTTOM + 20.0], "middle", &label(tick));
    }
    for tick in y.ticks() {
        chart.line("grid", [LEFT, y.place(tick)], [RIGHT, y.place(tick)]);
        chart.text("tick", [LEFT - 8.0, y.place(tick) + 5.0], "end", &label(tick));
    }
    let mut named = f64::INFINITY;
    for (level, name) in near {
        let at = y.place(*level);
        chart.line("level", [LEFT, at], [RIGHT, at]);
        if (at - named).abs() >= NAME_HEIGHT {
            chart.text("note", [LEFT + 6.0, at - 4.0], "start", name);
            named = at;
        }
    }
    slope(&mut chart, &x, &y, series);
    for s in series {
        let usable: Vec<&Mark> = s.marks.iter().filter(|m| m.x > 0.0 && m.y > 0.0).collect();
        let places: Vec<[f64; 2]> = usable.iter().map(|m| [x.place(m.x), y.place(m.y)]).collect();
        chart.path(&format!("line s{}", s.color % super::COLORS), &places);
        for (mark, [px, py]) in usable.iter().zip(&places) {
            let class = format!("bar s{}", s.color % super::COLORS);
            if mark.error.is_finite() {
                let ends = [mark.y + mark.error, mark.y - mark.error].map(|v| y.place(v.max(y.ends()[0])));
                chart.line(&class, [*px, ends[0]], [*px, ends[1]]);
                ends.iter().for_each(|end| chart.line(&class, [px - 4.0, *end], [px + 4.0, *end]));
            }
            chart.mark(s.color, false, [*px, *py], &mark.hint);
        }
    }
    chart.line("axis", [LEFT, BOTTOM], [RIGHT, BOTTOM]);
    chart.line("axis", [LEFT, BOTTOM], [LEFT, top]);
    chart.text("label", [(LEFT + RIGHT) / 2.0, BOTTOM + 44.0], "middle", axes.x);
    chart.upright("label", [14.0, (BOTTOM + top) / 2.0], axes.y);
    chart
}

/// A line of slope -1 through the middle (geometric mean) of the first series, cut at the edges of the plane.
fn slope(chart: &mut Chart, x: &Scale, y: &Scale, series: &[Series]) {
    let Some(first) = series.iter().find(|s| s.marks.iter().any(|m| m.x > 0.0 && m.y > 0.0)) else { return };
    let logs: Vec<f64> = first.marks.iter().filter(|m| m.x > 0.0 && m.y > 0.0).map(|m| (m.x * m.y).ln()).collect();
    let product = (logs.iter().sum::<f64>() / logs.len() as f64).exp();
    let ([x0, x1], [y0, y1]) = (x.ends(), y.ends());
    let (from, to) = (x0.max(product / y1), x1.min(product / y0));
    if from < to {
        let ends = [from, to].map(|v| [x.place(v), y.place(product / v)]);
        chart.line("slope", ends[0], ends[1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(x: f64, y: f64, error: f64) -> Mark {
        Mark { x, y, error, hint: format!("{x} & {y}") }
    }

    #[test]
    fn charts_of_any_values_stay_within_their_area() {
        let axes = Axes { x: "time [s]", y: "variance", levels: vec![(0.25, "k = 0.5".into())], slope: "1/t" };
        let odd = vec![mark(1.0, 0.0, 0.0), mark(f64::NAN, 1.0, 1.0), mark(2.0, 3.0, 9.0), mark(4.0, 1.0, f64::NAN)];
        for marks in [vec![], odd, vec![mark(1e-12, 1e12, 1e13)], vec![mark(1.0, 8.0, 1.0), mark(8.0, 1.0, 0.1)]] {
            let series = [Series { color: 7, name: "a < b".into(), marks }];
            let text = draw("x", "title", &axes, &series).file();
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            let document = roxmltree::Document::parse(&text).expect("well-formed");
            let numbers = ["x", "y", "x1", "x2", "cx"].map(|name| {
                document.descendants().filter_map(move |n| n.attribute(name)?.parse::<f64>().ok()).collect::<Vec<_>>()
            });
            assert!(numbers.iter().flatten().all(|v| (0.0..=SIZE[0]).contains(v)), "{text}");
        }
    }

    #[test]
    fn points_of_a_mean_lie_on_the_slope() {
        let marks = vec![mark(1.0, 8.0, 0.0), mark(2.0, 4.0, 0.0), mark(8.0, 1.0, 0.0)];
        let series = [Series { color: 0, name: "uniform".into(), marks }];
        let axes = Axes { x: "", y: "", levels: vec![], slope: "1/t" };
        let text = draw("x", "", &axes, &series).file();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        let class = |name: &'static str| document.descendants().filter(move |n| n.attribute("class") == Some(name));
        let number = |n: roxmltree::Node<'_, '_>, name: &str| n.attribute(name).and_then(|v| v.parse::<f64>().ok());
        // The first is the one of the legend.
        let slope = class("slope").nth(1).expect("a slope");
        let [x1, y1, x2, y2] = ["x1", "y1", "x2", "y2"].map(|n| number(slope, n).expect("a number"));
        let circles: Vec<_> = document.descendants().filter(|n| n.has_tag_name("circle")).collect();
        // One in the legend, three points.
        assert_eq!(circles.len(), 4);
        for circle in &circles[1..] {
            let (x, y) = (number(*circle, "cx").expect("x"), number(*circle, "cy").expect("y"));
            let on_line = y1 + (x - x1) / (x2 - x1) * (y2 - y1);
            assert!((y - on_line).abs() < 0.5, "({x}, {y}) is not on the line, which is at {on_line}");
        }
    }
}
