//! Motion of a job: velocities and rotations of objects, the line-scan camera, and the shutter of the scene.

use super::check::{self, ranged};
use super::place::{self, Place};
use crate::quantity::{AngularSpeed, Frequency, Speed, Time};
use dunkelfeld_geometry::DVec3;
use serde::Deserialize;
use serde::de::{Deserializer, Error};

/// Largest speed \[m/s\] of an object, and largest angular speed \[rad/s\]. Light is faster by a factor of 300, and is taken
/// to be infinitely fast.
const FASTEST: f64 = 1e6;

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
    /// The lights of the captures flash in turn, line by line: capture k of n has the lines k, k + n and so on. Default false.
    #[serde(default)]
    pub alternate: bool,
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
    ranged::<Time, D>(d, 0.0..=1.0, " s", "a time from 0 to 1s, such as \"1us\"")
}

fn line_rate<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    ranged::<Frequency, D>(d, 1e-3..=1e9, " Hz", "the lines per second, such as \"10kHz\"")
}

/// A time of an animation \[s\].
pub(super) fn animation_time<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    ranged::<Time, D>(d, 0.0..=1e6, " s", "a time from 0 to 1e6 s, such as \"1.5s\"")
}

fn angular_speed<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    ranged::<AngularSpeed, D>(d, -FASTEST..=FASTEST, " rad/s", "a speed such as \"120rpm\"")
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
