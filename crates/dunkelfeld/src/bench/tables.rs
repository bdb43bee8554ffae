//! The numbers of a report: the same cells as CSV for programs and as HTML for people.

use super::chart::escape;
use super::hidden::growth;
use super::results::{OFF, Point, Results, rounded};
use super::statistics::Estimate;
use std::fmt::Write;

/// Digits that are kept of every number, in both forms.
const DIGITS: usize = 6;

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    Text(String),
    Number(f64),
    Count(u64),
    /// Two columns of the CSV: the number, and its standard error.
    Estimate(Estimate),
}

/// A column: its key in the CSV, its heading, its unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    pub(super) key: &'static str,
    pub(super) heading: &'static str,
    pub(super) unit: &'static str,
    pub(super) is_estimate: bool,
}

/// A table with its file's name, without ending.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) name: &'static str,
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Vec<Cell>>,
}

const fn column(key: &'static str, heading: &'static str, unit: &'static str) -> Column {
    Column { key, heading, unit, is_estimate: false }
}

const fn estimate(key: &'static str, heading: &'static str, unit: &'static str) -> Column {
    Column { key, heading, unit, is_estimate: true }
}

impl Table {
    /// As comma-separated values (RFC 4180) with a header; numbers that are not known are empty.
    pub(super) fn csv(&self) -> String {
        let headers: Vec<String> = self
            .columns
            .iter()
            .flat_map(|c| {
                let error = c.is_estimate.then(|| format!("{}_error", c.key));
                [Some(c.key.to_string()), error]
            })
            .flatten()
            .collect();
        let mut text = headers.join(",") + "\r\n";
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .flat_map(|cell| match cell {
                    Cell::Text(t) => vec![quoted(t)],
                    Cell::Number(v) => vec![number(*v)],
                    Cell::Count(n) => vec![n.to_string()],
                    Cell::Estimate(e) => vec![number(e.value), number(e.error)],
                })
                .collect();
            text += &(cells.join(",") + "\r\n");
        }
        text
    }

    /// As an HTML table. Each number is a `data` element that carries the value of the CSV.
    pub(super) fn html(&self) -> String {
        let mut text = format!("<div class=\"scroll\"><table id=\"table-{}\"><thead><tr>", self.name);
        for c in &self.columns {
            let unit = if c.unit.is_empty() { String::new() } else { format!(" <small>{}</small>", escape(c.unit)) };
            let _ = write!(text, "<th scope=\"col\">{}{unit}</th>", escape(c.heading));
        }
        text += "</tr></thead><tbody>";
        for row in &self.rows {
            text += "<tr>";
            for cell in row {
                match cell {
                    Cell::Text(t) => {
                        let _ = write!(text, "<td>{}</td>", escape(t));
                    }
                    Cell::Number(v) => {
                        let _ = write!(text, "<td class=\"n\">{}</td>", data(*v, &rounded(*v)));
                    }
                    Cell::Count(n) => {
                        let _ = write!(text, "<td class=\"n\"><data value=\"{n}\">{n}</data></td>");
                    }
                    Cell::Estimate(e) => {
                        let (value, error) = shown(*e);
                        let error = data(e.error, &error);
                        let _ = write!(text, "<td class=\"n\">{}<i> \u{b1} {error}</i></td>", data(e.value, &value));
                    }
                }
            }
            text += "</tr>";
        }
        text + "</tbody></table></div>"
    }
}

fn data(value: f64, shown: &str) -> String {
    format!("<data value=\"{}\">{}</data>", number(value), escape(shown))
}

/// An estimate with the digits that its error leaves: two of the error, and the value to the same place.
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

/// A number in as many digits as both forms keep; empty if it is not known.
fn number(v: f64) -> String {
    if !v.is_finite() {
        return String::new();
    }
    // Through its decimal form, so that what is written is exactly what was rounded.
    let short = format!("{v:.*e}", DIGITS - 1).parse::<f64>().unwrap_or(v);
    let plain = format!("{short}");
    if plain.len() <= 14 { plain } else { format!("{short:e}") }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

/// All tables of a report.
pub(super) fn tables(r: &Results) -> [Table; 5] {
    [noise(r), hidden(r), denoised(r), stages(r), effects(r)]
}

fn noise(r: &Results) -> Table {
    let has_sensor = r.view.has_sensor();
    let mut columns = vec![
        column("strategy", "strategy", ""),
        column("spp", "samples", "per pixel"),
        column("seeds", "renders", ""),
        estimate("seconds", "time", "s"),
        estimate("variance_picture", "variance, 8-bit picture", "DN\u{b2}"),
        estimate(
            "variance_signal",
            "variance, linear",
            if has_sensor { "e\u{207b}\u{b2}" } else { "(W/(m\u{b2} sr))\u{b2}" },
        ),
        column("stated_over_measured", "stated / measured", ""),
    ];
    if has_sensor {
        columns.insert(6, estimate("variance_over_sensor", "over the sensor\u{2019}s, v/s", ""));
        columns.push(column("hidden_half", "hidden at k = 0.5", "share"));
    }
    let rows = r.points.iter().map(|p| {
        let mut row = vec![
            Cell::Text(p.strategy.name().into()),
            Cell::Count(p.spp.into()),
            Cell::Count(p.seeds as u64),
            Cell::Estimate(p.seconds),
            Cell::Estimate(p.picture),
            Cell::Estimate(p.signal),
        ];
        row.extend(p.ratio.map(Cell::Estimate));
        row.push(Cell::Number(p.stated));
        row.extend(p.hidden.map(Cell::Number));
        row
    });
    Table { name: "noise", columns, rows: rows.collect() }
}

fn denoised(r: &Results) -> Table {
    let has_sensor = r.view.has_sensor();
    let unit = if has_sensor { "over the sensor\u{2019}s variance" } else { "(W/(m\u{b2} sr))\u{b2}" };
    let columns = vec![
        column("strategy", "strategy", ""),
        column("denoiser", "denoiser", ""),
        column("spp", "samples", "per pixel"),
        column("seeds", "renders", ""),
        estimate("seconds", "time", "s"),
        estimate("variance_picture", "variance, 8-bit picture", "DN\u{b2}"),
        estimate("squared_error", "squared error", unit),
        column("error_over_off", "over that without", ""),
        column("noise_share", "of which noise", "%"),
    ];
    let off = |p: &Point| {
        let same = |q: &&Point| (q.strategy, q.spp, q.denoiser) == (p.strategy, p.spp, OFF);
        r.denoised.iter().find(same).and_then(|q| q.squared_error).map_or(f64::NAN, |e| e.value)
    };
    let rows = r.denoised.iter().map(|p| {
        let error = p.squared_error.unwrap_or(Estimate { value: f64::NAN, error: f64::NAN });
        let noise = p.ratio.unwrap_or(p.signal);
        vec![
            Cell::Text(p.strategy.name().into()),
            Cell::Text(p.denoiser.into()),
            Cell::Count(p.spp.into()),
            Cell::Count(p.seeds as u64),
            Cell::Estimate(p.seconds),
            Cell::Estimate(p.picture),
            Cell::Estimate(error),
            Cell::Number(error.value / off(p)),
            Cell::Number(100.0 * noise.value / error.value),
        ]
    });
    Table { name: "denoised", columns, rows: rows.collect() }
}

fn hidden(r: &Results) -> Table {
    let columns = vec![
        column("k", "k", ""),
        column("noise_growth", "total noise", "% above the sensor\u{2019}s"),
        column("strategy", "strategy", ""),
        estimate("spp", "samples", "per pixel"),
        estimate("seconds", "time", "s"),
        column("over_best", "over the best", ""),
    ];
    let mut rows = Vec::new();
    for (i, &k) in r.settings.levels.iter().enumerate() {
        let prices = || r.tops.iter().filter_map(|t| Some((t.strategy, t.prices.get(i)?)));
        let best = prices().map(|(_, p)| p.seconds.value).fold(f64::INFINITY, f64::min);
        rows.extend(prices().map(|(strategy, p)| {
            vec![
                Cell::Number(k),
                Cell::Number(100.0 * growth(k)),
                Cell::Text(strategy.name().into()),
                Cell::Estimate(p.spp),
                Cell::Estimate(p.seconds),
                Cell::Number(p.seconds.value / best),
            ]
        }));
    }
    Table { name: "hidden", columns, rows }
}

fn stages(r: &Results) -> Table {
    let columns = vec![
        column("strategy", "strategy", ""),
        column("spp", "samples", "per pixel"),
        column("stage", "stage", ""),
        column("seconds", "time", "s"),
        column("share", "share", "%"),
    ];
    let rows = r.tops.iter().flat_map(|t| {
        let total: f64 = t.stages.iter().map(|s| s.1).sum();
        t.stages.iter().map(move |(stage, seconds)| {
            vec![
                Cell::Text(t.strategy.name().into()),
                Cell::Count(t.spp.into()),
                Cell::Text(stage.clone()),
                Cell::Number(*seconds),
                Cell::Number(100.0 * seconds / total),
            ]
        })
    });
    Table { name: "stages", columns, rows: rows.collect() }
}

fn effects(r: &Results) -> Table {
    let unit = if r.view.has_sensor() { "DN" } else { "W/(m\u{b2} sr)" };
    let gain = r.view.gain().unwrap_or(1.0);
    let mut columns = vec![
        column("effect", "left out", ""),
        column("seeds", "renders", ""),
        estimate("seconds_saved", "time saved", "s"),
        column("share_saved", "of the whole", "%"),
        estimate("bias_mean", "bias, mean", unit),
        column("bias_p99", "bias, 99 %", unit),
        column("bias_p99_noise", "of which noise", unit),
    ];
    if r.view.has_sensor() {
        columns.extend([
            column("sigma_rms", "bias, rms", "sensor \u{3c3}"),
            column("sigma_p99", "bias, 99 %", "sensor \u{3c3}"),
            column("sigma_p99_noise", "of which noise", "sensor \u{3c3}"),
            column("visible", "can this camera tell?", ""),
        ]);
    }
    let rows = r.ablations.iter().map(|a| {
        let b = &a.bias;
        let mut row = vec![
            Cell::Text(a.effect.name().into()),
            Cell::Count(a.seeds as u64),
            Cell::Estimate(a.saved),
            Cell::Number(100.0 * a.saved.value / a.whole.value),
            Cell::Estimate(b.mean.scaled(gain)),
            Cell::Number(b.p99 * gain),
            Cell::Number(b.noise * gain),
        ];
        if let Some(verdict) = b.verdict {
            row.extend([b.rms_sigma, b.p99_sigma, b.noise_sigma].map(Cell::Number));
            row.push(Cell::Text(verdict.words().into()));
        }
        row
    });
    Table { name: "effects", columns, rows: rows.collect() }
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
        let html = table.html();
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

    #[test]
    fn numbers_keep_six_digits_and_errors_two() {
        assert_eq!(
            [number(0.1), number(123_456.7), number(1e-9), number(f64::NAN)],
            ["0.1", "123457", "0.000000001", ""]
        );
        assert_eq!(number(1.234_567_89e-15), "1.23457e-15");
        let pair = |value, error| shown(Estimate { value, error });
        assert_eq!(pair(123.4567, 0.0789), ("123.457".into(), "0.079".into()));
        assert_eq!(pair(12345.6, 780.0).0, "12346");
        assert_eq!(pair(2.0, f64::NAN), ("2.00".into(), "-".into()));
    }
}
