//! `[film]` of a job: the number of pixels, their size on the sensor, and the part of the sensor that is read.

use super::check;
use dunkelfeld_film::MAX_SIDE;
use serde::Deserialize;
use serde::de::{Deserializer, Error};

/// `[film]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilmSettings {
    /// Width in pixels, 1 to 32768.
    #[serde(deserialize_with = "check::pixels")]
    pub width: Option<u32>,
    /// Height in pixels, 1 to 32768.
    #[serde(deserialize_with = "check::pixels")]
    pub height: Option<u32>,
    /// Side of a pixel \[m\] on the sensor, written as `"3.45um"`. A focal length refers to it. Default: that of the
    /// sensor model.
    #[serde(deserialize_with = "check::positive_length")]
    pub pixel_pitch: Option<f64>,
    /// Width \[m\] of the film on the sensor, for any number of pixels; instead of `pixel_pitch`.
    #[serde(deserialize_with = "check::positive_length")]
    pub sensor_width: Option<f64>,
    /// Height \[m\] of the film on the sensor; instead of `pixel_pitch`.
    #[serde(deserialize_with = "check::positive_length")]
    pub sensor_height: Option<f64>,
    /// The film has the resolution of the sensor model, instead of `width` and `height`.
    pub full: bool,
    /// Region of interest: left, top, width and height in pixels of the whole film.
    #[serde(deserialize_with = "region")]
    pub roi: Option<[u32; 4]>,
    /// Side of the squares of pixels that are read as one pixel, 1 to 16. Default 1.
    #[serde(deserialize_with = "binning")]
    pub binning: Option<u32>,
}

fn region<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[u32; 4]>, D::Error> {
    let form = "write [left, top, width, height] in pixels, such as [100, 50, 640, 480]";
    let numbers = Vec::<i64>::deserialize(d)?;
    let Ok([left, top, width, height]) = <[i64; 4]>::try_from(numbers) else {
        return Err(D::Error::custom(format!("a region has four numbers; {form}")));
    };
    let pixel = |v: i64, least: i64| u32::try_from(v).ok().filter(|n| v >= least && *n <= MAX_SIDE);
    match (pixel(left, 0), pixel(top, 0), pixel(width, 1), pixel(height, 1)) {
        (Some(left), Some(top), Some(width), Some(height)) => Ok(Some([left, top, width, height])),
        _ => Err(D::Error::custom(format!("a number of the region is out of range; {form}"))),
    }
}

fn binning<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u32>, D::Error> {
    check::whole(d, 1, 16).map(Some)
}
