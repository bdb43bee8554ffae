//! The report of an analysis: one page that needs no other file.

use super::figures::{self, Figure};
use super::findings::Findings;
use super::measurement::ReadMeasurement;
use crate::report;
use dunkelfeld_emva1288::{Analysis, Bound, Quantity, Release, Side};
use dunkelfeld_report::page::{self, Heading};
use maud::{Markup, html};

/// A value and its error. The error has two digits, and the value ends at the same place.
pub(super) fn digits(q: &Quantity) -> (String, String) {
    if !(q.standard_error > 0.0 && q.standard_error.is_finite()) {
        return (format!("{:.6}", q.value), "0".into());
    }
    let places = (1.0 - q.standard_error.log10().floor()).clamp(0.0, 12.0) as usize;
    (format!("{:.places$}", q.value), format!("{:.places$}", q.standard_error))
}

/// The same, or the bound if only a bound is known.
pub(super) fn shown(q: &Quantity, bound: Option<Bound>) -> (String, String) {
    match bound {
        Some(b) => (format!("{} {}", sign(&b), digits(&Quantity { value: b.limit, ..*q }).0), String::new()),
        None => digits(q),
    }
}

fn sign(bound: &Bound) -> char {
    match bound.side {
        Side::Below => '<',
        Side::Above => '>',
    }
}

/// The whole page.
pub(super) fn page(findings: &Findings, read: &ReadMeasurement) -> String {
    let name = read.file.parent().and_then(|p| p.file_name()).or(read.file.file_name()).unwrap_or_default();
    let name = name.to_string_lossy().into_owned();
    let (release, bits, module) = match findings {
        Findings::Linear(a) => (a.release, a.bits, "Linear"),
        Findings::General(a) => (a.release, a.bits, "General"),
    };
    let release = match release {
        Release::R31 => "3.1",
        Release::R40 => "4.0",
    };
    let [width, height] = read.size;
    let facts = format!(
        "{width} \u{d7} {height} pixels \u{b7} {bits} bits \u{b7} {} frames \u{b7} rules of release {release} {module} \u{b7} Dunkelfeld {}",
        read.frames,
        env!("CARGO_PKG_VERSION")
    );
    let mut sections = vec![
        html! {
            (page::head(&format!("EMVA 1288: {name}"), &facts))
            (notes(findings, read))
            (page::tiles(&tiles(findings)))
        },
        table(findings),
    ];
    match findings {
        Findings::Linear(a) => sections.extend(linear(a)),
        Findings::General(a) => {
            let text = "Without a straight line there is neither K nor \u{3b7}. Noise is referred to the light by the local slope of the \
                        characteristic curve, \u{3c3}p = \u{3c3}y / (d\u{3bc}y/d\u{3bc}p).";
            sections.push(section("Characteristic curve and noise", text, &figures::general(a)));
        }
    }
    sections.push(method(findings));
    report::page::page(&format!("{name} \u{b7} EMVA 1288"), &sections)
}

fn notes(findings: &Findings, read: &ReadMeasurement) -> Markup {
    let mut all = findings.notes().iter().chain(&read.warnings).peekable();
    html! { @if all.peek().is_some() { div.banner { @for note in all { p { (note) } } } } }
}

/// The main figures.
fn tiles(findings: &Findings) -> Vec<(String, String)> {
    let rows: &[(&str, f64, &str, &str)] = match findings {
        Findings::Linear(_) => &[
            ("eta", 100.0, "%", "quantum efficiency"),
            ("sigma_d", 1.0, "e\u{207b}", "temporal dark noise"),
            ("mu_e.sat", 1.0, "e\u{207b}", "saturation capacity"),
            ("DR.dB", 1.0, "dB", "dynamic range"),
            ("SNR_max.dB", 1.0, "dB", "largest signal-to-noise ratio"),
            ("mu_p.min", 1.0, "photons", "absolute sensitivity threshold"),
            ("DSNU1288", 1.0, "e\u{207b}", "dark signal nonuniformity"),
            ("PRNU1288", 1.0, "%", "photo response nonuniformity"),
        ],
        Findings::General(_) => &[
            ("DR.dB", 1.0, "dB", "dynamic range"),
            ("SNR_max.dB", 1.0, "dB", "largest signal-to-noise ratio at the input"),
            ("mu_p.min", 1.0, "photons", "absolute sensitivity threshold"),
            ("mu_p.sat", 1.0, "photons", "saturation irradiation"),
        ],
    };
    let find = |symbol: &str| findings.quantities().iter().find(|q| q.symbol == symbol);
    rows.iter()
        .filter_map(|(symbol, scale, unit, words)| {
            let q = find(symbol)?;
            // One digit of the error suffices here, and four of the value.
            let bound = findings.bound(symbol);
            let value = scale * bound.map_or(q.value, |b| b.limit);
            let places = (3.0 - value.abs().max(1e-9).log10().floor()).clamp(0.0, 3.0) as usize;
            let side = bound.map_or(String::new(), |b| format!("{} ", sign(&b)));
            Some((format!("{side}{value:.places$} {unit}"), (*words).to_owned()))
        })
        .collect()
}

fn table(findings: &Findings) -> Markup {
    let rows = html! {
        @for q in findings.quantities() {
            @let (value, error) = shown(q, findings.bound(q.symbol));
            tr {
                td { (symbol(q.symbol)) }
                td { (q.name) }
                td.n { data value=(q.value) { (value) } @if !error.is_empty() { i { " \u{b1} " (error) } } }
                td { (q.unit) }
                td { (q.section) }
            }
        }
    };
    let headings = ["symbol", "what", "value and standard error", "unit", "section"].map(Heading::of);
    html! { section { h2 { "Figures" } (page::table("figures", headings, rows)) } }
}

/// A symbol in the typography of the standard: Greek letters, the rest as an index.
fn symbol(ascii: &str) -> Markup {
    let greek = [("mu_", "\u{3bc}"), ("sigma_", "\u{3c3}"), ("eta", "\u{3b7}")];
    let letter = greek.iter().find_map(|(name, letter)| Some((letter, ascii.strip_prefix(name)?)));
    let (base, index) = match letter {
        Some((letter, rest)) => ((*letter).to_owned(), rest.to_owned()),
        None => {
            let (base, index) = ascii.split_once(['_', '.']).unwrap_or((ascii, ""));
            match base.strip_suffix("1288") {
                Some(word) if index.is_empty() => (word.to_owned(), "1288".to_owned()),
                Some(word) => (word.to_owned(), format!("1288.{index}")),
                None => (base.to_owned(), index.to_owned()),
            }
        }
    };
    html! { span title=(ascii) { (base) @if !index.is_empty() { sub { (index) } } } }
}

fn linear(a: &Analysis) -> Vec<Markup> {
    let mut sections = vec![section(
        "Sensitivity, linearity and noise",
        "Each point is a pair of frames. Temporal noise is what differs between the two, so that neither uneven light nor the fixed \
         pattern counts.",
        &figures::sensitivity(a),
    )];
    if let Some(n) = &a.nonuniformity {
        let [spectra, profiles, histograms] = figures::nonuniformity(n, a.value("K"));
        let [dark, bright] = n.frames;
        sections.push(section(
            "Defect pixels",
            "Normal differences between pixels make a parabola on a logarithmic axis; defects stand beside it. Responses were \
             high-pass filtered over 5 \u{d7} 5 pixels, which takes off uneven light.",
            &histograms,
        ));
        sections.push(section(
            "Spectrograms",
            &format!(
                "Periods in the mean image of {dark} dark frames, and of {bright} at half of saturation with the dark taken off. White \
                 differences between pixels have the same standard deviation at all frequencies; rows and columns that differ, or \
                 interference, stand out."
            ),
            &spectra,
        ));
        sections.push(section("Profiles", "How the mean images run along their rows and columns.", &profiles));
    }
    sections
}

fn section(title: &str, text: &str, figures: &[Figure]) -> Markup {
    // Four tiles in rows of three would leave a single one.
    let is_paired = figures.len() == 4;
    html! {
        section {
            h2 { (title) }
            p { (text) }
            div.charts.pairs[is_paired] {
                @for f in figures { figure { (f.chart) figcaption { (f.caption) } } }
            }
        }
    }
}

fn method(findings: &Findings) -> Markup {
    let saturation = match findings {
        Findings::Linear(a) if a.release == Release::R31 => {
            "Saturation is the level with the largest variance (release 3.1)."
        }
        Findings::Linear(_) | Findings::General(_) => {
            "Saturation is where 0.15 % of the values are the largest that occurs, between the levels by the normal integral \
             (release 4.0 asks for 0.1 to 0.2 %)."
        }
    };
    let mut rules = vec![
        saturation,
        "Standard errors are propagated from the scatter of the pixels: each measured mean and variance is moved by its own error. They \
         are those of a repetition with another camera of the same kind.",
    ];
    match findings {
        Findings::Linear(_) => rules.extend([
            "Behind < stands an upper bound: of a root three standard errors above it, where its square does not stand out from its error; \
             or what rounding may hide. Behind > stands a lower bound, for what rounding may hide.",
            "Variances of rows, columns and pixels are those of release 4.0; a slightly negative one is reported as zero.",
        ]),
        Findings::General(a) if !a.bounds.is_empty() => rules.push(
            "Behind < stands an upper bound and behind > a lower one, by the largest dark noise that rounding may hide.",
        ),
        Findings::General(_) => {}
    }
    html! { section { h2 { "How it was measured" } ul { @for rule in rules { li { (rule) } } } } }
}
