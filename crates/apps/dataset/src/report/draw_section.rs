//! The drawn values of a set: a chart of each setting that varies, and a table of those that do not.

use super::draws::Drawn;
use super::table::table;
use super::view::SetView;
use dunkelfeld_report::bins::Bins;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::counts::{Fill, bars, histogram};
use dunkelfeld_report::page::charts;
use dunkelfeld_report::words::{label, shortened};
use maud::{Markup, html};

/// Maximum number of charts, and of rows of the table.
const CHARTS: usize = 60;
const ROWS: usize = 200;
/// Maximum number of bars of a chart.
const BARS: usize = 12;

/// The section of the drawn values.
pub(crate) fn draw_section(set: &SetView<'_>) -> Markup {
    let (mut numbers, mut texts): (Vec<Chart>, Vec<Chart>) = (Vec::new(), Vec::new());
    let (mut constant, mut left_out): (Vec<(&str, String)>, usize) = (Vec::new(), 0);
    for (name, values) in set.draws.iter() {
        match only_value(&values) {
            Some(value) if constant.len() < ROWS => constant.push((name, value)),
            None if numbers.len() + texts.len() < CHARTS => {
                let kind = if matches!(values, Drawn::Numbers { .. }) { &mut numbers } else { &mut texts };
                kind.push(chart(name, &values));
            }
            _ => left_out += 1,
        }
    }
    let rows = html! {
        @for (name, value) in &constant {
            tr { td.name { (shortened(name, 120)) } td.n { (shortened(value, 80)) } }
        }
    };
    html! {
        @if !set.draws.is_empty() {
            section {
                h2 { "Drawn values" }
                p { "The values that the study drew for each image." }
                (charts(&numbers))
                (charts(&texts))
                @if !constant.is_empty() {
                    h3 { "Equal in all images" }
                    (table("constant", &[("setting", ""), ("value", "")], rows))
                }
                @if left_out > 0 { p.faint { "Settings without a place on this page: " (left_out) "." } }
            }
        }
    }
}

/// The value that all images have.
fn only_value(values: &Drawn) -> Option<String> {
    match values {
        Drawn::Numbers { values, unit } => {
            let first = values.first()?;
            let text = format!("{} {}", label(*first), shortened(unit, 12));
            values.iter().all(|v| v == first).then(|| text.trim_end().into())
        }
        Drawn::Texts(counts) => match counts.as_slice() {
            [(text, _)] => Some(text.clone()),
            _ => None,
        },
    }
}

fn chart(name: &str, values: &Drawn) -> Chart {
    match values {
        Drawn::Numbers { values, unit } => {
            let bins = Bins::of(values);
            let axis = match (unit.as_str(), bins.is_log) {
                ("", false) => String::from("value"),
                ("", true) => "value, logarithmic".into(),
                (unit, false) => unit.into(),
                (unit, true) => format!("{unit}, logarithmic"),
            };
            histogram(name, &axis, "images", Fill::Series(0), &bins, &[])
        }
        Drawn::Texts(counts) => {
            let shown = if counts.len() <= BARS { counts.len() } else { BARS - 1 };
            let (shown, rest) = counts.split_at(shown);
            let mut rows = shown.to_vec();
            if !rest.is_empty() {
                rows.push((format!("{} other values", rest.len()), rest.iter().map(|c| c.1).sum()));
            }
            bars(name, "images", 5, &rows)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_have_no_chart() {
        let numbers = |values: &[f64]| Drawn::Numbers { values: values.to_vec(), unit: "mm".into() };
        assert_eq!(only_value(&numbers(&[0.31, 0.31])).as_deref(), Some("0.31 mm"));
        assert_eq!(only_value(&numbers(&[0.31, 0.32])), None);
        let texts = |n: usize| Drawn::Texts((0..n).map(|i| (format!("n{i}"), 1)).collect());
        assert_eq!(only_value(&texts(1)).as_deref(), Some("n0"));
        assert_eq!(only_value(&texts(2)), None);
    }

    #[test]
    fn rare_texts_share_a_bar() {
        use maud::Render;
        let counts = (0..30).map(|i| (format!("n{i:02}"), 30 - i)).collect();
        let text = chart("x", &Drawn::Texts(counts)).render().into_string();
        // 19 + 18 + ... + 1
        assert!(text.contains("19 other values: 190 images") && !text.contains("n11"), "{text}");
    }
}
