//! Values of lamps in a job: wavelengths, numbers of LEDs.

use crate::quantity::Length;
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
