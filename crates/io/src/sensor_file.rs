//! Sensor files: TOML with the unit in every key, checked, with errors that point at the place.
//!
//! ```toml
//! name = "Sony IMX900, low conversion gain"   # free text
//! source = "test report of the maker"
//! derived = ["gain_e_per_dn"]                 # optional: keys whose values were computed from others
//! assumed = ["offset_dn"]                     # optional: keys whose values are assumptions
//! bit_depth = 12                              # 8 to 16
//! pixel_pitch_um = 2.25
//! quantum_efficiency = [[536, 0.9125]]        # points [nm, fraction]; one point holds for all wavelengths
//! full_well_e = 9458
//! dark_noise_e = 5.56                         # sigma_d0
//! gain_e_per_dn = 2.505                       # or gain_dn_per_e, the K of EMVA 1288
//! offset_dn = 32                              # black level
//! dsnu_e = 3.7                                # optional, 0 if absent
//! prnu_percent = 0.7                          # optional, 0 if absent
//! temperature_c = 36                          # optional, 25 if absent
//! [dark_current]                              # optional, none if absent
//! e_per_s = 1.47
//! at_c = 36
//! doubling_k = 7
//! [published]                                 # optional, only to compare with
//! dynamic_range_db = 63.8
//! snr_max_db = 39.76
//! ```

use std::ops::Range;
use std::path::Path;

use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres};
use dunkelfeld_sensor::{
    DarkCurrent, FixedPattern, PRESETS, Published, QuantumEfficiency, SensorError, SensorModel, SensorSpec,
};
use serde::Deserialize;
use toml::Spanned;

use crate::error::InputError;
use crate::toml_file::TomlFile;

/// Temperature of a sensor about which nothing is said.
const ROOM_TEMPERATURE: Celsius = Celsius(25.0);

/// The sensor of a preset's name or, if there is no such preset, of a file.
///
/// # Errors
/// No such preset or file, or a file that is not a sensor.
pub fn find_sensor(name_or_path: &str) -> Result<SensorModel, InputError> {
    if PRESETS.iter().any(|(name, _)| *name == name_or_path) {
        return preset(name_or_path);
    }
    let path = Path::new(name_or_path);
    // A bare word that is not a file was meant as a name.
    if path.extension().is_none() && !path.exists() { preset(name_or_path) } else { load_sensor(path) }
}

/// Reads a sensor file.
///
/// # Errors
/// The file cannot be read, is not valid TOML, has unknown or missing keys or values out of range.
pub fn load_sensor(path: &Path) -> Result<SensorModel, InputError> {
    parse_sensor(&TomlFile::read(path)?)
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
            let mend = format!("name a sensor file (*.toml) or one of {}", known.join(", "));
            Err(InputError::new(name, "the sensor", "there is no preset of that name", mend))
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
    let efficiency = toml.quantum_efficiency.get_ref().iter().map(|[nm, eta]| (Nanometres(*nm), *eta)).collect();
    let at_efficiency = |e: SensorError| file.error_at(toml.quantum_efficiency.span(), e.to_string(), EFFICIENCY);
    let quantum_efficiency = QuantumEfficiency::new(efficiency).map_err(at_efficiency)?;
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
        quantum_efficiency,
        full_well: Electrons(*toml.full_well_e.get_ref()),
        dark_noise: Electrons(*toml.dark_noise_e.get_ref()),
        dark_current,
        temperature,
        system_gain: gain,
        offset: DigitalNumber(*toml.offset_dn.get_ref()),
        bit_depth: *toml.bit_depth.get_ref(),
        fixed_pattern: FixedPattern {
            dsnu: Electrons(value(&toml.dsnu_e, 0.0)),
            prnu: value(&toml.prnu_percent, 0.0) / 100.0,
        },
        published: toml.published.unwrap_or_default().into(),
    };
    SensorModel::new(spec).map_err(|e| match &e {
        SensorError::OutOfRange { field, allowed, .. } => {
            let mend = format!("write a value {allowed}");
            match toml.span(field, &gain_span) {
                Some(span) => file.error_at(span, "the value is out of range", mend),
                None => InputError::new(file.path(), *field, e.to_string(), mend),
            }
        }
        other => InputError::new(file.path(), "the sensor", other.to_string(), "see the format of sensor files"),
    })
}

const EFFICIENCY: &str = "write points [wavelength in nm, efficiency from 0 to 1] by ascending wavelength";

/// Every key that `derived` and `assumed` may name.
const KEYS: [&str; 13] = [
    "bit_depth",
    "pixel_pitch_um",
    "quantum_efficiency",
    "full_well_e",
    "dark_noise_e",
    "gain_e_per_dn",
    "gain_dn_per_e",
    "offset_dn",
    "dsnu_e",
    "prnu_percent",
    "temperature_c",
    "dark_current",
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
    bit_depth: Spanned<u32>,
    pixel_pitch_um: Spanned<f64>,
    quantum_efficiency: Spanned<Vec<[f64; 2]>>,
    full_well_e: Spanned<f64>,
    dark_noise_e: Spanned<f64>,
    gain_e_per_dn: Option<Spanned<f64>>,
    gain_dn_per_e: Option<Spanned<f64>>,
    offset_dn: Spanned<f64>,
    dsnu_e: Option<Spanned<f64>>,
    prnu_percent: Option<Spanned<f64>>,
    temperature_c: Option<Spanned<f64>>,
    dark_current: Option<DarkCurrentToml>,
    published: Option<PublishedToml>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DarkCurrentToml {
    e_per_s: Spanned<f64>,
    at_c: Spanned<f64>,
    doubling_k: Spanned<f64>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct PublishedToml {
    dynamic_range_db: Option<f64>,
    snr_max_db: Option<f64>,
}

impl From<PublishedToml> for Published {
    fn from(p: PublishedToml) -> Self {
        Self { dynamic_range_db: p.dynamic_range_db, snr_max_db: p.snr_max_db }
    }
}

impl SensorToml {
    /// `derived` and `assumed` are promises about keys; a promise about nothing is a misspelt one.
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

    /// K \[DN/e-\], and where it stands.
    fn gain(&self, file: &TomlFile) -> Result<(f64, Range<usize>), InputError> {
        match (&self.gain_e_per_dn, &self.gain_dn_per_e) {
            (Some(inverse), None) => Ok((1.0 / file.positive(inverse)?, inverse.span())),
            (None, Some(gain)) => Ok((file.positive(gain)?, gain.span())),
            (Some(_), Some(second)) => {
                Err(file.error_at(second.span(), "the gain is given twice", "keep one of gain_e_per_dn, gain_dn_per_e"))
            }
            (None, None) => {
                let mend = "add `gain_e_per_dn = ...` or `gain_dn_per_e = ...`";
                Err(InputError::new(file.path(), "the sensor", "the gain is missing", mend))
            }
        }
    }

    /// Where a field of [`SensorSpec`] stands in the file.
    fn span(&self, field: &str, gain: &Range<usize>) -> Option<Range<usize>> {
        let of = |value: &Option<Spanned<f64>>| value.as_ref().map(Spanned::span);
        let dark = self.dark_current.as_ref();
        match field {
            "pixel_pitch" => Some(self.pixel_pitch_um.span()),
            "full_well" => Some(self.full_well_e.span()),
            "dark_noise" => Some(self.dark_noise_e.span()),
            "dark_current" => dark.map(|d| d.e_per_s.span()),
            "dark_current_reference" => dark.map(|d| d.at_c.span()),
            "dark_current_doubling" => dark.map(|d| d.doubling_k.span()),
            "temperature" => of(&self.temperature_c),
            "system_gain" => Some(gain.clone()),
            "bit_depth" => Some(self.bit_depth.span()),
            "offset" => Some(self.offset_dn.span()),
            "dsnu" => of(&self.dsnu_e),
            "prnu" => of(&self.prnu_percent),
            _ => None,
        }
    }
}
