//! Readers for the fields of a job that refuse values out of range. The TOML layer adds line and caret to their
//! messages.

use super::place::one_or_three;
use crate::import::options::EmissiveUnit;
use crate::quantity::{Angle, Factor, Length, Memory, PerLength, Power, Time};
use dunkelfeld_adaptive::budget::{MAX_MEAN_SPP, NOISE_LEVELS, SHARES};
use dunkelfeld_film::MAX_SIDE;
use dunkelfeld_radiometry::{Number, Rgb};
use dunkelfeld_scene::{Distortion, Vignetting};
use serde::Deserialize;
use serde::de::{Deserializer, Error, Visitor};
use std::fmt;
use std::ops::RangeInclusive;
use std::time::Duration;

/// The default of switches.
pub(crate) fn yes() -> bool {
    true
}

/// A number of pixels along one side.
pub(super) fn pixels<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u32>, D::Error> {
    whole(d, 1, MAX_SIDE).map(Some)
}

/// Samples per pixel on average, with the range of `--spp`.
pub(super) fn spp<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<f64, D>(d, f64::MIN_POSITIVE..=MAX_MEAN_SPP, "", "a number above zero and up to 1e9, such as 64").map(Some)
}

pub(super) fn gain<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<Factor, D>(d, 0.01..=100.0, "", "a factor from 0.01 to 100, or -40dB to 40dB").map(Some)
}

/// Declares readers of numbers in a range.
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident: $type:ty, $least:expr, $most:expr;)*) => {$(
        $(#[$doc])*
        pub(super) fn $name<'de, D: Deserializer<'de>>(d: D) -> Result<Option<$type>, D::Error> {
            real(d, $least, $most).map(|v| Some(v as $type))
        }
    )*};
}

numbers! {
    /// Below a thousandth no sensor shows a difference. Above a thousand the limit has no effect.
    noise: f64, *NOISE_LEVELS.start(), *NOISE_LEVELS.end();
    hidden_share: f64, *SHARES.start(), *SHARES.end();
    temperature: f64, -100.0, 200.0;
    black_level: f64, 0.0, 65_535.0;
    unit: f32, 0.0, 1.0;
    signed_unit: f32, -1.0, 1.0;
    glare: f64, 0.0, 0.5;
    ior: f32, 1.0, 10.0;
    factor: f32, -1e3, 1e3;
    /// The range of `Optics`, refused here so that the message shows the line.
    f_number: f64, 0.5, 1000.0;
    magnification: f64, 0.0, 100.0;
    /// The sine of an angle, without both ends.
    numerical_aperture: f64, 1e-6, 0.999;
    /// A share between 0 and 1, without the ends.
    inner_share: f64, 0.01, 0.99;
    /// A factor of the strength of a light.
    light_scale: f64, 0.0, 1e12;
    /// A mean cosine of scattering. At the ends of the range, light would only continue straight or return.
    mean_cosine: f32, -0.9999, 0.9999;
    /// A factor of the lengths of a file.
    import_scale: f64, 1e-9, 1e9;
}

/// A seed. TOML has no whole numbers from 2^63 on, so it may be a text of digits.
pub(super) fn seed<'de, D: Deserializer<'de>>(d: D) -> Result<u64, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Written {
        Number(u64),
        Text(String),
        Other(toml::Value),
    }
    let (seed, text) = match Written::deserialize(d)? {
        Written::Number(seed) => return Ok(seed),
        Written::Text(text) => (text.parse().ok(), text),
        Written::Other(value) => (None, value.to_string()),
    };
    seed.ok_or_else(|| D::Error::custom(format!("{text} is out of range; write a whole number from 0 to {}", u64::MAX)))
}

/// The number of a frame.
pub(super) fn frame<'de, D: Deserializer<'de>>(d: D) -> Result<u32, D::Error> {
    let number = d.deserialize_any(Whole { least: 0, most: u32::MAX.into() })?;
    u32::try_from(number).map_err(D::Error::custom)
}

pub(super) fn pilot_spp<'de, D: Deserializer<'de>>(d: D) -> Result<u32, D::Error> {
    whole(d, 1, 65_536)
}

/// A whole number in a range.
pub(crate) fn whole<'de, D: Deserializer<'de>>(d: D, least: u32, most: u32) -> Result<u32, D::Error> {
    let v = d.deserialize_any(Whole { least: least.into(), most: most.into() })?;
    u32::try_from(v).map_err(D::Error::custom)
}

pub(super) fn share<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    real(d, 0.0, 1.0)
}

/// A transmission of zero would leave a black image.
pub(super) fn positive_share<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    real(d, 1e-6, 1.0)
}

pub(super) fn blades<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u32>, D::Error> {
    whole(d, 3, 64).map(Some)
}

/// A focus distance [m]; `inf` is valid.
pub(super) fn focus_distance<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    let help = "a distance such as \"300mm\", or \"inf\"";
    ranged::<LengthOrInf, D>(d, 1e-6..=f64::INFINITY, " m", help).map(Some)
}

/// As [`length`], for a key that may be absent.
pub(super) fn positive_length<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    length(d).map(Some)
}

/// A size on a sensor, of a field, or of a lamp [m].
pub(super) fn length<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    ranged::<Length, D>(d, 1e-9..=1000.0, " m", "a length from 1nm to 1km, such as \"3.45um\" or \"40mm\"")
}

/// A length [m] that may be zero.
pub(super) fn length_or_zero<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<Length, D>(d, 0.0..=1e6, " m", "a length from 0 to 1000km, such as \"40mm\"").map(Some)
}

/// A full angle [rad] of a cone.
pub(super) fn open_angle<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    angle_between(d, 1f64.to_radians(), std::f64::consts::PI, "from 1deg to 180deg")
}

/// A full angle \[rad\] at half of the intensity. 120 degrees is that of a Lambertian surface.
pub(super) fn lens_angle<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    let range = "from 1deg to 120deg, which is Lambertian";
    angle_between(d, 1f64.to_radians(), std::f64::consts::TAU / 3.0, range)
}

pub(super) fn quarter_turn<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    angle_between(d, 0.0, std::f64::consts::FRAC_PI_2, "from 0deg to 90deg")
}

/// An angular diameter [rad]; zero is a distant light of one direction.
pub(super) fn sun_angle<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    angle_between(d, 0.0, std::f64::consts::PI, "from 0deg to 180deg")
}

fn angle_between<'de, D: Deserializer<'de>>(d: D, least: f64, most: f64, range: &str) -> Result<Option<f64>, D::Error> {
    let Angle(v) = Angle::deserialize(d)?;
    // The ends may be rounded.
    if (least - 1e-9..=most + 1e-9).contains(&v) {
        return Ok(Some(v.clamp(least, most)));
    }
    Err(D::Error::custom(format!("{}deg is out of range; write an angle {range}", degrees(v))))
}

/// Number of copies of a lamp.
pub(super) fn count<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u32>, D::Error> {
    whole(d, 1, 64).map(Some)
}

/// A wavelength [nm].
pub(super) fn nanometres<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    wavelength(d, 200.0, "a wavelength from 200nm to 2500nm")
}

/// The width of a band [nm].
pub(super) fn band_width<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    wavelength(d, 0.1, "a width from 0.1nm to 2500nm")
}

fn wavelength<'de, D: Deserializer<'de>>(d: D, least: f64, what: &str) -> Result<f64, D::Error> {
    let Length(metres) = Length::deserialize(d)?;
    checked(metres * 1e9, least..=2500.0, " nm", what)
}

/// Coefficients in the order of OpenCV. Values beyond a million give no image.
pub(super) fn distortion<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Distortion>, D::Error> {
    let values = numbers::<D>(d)?;
    match Distortion::from_opencv(&values) {
        Some(distortion) => Ok(Some(distortion)),
        None if [12, 14].contains(&values.len()) => Err(D::Error::custom(
            "the coefficients of a thin prism or a tilted sensor (from the ninth on) are not zero; calibrate without \
             them (no cv2.CALIB_THIN_PRISM_MODEL, no cv2.CALIB_TILTED_MODEL), or write zeros",
        )),
        None => Err(D::Error::custom(format!(
            "{} coefficients are not OpenCV's model; write 4, 5, 8, 12 or 14 of them: [k1, k2, p1, p2, k3, k4, k5, k6]",
            values.len()
        ))),
    }
}

pub(super) fn principal_point<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[f64; 2]>, D::Error> {
    match numbers::<D>(d)?[..] {
        [right, down] => Ok(Some([right, down])),
        _ => Err(D::Error::custom("an offset has two numbers; write [right, down] in pixels, such as [12.5, -3]")),
    }
}

fn numbers<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<f64>, D::Error> {
    Vec::deserialize(d)?.into_iter().map(|v| in_range(v, -1e6, 1e6)).collect()
}

pub(super) fn vignetting<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Vignetting>, D::Error> {
    let known = [("none", Vignetting::None), ("cos4", Vignetting::CosineFourth)];
    word(d, "vignetting", &known, "\"none\" or \"cos4\"").map(Some)
}

fn real<'de, D: Deserializer<'de>>(d: D, least: f64, most: f64) -> Result<f64, D::Error> {
    in_range(f64::deserialize(d)?, least, most)
}

fn in_range<E: Error>(v: f64, least: f64, most: f64) -> Result<f64, E> {
    checked(v, least..=most, "", &format!("a number from {least} to {most}"))
}

/// A quantity in a range of SI units.
pub(super) fn ranged<'de, Q, D>(d: D, range: RangeInclusive<f64>, unit: &str, help: &str) -> Result<f64, D::Error>
where
    Q: Deserialize<'de> + Into<f64>,
    D: Deserializer<'de>,
{
    checked(Q::deserialize(d)?.into(), range, unit, help)
}

fn checked<E: Error>(v: f64, range: RangeInclusive<f64>, unit: &str, help: &str) -> Result<f64, E> {
    if range.contains(&v) {
        return Ok(v);
    }
    Err(E::custom(format!("{}{unit} is out of range; write {help}", Number(v))))
}

/// The value of a word.
fn word<'de, T: Copy, D: Deserializer<'de>>(d: D, what: &str, known: &[(&str, T)], help: &str) -> Result<T, D::Error> {
    let word = String::deserialize(d)?;
    let found = known.iter().find(|(name, _)| *name == word).map(|(_, value)| *value);
    found.ok_or_else(|| D::Error::custom(format!("unknown {what} \"{word}\"; write {help}")))
}

/// A time budget: whole nanoseconds, at most a year.
pub(super) fn duration<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Duration>, D::Error> {
    let seconds = ranged::<Time, D>(d, f64::MIN_POSITIVE..=3.2e7, " s", "a time above zero, such as \"20s\"")?;
    Ok(Some(Duration::from_secs_f64(seconds)))
}

/// The duration [s] of a pulse.
pub(super) fn pulse<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<Time, D>(d, 1e-9..=1e6, " s", "a time from 1ns on, such as \"100us\"").map(Some)
}

/// An angle [rad] in degrees, without the digits that result from rounding.
fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * 1e9).round() / 1e9
}

/// A field of view [rad].
pub(super) fn field_of_view<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    angle_between(d, 1e-4, std::f64::consts::PI * 0.99, "between 0.01deg and 178deg")
}

/// A rotation [rad].
pub(super) fn angle<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f32>, D::Error> {
    Ok(angle_between(d, -1e4, 1e4, "from -572957deg to 572957deg")?.map(|v| v as f32))
}

/// A focal length [m].
pub(super) fn focal_length<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<Length, D>(d, 1e-6..=100.0, " m", "a focal length such as \"12mm\"").map(Some)
}

/// A distance [m] above zero, also as f32; `inf` is valid.
pub(super) fn distance<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f32>, D::Error> {
    let help = "a distance above zero, such as \"2mm\", or \"inf\"";
    Ok(Some(ranged::<LengthOrInf, D>(d, 1e-30..=f64::INFINITY, " m", help)? as f32))
}

/// A power [W].
pub(super) fn power<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    ranged::<Power, D>(d, 0.0..=1e12, " W", "a power of zero or more, such as \"1.5W\"").map(Some)
}

/// A colour with channels from 0 to 1.
pub(super) fn color<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Rgb>, D::Error> {
    triple(d, 1.0).map(Some)
}

/// A colour that is not black: absorption towards zero light has no finite coefficient.
pub(super) fn positive_color<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Rgb>, D::Error> {
    let c = triple(d, 1.0)?;
    if c.to_array().iter().all(|v| *v > 0.0) {
        return Ok(Some(c));
    }
    Err(D::Error::custom("a channel is 0, which no finite absorption gives; write values from 0.001 to 1"))
}

/// A coefficient of absorption or scattering [1/m] per channel.
pub(super) fn coefficient<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Rgb>, D::Error> {
    let what = "a coefficient per metre such as 500 or \"0.5/mm\", or three of them [r, g, b]";
    channels(one_or_three::<PerLength, D>(d, what)?, 1e9).map(Some)
}

/// A priority among solids.
pub(super) fn priority<'de, D: Deserializer<'de>>(d: D) -> Result<Option<i32>, D::Error> {
    let v = d.deserialize_any(Whole { least: -1_000_000, most: 1_000_000 })?;
    i32::try_from(v).map(Some).map_err(D::Error::custom)
}

/// A radiometric quantity per channel.
pub(super) fn light<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Rgb>, D::Error> {
    triple(d, 1e12).map(Some)
}

fn triple<'de, D: Deserializer<'de>>(d: D, most: f64) -> Result<Rgb, D::Error> {
    channels(one_or_three::<f64, D>(d, "three numbers [r, g, b], or one for all three")?, most)
}

fn channels<E: Error>(values: [f64; 3], most: f64) -> Result<Rgb, E> {
    let [r, g, b] = values.map(|v| in_range::<E>(v, 0.0, most).map(|v| v as f32));
    Ok(Rgb::new(r?, g?, b?))
}

pub(super) fn emissive_unit<'de, D: Deserializer<'de>>(d: D) -> Result<EmissiveUnit, D::Error> {
    let watts = EmissiveUnit::WattPerSteradianSquareMetre;
    let nits = EmissiveUnit::Nit;
    let known = [("nit", nits), ("cd/m2", nits), ("W/(m2 sr)", watts), ("W/(m^2 sr)", watts)];
    word(d, "unit", &known, "\"nit\" or \"W/(m2 sr)\"")
}

/// A unit of length by its name [m].
pub(super) fn length_unit<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    let known = [("um", 1e-6), ("µm", 1e-6), ("μm", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("in", 0.0254)];
    word(d, "unit", &known, "\"um\", \"mm\", \"cm\", \"m\" or \"in\"").map(Some)
}

/// An amount of memory [B].
pub(super) fn memory<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u64>, D::Error> {
    let bytes = ranged::<Memory, D>(d, 1.0..=1e15, " B", "an amount from 1 B to 900 TiB, such as \"2GiB\"")?;
    Ok(Some(bytes as u64))
}

/// A whole number in a range.
struct Whole {
    least: i64,
    most: i64,
}

impl Visitor<'_> for Whole {
    type Value = i64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number from {} to {}", self.least, self.most)
    }

    fn visit_i64<E: Error>(self, v: i64) -> Result<i64, E> {
        if (self.least..=self.most).contains(&v) {
            return Ok(v);
        }
        let (least, most) = (self.least, self.most);
        Err(E::custom(format!("{v} is out of range; write a whole number from {least} to {most}")))
    }
}

/// A number of copies along an axis, at least one.
pub(super) struct Count(pub(super) u32);

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        whole(d, 1, 1_000_000).map(Count)
    }
}

/// A length [m], or `inf` with and without quotes.
struct LengthOrInf(f64);

impl From<LengthOrInf> for f64 {
    fn from(LengthOrInf(v): LengthOrInf) -> Self {
        v
    }
}

impl<'de> Deserialize<'de> for LengthOrInf {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let value = toml::Value::deserialize(d)?;
        match value.as_str().map(str::trim) {
            Some("inf") => Ok(Self(f64::INFINITY)),
            _ => Length::deserialize(value).map(|v| Self(v.0)).map_err(|e| D::Error::custom(e.message())),
        }
    }
}
