//! Sensor files: TOML with the unit in every key. Values are checked. Errors contain the place in the file.
//!
//! ```toml
//! name = "Sony IMX900, low conversion gain"   # free text
//! source = "test report of the maker"
//! derived = ["gain_e_per_dn"]                 # optional: keys whose values were computed from others
//! assumed = ["offset_dn"]                     # optional: keys whose values are assumptions
//! bit_depth = 12                              # 8 to 16
//! pixel_pitch_um = 2.25
//! resolution = [2064, 1552]                   # optional: columns and rows
//! quantum_efficiency = [[536, 0.9125]]        # points [nm, fraction]; one point holds for all wavelengths
//! full_well_e = 9458
//! dark_noise_e = 5.56                         # sigma_d0
//! gain_e_per_dn = 2.505                       # or gain_dn_per_e, the K of EMVA 1288
//! offset_dn = 32                              # black level
//! row_noise_e = 0.4                           # optional: the part of dark_noise_e that rows share
//! dsnu_e = 3.7                                # optional, 0 if absent
//! dsnu_row_e = 0.5                            # optional: the parts of dsnu_e that rows and columns share
//! dsnu_column_e = 0.8
//! prnu_percent = 0.7                          # optional, 0 if absent; with prnu_row_percent and prnu_column_percent
//! temperature_c = 36                          # optional, 25 if absent
//! min_exposure_us = 19                        # optional, as max_exposure_s: no limit if absent
//! dsnu_map = "dsnu.tif"                       # optional, as prnu_map and flat_field: measured maps of the pixels
//! [dark_current]                              # optional, none if absent
//! e_per_s = 1.47
//! at_c = 36
//! doubling_k = 7
//! [color_filter]                              # optional: a colour sensor, in place of quantum_efficiency
//! pattern = "rggb"
//! red = [[610, 0.5]]
//! green = [[530, 0.6]]
//! blue = [[460, 0.55]]
//! [defects]                                   # optional
//! hot_per_million = 50
//! dead_per_million = 5
//! [published]                                 # optional, only to compare with
//! dynamic_range_db = 63.8
//! snr_max_db = 39.76
//! ```

use std::path::{Path, PathBuf};

use dunkelfeld_film::MAX_SIDE;
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Number, Seconds};
use dunkelfeld_sensor::{
    BayerPattern, ColorFilter, DarkCurrent, Defects, Efficiency, FixedPattern, PRESETS, PixelMaps, Published,
    QuantumEfficiency, SensorError, SensorModel, SensorSpec,
};
use serde::Deserialize;
use serde::de::{Deserializer, Error};

use crate::error::InputError;
use crate::input::{InputFiles, Role};
use crate::job::check::{whole, yes};
use crate::tiff::read_map;
use crate::toml_file::TomlFile;
use crate::toml_keys::keys_of;

/// The sensor of the preset of this name, or of the file if there is no such preset.
///
/// # Errors
/// No such preset or file, or a file that is not a sensor.
pub fn find_sensor(name_or_path: &str) -> Result<SensorModel, InputError> {
    if PRESETS.iter().any(|(name, _)| *name == name_or_path) {
        return preset(name_or_path);
    }
    let path = Path::new(name_or_path);
    // A plain word that is no file is interpreted as a name.
    if path.extension().is_none() && !path.exists() { preset(name_or_path) } else { load_sensor(path) }
}

/// Reads a sensor file.
///
/// # Errors
/// The file cannot be read, is not valid TOML, has unknown or missing keys or values out of range.
pub fn load_sensor(path: &Path) -> Result<SensorModel, InputError> {
    load_sensor_recorded(path, &mut InputFiles::new())
}

/// [`load_sensor`], and records the file as an input.
///
/// # Errors
/// As [`load_sensor`].
pub fn load_sensor_recorded(path: &Path, inputs: &mut InputFiles) -> Result<SensorModel, InputError> {
    parse_recorded(&TomlFile::read(path, Role::Sensor, inputs)?, inputs)
}

/// The preset of that name.
///
/// # Errors
/// There is none.
pub fn preset(name: &str) -> Result<SensorModel, InputError> {
    match PRESETS.iter().find(|(n, _)| *n == name) {
        Some((_, text)) => parse_sensor(&TomlFile::from_text(format!("{name}.toml"), *text)),
        None => {
            let known: Vec<&str> = preset_names().collect();
            let help = format!("name a sensor file (*.toml) or one of {}", known.join(", "));
            Err(InputError::of_file(name, "there is no preset of that name", help))
        }
    }
}

/// The names of all presets.
pub fn preset_names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|(name, _)| *name)
}

/// A sensor from the text of its file. Paths of maps are relative to that file.
///
/// # Errors
/// As [`load_sensor`].
pub fn parse_sensor(file: &TomlFile) -> Result<SensorModel, InputError> {
    parse_recorded(file, &mut InputFiles::new())
}

fn parse_recorded(file: &TomlFile, inputs: &mut InputFiles) -> Result<SensorModel, InputError> {
    let toml: SensorToml = file.parse()?;
    toml.check_names(file)?;
    let (gain_key, system_gain) = toml.gain(file)?;
    let quantum_efficiency = toml.efficiency(file)?;
    let mut map = |path: &Option<PathBuf>| path.as_ref().map(|p| read_map(&file.resolve(p), inputs)).transpose();
    let (dsnu, prnu, flat_field) = (map(&toml.dsnu_map)?, map(&toml.prnu_map)?, map(&toml.flat_field)?);
    let maps = PixelMaps { dsnu, prnu, flat_field };
    let temperature = Celsius(toml.temperature_c);
    let dark_current = match toml.dark_current {
        Some(d) => DarkCurrent { rate: d.e_per_s, reference: Celsius(d.at_c), doubling: d.doubling_k },
        None => DarkCurrent { rate: 0.0, reference: temperature, doubling: 7.0 },
    };
    let spec = SensorSpec {
        name: toml.name,
        source: toml.source,
        derived: toml.derived,
        assumed: toml.assumed,
        pixel_pitch: Metres::from_micrometres(toml.pixel_pitch_um),
        resolution: toml.resolution.or(maps.size()),
        quantum_efficiency,
        full_well: Electrons(toml.full_well_e),
        dark_noise: Electrons(toml.dark_noise_e),
        row_noise: Electrons(toml.row_noise_e),
        dark_current,
        temperature,
        min_exposure: toml.min_exposure_us.map(|us| Seconds(us * 1e-6)),
        max_exposure: toml.max_exposure_s.map(Seconds),
        system_gain,
        offset: DigitalNumber(toml.offset_dn),
        bit_depth: toml.bit_depth,
        fixed_pattern: FixedPattern {
            dsnu: Electrons(toml.dsnu_e),
            dsnu_row: Electrons(toml.dsnu_row_e),
            dsnu_column: Electrons(toml.dsnu_column_e),
            prnu: toml.prnu_percent / 100.0,
            prnu_row: toml.prnu_row_percent / 100.0,
            prnu_column: toml.prnu_column_percent / 100.0,
            maps,
        },
        defects: Defects {
            hot: toml.defects.hot_per_million / 1e6,
            hot_factor: toml.defects.hot_dark_current_factor,
            dead: toml.defects.dead_per_million / 1e6,
        },
        published: toml.published,
    };
    SensorModel::new(spec).map_err(|e| match &e {
        SensorError::OutOfRange { field, allowed, .. } => {
            let (table, key) = key_of(field, gain_key);
            let path: Vec<&str> = table.into_iter().chain([key]).collect();
            file.error_at_key(&path, "the value is out of range", format!("write a value {allowed}"))
        }
        SensorError::Map { name, .. } => {
            file.error_at_key(&[name], e.to_string(), "use maps of this sensor, all of its size")
        }
        other => InputError::of_file(file.path(), other.to_string(), "see the format of sensor files"),
    })
}

/// The key of a field of [`SensorSpec`], and the table that has it.
fn key_of<'a>(field: &'a str, gain: &'a str) -> (Option<&'a str>, &'a str) {
    let key = match field {
        "dark_current" => return (Some("dark_current"), "e_per_s"),
        "dark_current_reference" => return (Some("dark_current"), "at_c"),
        "dark_current_doubling" => return (Some("dark_current"), "doubling_k"),
        "hot" => return (Some("defects"), "hot_per_million"),
        "hot_factor" => return (Some("defects"), "hot_dark_current_factor"),
        "dead" => return (Some("defects"), "dead_per_million"),
        "system_gain" => gain,
        "pixel_pitch" => "pixel_pitch_um",
        "full_well" => "full_well_e",
        "dark_noise" => "dark_noise_e",
        "row_noise" => "row_noise_e",
        "temperature" => "temperature_c",
        "min_exposure" => "min_exposure_us",
        "max_exposure" => "max_exposure_s",
        "bit_depth" => "bit_depth",
        "offset" => "offset_dn",
        "dsnu" => "dsnu_e",
        "dsnu_row" => "dsnu_row_e",
        "dsnu_column" => "dsnu_column_e",
        "prnu" => "prnu_percent",
        "prnu_row" => "prnu_row_percent",
        "prnu_column" => "prnu_column_percent",
        figure => return (Some("published"), figure),
    };
    (None, key)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorToml {
    name: String,
    source: String,
    #[serde(default)]
    derived: Vec<String>,
    #[serde(default)]
    assumed: Vec<String>,
    #[serde(deserialize_with = "bit_depth")]
    bit_depth: u32,
    pixel_pitch_um: f64,
    #[serde(default, deserialize_with = "resolution")]
    resolution: Option<[u32; 2]>,
    quantum_efficiency: Option<Points>,
    full_well_e: f64,
    dark_noise_e: f64,
    #[serde(default)]
    row_noise_e: f64,
    gain_e_per_dn: Option<f64>,
    gain_dn_per_e: Option<f64>,
    offset_dn: f64,
    #[serde(default)]
    dsnu_e: f64,
    #[serde(default)]
    dsnu_row_e: f64,
    #[serde(default)]
    dsnu_column_e: f64,
    #[serde(default)]
    prnu_percent: f64,
    #[serde(default)]
    prnu_row_percent: f64,
    #[serde(default)]
    prnu_column_percent: f64,
    dsnu_map: Option<PathBuf>,
    prnu_map: Option<PathBuf>,
    flat_field: Option<PathBuf>,
    #[serde(default = "room_temperature")]
    temperature_c: f64,
    min_exposure_us: Option<f64>,
    max_exposure_s: Option<f64>,
    dark_current: Option<DarkCurrentToml>,
    color_filter: Option<ColorFilterToml>,
    #[serde(default)]
    defects: DefectsToml,
    #[serde(default, with = "PublishedToml")]
    published: Published,
}

/// Points \[nm, fraction\] of a curve.
type Points = Vec<[f64; 2]>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DarkCurrentToml {
    e_per_s: f64,
    at_c: f64,
    doubling_k: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ColorFilterToml {
    #[serde(deserialize_with = "pattern")]
    pattern: BayerPattern,
    red: Points,
    green: Points,
    blue: Points,
    #[serde(default = "yes")]
    white_balance: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct DefectsToml {
    hot_per_million: f64,
    hot_dark_current_factor: f64,
    dead_per_million: f64,
}

impl Default for DefectsToml {
    fn default() -> Self {
        let hot_dark_current_factor = Defects::default().hot_factor;
        Self { hot_per_million: 0.0, hot_dark_current_factor, dead_per_million: 0.0 }
    }
}

#[derive(Deserialize)]
#[serde(remote = "Published", deny_unknown_fields)]
struct PublishedToml {
    quantum_efficiency_percent: Option<f64>,
    dark_noise_e: Option<f64>,
    gain_e_per_dn: Option<f64>,
    threshold_e: Option<f64>,
    threshold_p: Option<f64>,
    saturation_e: Option<f64>,
    saturation_p: Option<f64>,
    dynamic_range_db: Option<f64>,
    snr_max_db: Option<f64>,
    dsnu_e: Option<f64>,
    prnu_percent: Option<f64>,
}

fn room_temperature() -> f64 {
    25.0
}

fn bit_depth<'de, D: Deserializer<'de>>(d: D) -> Result<u32, D::Error> {
    whole(d, 8, 16)
}

/// Columns and rows of a sensor.
fn resolution<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[u32; 2]>, D::Error> {
    let side = |n: &i64| u32::try_from(*n).ok().filter(|n| (1..=MAX_SIDE).contains(n));
    let sides: Option<Vec<u32>> = Vec::<i64>::deserialize(d)?.iter().map(side).collect();
    let sides = sides.and_then(|sides| <[u32; 2]>::try_from(sides).ok());
    sides.map(Some).ok_or_else(|| {
        let form = format!("write [columns, rows], two whole numbers from 1 to {MAX_SIDE}");
        D::Error::custom(format!("this is no resolution; {form}"))
    })
}

fn pattern<'de, D: Deserializer<'de>>(d: D) -> Result<BayerPattern, D::Error> {
    let name = String::deserialize(d)?;
    BayerPattern::ALL.into_iter().find(|p| p.name() == name).ok_or_else(|| {
        let names = BayerPattern::ALL.map(|p| format!("\"{}\"", p.name())).join(", ");
        D::Error::custom(format!("unknown pattern \"{name}\"; write one of {names}"))
    })
}

/// Points of a file as a curve.
fn curve(file: &TomlFile, key: &[&str], points: &Points) -> Result<QuantumEfficiency, InputError> {
    let help = "write points [wavelength in nm, efficiency from 0 to 1] by ascending wavelength";
    let values = points.iter().map(|[nm, eta]| (Nanometres(*nm), *eta)).collect();
    QuantumEfficiency::new(values).map_err(|e| file.error_at_key(key, e.to_string(), help))
}

impl SensorToml {
    /// `derived` and `assumed` contain keys. A name that is no key is a spelling error.
    fn check_names(&self, file: &TomlFile) -> Result<(), InputError> {
        let texts = ["name", "source", "derived", "assumed"];
        let keys = keys_of::<Self>().iter().copied().chain(["doubling_k"]);
        let keys: Vec<&str> = keys.filter(|key| !texts.contains(key)).collect();
        for (list, names) in [("derived", &self.derived), ("assumed", &self.assumed)] {
            if let Some((i, name)) = names.iter().enumerate().find(|(_, name)| !keys.contains(&name.as_str())) {
                let problem = format!("`{name}` is not a key of this file");
                return Err(file.error_at_key(
                    &[list, &i.to_string()],
                    problem,
                    format!("name one of {}", keys.join(", ")),
                ));
            }
        }
        Ok(())
    }

    /// One curve, or one for each colour.
    fn efficiency(&self, file: &TomlFile) -> Result<Efficiency, InputError> {
        match (&self.quantum_efficiency, &self.color_filter) {
            (Some(points), None) => curve(file, &["quantum_efficiency"], points).map(Efficiency::Mono),
            (None, Some(ColorFilterToml { pattern, red, green, blue, white_balance })) => {
                let curve = |color: &str, points: &Points| curve(file, &["color_filter", color], points);
                let curves = [curve("red", red)?, curve("green", green)?, curve("blue", blue)?];
                let (pattern, white_balance) = (*pattern, *white_balance);
                Ok(Efficiency::Mosaic(ColorFilter { pattern, curves, white_balance }))
            }
            (Some(_), Some(_)) => Err(file.error_at_key(
                &["quantum_efficiency"],
                "the colours of [color_filter] have curves of their own",
                "remove `quantum_efficiency`, or [color_filter]",
            )),
            (None, None) => {
                let help = "add `quantum_efficiency = [[545, 0.7]]`, or a [color_filter] with a curve for each colour";
                Err(InputError::new(file.path(), "quantum_efficiency", "the key is missing", help))
            }
        }
    }

    /// K \[DN/e-\], and its key.
    fn gain(&self, file: &TomlFile) -> Result<(&'static str, f64), InputError> {
        let (key, written) = match (self.gain_e_per_dn, self.gain_dn_per_e) {
            (Some(inverse), None) => ("gain_e_per_dn", inverse),
            (None, Some(gain)) => ("gain_dn_per_e", gain),
            (Some(_), Some(_)) => {
                let help = "keep one of gain_e_per_dn, gain_dn_per_e";
                return Err(file.error_at_key(&["gain_dn_per_e"], "the gain is given twice", help));
            }
            (None, None) => {
                let help = "add `gain_e_per_dn = ...` or `gain_dn_per_e = ...`";
                return Err(InputError::of_file(file.path(), "the gain is missing", help));
            }
        };
        if !(written.is_finite() && written > 0.0) {
            let problem = format!("{} is not a positive number", Number(written));
            return Err(file.error_at_key(&[key], problem, "write a finite value above zero"));
        }
        Ok((key, if key == "gain_e_per_dn" { 1.0 / written } else { written }))
    }
}
