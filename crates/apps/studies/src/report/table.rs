//! Tables of a report: the same cells as CSV and as HTML.

use super::estimate::Estimate;
use dunkelfeld_report::page::{self, Heading};
use dunkelfeld_report::words::rounded;
use maud::{Markup, Render, html};
use serde_json::{Map, Value};

/// The figures of a report: the rows of its tables, by the name of the table, as objects with the keys of the CSV.
pub type Figures = Map<String, Value>;

/// Number of digits in both forms.
const DIGITS: usize = 6;

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cell {
    Text(String),
    Number(f64),
    Count(u64),
    /// Two columns of the CSV: the number, and its standard error.
    Estimate(Estimate),
}

/// A column: its key in the CSV, its heading, its unit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    pub(crate) key: &'static str,
    pub(crate) heading: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) is_estimate: bool,
}

/// A table with its file's name, without ending.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    pub(crate) name: &'static str,
    pub(crate) columns: Vec<Column>,
    pub(crate) rows: Vec<Vec<Cell>>,
}

pub(crate) const fn column(key: &'static str, heading: &'static str, unit: &'static str) -> Column {
    Column { key, heading, unit, is_estimate: false }
}

pub(crate) const fn estimate(key: &'static str, heading: &'static str, unit: &'static str) -> Column {
    Column { key, heading, unit, is_estimate: true }
}

impl Table {
    /// As comma-separated values (RFC 4180) with a header. Unknown numbers are empty.
    pub(crate) fn csv(&self) -> String {
        let header = self.columns.iter().flat_map(|c| match c.is_estimate {
            true => vec![c.key.to_string(), format!("{}_error", c.key)],
            false => vec![c.key.to_string()],
        });
        let cells = |cell: &Cell| match cell {
            Cell::Text(t) => vec![quoted(t)],
            Cell::Number(v) => vec![number(*v)],
            Cell::Count(n) => vec![n.to_string()],
            Cell::Estimate(e) => vec![number(e.value), number(e.error)],
        };
        let rows = self.rows.iter().map(|row| row.iter().flat_map(cells).collect());
        let lines = std::iter::once(header.collect()).chain(rows);
        lines.map(|line: Vec<String>| line.join(",") + "\r\n").collect()
    }
}

impl Table {
    /// The rows as JSON objects with the keys of the CSV, at full precision. Unknown numbers are null.
    pub(crate) fn records(&self) -> Value {
        let entries = |(c, cell): (&Column, &Cell)| match cell {
            Cell::Text(text) => vec![(c.key.to_string(), Value::from(text.as_str()))],
            Cell::Number(v) => vec![(c.key.to_string(), Value::from(*v))],
            Cell::Count(n) => vec![(c.key.to_string(), Value::from(*n))],
            Cell::Estimate(e) => {
                vec![(c.key.to_string(), Value::from(e.value)), (format!("{}_error", c.key), Value::from(e.error))]
            }
        };
        let record = |row: &Vec<Cell>| Value::Object(self.columns.iter().zip(row).flat_map(entries).collect());
        Value::Array(self.rows.iter().map(record).collect())
    }
}

/// The rows of tables, by the name of the table.
pub(crate) fn figures<'a>(tables: impl IntoIterator<Item = &'a Table>) -> Figures {
    tables.into_iter().map(|table| (table.name.to_string(), table.records())).collect()
}

/// As an HTML table. Each number is a `data` element with the value of the CSV.
impl Render for Table {
    fn render(&self) -> Markup {
        let heading = |c: &Column| Heading { text: c.heading, unit: c.unit, class: "" };
        let rows = html! { @for row in &self.rows { tr { @for cell in row { (cell) } } } };
        page::table(self.name, self.columns.iter().map(heading), rows)
    }
}

impl Render for Cell {
    fn render(&self) -> Markup {
        match self {
            Self::Text(t) => html! { td { (t) } },
            Self::Number(v) => html! { td.n { (data(*v, &rounded(*v))) } },
            Self::Count(n) => html! { td.n { data value=(n) { (n) } } },
            Self::Estimate(e) => {
                let (value, error) = shown(*e);
                html! { td.n { (data(e.value, &value)) i { " \u{b1} " (data(e.error, &error)) } } }
            }
        }
    }
}

fn data(value: f64, shown: &str) -> Markup {
    html! { data value=(number(value)) { (shown) } }
}

/// An estimate with the digits that its error supports: two of the error, and the value to the same place.
fn shown(e: Estimate) -> (String, String) {
    if !(e.error > 0.0 && e.error.is_finite() && e.value.is_finite()) {
        return (rounded(e.value), rounded(e.error));
    }
    let place = 1 - e.error.log10().floor() as i32;
    match place {
        0..=6 if e.value.abs() < 1e5 => {
            (format!("{:.*}", place as usize, e.value), format!("{:.*}", place as usize, e.error))
        }
        _ => (rounded(e.value), rounded(e.error)),
    }
}

/// A number with the number of digits of both forms; empty if it is unknown.
fn number(v: f64) -> String {
    if !v.is_finite() {
        return String::new();
    }
    // Conversion by the decimal form: the written number is exactly the rounded one.
    let short = format!("{v:.*e}", DIGITS - 1).parse::<f64>().unwrap_or(v);
    let plain = format!("{short}");
    if plain.len() <= 14 { plain } else { format!("{short:e}") }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let e = |value, error| Cell::Estimate(Estimate { value, error });
        Table {
            name: "t",
            columns: vec![column("name", "a <name>", ""), column("x", "x", "s"), estimate("y", "y", "DN\u{b2}")],
            rows: vec![
                vec![Cell::Text("a,\"b\"".into()), Cell::Number(1.0 / 3.0), e(123.4567, 0.0789)],
                vec![Cell::Text("plain".into()), Cell::Number(f64::NAN), e(1.5e-12, f64::INFINITY)],
                vec![Cell::Text("<&>".into()), Cell::Number(3e20), e(-7.0, 0.0)],
            ],
        }
    }

    #[test]
    fn csv_and_html_hold_the_same_numbers() {
        let table = table();
        let csv = table.csv();
        assert!(csv.starts_with("name,x,y,y_error\r\n\"a,\"\"b\"\"\",0.333333,123.457,0.0789\r\n"), "{csv}");
        let html = table.render().into_string();
        let document = roxmltree::Document::parse(&html).unwrap_or_else(|e| panic!("{e}: {html}"));
        let shown: Vec<&str> = document.descendants().filter_map(|n| n.attribute("value")).collect();
        let written: Vec<&str> = csv.lines().skip(1).flat_map(|line| line.rsplitn(4, ',').take(3)).collect();
        let sorted = [shown.clone(), written].map(|mut v| {
            v.sort_unstable();
            v
        });
        assert_eq!(sorted[0], sorted[1]);
        assert_eq!(shown.len(), 9);
    }
}
