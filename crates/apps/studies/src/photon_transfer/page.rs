//! The report: the paper's figures, its statements, and the results here. Beside it the numbers as CSV and the charts
//! as SVG.

use super::analysis::{Curve, LINEAR_BINS, Results};
use super::figures;
use super::findings::{Verdict, name};
use crate::report::estimate::Estimate;
use crate::report::maps::{Map, grey};
use crate::report::page::{maps, page, with_file, write as write_report};
use crate::report::table::{self, Cell, Figures, Table, column, estimate};
use dunkelfeld::Error;
use dunkelfeld_emva1288::LineFit;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::page::{self as frame, Heading, charts, facts, head, picture, tiles};
use dunkelfeld_report::words::duration;
use maud::{Markup, html};
use std::path::{Path, PathBuf};

/// Writes the page, the tables and the charts into a folder. Returns the files, the page first.
pub(super) fn write(folder: &Path, results: &Results) -> Result<Vec<PathBuf>, Error> {
    let report = Report::new(results)?;
    let tables = [&report.series, &report.lines, &report.curves].into_iter().filter(|t| !t.rows.is_empty());
    let pairs = report.transfer.iter().flatten();
    let charts = report.sensor.iter().chain(pairs).chain(&report.linear).chain(&report.cameras);
    write_report(folder, &report.html()?, tables.map(|t| (t.name, t.csv())), charts)
}

/// The figures of the tables.
pub(super) fn figures(r: &Results) -> Figures {
    table::figures(&[series(r), lines(r), curves(r)])
}

/// The content of the page.
struct Report<'a> {
    r: &'a Results,
    sensor: Option<Chart>,
    transfer: Vec<[Chart; 2]>,
    linear: Vec<Chart>,
    cameras: Vec<Chart>,
    maps: Vec<[Map; 2]>,
    series: Table,
    lines: Table,
    curves: Table,
}

impl<'a> Report<'a> {
    fn new(r: &'a Results) -> Result<Self, Error> {
        Ok(Self {
            r,
            sensor: figures::sensor(r),
            transfer: figures::transfer(r),
            linear: figures::linear(r),
            cameras: figures::cameras(r),
            maps: figures::maps(r)?,
            series: series(r),
            lines: lines(r),
            curves: curves(r),
        })
    }

    fn html(&self) -> Result<String, Error> {
        let sections = [
            self.head(),
            self.findings_section(),
            self.pictures_section()?,
            self.maps_section(),
            self.transfer_section(),
            self.camera_section(),
            self.method_section(),
        ];
        Ok(page(&format!("{} \u{b7} photon transfer", self.r.name), &sections))
    }

    fn head(&self) -> Markup {
        let r = self.r;
        let [width, height] = r.size;
        let facts = format!(
            "{width} \u{d7} {height} pixels \u{b7} {} \u{b7} dunkelfeld {}",
            r.camera,
            env!("CARGO_PKG_VERSION")
        );
        let [done, all] = r.finished;
        let mut figures = Vec::new();
        let findings = r.findings();
        let same = findings.iter().filter(|f| f.verdict == Verdict::Same).count();
        if !findings.is_empty() {
            figures.push((format!("{same} of {}", findings.len()), "findings of the paper are reproduced".into()));
        }
        if let Some(sensor) = &r.sensor {
            for s in &r.cameras {
                // A slope with an error of more than a tenth is no main finding.
                let is_known = |f: &&LineFit| f.slope.standard_error < 0.1 * sensor.truth;
                if let Some(fit) = s.matched.as_ref().and_then(|c| c.fit.as_ref()).filter(is_known) {
                    figures.push((
                        format!("{:+.2} %", 100.0 * (fit.slope.value / sensor.truth - 1.0)),
                        format!(
                            "error of K from noise-matched frames at {} samples per pixel (\u{b1} {:.2} %), on {:.0} % of the pixels",
                            s.spp,
                            100.0 * fit.slope.standard_error / sensor.truth,
                            100.0 * s.quiet
                        ),
                    ));
                }
            }
        }
        html! {
            (head(&format!("Photon transfer: {}", r.name), &facts))
            @if done < all {
                div.banner { "Not finished: " (done) " of " (all) " renders. The same command continues the measurement. \
                    This page uses the finished frames." }
            }
            (tiles(&figures))
        }
    }

    fn findings_section(&self) -> Markup {
        let rows = html! {
            @for f in self.r.findings() {
                tr {
                    td.wrap { (f.claim) br; small { (f.place) } }
                    td.wrap { (f.here) }
                    td { (f.verdict.words()) }
                }
            }
        };
        html! {
            section {
                h2 { "Findings of the paper and of this measurement" }
                p { "Kludt et al., \u{201c}Noise analysis of a synthetically rendered scene in sensor-realistic image \
                    simulation\u{201d}. Pictures have 8 bits and gamma 2.2, without the noise of a sensor. The mean \
                    and the variance of each pixel are computed over frames with different seeds." }
                (frame::table("findings", ["the paper", "measured here", "result"].map(Heading::of), rows))
                (with_file(&self.series))
            }
        }
    }

    fn pictures_section(&self) -> Result<Markup, Error> {
        let caption = |s| format!("{}, {} a frame", name(s), duration(s.seconds));
        let all: Vec<_> =
            self.r.pictures.iter().map(|s| Ok((grey(&s.picture)?, caption(s)))).collect::<Result<_, Error>>()?;
        Ok(html! {
            section.pairs {
                h2 { "Figure 3: pictures" }
                p { "Each picture is the first frame of a series." }
                div.maps { @for ((uri, size), caption) in &all { (picture(uri, *size, caption)) } }
            }
        })
    }

    fn maps_section(&self) -> Markup {
        html! {
            section.pairs {
                h2 { "Figure 5: maps of the variance" }
                p { "The maps have the variance of the pictures over the frames. Each map has its own scale." }
                (maps(self.maps.iter().map(|m| &m[0])))
                h2 { "Figure 7: Sobel magnitude of one frame" }
                p { "The maps have the Sobel magnitude of the first frame of each series. The correlations above use \
                    the variance of the other frames, so that the noise of the first frame enters only once." }
                (maps(self.maps.iter().map(|m| &m[1])))
            }
        }
    }

    fn transfer_section(&self) -> Markup {
        html! {
            section.pairs {
                h2 { "Figure 6: photon transfer of the pictures" }
                p { "Pixels with a mean in the same interval of one grey value form a point. Its ordinate is their \
                    mean variance. The curve of a camera is a straight line before gamma, and decreases slowly after \
                    gamma." }
                (charts(self.transfer.iter().map(|t| &t[0])))
                h2 { "Figure 8: photon transfer without strong edges" }
                p { "The curves omit the " (format!("{:.0}", 100.0 * self.r.settings.edges())) " % of the pixels with the \
                    steepest gradient in the first frame of the series." }
                (charts(self.transfer.iter().map(|t| &t[1])))
                @if let (Some(chart), Some(sensor)) = (&self.sensor, &self.r.sensor) {
                    h2 { "Figure 2: photon transfer curve of a camera" }
                    p {
                        "The curve of the sensor " (sensor.name) " is computed from two frames of even light at each of 50 \
                         levels. The line through the dark level and 0\u{2013}70 % of saturation has the slope K"
                        @if let Some(k) = &sensor.gain {
                            " = " (format!("{:.5} \u{b1} {:.5}", k.value, k.standard_error)) " DN/e\u{207b}. \
                             The data of the sensor have " (format!("{:.5}", sensor.truth))
                        }
                        "."
                    }
                    (charts([chart]))
                }
            }
        }
    }

    fn camera_section(&self) -> Markup {
        if self.linear.is_empty() && self.cameras.is_empty() {
            return Markup::default();
        }
        html! {
            section.pairs {
                h2 { "Photon transfer of linear grey values" }
                p { "Gamma bends every curve. These curves use the expected grey values of the sensor, without the \
                    noise of the sensor. The noise of a render does not give a straight line here either." }
                (charts(&self.linear))
                @if !self.cameras.is_empty() {
                    h2 { "Frames of the sensor" }
                    p { "These renders use the allocation " code { "sensor" } ", and each render is exposed. Plain \
                        exposure adds the noise of the sensor to that of the render. Matched exposure adds only the \
                        missing part of the noise. The curves use the pixels with at most 0.7 of the noise of the \
                        sensor in the render, on average over the frames. They use the frames without a rare sample \
                        in the pixel (a sample that is visible by itself). The curve of matched exposure must be the \
                        line of the sensor." }
                    (charts(&self.cameras))
                }
                (with_file(&self.lines))
            }
        }
    }

    fn method_section(&self) -> Markup {
        let r = self.r;
        let spp: Vec<String> = r.settings.spp().iter().map(ToString::to_string).collect();
        let frames: Vec<String> = r.pictures.iter().map(|s| format!("{}: {}", name(s), s.frames)).collect();
        let measured = [
            ("input", r.name.clone()),
            ("film", format!("{} \u{d7} {} pixels", r.size[0], r.size[1])),
            ("camera", r.camera.clone()),
            ("series", format!("{} samples per pixel", spp.join(", "))),
            ("frames", frames.join("; ")),
            ("denoiser", r.denoiser.clone().unwrap_or_else(|| "none".into())),
            ("strong edges", format!("the steepest {:.0} % of the pixels", 100.0 * r.settings.edges())),
            ("seed", r.seed.to_string()),
        ];
        html! {
            section {
                h2 { "How it was measured" }
                (facts(&measured))
                ul {
                    li { "Series of pictures have the same number of samples in each pixel. All use the exposure of \
                        the first frame with the most samples. White is saturation." }
                    li { "A curve is not linear if the points differ from the straight line by more than their \
                        standard errors allow. A curve is not monotone if it both rises and falls by more than five \
                        standard errors between groups of pixels." }
                    li { "Lines are fitted to the points from 0 to 70 % of saturation. The points are weighted by the \
                        variance of their ordinate (EMVA 1288 release 4.0 Linear, equations 15 and 50). R\u{b2} uses \
                        the same weights." }
                    li { "Linear curves have intervals of 1/" (LINEAR_BINS) " of the range or 1 DN, whichever is \
                        wider." }
                    li { "The folder " code { "units/" } " contains the finished renders. A later run with more frames \
                        or another share of strong edges uses them." }
                }
            }
        }
    }
}

/// The series of pictures in numbers.
fn series(r: &Results) -> Table {
    let columns = vec![
        column("spp", "samples", "per pixel"),
        column("denoised", "denoised", ""),
        column("frames", "frames", ""),
        column("seconds", "time of a frame", "s"),
        column("variance", "mean variance", "DN\u{b2}"),
        column("variance_edges", "at strong edges", "DN\u{b2}"),
        column("variance_flat", "elsewhere", "DN\u{b2}"),
        column("pearson", "correlation with Sobel", ""),
        column("spearman", "of ranks", ""),
    ];
    let rows = r.pictures.iter().map(|s| {
        let mut row = vec![
            Cell::Count(s.spp.into()),
            Cell::Text(if s.is_denoised { "yes" } else { "no" }.into()),
            Cell::Count(s.frames),
            Cell::Number(s.seconds),
        ];
        row.extend(s.mean_variance.into_iter().chain(s.correlations).map(Cell::Number));
        row
    });
    Table { name: "series", columns, rows: rows.collect() }
}

/// Straight lines through curves of linear grey values.
fn lines(r: &Results) -> Table {
    let columns = vec![
        column("curve", "curve", ""),
        column("spp", "samples", "per pixel"),
        column("frames", "frames", ""),
        column("pixels", "pixels", "%"),
        estimate("gain", "slope K", "DN/e\u{207b}"),
        column("gain_over_truth", "over the sensor\u{2019}s", ""),
        estimate("intercept", "variance without light", "DN\u{b2}"),
        column("r_squared", "R\u{b2}", ""),
        column("reduced_chi_squared", "\u{3c7}\u{b2} per degree of freedom", ""),
    ];
    let truth = r.sensor.as_ref().map_or(f64::NAN, |s| s.truth);
    let row = |what: &str, spp: Option<u32>, frames: u64, held: f64, curve: &Curve| {
        // A curve of too few points has no line, but a row with a note.
        let (mut gain, mut intercept, mut quality) = (Estimate::NONE, Estimate::NONE, [f64::NAN; 2]);
        if let Some(fit) = &curve.fit {
            gain = Estimate { value: fit.slope.value, error: fit.slope.standard_error };
            intercept = Estimate { value: fit.intercept.value, error: fit.intercept.standard_error };
            quality = [fit.r_squared, fit.reduced_chi_squared];
        }
        vec![
            Cell::Text(what.into()),
            spp.map_or(Cell::Number(f64::NAN), |n| Cell::Count(n.into())),
            Cell::Count(frames),
            Cell::Number(100.0 * held),
            Cell::Estimate(gain),
            Cell::Number(gain.value / truth),
            Cell::Estimate(intercept),
            Cell::Number(quality[0]),
            Cell::Number(quality[1]),
        ]
    };
    let mut rows = Vec::new();
    rows.extend(r.sensor.as_ref().map(|s| row("the sensor, even light", None, 2, 1.0, &s.curve)));
    for s in &r.pictures {
        let what = if s.is_denoised { "render, denoised" } else { "render" };
        rows.extend(s.linear.as_ref().map(|c| row(what, Some(s.spp), s.frames, 1.0, c)));
    }
    for s in &r.cameras {
        for (what, curve) in [("plain exposure", &s.plain), ("matched exposure", &s.matched)] {
            rows.extend(curve.as_ref().map(|c| row(what, Some(s.spp), s.frames, s.quiet, c)));
        }
    }
    Table { name: "lines", columns, rows }
}

/// Every point of every curve.
fn curves(r: &Results) -> Table {
    let columns = vec![
        column("curve", "curve", ""),
        column("spp", "samples", "per pixel"),
        column("mean", "mean", "DN"),
        estimate("variance", "variance", "DN\u{b2}"),
        column("pixels", "pixels", ""),
    ];
    let mut rows = Vec::new();
    let mut add = |what: String, spp: Option<u32>, curve: &Curve| {
        rows.extend(curve.points.iter().map(|p| {
            vec![
                Cell::Text(what.clone()),
                spp.map_or(Cell::Number(f64::NAN), |n| Cell::Count(n.into())),
                Cell::Number(p.mean),
                Cell::Estimate(Estimate { value: p.variance, error: p.variance_error }),
                Cell::Count(p.pixels),
            ]
        }));
    };
    if let Some(sensor) = &r.sensor {
        add("sensor".into(), None, &sensor.curve);
    }
    for s in &r.pictures {
        let suffix = if s.is_denoised { ", denoised" } else { "" };
        add(format!("picture{suffix}"), Some(s.spp), &s.curve);
        add(format!("picture without strong edges{suffix}"), Some(s.spp), &s.filtered);
        if let Some(linear) = &s.linear {
            add(format!("linear{suffix}"), Some(s.spp), linear);
        }
    }
    for s in &r.cameras {
        for (what, curve) in [("plain", &s.plain), ("matched", &s.matched)] {
            if let Some(curve) = curve {
                add(format!("{what} exposure"), Some(s.spp), curve);
            }
        }
    }
    Table { name: "curves", columns, rows }
}
