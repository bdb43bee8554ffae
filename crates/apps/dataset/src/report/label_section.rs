//! The labels of a set: a table of the categories, contrast-to-noise ratios, and visible shares.

use super::page::swatch;
use super::summary::Summary;
use super::table::table;
use super::view::{Instance, Labels, SetView};
use dunkelfeld_report::bins::Bins;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::counts::{Fill, histogram};
use dunkelfeld_report::page::charts;
use dunkelfeld_report::words::{counted, percent, rounded, shortened};
use maud::{Markup, html};

/// Contrast-to-noise ratios with a share in the table.
const LEVELS: [f64; 3] = [1.0, 3.0, 5.0];
/// Maximum number of histograms of categories.
const CHARTS: usize = 24;
/// Number of bins of the contrast-to-noise ratio.
const BINS: usize = 20;
/// The lowest contrast-to-noise ratio of a histogram. Lower ones are counted as unseen.
const LOWEST: f64 = 0.01;

/// A category with its position and its labels.
struct Row<'a> {
    position: usize,
    name: &'a str,
    is_defect: bool,
    labels: &'a Labels,
}

/// The categories, those of defects first.
fn rows<'a>(set: &'a SetView<'_>) -> Vec<Row<'a>> {
    let categories = set.set.manifest().categories.iter().zip(&set.labels).enumerate();
    let mut rows: Vec<Row<'_>> = categories
        .map(|(position, (c, labels))| Row { position, name: &c.name, is_defect: c.is_defect, labels })
        .collect();
    rows.sort_by_key(|r| !r.is_defect);
    rows
}

/// The share of the defects with a contrast-to-noise ratio above three. None if none is known.
pub(crate) fn findable(set: &SetView<'_>) -> Option<f64> {
    let rows = rows(set);
    let defects = rows.iter().filter(|r| r.is_defect).flat_map(|r| &r.labels.instances);
    share_above(defects, 3.0)
}

/// The share of the known contrast-to-noise ratios above a level.
fn share_above<'a>(instances: impl Iterator<Item = &'a Instance>, level: f64) -> Option<f64> {
    let known = instances.map(|i| f64::from(i.cnr)).filter(|v| v.is_finite());
    let (above, n) = known.fold((0_u64, 0_u64), |(above, n), v| (above + u64::from(v > level), n + 1));
    (n > 0).then(|| above as f64 / n as f64)
}

/// The section of the labels.
pub(crate) fn label_section(set: &SetView<'_>) -> Markup {
    let rows = rows(set);
    let cnr = cnr_charts(&rows);
    let unseen = rows.iter().filter(|r| r.is_defect).flat_map(|r| &r.labels.instances);
    let unseen = unseen.filter(|i| f64::from(i.cnr) < LOWEST).count() as u64;
    html! {
        section {
            h2 { "Labels" }
            @if rows.is_empty() {
                p { "The set has no categories." }
            } @else {
                (categories(set, &rows))
                p.faint { "CNR is the contrast-to-noise ratio: the magnitude of the contrast divided by the noise. A \
                    camera could find an instance whose CNR is high enough. Rose's criterion is 5. An instance without \
                    visible pixels has the CNR 0, and one whose CNR is unknown is not counted. Ranges contain 90 % of the \
                    values." }
            }
            @if !cnr.is_empty() {
                h3 { "Contrast-to-noise ratio of defects" }
                p.faint { "The dotted lines are at 1, 3 and 5. All axes are equal." }
                (charts(&cnr))
                @if unseen > 0 {
                    p.faint { "Not drawn: " (counted(unseen, "defect")) " with a CNR below " (LOWEST) "." }
                }
            }
        }
    }
}

fn categories(set: &SetView<'_>, rows: &[Row<'_>]) -> Markup {
    let done = set.finished.len() as f64;
    let range = |values: Summary, text: fn(f64) -> String| {
        html! {
            @if values.n == 0 { "-" } @else {
                (text(values.median)) br; small { (text(values.low)) " to " (text(values.high)) }
            }
        }
    };
    let above = |labels: &Labels, level| share_above(labels.instances.iter(), level).map_or("-".into(), percent);
    let of =
        |labels: &Labels, part: fn(&Instance) -> f32| Summary::of(labels.instances.iter().map(|i| f64::from(part(i))));
    let body = html! {
        @for row in rows {
            tr {
                td.name { (swatch(row.position)) (shortened(row.name, 80)) br;
                    small { @if row.is_defect { "defect" } @else { "object" } } }
                td.n { (row.labels.instances.len()) }
                td.n { (row.labels.images) br; small { (percent(row.labels.images as f64 / done)) } }
                td.n { (range(of(row.labels, |i| i.size), rounded)) }
                td.n { (range(of(row.labels, |i| i.visible), |v| format!("{v:.0}"))) }
                td.n { (range(of(row.labels, |i| i.contrast), rounded)) }
                @for level in LEVELS { td.n { (above(row.labels, level)) } }
            }
        }
    };
    let headings = [
        ("category", ""),
        ("instances", ""),
        ("images", ""),
        ("size", "mm, median"),
        ("visible", "pixels, median"),
        ("contrast", "DN, median"),
        ("CNR > 1", "share"),
        ("CNR > 3", "share"),
        ("CNR > 5", "share"),
    ];
    table("categories", &headings, body)
}

/// Histograms of the categories of defects on the same axis.
fn cnr_charts(rows: &[Row<'_>]) -> Vec<Chart> {
    let usable = |row: &Row<'_>| -> Vec<f64> {
        let known = row.labels.instances.iter().map(|i| f64::from(i.cnr));
        known.filter(|v| v.is_finite() && *v >= LOWEST).collect()
    };
    let all: Vec<(&Row<'_>, Vec<f64>)> =
        rows.iter().filter(|r| r.is_defect).map(|r| (r, usable(r))).filter(|(_, v)| !v.is_empty()).collect();
    let ends = |(a, b): (f64, f64), v: &f64| (a.min(*v), b.max(*v));
    // The axis contains the levels.
    let (low, high) = all.iter().flat_map(|(_, values)| values).fold((0.5, 10.0), ends);
    let levels = [(1.0, "1"), (3.0, "3"), (5.0, "5")];
    let chart = |(row, values): &(&Row<'_>, Vec<f64>)| {
        let bins = Bins::within(values, low, high * 1.0001, BINS, true);
        let heading = format!("{}, {}", shortened(row.name, 32), counted(values.len() as u64, "instance"));
        let fill = Fill::Category(row.position);
        histogram(&heading, "CNR, logarithmic", "instances", fill, &bins, &levels)
    };
    all.iter().take(CHARTS).map(chart).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instance(cnr: f32) -> Instance {
        Instance { visible: 10.0, contrast: 1.0, cnr, size: f32::NAN }
    }

    #[test]
    fn shares_are_of_the_known_ratios() {
        let all = [0.0, 1.0, 1.5, 4.0, f32::NAN].map(instance);
        assert_eq!([1.0, 3.0, 5.0].map(|level| share_above(all.iter(), level)), [Some(0.5), Some(0.25), Some(0.0)]);
        assert_eq!(share_above([instance(f32::NAN)].iter(), 1.0), None);
    }

    #[test]
    fn charts_have_the_instances_that_they_can_show() {
        let labels = Labels { instances: [0.0, 0.2, 2.0, 9.0, f32::NAN].map(instance).into(), images: 1 };
        let row = |is_defect| Row { position: 0, name: "a <b>", is_defect, labels: &labels };
        let charts = cnr_charts(&[row(true), row(false)]);
        assert_eq!(charts.len(), 1);
        assert!(charts[0].title.contains("3 instances"), "{}", charts[0].title);
    }

    #[test]
    fn a_category_has_one_colour_in_images_legend_and_charts() {
        let (chart, page) = (dunkelfeld_report::chart::STYLE, include_str!("style.css"));
        for i in 0..dunkelfeld_report::chart::COLORS {
            let color = |text: &str, key: String| {
                let after = text.split_once(&key).unwrap_or_else(|| panic!("{key}")).1;
                after.split_once(';').expect("an end").0.to_owned()
            };
            let [fill, stroke] =
                [color(chart, format!(".fill.k{i} {{ fill: ")), color(page, format!(".o{i} {{ stroke: "))];
            assert_eq!(fill, stroke);
        }
    }
}
