//! The sensor file of a measured camera, and the maps of its pixels, as a job reads them.

use super::measurement::ReadMeasurement;
use super::options::AnalyseOptions;
use dunkelfeld::Error;
use dunkelfeld::film::Plane;
use dunkelfeld::outputs::{save_text, written};
use dunkelfeld::sensor::PixelMap;
use dunkelfeld_emva1288::{Analysis, MeasuredMaps, Quantity, measured_maps};
use dunkelfeld_io::InputError;
use dunkelfeld_io::sensor_file::parse_sensor;
use dunkelfeld_io::tiff::write_map;
use dunkelfeld_io::toml_file::{TomlFile, toml_text};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The maps: key of the sensor file, end of the file name, description.
const MAPS: [(&str, &str, &str); 3] = [
    ("dsnu_map", "dsnu", "dark signal of each pixel less the mean [e-]"),
    ("prnu_map", "prnu", "response of each pixel over the flat field"),
    ("flat_field", "flat", "response over its mean, low frequencies"),
];

/// The files that belong to a sensor file: itself, and its maps beside it.
pub(super) fn files_of(sensor: &Path, maps: bool) -> Vec<PathBuf> {
    let of_maps = MAPS.iter().filter(|_| maps).map(|(_, end, _)| sensor.with_file_name(map_name(sensor, end)));
    std::iter::once(sensor.to_path_buf()).chain(of_maps).collect()
}

fn map_name(sensor: &Path, end: &str) -> String {
    format!("{}-{end}.tif", sensor.file_stem().unwrap_or_default().to_string_lossy())
}

/// Writes the sensor file of the options, and its maps if they are wanted, and returns the files.
///
/// # Errors
/// Figures that no sensor can have, maps without stacks, and those of the file system.
pub(super) fn save(
    analysis: &Analysis,
    read: &ReadMeasurement,
    options: &AnalyseOptions,
    path: &Path,
) -> Result<Vec<PathBuf>, Error> {
    let mut text = sensor_text(analysis, read, options, path);
    parse_sensor(&TomlFile::from_text(path, text.clone()))?;
    if options.maps {
        let unfit = |problem: String, help: &str| InputError::new(&read.file, "data set", problem, help);
        let maps = measured_maps(&read.measurement, analysis).map_err(|e| unfit(e.to_string(), e.help()))?;
        let help = "add a block of 16 or more frames without light, and one at half of saturation";
        let maps = maps.ok_or_else(|| unfit("there are no stacks, from which maps are made".into(), help))?;
        let MeasuredMaps { width, height, dsnu, prnu, flat_field } = maps;
        let mut keys = String::from("# Without these lines a seed draws the pattern, for images of any size.\n");
        for ((key, end, description), values) in MAPS.into_iter().zip([dsnu, prnu, flat_field]) {
            let name = map_name(path, end);
            let plane = Plane::from_vec(width, height, values).map(PixelMap::new);
            let map = plane.and_then(Result::ok).ok_or_else(|| unfit(format!("{key} is not finite"), help))?;
            let file = path.with_file_name(&name);
            written(&file, write_map(&file, &map, description))?;
            keys += &toml_text(&std::collections::BTreeMap::from([(key, name)])).unwrap_or_default();
        }
        // Keys of the file itself are in front of its tables.
        let at = text.find("\n[dark_current]\n").map_or(text.len(), |end| end + 1);
        text.insert_str(at, &keys);
    }
    save_text(path, &text)?;
    Ok(files_of(path, options.maps))
}

/// The first keys.
#[derive(Serialize)]
struct Head<'a> {
    name: &'a str,
    source: String,
    derived: Vec<&'a str>,
    assumed: Vec<&'a str>,
}

/// The figures of a data set as keys of a sensor file, each with its standard error.
struct Keys<'a> {
    analysis: &'a Analysis,
    text: String,
    assumed: Vec<&'a str>,
}

impl<'a> Keys<'a> {
    /// A number, at most `limit`. A figure that is only known to be small is left out, with its bound; and the number is
    /// then 0.
    fn figure(&mut self, key: &str, symbol: &str, limit: f64) -> f64 {
        let bound = self.analysis.bound(symbol);
        match (self.analysis.get(symbol), bound) {
            (Some(q), None) => {
                let value = q.value.min(limit);
                self.line(key, &shortest(value), q);
                value
            }
            (Some(q), Some(bound)) => {
                let _ =
                    writeln!(self.text, "# {key}: unknown, {symbol} is at most {} {}", shortest(bound.limit), q.unit);
                0.0
            }
            (None, _) => {
                let _ = writeln!(self.text, "# {key}: unknown, the data set has no {symbol}");
                0.0
            }
        }
    }

    fn line(&mut self, key: &str, value: &str, q: &Quantity) {
        let _ = writeln!(self.text, "{key} = {value}  # +- {:.1e}, {}", q.standard_error, q.symbol);
    }

    /// A total with the parts of rows and columns, which leave something of it by squares.
    fn pattern(&mut self, keys: [&str; 3], symbols: [&str; 3]) {
        let total = self.figure(keys[0], symbols[0], f64::INFINITY);
        if total > 0.0 {
            let row = self.figure(keys[1], symbols[1], total);
            self.figure(keys[2], symbols[2], (total * total - row * row).max(0.0).sqrt());
        }
    }

    /// The dark noise is required: if only a bound is known, that is assumed.
    fn dark_noise(&mut self) -> f64 {
        let Some(bound) = self.analysis.bound("sigma_d") else {
            return self.figure("dark_noise_e", "sigma_d", f64::INFINITY);
        };
        self.assumed.push("dark_noise_e");
        let value = shortest(bound.limit);
        let _ = writeln!(
            self.text,
            "dark_noise_e = {value}  # the upper bound of sigma_d; the data set does not show more"
        );
        bound.limit
    }

    /// Electrons of a full pixel, from the largest grey value.
    fn full_well(&mut self) {
        let a = self.analysis;
        let (gain, relative) = (a.value("K"), a.get("K").map_or(0.0, |k| k.standard_error / k.value));
        let Some(largest) = a.saturation_value else {
            self.figure("full_well_e", "mu_e.sat", f64::INFINITY);
            self.text += "# The brightest frames do not end at one value, so this is the saturation capacity.\n";
            return;
        };
        let electrons = (f64::from(largest) - a.value("mu_y.dark")) / gain;
        let (value, error) = (shortest(electrons), relative * electrons);
        let _ = writeln!(self.text, "full_well_e = {value}  # +- {error:.1e}, at the largest grey value {largest}");
        if u32::from(largest) + 1 == 1 << a.bits {
            self.text += "# That is the end of the converter: the well may hold more.\n";
        }
    }

    fn dark_current(&mut self) {
        self.assumed.push("temperature_c");
        self.text += "temperature_c = 25  # not measured; it stands for that of the camera during the measurement\n";
        let known = |symbol: &str| self.analysis.get(symbol).filter(|q| q.value > 2.0 * q.standard_error);
        let Some(mean) = known("mu_I.mean") else {
            self.text += "# [dark_current]: the data set does not show one\n";
            return;
        };
        self.assumed.push("doubling_k");
        self.text += "[dark_current]\n";
        self.line("e_per_s", &shortest(mean.value), mean);
        self.text += "at_c = 25  # temperature_c\ndoubling_k = 7  # not measured; usual for silicon\n";
        if let Some(other) =
            known("mu_I.var").filter(|v| v.value - mean.value > 3.0 * v.standard_error.hypot(mean.standard_error))
        {
            let _ =
                writeln!(self.text, "# The noise shows more, {other}: the camera may subtract the mean dark current.");
        }
    }
}

fn sensor_text(a: &Analysis, read: &ReadMeasurement, options: &AnalyseOptions, path: &Path) -> String {
    let mut keys = Keys { analysis: a, text: String::new(), assumed: Vec::new() };
    let ([width, height], pitch) = (read.size, options.pixel_pitch.unwrap_or_default());
    let _ = writeln!(keys.text, "bit_depth = {}\npixel_pitch_um = {pitch}\nresolution = [{width}, {height}]", a.bits);
    if let Some(eta) = a.get("eta") {
        let point = format!("[[{}, {}]]", options.wavelength.unwrap_or_default(), shortest(eta.value));
        keys.line("quantum_efficiency", &point, eta);
    }
    keys.figure("gain_dn_per_e", "K", f64::INFINITY);
    keys.figure("offset_dn", "mu_y.dark", f64::INFINITY);
    keys.full_well();
    let dark_noise = keys.dark_noise();
    keys.figure("row_noise_e", "sigma_d.row", dark_noise);
    keys.pattern(["dsnu_e", "dsnu_row_e", "dsnu_column_e"], ["DSNU1288", "DSNU1288.row", "DSNU1288.col"]);
    keys.pattern(
        ["prnu_percent", "prnu_row_percent", "prnu_column_percent"],
        ["PRNU1288", "PRNU1288.row", "PRNU1288.col"],
    );
    keys.dark_current();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let source = format!("dunkelfeld emva analyse {}, EMVA 1288", read.file.display());
    let head = Head { name: &stem, source, derived: vec!["full_well_e"], assumed: keys.assumed };
    // Plain data with string keys: serialisation cannot fail.
    let mut text =
        toml_text(&head).unwrap_or_default() + "# A comment has the standard error of the value and its symbol.\n\n";
    text += &keys.text;
    a.notes.iter().for_each(|note| text += &format!("# Note: {note}\n"));
    text
}

/// Seven significant digits: exact for 16 bits.
fn shortest(value: f64) -> String {
    format!("{value:.6e}").parse::<f64>().unwrap_or(value).to_string()
}
