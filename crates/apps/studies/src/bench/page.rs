//! The report as one page that needs no other file: no script, style, font or picture from other sources. Beside it,
//! its numbers as CSV and its charts as SVG.

use super::figures;
use super::hidden::{SHARE, growth};
use super::results::{OFF, Results};
use super::statistics::POOL;
use super::tables::tables;
use crate::report::maps::{Map, grey};
use crate::report::page::{maps, page, with_file, write as write_report};
use crate::report::table::Table;
use dunkelfeld::Error;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::page::{charts, facts, head, picture, tiles};
use dunkelfeld_report::words::rounded;
use maud::{Markup, html};
use std::path::{Path, PathBuf};

/// Writes the page, the tables and the charts into a folder. Returns the files, the page first.
pub(super) fn write(folder: &Path, results: &Results) -> Result<Vec<PathBuf>, Error> {
    let report = Report::new(results)?;
    let tables = report.tables.iter().filter(|t| !t.rows.is_empty()).map(|t| (t.name, t.csv()));
    write_report(folder, &report.html(), tables, report.charts())
}

/// A picture: its name, its address and its size.
type Shown = (String, String, [u32; 2]);

/// The content of the page.
struct Report<'a> {
    r: &'a Results,
    tables: [Table; 5],
    noise: Vec<[Chart; 2]>,
    hidden: Option<Chart>,
    denoised: Vec<Chart>,
    denoised_maps: Vec<Map>,
    stages: Option<Chart>,
    effects: Option<Chart>,
    samples: Vec<Map>,
    biases: Vec<Map>,
    pictures: Vec<Shown>,
}

impl<'a> Report<'a> {
    fn new(r: &'a Results) -> Result<Self, Error> {
        let biases =
            r.ablations.iter().map(|a| figures::bias(r, a.effect.name(), &a.bias)).collect::<Result<_, _>>()?;
        Ok(Self {
            r,
            tables: tables(r),
            noise: if r.points.is_empty() { Vec::new() } else { figures::noise(r) },
            hidden: figures::hidden(r),
            denoised: figures::denoised(r),
            denoised_maps: figures::denoised_maps(r)?,
            stages: figures::stages(r),
            effects: figures::effects(r),
            samples: figures::samples(r)?,
            biases,
            pictures: pictures(r)?,
        })
    }

    fn charts(&self) -> impl Iterator<Item = &Chart> {
        self.noise.iter().flatten().chain(&self.hidden).chain(&self.denoised).chain(&self.stages).chain(&self.effects)
    }

    fn table(&self, name: &str) -> Markup {
        html! {
            @if let Some(table) = self.tables.iter().find(|t| t.name == name) { (with_file(table)) }
        }
    }

    fn html(&self) -> String {
        let r = self.r;
        let sections = [
            self.head(),
            self.noise_section(),
            self.hidden_section(),
            self.denoised_section(),
            self.samples_section(),
            self.stages_section(),
            self.effects_section(),
            self.pictures_section(),
            self.method_section(),
        ];
        page(&format!("{} \u{b7} bench", r.name), &sections)
    }

    fn head(&self) -> Markup {
        let r = self.r;
        let [width, height] = r.size;
        let facts = format!("{width} \u{d7} {height} pixels \u{b7} {} \u{b7} {}", r.camera, r.program);
        let [done, all] = r.finished;
        html! {
            (head(&format!("Noise, time and effects: {}", r.name), &facts))
            @if done < all {
                div.banner { "Not finished: " (done) " of " (all) " renders. The same command continues the bench. This page \
                    uses the finished renders." }
            }
            (tiles(&self.tiles()))
        }
    }

    /// The main findings: each a figure with its meaning.
    fn tiles(&self) -> Vec<(String, String)> {
        let r = self.r;
        let mut tiles = Vec::new();
        let k = r.headline_level();
        let prices = || r.tops.iter().filter_map(|t| Some((t.strategy, t.prices.iter().find(|p| p.k == k)?)));
        let best = prices().min_by(|a, b| a.1.seconds.value.total_cmp(&b.1.seconds.value));
        if !r.has_light() {
            tiles.push(("no light".into(), "the image is black and has no noise".into()));
        }
        if let Some((strategy, price)) = best.filter(|(_, price)| price.seconds.value > 0.0) {
            let [time, spp] = price.words();
            tiles.push((
                time,
                format!(
                    "until the render\u{2019}s noise is hidden at k = {k} with {strategy}: {spp} samples per pixel"
                ),
            ));
            let plain = prices().find(|(s, _)| *s == Strategy::Uniform && strategy != Strategy::Uniform);
            if let Some((_, plain)) = plain.filter(|(_, plain)| !plain.is_beyond_reach()) {
                tiles.push((
                    format!("{} \u{d7}", rounded(plain.seconds.value / price.seconds.value)),
                    format!(
                        "less time than with the same number of samples everywhere; {} \u{d7} fewer samples",
                        rounded(plain.spp.value / price.spp.value)
                    ),
                ));
            }
        }
        let judged = r.ablations.iter().filter_map(|a| a.bias.verdict);
        let seen = judged.clone().filter(|v| *v == super::ablation::Verdict::Visible).count();
        if judged.clone().count() > 0 {
            tiles.push((
                format!("{seen} of {}", judged.count()),
                "effects that the scene needs and that are visible in a single frame of this camera".into(),
            ));
        }
        let top = r.settings.ladder().last().copied();
        let stated: Vec<f64> = r.points.iter().filter(|p| Some(p.spp) == top).map(|p| p.stated).collect();
        let (low, high) = stated.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
        if low <= high {
            let range = if stated.len() == 1 { format!("{low:.2}") } else { format!("{low:.2} to {high:.2}") };
            tiles.push((range, "ratio of the variance that a render estimates to the variance between renders".into()));
        }
        tiles
    }

    fn noise_section(&self) -> Markup {
        if self.noise.is_empty() {
            return Markup::default();
        }
        let linear = if self.r.view.has_sensor() {
            "The second chart has the variance of the expected photo-electrons over the unsaturated pixels. Measurements \
             use this variance. The third chart has the variance of each pixel divided by the variance of the sensor. \
             The dotted levels are k\u{b2}."
        } else {
            "The second chart has the variance of the luminance, without gamma and clipping."
        };
        html! {
            section {
                h2 { "Noise against time" }
                p { "Each point is computed from " (self.r.seeds) " renders with different seeds. The variance between \
                    the renders is computed for each pixel and averaged over the image. The first chart has the \
                    variance of the 8-bit pictures with gamma 2.2, as in the paper. " (linear) " Lower values further \
                    left are better. The dashed line is proportional to the reciprocal of the quantity on the axis, \
                    like the variance of a mean." }
                input.choice type="radio" name="axis" id="by-time" checked="checked";
                label for="by-time" { "against time" }
                input.choice type="radio" name="axis" id="by-samples";
                label for="by-samples" { "against samples" }
                div.charts {
                    @for [time, samples] in &self.noise {
                        figure { div.against-time { (time) } div.against-samples { (samples) } }
                    }
                }
                p.faint { "Bars are one standard error (jackknife over the renders). Very rare light paths can be \
                    missing from all renders of a point. Then the variance and its standard error are too small. The \
                    time depends on the machine and on its load, the number of samples does not." }
                (self.table("noise"))
            }
        }
    }

    fn hidden_section(&self) -> Markup {
        let Some(chart) = &self.hidden else { return Markup::default() };
        let k = self.r.headline_level();
        html! {
            section {
                h2 { "Time until hidden" }
                p { "A pixel is hidden at k if the variance of its rendered value is at most k\u{b2} times the \
                    variance of the sensor. A render is hidden if " (format!("{:.0}", 100.0 * SHARE)) " % of its \
                    unsaturated pixels are hidden. An exposed picture of a hidden render has a standard deviation \
                    larger than that of the sensor alone by the factor \u{221a}(1 + k\u{b2}): "
                    (format!("{:.1}", 100.0 * growth(k))) " % at k = " (k) "." }
                figure.wide {
                    (chart)
                    figcaption { "Time of rendering until hidden, by k and strategy. Bars are one standard error. The \
                        time is computed from the variance between the renders with the largest number of samples, \
                        pooled over " (POOL) " \u{d7} " (POOL) " pixels. The computation assumes that the variance is \
                        proportional to the reciprocal of the number of samples. A time far beyond the measured \
                        numbers of samples is a forecast." }
                }
                (self.table("hidden"))
            }
        }
    }

    fn denoised_section(&self) -> Markup {
        if self.denoised.is_empty() {
            return Markup::default();
        }
        let error = if self.r.view.has_sensor() { ", over the sensor\u{2019}s variance" } else { "" };
        html! {
            section {
                h2 { "Effect of a denoiser" }
                p { "The charts compare the same renders with and without denoiser. The first chart has the variance \
                    of the 8-bit picture between the renders, as in the paper. A denoiser reduces this variance. Its \
                    systematic errors are equal in all renders, so the variance does not contain them. The second \
                    chart has the squared error against the truth" (error) ". It contains noise and bias. Without \
                    denoiser it is the variance. A denoised image is for viewing only. No measure of hidden noise, \
                    certificate or photon transfer uses it." }
                (charts(&self.denoised))
                (maps(&self.denoised_maps))
                (self.table("denoised"))
            }
        }
    }

    fn samples_section(&self) -> Markup {
        if self.samples.is_empty() {
            return Markup::default();
        }
        html! {
            section {
                h2 { "Maps of the noise and of the samples" }
                p { "The variance maps show the variance of each pixel between the renders, all on one scale. The \
                    paper proposes more samples for pixels with a steep gradient in the pilot image. Samples are best \
                    allocated if their map resembles the map of the variance. The remaining variance is then uniform." }
                (maps(&self.samples))
            }
        }
    }

    fn stages_section(&self) -> Markup {
        let Some(chart) = &self.stages else { return Markup::default() };
        html! {
            section {
                h2 { "Time by stage" }
                p { "The chart has the stages of a render with the largest number of samples, as means over the \
                    renders. Exposing and writing were timed once, on the first render. The time to read the scene is \
                    not included." }
                figure.wide { (chart) }
                (self.table("stages"))
            }
        }
    }

    fn effects_section(&self) -> Markup {
        let Some(chart) = &self.effects else { return Markup::default() };
        html! {
            section {
                h2 { "Cost and bias of each effect" }
                p {
                    "The scene was rendered without each of the effects that it needs, with "
                    (self.r.settings.effect_spp()) " samples in each pixel. Seeds and exposure are those of the render with \
                     all effects. "
                    @if self.r.view.has_sensor() {
                        "A difference is visible in a frame of this camera if at least 1 % of the pixels differ by more than one \
                         standard deviation of the noise of the camera in a single frame, and by more than twice the \
                         difference expected from noise alone."
                    }
                }
                figure.wide {
                    (chart)
                    figcaption { "The bias is the mean difference over the renders. It contains noise. The hollow mark \
                        is the value that 99 % of the pixels would not exceed without bias. It is computed from the \
                        same differences with alternating signs." }
                }
                (self.table("effects"))
                (maps(&self.biases))
                p.faint { "The maps have the difference without effect minus with effect, per pixel. Blue pixels are \
                    darker without the effect, orange pixels are brighter." }
            }
        }
    }

    fn pictures_section(&self) -> Markup {
        html! {
            section {
                h2 { "Pictures" }
                p {
                    "Pictures have 8 bits and gamma 2.2. White is saturation."
                    @if self.r.view.has_sensor() {
                        " Pictures \u{201c}as exposed\u{201d} also contain the noise of the sensor. They cannot be \
                         distinguished where the noise of the render is hidden."
                    }
                }
                div.maps { @for (name, uri, size) in &self.pictures { (picture(uri, *size, name)) } }
            }
        }
    }

    fn method_section(&self) -> Markup {
        let r = self.r;
        let s = &r.settings;
        let list = |v: &[String]| v.join(", ");
        let rungs: Vec<String> = s.ladder().iter().map(ToString::to_string).collect();
        let strategies: Vec<String> = s.strategies().iter().map(ToString::to_string).collect();
        let measured = [
            ("input", r.name.clone()),
            (
                "film",
                format!(
                    "{} \u{d7} {} pixels{}",
                    r.size[0],
                    r.size[1],
                    if s.quick { " (reduced by --quick)" } else { "" }
                ),
            ),
            ("camera", r.camera.clone()),
            ("strategies", list(&strategies)),
            ("numbers of samples", format!("{} samples per pixel on average", list(&rungs))),
            ("renders per point", format!("{}, seeds derived from {}", r.seeds, r.seed)),
            (
                "reference",
                format!(
                    "{} samples per pixel, uniform; {:.2} % of its pixels are not saturated",
                    s.reference_spp(),
                    100.0 * r.unsaturated
                ),
            ),
            ("effects", format!("{} samples per pixel, uniform", s.effect_spp())),
            ("denoisers", list(&r.denoisers.iter().map(|d| d.1.clone()).collect::<Vec<_>>())),
            ("threads", r.threads.to_string()),
            ("program", r.program.clone()),
        ];
        html! {
            section {
                h2 { "How it was measured" }
                (facts(&measured))
                ul {
                    li { "Renders of one point differ only in the seed. The variance between them has (renders \
                        \u{2212} 1) degrees of freedom per pixel. It includes the variance from the decisions of the \
                        strategy, which depend on the pilot of each render." }
                    @if r.view.has_sensor() {
                        li { "Sensor variance s = \u{3bc}" sub { "e" } " + \u{3c3}" sub { "d" } "\u{b2} + \u{3c3}"
                            sub { "q" } "\u{b2}/K\u{b2} with \u{3c3}" sub { "q" } "\u{b2} = 1/12 DN\u{b2} (EMVA \
                            1288), at the electrons of the reference. v is the variance of the rendered electrons, \
                            before any sensor noise is added." }
                        li { "All renders use the exposure of the reference." }
                    }
                    li { "\u{201c}Stated / measured\u{201d} is the variance that renders estimate, divided by the \
                        variance between renders. A render estimates its variance from four batches of samples and \
                        assumes fully correlated channels of a pixel." }
                    li { "The squared error is the mean of (x \u{2212} a)(x \u{2212} b) over the pixels that are not \
                        saturated. Here x is the image and a is the reference. b is the mean of the renders of the \
                        strategy with the largest number of samples, without the render from which x was computed. a \
                        and b are independent and unbiased, so their noise adds nothing to the expectation." }
                    li { "The renders alternate between the strategies and numbers of samples. So a change of the \
                        speed of the machine affects all of them equally." }
                    li { "The folder " code { "units/" } " contains a small text and an image of each finished render. \
                        All figures can be computed again from these files." }
                }
            }
        }
    }
}

/// The pictures: pilot, the strategies with the most samples, reference; with and without the sensor's
/// noise.
fn pictures(r: &Results) -> Result<Vec<Shown>, Error> {
    let mut signals = Vec::new();
    if let Some((spp, pilot)) = &r.pilot {
        signals.push((format!("pilot, {spp} samples per pixel"), pilot));
    }
    for top in &r.tops {
        signals.push((format!("{}, {} samples per pixel", top.strategy, top.spp), &top.signal));
    }
    for look in r.looks.iter().filter(|l| l.denoiser != OFF) {
        signals.push((
            format!("{}, {} samples per pixel, denoised by {}", look.strategy, look.spp, look.denoiser),
            &look.signal,
        ));
    }
    signals.push((format!("reference, {} samples per pixel", r.settings.reference_spp()), &r.reference));
    let mut shown = Vec::new();
    for (name, signal) in &signals {
        let (uri, size) = grey(&r.view.picture(signal))?;
        shown.push((name.clone(), uri, size));
    }
    // One seed for all: two pictures differ only in the render, not in the noise of the sensor.
    for (name, signal) in &signals {
        if let Some(picture) = r.view.exposed(signal, r.seed) {
            let (uri, size) = grey(&picture)?;
            shown.push((format!("{name}, as exposed"), uri, size));
        }
    }
    Ok(shown)
}
