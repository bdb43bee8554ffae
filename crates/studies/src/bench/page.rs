//! The report as one page that needs no other file: no script, style, font or picture from other sources. Beside it,
//! its numbers as CSV and its charts as SVG.

use super::figures;
use super::hidden::{SHARE, growth};
use super::results::{OFF, Results};
use super::statistics::POOL;
use super::tables::tables;
use crate::report::chart::Chart;
use crate::report::maps::{Map, grey};
use crate::report::page::{charts, facts, head, maps, page, picture, tiles, with_file};
use crate::report::table::Table;
use crate::report::words::{duration, rounded};
use dunkelfeld::Error;
use dunkelfeld::save_text;
use dunkelfeld_adaptive::weights::Strategy;
use maud::{Markup, html};
use std::path::{Path, PathBuf};

/// Writes the page, the tables and the charts into a folder. Returns the files, the page first.
pub(super) fn write(folder: &Path, results: &Results) -> Result<Vec<PathBuf>, Error> {
    let report = Report::new(results)?;
    let mut files = Vec::new();
    let mut save = |name: String, text: &str| -> Result<(), Error> {
        let path = folder.join(name);
        save_text(&path, text)?;
        files.push(path);
        Ok(())
    };
    save("report.html".into(), &report.html())?;
    for table in report.tables.iter().filter(|t| !t.rows.is_empty()) {
        save(format!("{}.csv", table.name), &table.csv())?;
    }
    for chart in report.charts() {
        save(format!("{}.svg", chart.name), &chart.file())?;
    }
    Ok(files)
}

/// A picture to compare: its name and its image.
struct Shown {
    name: String,
    uri: String,
    size: [u32; 2],
}

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
            (head(&format!("What accuracy costs: {}", r.name), &facts))
            @if done < all {
                div.banner { "Not finished: " (done) " of " (all) " renders. The same command goes on from here; what \
                    is shown rests on the renders that there are." }
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
            tiles.push(("no light".into(), "the image is black: there is no noise to hide or to compare".into()));
        }
        if let Some((strategy, price)) = best.filter(|(_, price)| price.seconds.value > 0.0) {
            tiles.push((
                duration(price.seconds.value),
                format!(
                    "until the render\u{2019}s noise is hidden at k = {k} with {strategy}: {} samples per pixel",
                    rounded(price.spp.value)
                ),
            ));
            if let Some((_, plain)) = prices().find(|(s, _)| *s == Strategy::Uniform && strategy != Strategy::Uniform) {
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
        let top = r.settings.ladder.last().copied();
        let stated: Vec<f64> = r.points.iter().filter(|p| Some(p.spp) == top).map(|p| p.stated).collect();
        let (low, high) = stated.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
        if low <= high {
            let range = if stated.len() == 1 { format!("{low:.2}") } else { format!("{low:.2} to {high:.2}") };
            tiles.push((range, "the variance that a render states of itself, over the one between renders".into()));
        }
        tiles
    }

    fn noise_section(&self) -> Markup {
        if self.noise.is_empty() {
            return Markup::default();
        }
        let linear = if self.r.view.has_sensor() {
            "The second is the variance of the expected photo-electrons over the unsaturated pixels, which is what a \
             measurement must be made on. The third divides each pixel\u{2019}s by the sensor\u{2019}s own variance; the dotted \
             levels are k\u{b2}."
        } else {
            "The second is the variance of the luminance, without gamma and clipping."
        };
        html! {
            section {
                h2 { "Noise against time" }
                p { "Each point is " (self.r.seeds) " renders with seeds of their own. Their variance from render to \
                    render, pixel by pixel, is averaged over the image. The first chart is of the 8-bit pictures with \
                    gamma 2.2, as in the paper. " (linear) " Lower and further left is better; the dashed line falls \
                    as one over the quantity along the axis, as the variance of a mean does." }
                input.choice type="radio" name="axis" id="by-time" checked="checked";
                label for="by-time" { "against time" }
                input.choice type="radio" name="axis" id="by-samples";
                label for="by-samples" { "against samples" }
                div.charts {
                    @for [time, samples] in &self.noise {
                        figure { div.against-time { (time) } div.against-samples { (samples) } }
                    }
                }
                p.faint { "Bars are one standard error, from leaving out one render at a time. Light that is found \
                    very rarely may be missing from all renders of a point: then its noise is too, and the bar does \
                    not know. Time depends on the machine and on what else it does; samples do not." }
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
                p { "A pixel is hidden at k when the variance of its rendered value is at most k\u{b2} times the \
                    sensor\u{2019}s own; the render is when " (format!("{:.0}", 100.0 * SHARE)) " % of its \
                    unsaturated pixels are. A picture taken then is noisier than the sensor alone by the factor \
                    \u{221a}(1 + k\u{b2}): " (format!("{:.1}", 100.0 * growth(k))) " % at k = " (k) "." }
                figure.wide {
                    (chart)
                    figcaption { "Time of rendering until hidden, by k and strategy; bars are one standard error. \
                        From the variance between the renders at the top of the ladder, pooled over " (POOL) " \u{d7} \
                        " (POOL) " pixels, taking that it falls as one over the samples: a figure far beyond the \
                        ladder is a forecast." }
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
                h2 { "What a denoiser does" }
                p { "The same renders, denoised. The first chart is what the paper shows: the variance of the 8-bit \
                    picture from render to render. A denoiser smooths it away, but what it smooths wrongly is the \
                    same in every render, and no variance shows that. The second is the squared error against the \
                    truth, noise and bias together" (error) ": for renders as they are it is their variance. A \
                    denoised image is for looking at; no measure of hiding, certificate or photon transfer reads it."
                    }
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
                h2 { "Where the noise is, where the samples went" }
                p { "The variance map shows which pixels differ from render to render. The paper proposes to send \
                    samples where the pilot image is steep; a map of samples that looks like the map of the variance \
                    sends them where they are needed, and leaves a variance that is even. Maps of the variance share \
                    one scale." }
                (maps(&self.samples))
            }
        }
    }

    fn stages_section(&self) -> Markup {
        let Some(chart) = &self.stages else { return Markup::default() };
        html! {
            section {
                h2 { "Where the time went" }
                p { "Stages of a render at the top of the ladder: means over the renders; exposing and writing were \
                    timed once, on the first. Reading the scene is not part of it." }
                figure.wide { (chart) }
                (self.table("stages"))
            }
        }
    }

    fn effects_section(&self) -> Markup {
        let Some(chart) = &self.effects else { return Markup::default() };
        html! {
            section {
                h2 { "What each effect costs and changes" }
                p {
                    "The scene was rendered without each of the effects that it calls for, with the same "
                    (self.r.settings.effect_spp) " samples per pixel everywhere, the same seeds and the same exposure as with \
                     all of them. "
                    @if self.r.view.has_sensor() {
                        "The difference is visible to this camera if at least 1 % of the pixels differ by more than one \
                         standard deviation of its own noise in a single frame, and by more than twice what chance alone \
                         would show."
                    }
                }
                figure.wide {
                    (chart)
                    figcaption { "The bias is the mean difference over the renders; it holds noise of its own. The \
                        hollow mark is what 99 % of the pixels would stay below if there were no bias: from the same \
                        differences, with alternating signs." }
                }
                (self.table("effects"))
                (maps(&self.biases))
                p.faint { "Without minus with, per pixel. Blue pixels are darker without the effect, orange ones \
                    brighter." }
            }
        }
    }

    fn pictures_section(&self) -> Markup {
        let (Some(first), Some(last)) = (self.pictures.first(), self.pictures.last()) else { return Markup::default() };
        let select = |label: &str, shows: &str, chosen: &str| {
            html! {
                label {
                    small { (label) } " "
                    select data-shows=(shows) {
                        @for (i, p) in self.pictures.iter().enumerate() {
                            option value={ "picture-" (i) } selected=[(p.name == chosen).then_some("selected")] { (p.name) }
                        }
                    }
                }
            }
        };
        let [width, height] = first.size;
        let blank = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA=";
        html! {
            section {
                h2 { "Side by side" }
                p {
                    "Drag the edge to compare. Pictures are 8 bit, gamma 2.2, white at saturation."
                    @if self.r.view.has_sensor() {
                        " \u{201c}As exposed\u{201d} has the sensor\u{2019}s noise as well: where the render\u{2019}s noise is \
                         hidden, such pictures cannot be distinguished any more."
                    }
                }
                div.slider {
                    div.stage {
                        img id="shown-right" src=(blank) alt="" width=(width) height=(height);
                        div.over { img id="shown-left" src=(blank) alt="" width=(width) height=(height); }
                        div.edge {}
                        input type="range" min="0" max="100" value="50" step="0.5" aria-label="edge between the pictures";
                    }
                    div.picks {
                        (select("left", "shown-left", &first.name))
                        (select("right", "shown-right", &last.name))
                    }
                }
                details {
                    summary { "All pictures" }
                    div.maps {
                        @for (i, p) in self.pictures.iter().enumerate() {
                            (picture(Some(&format!("picture-{i}")), &p.uri, p.size, &p.name))
                        }
                    }
                }
            }
        }
    }

    fn method_section(&self) -> Markup {
        let r = self.r;
        let s = &r.settings;
        let list = |v: &[String]| v.join(", ");
        let rungs: Vec<String> = s.ladder.iter().map(ToString::to_string).collect();
        let strategies: Vec<String> = s.strategies.iter().map(ToString::to_string).collect();
        let measured = [
            ("input", r.name.clone()),
            (
                "film",
                format!(
                    "{} \u{d7} {} pixels{}",
                    r.size[0],
                    r.size[1],
                    if s.quick { ", chosen so that the bench is quick" } else { "" }
                ),
            ),
            ("camera", r.camera.clone()),
            ("strategies", list(&strategies)),
            ("ladder", format!("{} samples per pixel on average", list(&rungs))),
            ("renders per point", format!("{}, seeds derived from {}", r.seeds, r.seed)),
            (
                "reference",
                format!(
                    "{} samples per pixel, uniform; {:.2} % of its pixels are not saturated",
                    s.reference_spp,
                    100.0 * r.unsaturated
                ),
            ),
            ("effects", format!("{} samples per pixel, uniform", s.effect_spp)),
            ("denoisers", list(&r.denoisers.iter().map(|d| d.1.clone()).collect::<Vec<_>>())),
            ("threads", r.threads.to_string()),
            ("program", r.program.clone()),
        ];
        html! {
            section {
                h2 { "How it was measured" }
                (facts(&measured))
                ul {
                    li { "Renders of one point differ in nothing but their seed. The variance between them has \
                        (renders \u{2212} 1) degrees of freedom per pixel; the strategy\u{2019}s own decisions, which \
                        follow from each render\u{2019}s own pilot, are part of it." }
                    @if r.view.has_sensor() {
                        li { "Sensor variance s = \u{3bc}" sub { "e" } " + \u{3c3}" sub { "d" } "\u{b2} + \u{3c3}"
                            sub { "q" } "\u{b2}/K\u{b2} with \u{3c3}" sub { "q" } "\u{b2} = 1/12 DN\u{b2} (EMVA \
                            1288), at the electrons of the reference. v is the variance of the rendered electrons, \
                            before any sensor noise is added." }
                        li { "All renders are seen at one exposure, that of the reference." }
                    }
                    li { "\u{201c}Stated / measured\u{201d}: the variance that renders state of themselves, from four \
                        batches of samples and with the channels of a pixel taken to rise and fall together, over the \
                        variance between renders." }
                    li { "Squared error: (x \u{2212} a)(x \u{2212} b) over the pixels that are not saturated, where x \
                        is the image, a the reference, and b the mean of the strategy\u{2019}s renders at the top of \
                        the ladder without the one that x was made from: the noise of a and b, which are independent \
                        and unbiased, adds nothing to its expectation." }
                    li { "The renders are made in turns, one of each strategy and number of samples after another, so \
                        that a machine that slows down slows all alike." }
                    li { "The finished renders lie in " code { "units/" } ", a small text and an image each; what was \
                        measured can be measured again from them." }
                }
            }
        }
    }
}

/// The pictures to compare: pilot, the strategies at the top of the ladder, reference; with and without the sensor's
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
    signals.push((format!("reference, {} samples per pixel", r.settings.reference_spp), &r.reference));
    let mut shown = Vec::new();
    // One seed for all: two pictures differ only in the render, not in the noise of the sensor.
    for (name, signal) in &signals {
        if let Some(picture) = r.view.exposed(signal, r.seed) {
            let (uri, size) = grey(&picture)?;
            shown.push(Shown { name: format!("{name}, as exposed"), uri, size });
        }
    }
    for (name, signal) in &signals {
        let (uri, size) = grey(&r.view.picture(signal))?;
        shown.push(Shown { name: name.clone(), uri, size });
    }
    // The plain pilot is first and the plain reference last, so that the page opens with the widest comparison.
    let exposed = shown.len() - signals.len();
    shown.rotate_left(exposed);
    let plain = signals.len();
    let reference = shown.remove(plain - 1);
    shown.push(reference);
    Ok(shown)
}
