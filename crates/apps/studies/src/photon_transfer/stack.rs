//! Photon transfer of frames from files: of a camera with a fixed scene, or of another renderer.

use super::analysis::{Curve, Gradient, fault, linear_curve, picture_curve};
use super::figures::{LINEAR_AXES, chart};
use super::settings::PtcSettings;
use crate::folder::check_folder;
use crate::report::estimate::Estimate;
use crate::report::maps;
use crate::report::page::{maps, page, write};
use crate::report::table::{self, Cell, Figures, Table, column, estimate};
use crate::series::Kept;
use dunkelfeld::film::Plane;
use dunkelfeld::{Error, Session, Stage};
use dunkelfeld_emva1288::{AnalysisError, Frame, TemporalAccumulator, TemporalStatistics, TransferPoint};
use dunkelfeld_io::gray::{GrayFrame, read_gray};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::loader::Limits;
use dunkelfeld_io::results::ResultsFolder;
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::page::{charts, head};
use dunkelfeld_report::words::rounded;
use maud::html;
use std::path::{Path, PathBuf};

/// The pixels of the two curves.
const PIXELS_OF: [&str; 2] = ["all", "without strong edges"];

/// File extensions of frames. Others are scenes.
const EXTENSIONS: [&str; 4] = ["png", "tif", "tiff", "bmp"];

/// Is the path that of a frame, by its extension?
pub fn is_frame(path: &Path) -> bool {
    EXTENSIONS.iter().any(|e| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e)))
}

/// The photon transfer of a stack of frames.
#[derive(Clone, Debug)]
pub struct FrameStack {
    /// The files of the frames. No file of the report replaces one.
    pub inputs: InputFiles,
    /// Mean and variance of every pixel.
    statistics: TemporalStatistics,
    /// The curve of pixels of equal mean: all pixels, and all without strong edges. Intervals are 1 DN wide for 8-bit
    /// frames, 1/128 of the range for others.
    curves: [Curve; 2],
    /// Correlation of the Sobel magnitude of the first frame with the variance of the others: Pearson's, Spearman's.
    /// NaN if one of both is constant.
    correlations: [f64; 2],
    /// Mean variance \[DN^2\] of all pixels, of those at strong edges, of the others.
    mean_variance: [f64; 3],
    edges: f64,
    sobel: Plane<f32>,
}

/// The pixels of files.
struct Frames {
    first: Plane<u16>,
    largest: u16,
    /// Mean and variance of all frames, and of all but the first.
    statistics: [TemporalStatistics; 2],
}

/// Reads frames of one size, one at a time, and computes their photon transfer; `None` if it was cancelled.
///
/// # Errors
/// Fewer than three frames, a file that is no frame of grey values, frames that differ in size, settings out of range.
pub fn ptc_of_frames(
    files: &[PathBuf],
    settings: &PtcSettings,
    session: &Session<'_>,
) -> Result<Option<FrameStack>, Error> {
    settings.check_of_frames()?;
    let Some(Frames { first, largest, statistics: [statistics, others] }) = read_frames(files, session)? else {
        return Ok(None);
    };
    let bits = (8..=16).find(|bits| u32::from(largest) < 1 << bits).unwrap_or(16);
    let range @ [dark, saturation] = range_of(settings, largest, bits)?;
    // The gradient is scaled to 8 bits over the range.
    let scale = 255.0 / (saturation - dark);
    let eight = first.map(|&y| ((f64::from(y) - dark) * scale).clamp(0.0, 255.0).round() as u8);
    let gradient = Gradient::new(&eight, settings.edges());
    let curve = |keep: Option<&[bool]>| {
        if bits == 8 { picture_curve(&statistics, range, keep) } else { linear_curve(&statistics, range, keep) }
    };
    let mut inputs = InputFiles::new();
    files.iter().for_each(|file| inputs.add(file, Role::Frame));
    Ok(Some(FrameStack {
        mean_variance: gradient.mean_variance(&statistics.variance),
        correlations: gradient.correlations(&others.variance),
        curves: [curve(None)?, curve(Some(&gradient.flat))?],
        inputs,
        edges: settings.edges(),
        sobel: gradient.sobel,
        statistics,
    }))
}

/// Reads the frames; `None` if it was cancelled.
fn read_frames(files: &[PathBuf], session: &Session<'_>) -> Result<Option<Frames>, Error> {
    if files.len() < 3 {
        let problem = format!("{} frames are too few for the variance of a pixel and its error", files.len());
        return Err(Error::setting("frames", problem, "give three frames of the same scene or more"));
    }
    let (mut all, mut others, mut first, mut bits_of_first) = (None, None, None, None);
    let mut largest = 0;
    for (i, file) in files.iter().enumerate() {
        if session.is_cancelled() {
            return Ok(None);
        }
        session.report_share(Stage::Load, i as f64 / files.len() as f64);
        let GrayFrame { values: frame, stored_bits } = read_gray(file, &Limits::default())?;
        if *bits_of_first.get_or_insert(stored_bits) != stored_bits {
            let problem = format!("{} has {stored_bits} bits per value, the frames before it have not", file.display());
            return Err(Error::setting("frames", problem, "give frames that were all stored in the same way"));
        }
        let (width, height) = (frame.width(), frame.height());
        largest = frame.data().iter().copied().fold(largest, u16::max);
        let view = Frame::new(width, height, frame.data()).map_err(fault)?;
        for stack in [&mut all, &mut others].into_iter().take(if i == 0 { 1 } else { 2 }) {
            let stack = stack.get_or_insert_with(|| TemporalAccumulator::new(width, height));
            let wrong = |e: AnalysisError| {
                let help = "give frames of one camera, of one size";
                Error::setting("frames", format!("{}: {e}", file.display()), help)
            };
            stack.add(view).map_err(wrong)?;
        }
        first.get_or_insert(frame);
    }
    let (Some(all), Some(others), Some(first)) = (all, others, first) else { return Ok(None) };
    let statistics = [all.finish().map_err(fault)?, others.finish().map_err(fault)?];
    if statistics[0].variance.iter().all(|v| *v == 0.0) {
        let help = "give frames that were taken or rendered one after another";
        return Err(Error::setting("frames", "no pixel varies: all are copies of one frame", help));
    }
    Ok(Some(Frames { first, largest, statistics }))
}

/// Grey values \[DN\] of dark and of saturation.
fn range_of(settings: &PtcSettings, largest: u16, bits: u32) -> Result<[f64; 2], Error> {
    let dark = settings.dark.unwrap_or(0.0);
    let saturation = settings.saturation.unwrap_or(f64::from((1u32 << bits) - 1));
    if !(dark >= 0.0 && saturation > dark && saturation <= 65_535.0) {
        let problem = format!("{saturation} is no grey value of saturation above the dark one, {dark}");
        let help = "give grey values from 0 to 65535 by --dark and --saturation";
        return Err(Error::setting("saturation", problem, help));
    }
    if f64::from(largest) > saturation {
        let problem = format!("a frame holds {largest}, which is above {saturation}");
        return Err(Error::setting("saturation", problem, "give the largest grey value of the camera by --saturation"));
    }
    Ok([dark, saturation])
}

impl FrameStack {
    /// The findings as a few lines of text.
    pub fn findings(&self) -> Vec<String> {
        let s = &self.statistics;
        let mut lines = vec![
            format!("{} frames of {} x {} pixels", s.frames, s.width, s.height),
            format!(
                "temporal variance {} DN^2 on average; {} at the steepest {:.0} % of the pixels, {} elsewhere",
                rounded(self.mean_variance[0]),
                rounded(self.mean_variance[1]),
                100.0 * self.edges,
                rounded(self.mean_variance[2])
            ),
            match self.correlations {
                [by, ranks] if by.is_finite() && ranks.is_finite() => {
                    format!("the Sobel image of the first frame correlates with it by {by:.2}, its ranks by {ranks:.2}")
                }
                _ => "the Sobel image of the first frame is the same in all pixels: nothing correlates with it".into(),
            },
        ];
        for (what, curve) in ["all pixels", "without strong edges"].iter().zip(&self.curves) {
            lines.push(match &curve.fit {
                Some(f) => format!(
                    "{what}: K = {:.5} +- {:.5} DN/e-, variance without light {} +- {} DN^2, R^2 = {:.5}, chi^2 per degree of freedom {}",
                    f.slope.value,
                    f.slope.standard_error,
                    rounded(f.intercept.value),
                    rounded(f.intercept.standard_error),
                    f.r_squared,
                    rounded(f.reduced_chi_squared)
                ),
                None => format!("{what}: too few grey values for a line"),
            });
        }
        if let Some(line) = &self.curves[0].fit
            && line.intercept.value < -5.0 * line.intercept.standard_error
        {
            lines.push(format!(
                "no variance is below zero: is {} the grey value without light? set it with --dark",
                rounded(self.curves[0].range[0])
            ));
        }
        lines
    }

    /// The figures: `curves` and `lines` of all pixels and of those without strong edges, `variance` \[DN^2\] and its
    /// correlation with the Sobel magnitude of the first frame. Unknown numbers are null.
    pub fn figures(&self) -> Figures {
        table::figures(&self.tables())
    }

    fn tables(&self) -> [Table; 3] {
        let estimate_of = |value, error| Cell::Estimate(Estimate { value, error });
        let named = || PIXELS_OF.iter().map(|what| Cell::Text((*what).into()));
        let points = |(what, curve): (Cell, &Curve)| {
            let row = |p: &TransferPoint| {
                let [mean, variance] = [(p.mean, p.mean_error), (p.variance, p.variance_error)];
                vec![
                    what.clone(),
                    estimate_of(mean.0, mean.1),
                    estimate_of(variance.0, variance.1),
                    Cell::Count(p.pixels),
                ]
            };
            curve.points.iter().map(row).collect::<Vec<_>>()
        };
        let line = |(what, curve): (Cell, &Curve)| {
            let f = curve.fit.as_ref()?;
            let [gain, intercept] = [f.slope, f.intercept].map(|v| estimate_of(v.value, v.standard_error));
            Some(vec![what, gain, intercept, Cell::Number(f.r_squared), Cell::Number(f.reduced_chi_squared)])
        };
        let of = column("pixels_of", "", "");
        let curves = Table {
            name: "curves",
            columns: vec![of, estimate("mean", "", ""), estimate("variance", "", ""), column("pixels", "", "")],
            rows: named().zip(&self.curves).flat_map(points).collect(),
        };
        let quality = ["r_squared", "reduced_chi_squared"].map(|key| column(key, "", ""));
        let lines = Table {
            name: "lines",
            columns: [of, estimate("gain", "", ""), estimate("intercept", "", "")].into_iter().chain(quality).collect(),
            rows: named().zip(&self.curves).filter_map(line).collect(),
        };
        let keys = ["variance", "variance_edges", "variance_flat", "pearson", "spearman"];
        let variance = Table {
            name: "variance",
            columns: keys.map(|key| column(key, "", "")).to_vec(),
            rows: vec![self.mean_variance.iter().chain(&self.correlations).map(|v| Cell::Number(*v)).collect()],
        };
        [curves, lines, variance]
    }

    /// Writes a page with curves and maps, and the curve as CSV, into a folder. Returns the files, the page first.
    ///
    /// # Errors
    /// A file that cannot be written, or a folder that contains the measurement of a scene.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Error> {
        check_folder(folder, &self.inputs)?;
        let drawn = self.charts();
        let s = &self.statistics;
        let plane = Plane::from_vec(s.width, s.height, s.variance.clone()).unwrap_or_else(|| Plane::new(1, 1, 0.0));
        let variance = maps::logarithmic(&plane, &plane, "DN\u{b2}", format!("variance over {} frames", s.frames))?;
        let sobel = self.sobel.map(|&v| f64::from(v));
        let sobel = maps::linear(&sobel, "of 255 per pixel", "Sobel magnitude of the first frame".into())?;
        let sections = [
            head("Photon transfer of frames", &format!("dunkelfeld {}", env!("CARGO_PKG_VERSION"))),
            html! { section { ul { @for finding in self.findings() { li { (finding) } } } } },
            html! {
                section.pairs {
                    h2 { "Photon transfer" }
                    p { "Pixels of like mean form a point; its height is their mean variance. For a linear camera it is a \
                        straight line of slope K (EMVA 1288 release 4.0 Linear, equation 15)." }
                    (charts(&drawn))
                }
            },
            html! { section.pairs { h2 { "Where the variance is" } (maps([&variance, &sobel])) } },
        ];
        if Kept::is_there(folder) {
            let problem = "holds the measurement of a scene, whose report this one would replace".into();
            return Err(Error::Output { file: folder.into(), problem, help: "name another folder with -o".into() });
        }
        let _locked = ResultsFolder::open(folder)?;
        let [curves, ..] = self.tables();
        write(folder, &page("photon transfer of frames", &sections), [("curves", curves.csv())], &drawn)
    }

    fn charts(&self) -> [Chart; 2] {
        let one = |i: usize, name: &str, words: &str| {
            chart(name, &format!("photon transfer, {words}"), LINEAR_AXES, &[(i, words, &self.curves[i])])
        };
        [one(0, "transfer", "all pixels"), one(1, "transfer-flat", "without strong edges")]
    }
}
