//! Rows of dots on one logarithmic axis: the cost of each strategy, or the bias of each effect.

use super::Chart;
use super::scale::Scale;
use crate::words::label;

const WIDTH: f64 = 640.0;
const RIGHT: f64 = 620.0;
/// Height of a row, and distance of the dots in it \[px\].
const ROW: f64 = 30.0;
const STEP: f64 = 13.0;

/// A dot.
#[derive(Clone, Debug)]
pub struct Dot {
    /// Index of colour and shape in the palette.
    pub series: usize,
    /// The value. A dot that is not positive is left out.
    pub x: f64,
    /// One standard error; zero draws none.
    pub error: f64,
    /// The tooltip.
    pub hint: String,
}

/// A row.
#[derive(Clone, Debug)]
pub struct Row {
    /// Its name, at the left.
    pub name: String,
    /// Its dots.
    pub dots: Vec<Dot>,
    /// Are the dots one below the other?
    pub spread: bool,
}

/// Draws the chart: title of the axis, a level with its name, indices and names of the series, rows from the top.
pub fn draw(
    name: &str,
    title: &str,
    axis: &str,
    level: Option<(f64, &str)>,
    legend: &[(usize, String)],
    rows: &[Row],
) -> Chart {
    let height_of = |r: &Row| if r.spread { ROW + STEP * r.dots.len().saturating_sub(1) as f64 } else { ROW };
    let longest = rows.iter().map(|r| r.name.chars().count()).max().unwrap_or(0) as f64;
    let left = (24.0 + 8.2 * longest).min(0.45 * WIDTH);
    let plane: f64 = rows.iter().map(height_of).sum();
    let mut chart = Chart::new(name, title, WIDTH, 0.0);
    let top = chart.legend(left, legend, "") + 8.0;
    let bottom = top + plane;
    chart.height = bottom + 58.0;
    let dots = || rows.iter().flat_map(|r| &r.dots).filter(|d| d.x > 0.0);
    let reach = dots().flat_map(|d| [d.x, d.x + d.error, (d.x - d.error).max(0.3 * d.x)]);
    let x = Scale::log(reach.chain(level.map(|l| l.0)), left, RIGHT);
    for tick in x.ticks() {
        chart.line("grid", [x.place(tick), bottom], [x.place(tick), top]);
        chart.text("tick", [x.place(tick), bottom + 20.0], "middle", &label(tick));
    }
    if let Some((at, name)) = level {
        chart.line("level", [x.place(at), bottom], [x.place(at), top]);
        chart.text("note", [x.place(at) + 6.0, bottom - 6.0], "start", name);
    }
    let mut y = top;
    for row in rows {
        let height = height_of(row);
        chart.line("grid", [left, y + height], [RIGHT, y + height]);
        chart.text("name", [left - 10.0, y + height / 2.0 + 5.0], "end", &row.name);
        for (i, dot) in row.dots.iter().enumerate().filter(|(_, d)| d.x > 0.0) {
            let place = [x.place(dot.x), y + ROW / 2.0 + if row.spread { STEP * i as f64 } else { 0.0 }];
            if dot.error > 0.0 && dot.error.is_finite() {
                let class = format!("bar s{}", dot.series % super::COLORS);
                let ends = [dot.x - dot.error, dot.x + dot.error].map(|v| x.place(v.max(x.ends()[0])));
                chart.line(&class, [ends[0], place[1]], [ends[1], place[1]]);
            }
            chart.mark(dot.series, dot.series == super::HOLLOW, place, &dot.hint);
        }
        y += height;
    }
    chart.line("axis", [left, bottom], [RIGHT, bottom]);
    chart.text("label", [(left + RIGHT) / 2.0, bottom + 46.0], "middle", axis);
    chart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_any_numbers_are_drawn() {
        let dot = |x| Dot { series: 1, x, error: 0.5 * x, hint: "h".into() };
        let row = |dots: Vec<Dot>| Row { name: "k = 0.5".into(), dots, spread: true };
        for rows in [vec![], vec![row(vec![dot(f64::NAN), dot(0.0)]), row(vec![dot(1e-3), dot(1e9)])]] {
            let text = draw("x", "t", "time [s]", Some((1.0, "one")), &[(1, "sobel".into())], &rows).file();
            roxmltree::Document::parse(&text).expect("well-formed");
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        }
    }
}
