//! The noise and the cost of a set: certificates, matched exposures, and times by stage.

use super::summary::Summary;
use super::table::table;
use super::view::SetView;
use crate::record::Cost;
use dunkelfeld_report::bins::Bins;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::bars::{self, Bar};
use dunkelfeld_report::chart::counts::{Fill, histogram};
use dunkelfeld_report::page::charts;
use dunkelfeld_report::words::{duration, rounded};
use maud::{Markup, html};

/// A stage of an image in words, and its seconds.
type Part = (&'static str, fn(&Cost) -> f64);

/// The stages of an image in the order of their work.
const STAGES: [Part; 6] = [
    ("change the scene", |c| c.change),
    ("render", |c| c.render),
    ("plan", |c| c.plan),
    ("expose", |c| c.expose),
    ("label", |c| c.label),
    ("write files", |c| c.write),
];

/// The mean time of an image [s]. None without costs.
pub(crate) fn image_seconds(set: &SetView<'_>) -> Option<f64> {
    Some(Summary::of(set.costs.iter().map(|cost| cost.total)).mean).filter(|s| *s > 0.0)
}

/// The section of the noise of the renders. Empty without certificates and matched shares.
pub(crate) fn noise_section(set: &SetView<'_>) -> Markup {
    let share = |heading: &str, axis: &str, color, values: &[f64]| -> Option<Chart> {
        let bins = Bins::of(values);
        let median = Summary::of(values.iter().copied()).median;
        let heading = format!("{heading}, median {}", rounded(median));
        (!values.is_empty()).then(|| histogram(&heading, axis, "images", Fill::Series(color), &bins, &[]))
    };
    let ks: Vec<&str> = set.ks.iter().take(6).map(String::as_str).collect();
    let axis = format!("share of pixels that are hidden at k = {}", ks.join(", "));
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

/// The section of times. Empty without costs.
pub(crate) fn cost_section(set: &SetView<'_>) -> Markup {
    let of = |part: fn(&Cost) -> f64| Summary::of(set.costs.iter().map(part));
    let stages = STAGES.map(|(words, part)| (words, of(part)));
    let bar = Bar { name: "mean".into(), parts: stages.iter().map(|(_, s)| s.mean.max(0.0)).collect() };
    let rows = html! {
        @for (words, s) in stages.iter().chain([&("total", of(|c| c.total))]) {
            tr { td.name { @if *words == "total" { b { (words) } } @else { (words) } }
                td.n { (rounded(s.mean)) } td.n { (rounded(s.median)) } td.n { (rounded(s.high)) } td.n { (s.n) } }
        }
    };
    let noise = set.measured.price(set.set.count(), 1, 1).and_then(|price| price.noise());
    let headings = [("stage", ""), ("mean", "s"), ("median", "s"), ("95 %", "s"), ("images", "")];
    html! {
        @if let Some(seconds) = image_seconds(set) {
            section {
            h2 { "Cost" }
            p { "An image needs " (duration(seconds)) " on average. One process renders "
                (rounded(3600.0 / seconds)) " images per hour."
                @if let Some(noise) = &noise { " On average " (noise) "." } }
            figure.wide {
                (bars::draw("times", "Mean time of an image by stage", "time [s]", &stages.map(|(words, _)| words), &[bar]))
            }
            (table("times", &headings, rows))
            }
        }
    }
}
