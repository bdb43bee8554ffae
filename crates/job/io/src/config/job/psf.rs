//! The point spread function of a lens, as a job writes it: a word, a Gaussian, or a table in a CSV file.

use crate::error::InputError;
use crate::input::{InputFiles, Role};
use crate::quantity::Length;
use dunkelfeld_radiometry::Metres;
use dunkelfeld_sensor::{MtfCurve, MtfTable, Psf};
use serde::Deserialize;
use serde::de::{Deserializer, Error};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Larger files are refused. A table of ten heights and a hundred frequencies has a hundredth of it.
const LARGEST: u64 = 1 << 20;

/// `psf` of a lens.
#[derive(Clone, Debug, PartialEq)]
pub enum PsfSettings {
    /// `"none"`, `"diffraction"`, `{ sigma = "1.5um" }` or `{ mtf50 = 80 }`.
    Given(Psf),
    /// A CSV file, relative to the job file: see [`load_mtf`].
    File(PathBuf),
}

impl PsfSettings {
    /// From a word or the path of a CSV file.
    ///
    /// # Errors
    /// A word that is none of `none` and `diffraction`, and no name of a CSV file.
    pub fn from_word(word: &str) -> Result<Self, String> {
        match word {
            "none" => Ok(Self::Given(Psf::None)),
            "diffraction" => Ok(Self::Given(Psf::Diffraction)),
            _ if word.to_ascii_lowercase().ends_with(".csv") => Ok(Self::File(word.into())),
            _ => Err(format!(
                "\"{word}\" is no point spread function; write \"none\", \"diffraction\" or a CSV file; a job may also have {{ sigma = \"1.5um\" }} or {{ mtf50 = 80 }}"
            )),
        }
    }

    /// The point spread function. A table is read from its file.
    ///
    /// # Errors
    /// As [`load_mtf`].
    pub fn load(&self, inputs: &mut InputFiles) -> Result<Psf, InputError> {
        match self {
            Self::Given(psf) => Ok(psf.clone()),
            Self::File(path) => Ok(Psf::Table(Arc::new(load_mtf(path, inputs)?))),
        }
    }
}

impl<'de> Deserialize<'de> for PsfSettings {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "write \"none\", \"diffraction\", a CSV file, { sigma = \"1.5um\" } or { mtf50 = 80 }, in line pairs per mm"
        )]
        enum Written {
            Word(String),
            Gaussian(Gaussian),
            Mtf50(Mtf50),
        }
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Gaussian {
            sigma: Length,
        }
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Mtf50 {
            mtf50: f64,
        }
        let gaussian = match Written::deserialize(d)? {
            Written::Word(word) => return Self::from_word(&word).map_err(D::Error::custom),
            Written::Gaussian(Gaussian { sigma: Length(sigma) }) => Psf::gaussian(Metres(sigma)),
            Written::Mtf50(Mtf50 { mtf50 }) => Psf::mtf50(1e3 * mtf50),
        };
        gaussian.map(Self::Given).map_err(D::Error::custom)
    }
}

/// Reads the MTF of a lens from a CSV file with a row per frequency: `frequency_lp_mm` on the sensor and `mtf`, and
/// `height_mm` for several field heights. For a lens whose sagittal and tangential lines differ, it is their mean.
///
/// # Errors
/// A file that cannot be read, has other columns, or is not an MTF.
pub fn load_mtf(path: &Path, inputs: &mut InputFiles) -> Result<MtfTable, InputError> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Row {
        #[serde(default)]
        height_mm: f64,
        frequency_lp_mm: f64,
        mtf: f64,
    }
    let bytes = inputs.read(path, Role::Mtf, LARGEST).map_err(|fault| fault.at(path))?;
    let help = "write the columns height_mm (optional), frequency_lp_mm and mtf, with a row per frequency";
    let mut curves: Vec<MtfCurve> = Vec::new();
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(&bytes[..]);
    for row in reader.deserialize() {
        let Row { height_mm, frequency_lp_mm, mtf } = row.map_err(|e| {
            let line = e.position().map_or_else(|| "the table".into(), |p| format!("line {}", p.line()));
            InputError::new(path, line, e.to_string(), help)
        })?;
        let (height, point) = (1e-3 * height_mm, [1e3 * frequency_lp_mm, mtf]);
        match curves.last_mut() {
            // The point at frequency 0, where the MTF is 1, says nothing.
            _ if point == [0.0, 1.0] => {}
            Some(curve) if curve.height == height => curve.points.push(point),
            _ => curves.push(MtfCurve { height, points: vec![point] }),
        }
    }
    MtfTable::new(curves).map_err(|e| InputError::new(path, "the table", e.to_string(), help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read_by_their_columns() {
        let folder = tempfile::tempdir().expect("a folder");
        let read = |text: &str| {
            let path = folder.path().join("lens.csv");
            std::fs::write(&path, text).expect("written");
            load_mtf(&path, &mut InputFiles::new())
        };
        let table = read("mtf, frequency_lp_mm, height_mm\n1, 0, 0\n0.8, 50, 0\n0.5, 100, 0\n# outside\n0.6, 50, 4\n");
        let curve = |height, points: &[[f64; 2]]| MtfCurve { height, points: points.to_vec() };
        let expected = MtfTable::new(vec![curve(0.0, &[[50e3, 0.8], [100e3, 0.5]]), curve(4e-3, &[[50e3, 0.6]])]);
        assert_eq!(table.expect("a table"), expected.expect("valid"));
        for (text, place) in [
            ("frequency_lp_mm,mtf\n50,1.2\n", "the table"),
            ("frequency_lp_mm,mtf\n50,0.4\n60,0.5\n", "the table"),
            ("frequency_lp_mm,mtf\n50,NaN\n", "the table"),
            ("frequency_lp_mm,mtf\n50,0.5\n60,x\n", "line 3"),
            ("f,mtf\n50,0.5\n", "line 2"),
            ("", "the table"),
        ] {
            let error = read(text).expect_err(text);
            assert_eq!(error.place, place, "{text}: {}", error.problem);
        }
    }

    #[test]
    fn words_and_numbers_are_point_spread_functions() {
        let read =
            |text: &str| toml::from_str::<std::collections::BTreeMap<String, PsfSettings>>(&format!("psf = {text}"));
        let of = |text: &str| read(text).expect(text).remove("psf").expect("a key");
        assert_eq!(of("\"diffraction\""), PsfSettings::Given(Psf::Diffraction));
        assert_eq!(of("\"none\""), PsfSettings::Given(Psf::None));
        assert_eq!(of("\"lens.csv\""), PsfSettings::File("lens.csv".into()));
        assert_eq!(of("{ sigma = \"1.5um\" }"), PsfSettings::Given(Psf::Gaussian { sigma: Metres(1.5 * 1e-6) }));
        assert!(matches!(of("{ mtf50 = 80 }"), PsfSettings::Given(Psf::Gaussian { .. })));
        for bad in
            ["\"sharp\"", "3", "{ sigma = \"0um\" }", "{ mtf50 = 0 }", "{ mtf50 = nan }", "{ sigma = 1, mtf50 = 2 }"]
        {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
