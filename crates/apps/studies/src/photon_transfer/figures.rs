//! The charts and maps of a photon transfer report, in the order of the paper's figures.

use super::analysis::{CameraSeries, Curve, PictureSeries, Results};
use super::findings::name;
use crate::report::maps::{self, Map};
use crate::series::statistics::quantile;
use dunkelfeld::Error;
use dunkelfeld_emva1288::TransferPoint;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::plot::{self, Axis, Style, Trace};

const PICTURE_AXES: [&str; 2] = ["mean grey value [DN, 8 bit, gamma 2.2]", "temporal variance [DN\u{b2}]"];
pub(super) const LINEAR_AXES: [&str; 2] = ["mean grey value [DN, linear]", "temporal variance [DN\u{b2}]"];
/// Fits are drawn over their data range, 0-70 % of saturation.
const RANGE: f64 = 0.7;
/// Limit for outliers: points above this multiple of the given quantile are drawn at the multiple.
const REACH: f64 = 1.5;
const USUAL: f64 = 0.98;

/// Figure 2: the sensor's own curve.
pub(super) fn sensor(r: &Results) -> Option<Chart> {
    let sensor = r.sensor.as_ref()?;
    Some(chart(
        "sensor",
        "photon transfer of the sensor, from even light",
        LINEAR_AXES,
        &[(0, "even light", &sensor.curve)],
    ))
}

/// Figures 6 and 8: the curves of the pictures, all pixels and without strong edges.
pub(super) fn transfer(r: &Results) -> Vec<[Chart; 2]> {
    let one = |s: &PictureSeries, curve: &Curve, key: &str, words: &str| {
        let title = format!("photon transfer of pictures, {}{words}", name(s));
        // Gamma makes also a camera's curve nonlinear, so no line is drawn.
        let plain = Curve { fit: None, ..curve.clone() };
        chart(
            &format!("{key}-{}", file_part(s)),
            &title,
            PICTURE_AXES,
            &[(usize::from(s.is_denoised), &name(s), &plain)],
        )
    };
    let both = |s| [one(s, &s.curve, "transfer", ""), one(s, &s.filtered, "transfer-flat", ", without strong edges")];
    r.pictures.iter().map(both).collect()
}

/// The same pictures before gamma: expected grey values.
pub(super) fn linear(r: &Results) -> Vec<Chart> {
    let one = |s: &PictureSeries| {
        let curve = s.linear.as_ref()?;
        let title = format!("photon transfer of linear grey values, {}", name(s));
        Some(chart(
            &format!("linear-{}", file_part(s)),
            &title,
            LINEAR_AXES,
            &[(usize::from(s.is_denoised), &name(s), curve)],
        ))
    };
    r.pictures.iter().filter_map(one).collect()
}

/// Frames of the sensor: plain and matched exposure.
pub(super) fn cameras(r: &Results) -> Vec<Chart> {
    // The camera's own line is their target.
    let truth = r.sensor.as_ref().map(|sensor| Curve { points: Vec::new(), ..sensor.curve.clone() });
    let one = |s: &CameraSeries| {
        let named = [(1, "plain exposure", &s.plain), (2, "matched exposure", &s.matched)];
        let curves = named.into_iter().filter_map(|(color, name, curve)| Some((color, name, curve.as_ref()?)));
        let all: Vec<(usize, &str, &Curve)> = curves.chain(truth.iter().map(|t| (0, "", t))).collect();
        let title = format!("photon transfer of frames, {} samples per pixel", s.spp);
        chart_with(&format!("camera-{}", s.spp), &title, LINEAR_AXES, &all, true)
    };
    r.cameras.iter().map(one).collect()
}

/// Figures 5 and 7: variance and Sobel magnitude of each series. Each has its own scale, as in the paper.
pub(super) fn maps(r: &Results) -> Result<Vec<[Map; 2]>, Error> {
    let both = |s: &PictureSeries| {
        let variance = maps::logarithmic(
            &s.variance,
            &s.variance,
            "DN\u{b2}",
            format!("variance over {} frames, {}", s.frames, name(s)),
        )?;
        let sobel = s.sobel.map(|&v| f64::from(v));
        Ok([variance, maps::linear(&sobel, "DN/pixel", format!("Sobel magnitude of one frame, {}", name(s)))?])
    };
    r.pictures.iter().map(both).collect()
}

/// Part of a file's name.
fn file_part(s: &PictureSeries) -> String {
    format!("{}{}", s.spp, if s.is_denoised { "-denoised" } else { "" })
}

pub(super) fn chart(name: &str, title: &str, axes: [&str; 2], curves: &[(usize, &str, &Curve)]) -> Chart {
    chart_with(name, title, axes, curves, false)
}

/// Curves with their lines; of the last one only the line if `last_is_truth`.
fn chart_with(
    name: &str,
    title: &str,
    axes: [&str; 2],
    curves: &[(usize, &str, &Curve)],
    last_is_truth: bool,
) -> Chart {
    let mut traces = Vec::new();
    for (color, name, curve) in curves.iter().filter(|(_, _, curve)| !curve.points.is_empty()) {
        let points = within_reach(&curve.points);
        traces.push(Trace { color: *color, name: (*name).to_string(), style: Style::Points, points });
    }
    let lined = if last_is_truth { &curves[curves.len().saturating_sub(1)..] } else { curves };
    let words = if last_is_truth { "the sensor\u{2019}s line" } else { "line through 0\u{2013}70 %" };
    for (color, _, curve) in lined {
        if let Some(fit) = &curve.fit {
            let [dark, full] = curve.range;
            // The fit is over grey values above the dark level.
            let at = |x: f64| [x, fit.intercept.value + fit.slope.value * (x - dark)];
            let points = vec![at(dark), at(dark + RANGE * (full - dark))];
            traces.push(Trace { color: *color, name: words.into(), style: Style::Dashed, points });
        }
    }
    let axes = axes.map(|label| Axis { label, is_log: false, has_zero: true });
    plot::draw(name, title, axes, &traces)
}

/// The points of a curve. The few that are far above all others are drawn at the upper limit, because they would
/// compress the rest.
fn within_reach(points: &[TransferPoint]) -> Vec<[f64; 2]> {
    let usual = quantile(points.iter().map(|p| p.variance).collect(), USUAL);
    points.iter().map(|p| [p.mean, p.variance.min(REACH * usual)]).collect()
}
