//! The charts and maps of a report, from its results.

use super::ablation::Bias;
use super::hidden::growth;
use super::results::{Look, OFF, Point, Results, Top, shown_strategy};
use crate::report::estimate::Estimate;
use crate::report::maps::{self, Map};
use dunkelfeld::Error;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::film::Plane;
use dunkelfeld_report::chart::bars::{self, Bar};
use dunkelfeld_report::chart::dots::{self, Dot, Row};
use dunkelfeld_report::chart::lines::{self, Axes, Mark, Series};
use dunkelfeld_report::chart::{Chart, HOLLOW};
use dunkelfeld_report::words::rounded;

/// Limit of the colour scale of a bias map, in standard deviations of the sensor.
const BIAS_REACH: f64 = 3.0;

/// The colour of a strategy: the same in every chart, for any set of strategies.
pub(super) fn color_of(strategy: Strategy) -> usize {
    let place = Strategy::ALL.iter().position(|s| *s == strategy).unwrap_or(0);
    if place < HOLLOW { place } else { place + 1 }
}

/// A measure of noise.
struct Measure {
    key: &'static str,
    axis: String,
    of: fn(&Point) -> Option<Estimate>,
}

fn measures(r: &Results) -> Vec<Measure> {
    let linear = if r.view.has_sensor() { "e\u{207b}\u{b2}" } else { "(W/(m\u{b2} sr))\u{b2}" };
    let picture = "variance of the 8-bit picture [DN\u{b2}]".into();
    let mut all = vec![
        Measure { key: "picture", axis: picture, of: |p| Some(p.picture) },
        Measure { key: "signal", axis: format!("variance of the signal [{linear}]"), of: |p| Some(p.signal) },
    ];
    if r.view.has_sensor() {
        let axis = "variance over the sensor\u{2019}s, v/s".into();
        all.push(Measure { key: "sensor", axis, of: |p| p.ratio });
    }
    all
}

/// Noise against time and against samples: for each measure a pair.
pub(super) fn noise(r: &Results) -> Vec<[Chart; 2]> {
    let chart = |measure: &Measure, by_time: bool| {
        let series: Vec<Series> = r
            .settings
            .strategies
            .iter()
            .map(|&strategy| {
                let marks = r.points.iter().filter(|p| p.strategy == strategy).filter_map(|p| {
                    let noise = (measure.of)(p)?;
                    let x = if by_time { p.seconds.value } else { f64::from(p.spp) };
                    let hint = format!(
                        "{strategy}, {} samples per pixel, {} s, {} renders: {} \u{b1} {}",
                        p.spp,
                        rounded(p.seconds.value),
                        p.seeds,
                        rounded(noise.value),
                        rounded(noise.error)
                    );
                    Some(Mark { x, y: noise.value, error: noise.error, hint })
                });
                Series { color: color_of(strategy), name: strategy.name().into(), marks: marks.collect() }
            })
            .filter(|s| !s.marks.is_empty())
            .collect();
        let is_ratio = measure.key == "sensor";
        let levels = r.settings.levels().iter().filter(|_| is_ratio).map(|k| (k * k, format!("k = {k}"))).collect();
        let (x, slope, against) = if by_time {
            ("time of one render [s]", "1 / time", "time")
        } else {
            ("samples per pixel, on average", "1 / samples", "samples")
        };
        let axes = Axes { x, y: &measure.axis, levels, slope };
        let title = format!("{} against {against}", measure.axis);
        lines::draw(&format!("noise-{}-{against}", measure.key), &title, &axes, &series)
    };
    measures(r).iter().map(|m| [chart(m, true), chart(m, false)]).collect()
}

/// Effect of denoisers on the variance and the error, against time, with one strategy.
pub(super) fn denoised(r: &Results) -> Vec<Chart> {
    let Some(strategy) = shown_strategy(r.settings.strategies()).filter(|_| !r.denoised.is_empty()) else {
        return Vec::new();
    };
    let has_sensor = r.view.has_sensor();
    let error = if has_sensor {
        "squared error over the sensor\u{2019}s variance"
    } else {
        "squared error [(W/(m\u{b2} sr))\u{b2}]"
    };
    let measures = [
        Measure { key: "picture", axis: "variance of the 8-bit picture [DN\u{b2}]".into(), of: |p| Some(p.picture) },
        Measure { key: "error", axis: error.into(), of: |p| p.squared_error },
    ];
    let names = || [OFF].into_iter().chain(r.denoisers.iter().map(|d| d.0));
    let chart = |measure: &Measure| {
        let series = names().enumerate().map(|(i, name)| {
            let points = r.denoised.iter().filter(|p| p.strategy == strategy && p.denoiser == name);
            let marks = points.filter_map(|p| {
                let noise = (measure.of)(p)?;
                let hint = format!(
                    "{name}, {} samples per pixel, {} s: {} \u{b1} {}",
                    p.spp,
                    rounded(p.seconds.value),
                    rounded(noise.value),
                    rounded(noise.error)
                );
                Some(Mark { x: p.seconds.value, y: noise.value, error: noise.error, hint })
            });
            // Without denoising, the line has the colour of its strategy. The others have the colours that no strategy
            // has, then the hollow mark.
            let color = [color_of(strategy), Strategy::ALL.len() + 1, HOLLOW][i.min(2)];
            let name = if name == OFF { format!("{strategy}, not denoised") } else { name.into() };
            Series { color, name, marks: marks.collect() }
        });
        let series: Vec<Series> = series.filter(|s| !s.marks.is_empty()).collect();
        let levels = r.settings.levels().iter().filter(|_| has_sensor && measure.key == "error");
        let levels = levels.map(|k| (k * k, format!("k = {k}"))).collect();
        let axes = Axes { x: "time of one render, denoised [s]", y: &measure.axis, levels, slope: "1 / time" };
        let title = format!("{} against time, with and without denoiser", measure.axis);
        lines::draw(&format!("denoised-{}", measure.key), &title, &axes, &series)
    };
    measures.iter().map(chart).collect()
}

/// Variance between renders with and without denoiser, for the smallest and the largest sample count, on one scale.
pub(super) fn denoised_maps(r: &Results) -> Result<Vec<Map>, Error> {
    let Some(like) = r.looks.iter().find(|l| l.denoiser == OFF) else { return Ok(Vec::new()) };
    let map = |look: &Look| {
        let caption =
            format!("variance between renders, {}, {} samples per pixel", denoiser_words(look.denoiser), look.spp);
        maps::logarithmic(&look.picture_variance, &like.picture_variance, "DN\u{b2}", caption)
    };
    r.looks.iter().map(map).collect()
}

/// A description of the processing of a render.
pub(super) fn denoiser_words(denoiser: &str) -> String {
    if denoiser == OFF { "not denoised".into() } else { format!("denoised by {denoiser}") }
}

/// The time until hidden.
pub(super) fn hidden(r: &Results) -> Option<Chart> {
    let mut levels: Vec<f64> = r.settings.levels().to_vec();
    levels.sort_by(|a, b| b.total_cmp(a));
    let rows: Vec<Row> = levels
        .iter()
        .map(|&k| {
            let dots = r.tops.iter().filter_map(|t| {
                let price = t.prices.iter().find(|p| p.k == k)?;
                let (spp, seconds) = (price.spp, price.seconds);
                let hint = format!(
                    "{}, k = {k}: {} \u{b1} {} s, {} samples per pixel",
                    t.strategy,
                    rounded(seconds.value),
                    rounded(seconds.error),
                    rounded(spp.value)
                );
                Some(Dot { series: color_of(t.strategy), x: seconds.value, error: seconds.error, hint })
            });
            Row { name: format!("k = {k} (+{:.1} %)", 100.0 * growth(k)), dots: dots.collect(), spread: true }
        })
        .filter(|row| !row.dots.is_empty())
        .collect();
    let legend: Vec<_> = r.tops.iter().map(|t| (color_of(t.strategy), t.strategy.name().to_string())).collect();
    let title = "time until the noise of the render is hidden by the noise of the sensor";
    (!rows.is_empty()).then(|| dots::draw("hidden", title, "time until hidden [s]", None, &legend, &rows))
}

/// Time by stage.
pub(super) fn stages(r: &Results) -> Option<Chart> {
    let names = ["pilot", "plan", "refine", "expose", "write"];
    let bars: Vec<Bar> = r
        .tops
        .iter()
        .map(|t| {
            let seconds = |stage: &str| t.stages.iter().find(|(name, _)| name == stage).map_or(0.0, |(_, s)| *s);
            Bar { name: t.strategy.name().into(), parts: names.iter().map(|n| seconds(n)).collect() }
        })
        .collect();
    let title = "time of a render by stage";
    (!bars.is_empty()).then(|| bars::draw("stages", title, "time of one render [s]", &names, &bars))
}

/// The bias of each effect, with its noise.
pub(super) fn effects(r: &Results) -> Option<Chart> {
    let has_sensor = r.view.has_sensor();
    let unit = if has_sensor {
        "bias that 99 % of the pixels do not exceed [sensor \u{3c3}]"
    } else {
        "bias, 99 % [W/(m\u{b2} sr)]"
    };
    let rows: Vec<Row> = r
        .ablations
        .iter()
        .map(|a| {
            let b = &a.bias;
            let hint = |x, what: &str| format!("without {}: {what} {}", a.effect.name(), rounded(x));
            let dot = |series, x, what: &str| Dot { series, x, error: 0.0, hint: hint(x, what) };
            let dots = vec![dot(HOLLOW, b.noise_sigma, "noise alone"), dot(1, b.p99_sigma, "bias")];
            Row { name: a.effect.name().into(), dots, spread: false }
        })
        .collect();
    let legend = [(1, "bias, noise included".to_string()), (HOLLOW, "noise alone".to_string())];
    let level = has_sensor.then_some((1.0, "noise of one frame"));
    (!rows.is_empty()).then(|| dots::draw("effects", "what leaving out an effect changes", unit, level, &legend, &rows))
}

/// The maps of noise and samples, in the order of the paper: variance, Sobel, samples.
pub(super) fn samples(r: &Results) -> Result<Vec<Map>, Error> {
    let mut maps = Vec::new();
    let uniform = r.tops.iter().find(|t| t.strategy == Strategy::Uniform);
    let Some(plain) = uniform.or(r.tops.first()) else { return Ok(maps) };
    let variance = |top: &Top| {
        let caption = format!("variance between renders, {}, {} samples per pixel", top.strategy, top.spp);
        maps::logarithmic(&top.picture_variance, &plain.picture_variance, "DN\u{b2}", caption)
    };
    maps.push(variance(plain)?);
    if let (Some((sobel, correlation)), Some((spp, _))) = (&r.sobel, &r.pilot) {
        let mut caption = format!("Sobel magnitude of the pilot, {spp} samples per pixel");
        if correlation.is_finite() {
            caption += &format!("; rank correlation with the variance {correlation:.2}");
        }
        maps.push(maps::linear(&sobel.map(|&v| f64::from(v)), "DN/pixel", caption)?);
    }
    for top in r.tops.iter().filter(|t| t.strategy != plain.strategy) {
        let caption = format!("samples per pixel, {}, {} on average", top.strategy, top.spp);
        let counts = top.counts.map(|&n| f64::from(n));
        maps.push(maps::logarithmic(&counts, &counts, "samples", caption)?);
        maps.push(variance(top)?);
    }
    Ok(maps)
}

/// The map of the bias of an effect.
pub(super) fn bias(r: &Results, name: &str, bias: &Bias) -> Result<Map, Error> {
    let plane: Plane<f64> = bias.map.map(|&v| f64::from(v));
    let (reach, unit) =
        if r.view.has_sensor() { (BIAS_REACH, "\u{3c3}") } else { (bias.p99.max(1e-9), "W/(m\u{b2} sr)") };
    maps::signed(&plane, reach, unit, format!("without {name}"))
}
