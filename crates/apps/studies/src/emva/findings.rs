//! The results of the analyser, for users and programs.

use super::measurement::ReadMeasurement;
use super::options::AnalyseOptions;
use super::page;
use dunkelfeld::Error;
use dunkelfeld::guard::{Output, check_outputs};
use dunkelfeld::outputs::written;
use dunkelfeld_emva1288::{Analysis, AnalysisSettings, Bound, GeneralAnalysis, Quantity, analyse, analyse_general};
use dunkelfeld_io::InputError;
use dunkelfeld_io::emva_descriptor::read_descriptor;
use dunkelfeld_io::input::{InputFiles, Role};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The results of a data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "module", rename_all = "lowercase")]
pub enum Findings {
    /// Results of a linear camera.
    Linear(Box<Analysis>),
    /// Results of any camera, at its input.
    General(GeneralAnalysis),
}

impl Findings {
    /// Checks before frames are read the options, and whether the files can be written: each to its own path, and none with
    /// the path of the descriptor or of a frame.
    ///
    /// # Errors
    /// Those of [`AnalyseOptions::check`]; the first file that cannot be written; a descriptor that cannot be read.
    pub fn check_outputs(
        input: &Path,
        options: &AnalyseOptions,
        json: Option<&Path>,
        html: Option<&Path>,
    ) -> Result<(), Error> {
        options.check()?;
        let paths = [("the figures as JSON", json), ("the report", html)];
        let sensor_files = options.sensor_files();
        let of_sensor = sensor_files.iter().map(|path| ("the measured sensor", path.as_path()));
        let outputs: Vec<Output<'_>> =
            paths.into_iter().filter_map(|(what, path)| Some((what, path?))).chain(of_sensor).collect();
        if outputs.is_empty() {
            return Ok(());
        }
        let mut inputs = InputFiles::new();
        inputs.add(input, Role::Descriptor);
        check_outputs(&outputs, &inputs)?;
        for (_, path) in &outputs {
            written(path, dunkelfeld_io::atomic::check_writable(path))?;
        }
        let folder = input.parent().unwrap_or(Path::new(""));
        let (descriptor, _) = read_descriptor(input)?;
        let frames = descriptor.blocks.iter().flat_map(|b| &b.frames);
        frames.for_each(|frame| inputs.add(&folder.join(frame), Role::Frame));
        check_outputs(&outputs, &inputs)
    }

    /// Analyses a linear camera.
    ///
    /// # Errors
    /// The shortcomings of the data set.
    pub fn linear(read: &ReadMeasurement, settings: &AnalysisSettings) -> Result<Self, Error> {
        let found = analyse(&read.measurement, settings);
        found
            .map(|a| Self::Linear(Box::new(a)))
            .map_err(|e| InputError::new(&read.file, "data set", e.to_string(), e.help()).into())
    }

    /// Analyses a camera of any characteristic.
    ///
    /// # Errors
    /// The shortcomings of the data set.
    pub fn general(read: &ReadMeasurement, settings: &AnalysisSettings) -> Result<Self, Error> {
        let found = analyse_general(&read.measurement, settings);
        found.map(Self::General).map_err(|e| InputError::new(&read.file, "data set", e.to_string(), e.help()).into())
    }

    /// The figures.
    pub fn quantities(&self) -> &[Quantity] {
        match self {
            Self::Linear(a) => &a.quantities,
            Self::General(a) => &a.quantities,
        }
    }

    /// The bound of a figure of which only a bound is known.
    pub fn bound(&self, symbol: &str) -> Option<Bound> {
        match self {
            Self::Linear(a) => a.bound(symbol),
            Self::General(a) => a.bound(symbol),
        }
    }

    /// The shortcomings of the data set against the standard.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Linear(a) => &a.notes,
            Self::General(a) => &a.notes,
        }
    }

    /// All results as JSON: `quantities`, and the numbers behind every plot.
    pub fn json(&self) -> String {
        // Plain data with string keys: serialisation cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// The figures as a table with aligned columns: symbol, value, error, unit, name, section.
    pub fn table(&self) -> String {
        let rows: Vec<[String; 6]> = self
            .quantities()
            .iter()
            .map(|q| {
                let (value, error) = page::shown(q, self.bound(q.symbol));
                [q.symbol.into(), value, error, q.unit.into(), q.name.into(), q.section.into()]
            })
            .collect();
        let heads = ["symbol", "value", "error", "unit", "name", "section"].map(String::from);
        let all = || std::iter::once(&heads).chain(&rows);
        let widths: [usize; 6] = std::array::from_fn(|i| all().map(|r| r[i].chars().count()).max().unwrap_or(0));
        let mut text = String::new();
        for row in all() {
            let cells = row.iter().zip(widths).enumerate().map(|(i, (cell, width))| match i {
                1 | 2 => format!("{cell:>width$}"),
                _ => format!("{cell:<width$}"),
            });
            text += cells.collect::<Vec<_>>().join("  ").trim_end();
            text += "\n";
        }
        text
    }

    /// One page with the figures and the plots of the standard. It needs no other file.
    pub fn html(&self, read: &ReadMeasurement) -> String {
        page::page(self, read)
    }

    /// Writes the sensor file of the options and its maps, and returns the files: none without a sensor file.
    ///
    /// # Errors
    /// Figures that no sensor can have, maps without stacks, and those of the file system.
    pub fn save_sensor(&self, read: &ReadMeasurement, options: &AnalyseOptions) -> Result<Vec<PathBuf>, Error> {
        match (self, &options.sensor) {
            (Self::Linear(analysis), Some(path)) => super::sensor_file::save(analysis, read, options, path),
            _ => Ok(Vec::new()),
        }
    }

    /// Writes [`Findings::json`].
    ///
    /// # Errors
    /// Those of the file system.
    pub fn save_json(&self, path: &Path) -> Result<(), Error> {
        dunkelfeld::outputs::save_text(path, &self.json())
    }

    /// Writes [`Findings::html`].
    ///
    /// # Errors
    /// Those of the file system.
    pub fn save_html(&self, read: &ReadMeasurement, path: &Path) -> Result<(), Error> {
        dunkelfeld::outputs::save_text(path, &self.html(read))
    }
}
