//! Motion of a job: velocities and rotations of objects, the line-scan camera, and the shutter of the scene.

use super::check;
use super::place::{self, Place};
use crate::quantity::{AngularSpeed, Frequency, Speed, Time};
use dunkelfeld_geometry::DVec3;
use dunkelfeld_radiometry::Number;
use serde::Deserialize;
use serde::de::{Deserializer, Error};

/// Largest speed \[m/s\] of an object. Light is faster by a factor of 300, and is taken to be infinitely fast.
const FASTEST: f64 = 1e6;
/// Largest angular speed \[rad/s\].
const FASTEST_TURN: f64 = 1e6;
/// Range of the line rate \[Hz\].
const LINE_RATES: std::ops::RangeInclusive<f64> = 1e-3..=1e9;

/// `rotation` of an object: a rotation at a constant speed about an axis of the world.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotationSettings {
    /// Direction of the axis. The rotation is right-handed about it.
    #[serde(deserialize_with = "place::direction")]
    pub axis: Option<DVec3>,
    /// A point of the axis. Default: the centre of the bounds of each object.
    pub origin: Option<Place>,
    /// Angular speed \[rad/s\]; written as `"2turn/s"`, `"120rpm"` or `"30deg/s"`.
    #[serde(deserialize_with = "angular_speed")]
    pub speed: f64,
}

/// `[line_scan]`: the rows of the film are exposed one after the other by one line of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineScanSettings {
    /// Lines per second \[Hz\]; written as `"10kHz"`.
    #[serde(deserialize_with = "line_rate")]
    pub line_rate: f64,
    /// Stages of time delay and integration, 1 to 1024. Default 1.
    #[serde(default = "one", deserialize_with = "stages")]
    pub tdi_stages: u32,
    /// Standard deviation \[s\] of the start of a line. Default 0.
    #[serde(default, deserialize_with = "jitter")]
    pub encoder_jitter: f64,
    /// Place of the sensor line in the height of the film, 0 (top) to 1. Default 0.5.
    #[serde(default = "half", deserialize_with = "check::share")]
    pub line: f64,
}

fn one() -> u32 {
    1
}

fn half() -> f64 {
    0.5
}

fn stages<'de, D: Deserializer<'de>>(d: D) -> Result<u32, D::Error> {
    check::whole(d, 1, 1024)
}

fn jitter<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    let Time(v) = Time::deserialize(d)?;
    if (0.0..=1.0).contains(&v) {
        return Ok(v);
    }
    Err(D::Error::custom(format!("{} s is out of range; write a time from 0 to 1s, such as \"1us\"", Number(v))))
}

fn line_rate<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    let Frequency(v) = Frequency::deserialize(d)?;
    if LINE_RATES.contains(&v) {
        return Ok(v);
    }
    Err(D::Error::custom(format!("{} Hz is out of range; write the lines per second, such as \"10kHz\"", Number(v))))
}

/// A time of an animation \[s\].
pub(super) fn animation_time<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    let Time(v) = Time::deserialize(d)?;
    if (0.0..=1e6).contains(&v) {
        return Ok(v);
    }
    Err(D::Error::custom(format!("{} s is out of range; write a time from 0 to 1e6 s, such as \"1.5s\"", Number(v))))
}

fn angular_speed<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    let AngularSpeed(v) = AngularSpeed::deserialize(d)?;
    if v.abs() <= FASTEST_TURN {
        return Ok(v);
    }
    Err(D::Error::custom(format!("{} rad/s is out of range; write a speed such as \"120rpm\"", Number(v))))
}

/// Three components \[m/s\] of a velocity.
pub(super) fn velocity<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DVec3>, D::Error> {
    let what = "three speeds such as [\"200mm/s\", 0, 0]";
    let v = DVec3::from_array(place::three::<Speed, D>(d, what)?.map(f64::from));
    // The largest of three components is not NaN if one of them is.
    if v.is_finite() && v.abs().max_element() <= FASTEST {
        return Ok(Some(v));
    }
    Err(D::Error::custom("the velocity is out of range; write three speeds from -1e6 to 1e6 m/s"))
}
