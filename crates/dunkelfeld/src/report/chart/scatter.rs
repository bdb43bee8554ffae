//! Points on two linear axes with straight lines through them: photon transfer curves.

use super::Chart;
use super::scale::{Scale, label};

const SIZE: [f64; 2] = [430.0, 330.0];
const LEFT: f64 = 68.0;
const RIGHT: f64 = 418.0;
const BOTTOM: f64 = 278.0;
/// Points beyond this multiple of the share below are left at the upper edge: few wild ones would press the others flat.
const ROOM: f64 = 1.35;
const SHARE: f64 = 0.985;

/// Points of one kind.
#[derive(Clone, Debug)]
pub(crate) struct Cloud {
    /// Which of the palette's colours.
    pub(crate) color: usize,
    pub(crate) name: String,
    pub(crate) points: Vec<[f64; 2]>,
}

/// A line `y = intercept + slope x` over an interval of x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) intercept: f64,
    pub(crate) slope: f64,
    pub(crate) from: f64,
    pub(crate) to: f64,
}

/// Draws the chart. Axes begin at zero; the dashed lines have the name `line_name`.
pub(crate) fn draw(
    name: &str,
    title: &str,
    axes: [&str; 2],
    clouds: &[Cloud],
    lines: &[Line],
    line_name: &str,
) -> Chart {
    let mut chart = Chart::new(name, title, SIZE[0], SIZE[1]);
    let names: Vec<_> = clouds.iter().map(|c| (c.color, c.name.clone())).collect();
    let top = chart.legend(LEFT, &names, if lines.is_empty() { "" } else { line_name }) + 8.0;
    let points = || clouds.iter().flat_map(|c| &c.points).filter(|p| p.iter().all(|v| v.is_finite()));
    let mut heights: Vec<f64> = points().map(|p| p[1]).collect();
    heights.sort_by(f64::total_cmp);
    let most = heights.last().copied().unwrap_or(1.0);
    let usual = heights.get((SHARE * heights.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(1.0);
    let x = Scale::linear(points().map(|p| p[0]), LEFT, RIGHT);
    let y = Scale::linear([most.min(ROOM * usual)].into_iter(), BOTTOM, top);
    for tick in x.ticks() {
        chart.line("grid", [x.place(tick), BOTTOM], [x.place(tick), top]);
        chart.text("tick", [x.place(tick), BOTTOM + 20.0], "middle", &label(tick));
    }
    for tick in y.ticks() {
        chart.line("grid", [LEFT, y.place(tick)], [RIGHT, y.place(tick)]);
        chart.text("tick", [LEFT - 8.0, y.place(tick) + 5.0], "end", &label(tick));
    }
    for cloud in clouds {
        let usable = cloud.points.iter().filter(|p| p.iter().all(|v| v.is_finite()));
        usable.for_each(|p| chart.dot(cloud.color, [x.place(p[0].max(0.0)), y.place(p[1].max(0.0))]));
    }
    for line in lines {
        let [low, high] = y.ends();
        let cut = |at: f64| (line.intercept + line.slope * at).clamp(low, high);
        // A line that leaves the plane is cut where it does.
        let leaves = if line.slope > 0.0 { (high - line.intercept) / line.slope } else { line.to };
        let to = line.to.min(leaves).min(x.ends()[1]);
        if to > line.from {
            chart.line("slope", [x.place(line.from), y.place(cut(line.from))], [x.place(to), y.place(cut(to))]);
        }
    }
    chart.line("axis", [LEFT, BOTTOM], [RIGHT, BOTTOM]);
    chart.line("axis", [LEFT, BOTTOM], [LEFT, top]);
    chart.text("label", [(LEFT + RIGHT) / 2.0, BOTTOM + 44.0], "middle", axes[0]);
    chart.upright("label", [14.0, (BOTTOM + top) / 2.0], axes[1]);
    chart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_the_numbers_are_the_chart_stays_on_its_paper() {
        let odd = vec![[1.0, 2.0], [f64::NAN, 1.0], [3.0, f64::INFINITY], [-5.0, -7.0], [1e9, 1e-12]];
        let line = Line { intercept: 1.0, slope: 1e6, from: 0.0, to: 1e12 };
        for points in [vec![], odd, vec![[0.0, 0.0]]] {
            let clouds = [Cloud { color: 7, name: "a < b".into(), points }];
            let text = draw("x", "title", ["x", "y"], &clouds, &[line], "fit").file();
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            let document = roxmltree::Document::parse(&text).expect("well-formed");
            for name in ["x1", "x2", "cx", "y1", "y2", "cy"] {
                let mut all = document.descendants().filter_map(|n| n.attribute(name)?.parse::<f64>().ok());
                assert!(all.all(|v| (0.0..=SIZE[0]).contains(&v)), "{text}");
            }
        }
    }

    #[test]
    fn points_of_a_line_lie_on_it() {
        let points: Vec<[f64; 2]> = (1..20).map(|i| [f64::from(i), 3.0 + 2.0 * f64::from(i)]).collect();
        let clouds = [Cloud { color: 0, name: String::new(), points }];
        let line = Line { intercept: 3.0, slope: 2.0, from: 0.0, to: 19.0 };
        let text = draw("x", "", ["", ""], &clouds, &[line], "").file();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        let number = |n: roxmltree::Node<'_, '_>, name: &str| n.attribute(name).and_then(|v| v.parse::<f64>().ok());
        let slope = document.descendants().rfind(|n| n.attribute("class") == Some("slope")).expect("a line");
        let [x1, y1, x2, y2] = ["x1", "y1", "x2", "y2"].map(|n| number(slope, n).expect("a number"));
        let dots: Vec<_> = document.descendants().filter(|n| n.attribute("r") == Some("2")).collect();
        assert_eq!(dots.len(), 19);
        for dot in dots {
            let (x, y) = (number(dot, "cx").expect("x"), number(dot, "cy").expect("y"));
            assert!((y - (y1 + (x - x1) / (x2 - x1) * (y2 - y1))).abs() < 0.5, "({x}, {y})");
        }
    }
}
