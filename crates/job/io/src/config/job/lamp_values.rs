//! Values of lights in a job: wavelengths, numbers of LEDs, strengths.

use super::check;
use crate::error::InputError;
use crate::quantity::Length;
use crate::toml_keys::TableKeys;
use dunkelfeld_radiometry::{Nanometres, Number, Rgb};
use serde::Deserialize;
use serde::de::{Deserializer, Error};

/// The wavelength of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wavelength(pub Nanometres);

impl<'de> Deserialize<'de> for Wavelength {
    /// A length such as `"625nm"`, or a colour of LEDs: `"red"` 630, `"amber"` 590, `"green"` 525, `"blue"` 470,
    /// `"infrared"` 850, `"ultraviolet"` 385 nm.
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "this is not a wavelength; write one with its unit, as in \"625nm\"")]
        enum Written {
            Text(String),
            Number(f64),
        }
        let colors = "red, amber, green, blue, infrared or ultraviolet";
        let text = match Written::deserialize(d)? {
            Written::Text(text) => text,
            Written::Number(n) => {
                let n = Number(n);
                return Err(D::Error::custom(format!("{n} has no unit; write a wavelength such as \"625nm\"")));
            }
        };
        let nm = match text.trim() {
            "red" => 630.0,
            "amber" => 590.0,
            "green" => 525.0,
            "blue" => 470.0,
            "infrared" => 850.0,
            "ultraviolet" => 385.0,
            length => {
                let fault = |_| {
                    let problem = format!("{length:?} is neither a wavelength nor a colour of LEDs");
                    D::Error::custom(format!("{problem}; write one such as \"625nm\", or {colors}"))
                };
                f64::from(length.parse::<Length>().map_err(fault)?) * 1e9
            }
        };
        if (200.0..=2500.0).contains(&nm) {
            return Ok(Self(Nanometres(nm)));
        }
        Err(D::Error::custom(format!(
            "{} nm is out of range; write a wavelength from 200nm to 2500nm, or a colour such as \"red\"",
            Number(nm)
        )))
    }
}

impl Wavelength {
    /// The channel of the render that carries its light: red, green or blue, by the colour of the materials that suits
    /// it.
    pub fn channel(self) -> usize {
        match self.0.0 {
            nm if nm >= 580.0 => 0,
            nm if nm >= 490.0 => 1,
            _ => 2,
        }
    }

    /// Light of the mean `mean` over the channels.
    pub fn triple(self, mean: f64) -> Rgb {
        let mut channels = [0.0; 3];
        channels[self.channel()] = (3.0 * mean) as f32;
        Rgb::from_array(channels)
    }
}

/// Number of LEDs: of a ring or bar, or columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LedCount {
    /// Along the band or the width.
    pub columns: u32,
    /// Across it.
    pub rows: u32,
}

impl LedCount {
    /// Largest number of LEDs of all lamps of a job together.
    pub(super) const MOST: u32 = 20_000;
}

impl<'de> Deserialize<'de> for LedCount {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "this is not a number of LEDs; write one such as 48, or [columns, rows]")]
        enum Written {
            Row(i64),
            Grid([i64; 2]),
        }
        let [columns, rows] = match Written::deserialize(d)? {
            Written::Row(n) => [n, 1],
            Written::Grid(both) => both,
        };
        let fits = |n: i64| u32::try_from(n).ok().filter(|n| (1..=10_000).contains(n));
        match (fits(columns), fits(rows)) {
            (Some(columns), Some(rows)) if columns * rows <= Self::MOST => Ok(Self { columns, rows }),
            _ => Err(D::Error::custom(format!(
                "{columns} x {rows} LEDs are out of range; write from 1 to 10000 in a row, and at most {} in all",
                Self::MOST
            ))),
        }
    }
}

/// The strength of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strength {
    /// Emitted radiance [W/(m^2 sr)] of a surface.
    Radiance(Rgb),
    /// Radiant power \[W\] of each light that the name selects, as the mean of the channels. The colour remains as it
    /// is (white if it was black). Not for distant light.
    Power(f64),
    /// Radiant intensity \[W/sr\] of a point light, of a spot light on its axis, or of an IES profile in its brightest
    /// direction.
    Intensity(Rgb),
    /// Irradiance [W/m^2] of distant light on a surface perpendicular to it; of a lamp on its axis at the working
    /// distance.
    Irradiance(Rgb),
}

impl Strength {
    /// Its key.
    pub(super) fn key(&self) -> &'static str {
        match self {
            Self::Radiance(_) => "radiance",
            Self::Power(_) => "power",
            Self::Intensity(_) => "intensity",
            Self::Irradiance(_) => "irradiance",
        }
    }

    /// The strength that the keys give, except those in `without`, and the working distance.
    pub(super) fn read(keys: &mut TableKeys<'_>, without: &[&str]) -> Result<(Option<Self>, Option<f64>), InputError> {
        let StrengthKeys { radiance, power, intensity, irradiance, working_distance } = keys.take(without)?;
        let given = [
            radiance.map(Self::Radiance),
            power.map(Self::Power),
            intensity.map(Self::Intensity),
            irradiance.map(Self::Irradiance),
        ];
        let mut given = given.into_iter().flatten();
        let strength = given.next();
        if let (Some(first), Some(second)) = (strength, given.next()) {
            let problem = format!("`{}` and `{}` both set the light's strength", first.key(), second.key());
            return Err(keys.error(second.key(), problem, "keep one of them"));
        }
        if working_distance.is_some() && irradiance.is_none() {
            let problem = "it is the distance of `irradiance`, which is not given";
            return Err(keys.error("working_distance", problem, "write `irradiance` as well, or remove this"));
        }
        Ok((strength, working_distance))
    }

    /// Refuses a colour of a light of one wavelength.
    pub(super) fn check_color(&self, wavelength: Option<Wavelength>, keys: &TableKeys<'_>) -> Result<(), InputError> {
        match self {
            Self::Radiance(c) | Self::Intensity(c) | Self::Irradiance(c)
                if wavelength.is_some() && (c.r != c.g || c.g != c.b) =>
            {
                let problem = "a light of one wavelength has no colour";
                Err(keys.error(self.key(), problem, "write one number, or remove `wavelength`"))
            }
            _ => Ok(()),
        }
    }
}

/// The keys of a strength.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct StrengthKeys {
    #[serde(deserialize_with = "check::light")]
    radiance: Option<Rgb>,
    #[serde(deserialize_with = "check::power")]
    power: Option<f64>,
    #[serde(deserialize_with = "check::light")]
    intensity: Option<Rgb>,
    #[serde(deserialize_with = "check::light")]
    irradiance: Option<Rgb>,
    #[serde(deserialize_with = "check::positive_length")]
    working_distance: Option<f64>,
}
