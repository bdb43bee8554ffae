//! Stacked bars on one linear axis: the time of a render or of an image by stage.

use super::Chart;
use super::scale::Scale;
use crate::words::label;

const WIDTH: f64 = 640.0;
const RIGHT: f64 = 560.0;
const ROW: f64 = 34.0;

/// A bar with its segments, in the order of the legend.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Its name, at the left.
    pub name: String,
    /// The lengths of the segments \[s\], not negative.
    pub parts: Vec<f64>,
}

/// Draws the chart. `axis` is the title of the axis, `parts` are the names of the segments.
pub fn draw(name: &str, title: &str, axis: &str, parts: &[&str], bars: &[Bar]) -> Chart {
    let longest = bars.iter().map(|r| r.name.chars().count()).max().unwrap_or(0) as f64;
    let left = (24.0 + 8.2 * longest).min(0.4 * WIDTH);
    let mut chart = Chart::new(name, title, WIDTH, 0.0);
    let top = legend(&mut chart, left, parts) + 8.0;
    let bottom = top + ROW * bars.len() as f64;
    chart.height = bottom + 58.0;
    let x = Scale::linear(bars.iter().map(|b| b.parts.iter().sum()), left, RIGHT);
    for tick in x.ticks() {
        chart.line("grid", [x.place(tick), bottom], [x.place(tick), top]);
        chart.text("tick", [x.place(tick), bottom + 20.0], "middle", &label(tick));
    }
    for (i, bar) in bars.iter().enumerate() {
        let y = top + ROW * i as f64;
        chart.text("name", [left - 10.0, y + ROW / 2.0 + 5.0], "end", &bar.name);
        let mut from = 0.0;
        for (k, (part, stage)) in bar.parts.iter().zip(parts).enumerate() {
            let (a, b) = (x.place(from), x.place(from + part));
            let hint = format!("{}, {stage}: {part:.3} s", bar.name);
            chart.rect(&format!("fill p{}", k % super::COLORS), [a, y + 6.0], [(b - a).max(0.0), ROW - 12.0], &hint);
            from += part;
        }
        chart.text("note", [x.place(from) + 6.0, y + ROW / 2.0 + 5.0], "start", &format!("{from:.2} s"));
    }
    chart.line("axis", [left, bottom], [RIGHT, bottom]);
    chart.text("label", [(left + RIGHT) / 2.0, bottom + 46.0], "middle", axis);
    chart
}

fn legend(chart: &mut Chart, left: f64, parts: &[&str]) -> f64 {
    let mut x = left;
    for (k, part) in parts.iter().enumerate() {
        chart.rect(&format!("fill p{}", k % super::COLORS), [x, 5.0], [12.0, 12.0], "");
        chart.text("name", [x + 18.0, 16.0], "start", part);
        x += 36.0 + 8.0 * part.chars().count() as f64;
    }
    28.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_add_up_to_their_bar() {
        let bars = [Bar { name: "sobel".into(), parts: vec![1.0, 0.0, 3.0] }, Bar { name: "x".into(), parts: vec![] }];
        let text = draw("t", "t", "time [s]", &["pilot", "plan", "refine"], &bars).file();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        let width = |class: &'static str| {
            let drawn = document.descendants().filter(move |n| n.attribute("class") == Some(class));
            drawn.filter_map(|n| n.attribute("width")?.parse::<f64>().ok()).next_back()
        };
        let (pilot, refine) = (width("fill p0").expect("pilot"), width("fill p2").expect("refine"));
        assert!((refine - 3.0 * pilot).abs() < 0.3, "{pilot} {refine}");
    }
}
