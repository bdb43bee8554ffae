//! The noise and the cost of a set: certificates, matched exposures, times by stage, and bytes by folder.

use super::summary::Summary;
use super::table::table;
use super::view::SetView;
use dunkelfeld_report::bins::Bins;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::bars::{self, Bar};
use dunkelfeld_report::chart::counts::{Fill, histogram};
use dunkelfeld_report::page::charts;
use dunkelfeld_report::words::{bytes, duration, rounded, shortened};
use maud::{Markup, html};

/// The stages in the order of their work, with their words.
const STAGES: [(&str, &str); 5] = [
    ("change", "change the scene"),
    ("render", "render"),
    ("expose", "expose"),
    ("label", "label"),
    ("write", "write files"),
];
/// The stage that is the sum of all.
const TOTAL: &str = "total";
/// Maximum number of rows of a table.
const ROWS: usize = 40;

/// The mean time of an image [s]. None without costs.
pub(crate) fn image_seconds(set: &SetView) -> Option<f64> {
    let mean = |name: &str| set.costs.get(name).map(|v| Summary::of(v.iter().copied()).mean);
    let sum = || {
        let parts: Vec<f64> = set.costs.keys().filter_map(|name| mean(name)).collect();
        (!parts.is_empty()).then(|| parts.iter().sum())
    };
    mean(TOTAL).or_else(sum).filter(|s| s.is_finite())
}

/// The section of the noise of the renders. Empty without certificates and matched shares.
pub(crate) fn noise_section(set: &SetView) -> Markup {
    let share = |heading: &str, axis: &str, color, values: &[f64]| -> Option<Chart> {
        let bins = Bins::of(values);
        let median = Summary::of(values.iter().copied()).median;
        let heading = format!("{heading}, median {}", rounded(median));
        (!values.is_empty()).then(|| histogram(&heading, axis, "images", Fill::Series(color), &bins, &[]))
    };
    let ks: Vec<&str> = set.ks.iter().take(6).map(String::as_str).collect();
    let axis = match ks.as_slice() {
        [] => "share of hidden pixels".into(),
        ks => format!("share of pixels that are hidden at k = {}", ks.join(", ")),
    };
    let drawn = [share("Hidden", &axis, 2, &set.hidden), share("Matched", "matched share", 3, &set.matched)];
    let drawn: Vec<Chart> = drawn.into_iter().flatten().collect();
    html! {
        @if !drawn.is_empty() {
            section {
                h2 { "Noise of the renders" }
                p { "A pixel is hidden at k if the variance of the render is at most k\u{b2} times the variance of the \
                    sensor. A matched exposure adds the noise of the camera less the noise of the render, so that the \
                    total variance is that of EMVA 1288. The matched share is the share of the pixels for which this \
                    is possible." }
                (charts(&drawn))
            }
        }
    }
}

/// The section of times and bytes. Empty without both.
pub(crate) fn cost_section(set: &SetView) -> Markup {
    html! {
        @if !set.costs.is_empty() || !set.bytes.is_empty() {
            section {
                h2 { "Cost" }
                (times(set))
                (sizes(set))
            }
        }
    }
}

/// The stages with their words: the known ones in their order, then others, the total last.
fn stages(set: &SetView) -> Vec<(&str, &str)> {
    let known = STAGES.into_iter().filter(|(name, _)| set.costs.contains_key(*name));
    let is_other = |name: &&String| *name != TOTAL && STAGES.iter().all(|(known, _)| known != name);
    let others = set.costs.keys().filter(is_other).map(|name| (name.as_str(), name.as_str()));
    let total = set.costs.contains_key(TOTAL).then_some((TOTAL, TOTAL));
    let mut all: Vec<(&str, &str)> = known.chain(others).collect();
    all.truncate(ROWS);
    all.extend(total);
    all
}

fn times(set: &SetView) -> Markup {
    let of = |name: &str| Summary::of(set.costs.get(name).into_iter().flatten().copied());
    let stages: Vec<(&str, String, Summary)> =
        stages(set).into_iter().map(|(name, words)| (name, shortened(words, 40), of(name))).collect();
    let parts: Vec<(&str, f64)> =
        stages.iter().filter(|s| s.0 != TOTAL).map(|s| (s.1.as_str(), s.2.mean.max(0.0))).collect();
    // More parts than colours would be ambiguous, and longer names would not fit into the legend.
    let letters: usize = parts.iter().map(|p| p.0.chars().count() + 4).sum();
    let chart = ((2..=6).contains(&parts.len()) && letters < 70).then(|| {
        let names: Vec<&str> = parts.iter().map(|p| p.0).collect();
        let bar = Bar { name: "mean".into(), parts: parts.iter().map(|p| p.1).collect() };
        bars::draw("times", "Mean time of an image by stage", "time [s]", &names, &[bar])
    });
    let rows = html! {
        @for (name, words, s) in &stages {
            tr { td.name { @if *name == TOTAL { b { (words) } } @else { (words) } }
                td.n { (rounded(s.mean)) } td.n { (rounded(s.median)) } td.n { (rounded(s.high)) } td.n { (s.n) } }
        }
    };
    let headings = [("stage", ""), ("mean", "s"), ("median", "s"), ("95 %", "s"), ("images", "")];
    html! {
        @if !stages.is_empty() {
            @if let Some(seconds) = image_seconds(set).filter(|s| *s > 0.0) {
                p { "An image needs " (duration(seconds)) " on average. One process renders "
                    (rounded(3600.0 / seconds)) " images per hour." }
            }
            @if let Some(chart) = &chart { figure.wide { (chart) } }
            (table("times", &headings, rows))
        }
    }
}

fn sizes(set: &SetView) -> Markup {
    let done = set.finished.len().max(1) as f64;
    let rows = html! {
        @for (folder, [files, total]) in set.bytes.iter().take(ROWS) {
            tr {
                td.name { @if folder.is_empty() { "(no folder)" } @else { (shortened(folder, 80)) "/" } }
                td.n { (files) }
                td.n { (bytes(*total as f64 / done)) }
                td.n { (bytes(*total as f64)) }
            }
        }
    };
    let headings = [("folder", ""), ("files", ""), ("per image", ""), ("total", "")];
    html! { @if !set.bytes.is_empty() { (table("bytes", &headings, rows)) } }
}
