//! `[sensor]` of a job: the model, the exposure time and its noise.

use dunkelfeld_radiometry::{Number, Seconds};
use dunkelfeld_sensor::ExposureNoise;
use serde::Deserialize;
use serde::de::{Deserializer, Error};
use std::path::PathBuf;

/// The preset of a render without a given sensor.
pub const DEFAULT_SENSOR: &str = "imx250";

/// `[sensor]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorSettings {
    /// Name of a preset (default [`DEFAULT_SENSOR`]), path of a sensor file (`"mine.toml"`, relative to the job file), or
    /// `"none"`: radiance to 8 bits, clipped at one.
    pub model: SensorChoice,
    /// Exposure time (`"5ms"`), or `"auto"` (default): the 99.5 % quantile at 90 % of saturation.
    pub exposure: Exposure,
    /// `"plain"` (default): all noise of the camera. `"matched"`: the noise of the camera less the noise of the render.
    pub exposure_noise: ExposureNoise,
    /// Factor of the system gain K of the model, 0.01 to 100, or decibels as `"6dB"`. The noise in electrons stays.
    /// Default 1.
    #[serde(deserialize_with = "super::check::gain")]
    pub gain: Option<f64>,
    /// Temperature of the sensor \[°C\], -100 to 200, which sets the dark current. Default: that of the model.
    #[serde(deserialize_with = "super::check::temperature")]
    pub temperature: Option<f64>,
    /// Offset of the grey values \[DN\], 0 to 65535 and at most 90 % of the largest grey value: the black level. Default: that of the
    /// model.
    #[serde(deserialize_with = "super::check::black_level")]
    pub black_level: Option<f64>,
    /// `false`: radiance 1 is white, as without a sensor. Size and pixels of the film stay those of the sensor. Overrides
    /// with `model = "none"` set it. Default true.
    pub expose: bool,
}

impl Default for SensorSettings {
    fn default() -> Self {
        Self {
            model: SensorChoice::default(),
            exposure: Exposure::Auto,
            exposure_noise: ExposureNoise::default(),
            gain: None,
            temperature: None,
            black_level: None,
            expose: true,
        }
    }
}

/// The choice of a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SensorChoice {
    /// No sensor.
    None,
    /// A preset by name.
    Preset(String),
    /// A sensor file.
    File(PathBuf),
}

impl Default for SensorChoice {
    fn default() -> Self {
        Self::Preset(DEFAULT_SENSOR.into())
    }
}

impl<'de> Deserialize<'de> for SensorChoice {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let text = String::deserialize(d)?;
        match text.trim() {
            "" => Err(D::Error::custom("the sensor's name is empty; write a preset, a file, or \"none\"")),
            "none" => Ok(Self::None),
            name if name.to_ascii_lowercase().ends_with(".toml") => Ok(Self::File(PathBuf::from(name))),
            name => Ok(Self::Preset(name.to_string())),
        }
    }
}

/// The exposure time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// Automatic: the 99.5 % quantile of the image is at 90 % of saturation.
    #[default]
    Auto,
    /// Seconds, above zero.
    Seconds(f64),
}

impl<'de> Deserialize<'de> for Exposure {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Text(String),
            Seconds(f64),
        }
        let seconds = match Written::deserialize(d)? {
            Written::Text(text) if text.trim() == "auto" => return Ok(Self::Auto),
            Written::Text(text) => f64::from(text.parse::<crate::quantity::Time>().map_err(D::Error::custom)?),
            Written::Seconds(v) => v,
        };
        // The sensor's own check runs here, where the line is available. It also refuses a number whose digits are lost
        // in f32.
        if dunkelfeld_sensor::Exposure::new(Seconds(seconds)).is_ok() {
            return Ok(Self::Seconds(seconds));
        }
        Err(D::Error::custom(format!(
            "{} s is out of range; write a time above zero such as \"5ms\", or \"auto\"",
            Number(seconds)
        )))
    }
}
