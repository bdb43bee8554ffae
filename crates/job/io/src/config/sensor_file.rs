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

use std::ops::Range;
use std::path::Path;

use dunkelfeld_film::MAX_SIDE;
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Seconds};
use dunkelfeld_sensor::{
    BayerPattern, ColorFilter, DarkCurrent, Defects, Efficiency, FixedPattern, PRESETS, Published, QuantumEfficiency,
    SensorError, SensorModel, SensorSpec,
};
use serde::Deserialize;
use toml::Spanned;

use crate::error::InputError;
use crate::input::{InputFiles, Role};
use crate::job::check::whole;
use crate::toml_file::TomlFile;

/// Default temperature of a sensor.
const ROOM_TEMPERATURE: Celsius = Celsius(25.0);

/// The sensor of the preset of this name, or of the file if there is no such preset.
///
/// # Errors
/// No such preset or file, or a file that is not a sensor.
pub fn find_sensor(name_or_path: &str) -> Result<SensorModel, InputError> {
    find_sensor_recorded(name_or_path, &mut InputFiles::new())
}

/// [`find_sensor`], and records the file as an input.
///
/// # Errors
/// As [`find_sensor`].
pub fn find_sensor_recorded(name_or_path: &str, inputs: &mut InputFiles) -> Result<SensorModel, InputError> {
    if PRESETS.iter().any(|(name, _)| *name == name_or_path) {
        return preset(name_or_path);
    }
    let path = Path::new(name_or_path);
    // A plain word that is no file is interpreted as a name.
    if path.extension().is_none() && !path.exists() { preset(name_or_path) } else { load_sensor_recorded(path, inputs) }
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
    parse_sensor(&TomlFile::read(path, Role::Sensor, inputs)?)
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

/// A sensor from the text of its file.
///
/// # Errors
/// As [`load_sensor`].
pub fn parse_sensor(file: &TomlFile) -> Result<SensorModel, InputError> {
    let toml: SensorToml = file.parse()?;
    toml.check_names(file)?;
    let (gain, gain_span) = toml.gain(file)?;
    let quantum_efficiency = toml.efficiency(file)?;
    let value = |field: &Option<Spanned<f64>>, otherwise: f64| field.as_ref().map_or(otherwise, |s| *s.get_ref());
    let temperature = Celsius(value(&toml.temperature_c, ROOM_TEMPERATURE.0));
    let dark_current = match &toml.dark_current {
        Some(d) => DarkCurrent {
            rate: *d.e_per_s.get_ref(),
            reference: Celsius(*d.at_c.get_ref()),
            doubling: *d.doubling_k.get_ref(),
        },
        None => DarkCurrent { rate: 0.0, reference: temperature, doubling: 7.0 },
    };
    let spec = SensorSpec {
        name: toml.name.clone(),
        source: toml.source.clone(),
        derived: toml.derived.iter().map(|s| s.get_ref().clone()).collect(),
        assumed: toml.assumed.iter().map(|s| s.get_ref().clone()).collect(),
        pixel_pitch: Metres::from_micrometres(*toml.pixel_pitch_um.get_ref()),
        resolution: toml.resolution.as_ref().map(|r| resolution(file, r)).transpose()?,
        quantum_efficiency,
        full_well: Electrons(*toml.full_well_e.get_ref()),
        dark_noise: Electrons(*toml.dark_noise_e.get_ref()),
        row_noise: Electrons(value(&toml.row_noise_e, 0.0)),
        dark_current,
        temperature,
        min_exposure: toml.min_exposure_us.as_ref().map(|us| Seconds(us.get_ref() * 1e-6)),
        max_exposure: toml.max_exposure_s.as_ref().map(|s| Seconds(*s.get_ref())),
        system_gain: gain,
        offset: DigitalNumber(*toml.offset_dn.get_ref()),
        bit_depth: toml.bit_depth.get_ref().0,
        fixed_pattern: FixedPattern {
            dsnu: Electrons(value(&toml.dsnu_e, 0.0)),
            dsnu_row: Electrons(value(&toml.dsnu_row_e, 0.0)),
            dsnu_column: Electrons(value(&toml.dsnu_column_e, 0.0)),
            prnu: value(&toml.prnu_percent, 0.0) / 100.0,
            prnu_row: value(&toml.prnu_row_percent, 0.0) / 100.0,
            prnu_column: value(&toml.prnu_column_percent, 0.0) / 100.0,
        },
        defects: toml.defects.as_ref().map_or_else(Defects::default, |d| Defects {
            hot: value(&d.hot_per_million, 0.0) / 1e6,
            hot_factor: value(&d.hot_dark_current_factor, Defects::default().hot_factor),
            dead: value(&d.dead_per_million, 0.0) / 1e6,
        }),
        published: toml.published.as_ref().map(PublishedToml::figures).unwrap_or_default(),
    };
    SensorModel::new(spec).map_err(|e| match &e {
        SensorError::OutOfRange { field, allowed, .. } => {
            let help = format!("write a value {allowed}");
            match toml.span(field, &gain_span) {
                Some(span) => file.error_at(span, "the value is out of range", help),
                None => InputError::new(file.path(), *field, e.to_string(), help),
            }
        }
        other => InputError::of_file(file.path(), other.to_string(), "see the format of sensor files"),
    })
}

const EFFICIENCY: &str = "write points [wavelength in nm, efficiency from 0 to 1] by ascending wavelength";

/// All keys that `derived` and `assumed` may contain.
const KEYS: [&str; 24] = [
    "bit_depth",
    "pixel_pitch_um",
    "resolution",
    "quantum_efficiency",
    "full_well_e",
    "dark_noise_e",
    "row_noise_e",
    "gain_e_per_dn",
    "gain_dn_per_e",
    "offset_dn",
    "dsnu_e",
    "dsnu_row_e",
    "dsnu_column_e",
    "prnu_percent",
    "prnu_row_percent",
    "prnu_column_percent",
    "temperature_c",
    "min_exposure_us",
    "max_exposure_s",
    "dark_current",
    "doubling_k",
    "color_filter",
    "defects",
    "published",
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorToml {
    name: String,
    source: String,
    #[serde(default)]
    derived: Vec<Spanned<String>>,
    #[serde(default)]
    assumed: Vec<Spanned<String>>,
    bit_depth: Spanned<BitDepth>,
    pixel_pitch_um: Spanned<f64>,
    resolution: Option<Spanned<Vec<i64>>>,
    quantum_efficiency: Option<Spanned<Vec<[f64; 2]>>>,
    full_well_e: Spanned<f64>,
    dark_noise_e: Spanned<f64>,
    row_noise_e: Option<Spanned<f64>>,
    gain_e_per_dn: Option<Spanned<f64>>,
    gain_dn_per_e: Option<Spanned<f64>>,
    offset_dn: Spanned<f64>,
    dsnu_e: Option<Spanned<f64>>,
    dsnu_row_e: Option<Spanned<f64>>,
    dsnu_column_e: Option<Spanned<f64>>,
    prnu_percent: Option<Spanned<f64>>,
    prnu_row_percent: Option<Spanned<f64>>,
    prnu_column_percent: Option<Spanned<f64>>,
    temperature_c: Option<Spanned<f64>>,
    min_exposure_us: Option<Spanned<f64>>,
    max_exposure_s: Option<Spanned<f64>>,
    dark_current: Option<DarkCurrentToml>,
    color_filter: Option<ColorFilterToml>,
    defects: Option<DefectsToml>,
    published: Option<PublishedToml>,
}

/// Bits of a grey value.
struct BitDepth(u32);

impl<'de> Deserialize<'de> for BitDepth {
    fn deserialize<D: serde::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        whole(d, 8, 16).map(Self)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DarkCurrentToml {
    e_per_s: Spanned<f64>,
    at_c: Spanned<f64>,
    doubling_k: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ColorFilterToml {
    pattern: Spanned<String>,
    red: Spanned<Vec<[f64; 2]>>,
    green: Spanned<Vec<[f64; 2]>>,
    blue: Spanned<Vec<[f64; 2]>>,
    #[serde(default = "yes")]
    white_balance: bool,
}

fn yes() -> bool {
    true
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DefectsToml {
    hot_per_million: Option<Spanned<f64>>,
    hot_dark_current_factor: Option<Spanned<f64>>,
    dead_per_million: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PublishedToml {
    quantum_efficiency_percent: Option<Spanned<f64>>,
    dark_noise_e: Option<Spanned<f64>>,
    gain_e_per_dn: Option<Spanned<f64>>,
    threshold_e: Option<Spanned<f64>>,
    threshold_p: Option<Spanned<f64>>,
    saturation_e: Option<Spanned<f64>>,
    saturation_p: Option<Spanned<f64>>,
    dynamic_range_db: Option<Spanned<f64>>,
    snr_max_db: Option<Spanned<f64>>,
    dsnu_e: Option<Spanned<f64>>,
    prnu_percent: Option<Spanned<f64>>,
}

impl PublishedToml {
    fn figures(&self) -> Published {
        let value = |field: &Option<Spanned<f64>>| field.as_ref().map(|s| *s.get_ref());
        Published {
            quantum_efficiency_percent: value(&self.quantum_efficiency_percent),
            dark_noise_e: value(&self.dark_noise_e),
            gain_e_per_dn: value(&self.gain_e_per_dn),
            threshold_e: value(&self.threshold_e),
            threshold_p: value(&self.threshold_p),
            saturation_e: value(&self.saturation_e),
            saturation_p: value(&self.saturation_p),
            dynamic_range_db: value(&self.dynamic_range_db),
            snr_max_db: value(&self.snr_max_db),
            dsnu_e: value(&self.dsnu_e),
            prnu_percent: value(&self.prnu_percent),
        }
    }
}

impl PublishedToml {
    /// The key path of a value in the file.
    fn span(&self, figure: &str) -> Option<Range<usize>> {
        let field = match figure {
            "quantum_efficiency_percent" => &self.quantum_efficiency_percent,
            "dark_noise_e" => &self.dark_noise_e,
            "gain_e_per_dn" => &self.gain_e_per_dn,
            "threshold_e" => &self.threshold_e,
            "threshold_p" => &self.threshold_p,
            "saturation_e" => &self.saturation_e,
            "saturation_p" => &self.saturation_p,
            "dynamic_range_db" => &self.dynamic_range_db,
            "snr_max_db" => &self.snr_max_db,
            "dsnu_e" => &self.dsnu_e,
            "prnu_percent" => &self.prnu_percent,
            _ => &None,
        };
        field.as_ref().map(Spanned::span)
    }
}

/// Columns and rows of a sensor.
fn resolution(file: &TomlFile, numbers: &Spanned<Vec<i64>>) -> Result<[u32; 2], InputError> {
    let side = |n: i64| u32::try_from(n).ok().filter(|n| (1..=MAX_SIDE).contains(n));
    match numbers.get_ref()[..] {
        [columns, rows] => side(columns).zip(side(rows)).map(|(columns, rows)| [columns, rows]),
        _ => None,
    }
    .ok_or_else(|| {
        let help = format!("write [columns, rows], two whole numbers from 1 to {MAX_SIDE}");
        file.error_at(numbers.span(), "this is no resolution", help)
    })
}

/// Points of a file as a curve.
fn curve(file: &TomlFile, points: &Spanned<Vec<[f64; 2]>>) -> Result<QuantumEfficiency, InputError> {
    let values = points.get_ref().iter().map(|[nm, eta]| (Nanometres(*nm), *eta)).collect();
    QuantumEfficiency::new(values).map_err(|e| file.error_at(points.span(), e.to_string(), EFFICIENCY))
}

impl ColorFilterToml {
    fn filter(&self, file: &TomlFile) -> Result<ColorFilter, InputError> {
        let name = self.pattern.get_ref().as_str();
        let Some(pattern) = BayerPattern::ALL.into_iter().find(|p| p.name() == name) else {
            let names = BayerPattern::ALL.map(|p| format!("\"{}\"", p.name())).join(", ");
            let problem = format!("unknown pattern \"{name}\"");
            return Err(file.error_at(self.pattern.span(), problem, format!("write one of {names}")));
        };
        let curves = [curve(file, &self.red)?, curve(file, &self.green)?, curve(file, &self.blue)?];
        Ok(ColorFilter { pattern, curves, white_balance: self.white_balance })
    }
}

impl SensorToml {
    /// `derived` and `assumed` contain keys. A name that is no key is a spelling error.
    fn check_names(&self, file: &TomlFile) -> Result<(), InputError> {
        match self.derived.iter().chain(&self.assumed).find(|name| !KEYS.contains(&name.get_ref().as_str())) {
            Some(name) => Err(file.error_at(
                name.span(),
                format!("`{}` is not a key of this file", name.get_ref()),
                format!("name one of {}", KEYS.join(", ")),
            )),
            None => Ok(()),
        }
    }

    /// One curve, or one for each colour.
    fn efficiency(&self, file: &TomlFile) -> Result<Efficiency, InputError> {
        match (&self.quantum_efficiency, &self.color_filter) {
            (Some(points), None) => curve(file, points).map(Efficiency::Mono),
            (None, Some(filter)) => filter.filter(file).map(Efficiency::Mosaic),
            (Some(points), Some(_)) => Err(file.error_at(
                points.span(),
                "the colours of [color_filter] have curves of their own",
                "remove `quantum_efficiency`, or [color_filter]",
            )),
            (None, None) => {
                let help = "add `quantum_efficiency = [[545, 0.7]]`, or a [color_filter] with a curve for each colour";
                Err(InputError::new(file.path(), "quantum_efficiency", "the key is missing", help))
            }
        }
    }

    /// K \[DN/e-\], and its key path.
    fn gain(&self, file: &TomlFile) -> Result<(f64, Range<usize>), InputError> {
        match (&self.gain_e_per_dn, &self.gain_dn_per_e) {
            (Some(inverse), None) => Ok((1.0 / file.positive(inverse)?, inverse.span())),
            (None, Some(gain)) => Ok((file.positive(gain)?, gain.span())),
            (Some(_), Some(second)) => {
                Err(file.error_at(second.span(), "the gain is given twice", "keep one of gain_e_per_dn, gain_dn_per_e"))
            }
            (None, None) => {
                let help = "add `gain_e_per_dn = ...` or `gain_dn_per_e = ...`";
                Err(InputError::of_file(file.path(), "the gain is missing", help))
            }
        }
    }

    /// The key path of a field of [`SensorSpec`].
    fn span(&self, field: &str, gain: &Range<usize>) -> Option<Range<usize>> {
        let of = |value: &Option<Spanned<f64>>| value.as_ref().map(Spanned::span);
        let dark = self.dark_current.as_ref();
        match field {
            "pixel_pitch" => Some(self.pixel_pitch_um.span()),
            "full_well" => Some(self.full_well_e.span()),
            "dark_noise" => Some(self.dark_noise_e.span()),
            "row_noise" => of(&self.row_noise_e),
            "dark_current" => dark.map(|d| d.e_per_s.span()),
            "dark_current_reference" => dark.map(|d| d.at_c.span()),
            "dark_current_doubling" => dark.map(|d| d.doubling_k.span()),
            "temperature" => of(&self.temperature_c),
            "min_exposure" => of(&self.min_exposure_us),
            "max_exposure" => of(&self.max_exposure_s),
            "system_gain" => Some(gain.clone()),
            "bit_depth" => Some(self.bit_depth.span()),
            "offset" => Some(self.offset_dn.span()),
            "dsnu" => of(&self.dsnu_e),
            "dsnu_row" => of(&self.dsnu_row_e),
            "dsnu_column" => of(&self.dsnu_column_e),
            "prnu" => of(&self.prnu_percent),
            "prnu_row" => of(&self.prnu_row_percent),
            "prnu_column" => of(&self.prnu_column_percent),
            "hot" => self.defects.as_ref().and_then(|d| of(&d.hot_per_million)),
            "hot_factor" => self.defects.as_ref().and_then(|d| of(&d.hot_dark_current_factor)),
            "dead" => self.defects.as_ref().and_then(|d| of(&d.dead_per_million)),
            figure => self.published.as_ref().and_then(|p| p.span(figure)),
        }
    }
}
