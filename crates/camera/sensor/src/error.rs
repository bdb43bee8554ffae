//! Errors of sensors, lenses and exposures.

use dunkelfeld_radiometry::Number;

/// The reason why a sensor, a lens or an exposure cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// A number is not finite or lies outside its range.
    #[error("{field} is {}, it must be {allowed}", Number(*value))]
    OutOfRange {
        /// The name of the field.
        field: &'static str,
        /// The value of the field.
        value: f64,
        /// The allowed range, in words.
        allowed: &'static str,
    },
    /// An exposure time that the camera does not have.
    #[error(
        "{} is {} of {camera}, {}",
        time_in_words(*time),
        if time < limit { "below the shortest" } else { "above the longest" },
        time_in_words(*limit)
    )]
    Exposure {
        /// The name of the sensor and its camera.
        camera: String,
        /// The exposure time \[s\].
        time: f64,
        /// The shortest or the longest one \[s\].
        limit: f64,
    },
    /// The quantum efficiency is not a curve.
    #[error("quantum_efficiency: {0}")]
    Curve(&'static str),
    /// A table is no MTF.
    #[error("the MTF {0}")]
    Mtf(String),
    /// A map of the pixels does not fit the sensor.
    #[error("{name} {problem}")]
    Map {
        /// The key of the map in a sensor file.
        name: &'static str,
        /// The fault, as the continuation of the name.
        problem: String,
    },
    /// A plane does not have the size of the device.
    #[error("the device has {0} x {1} pixels, the plane {2} x {3}")]
    Size(u32, u32, u32, u32),
    /// The requested rows do not fit the plane, or the buffer does not fit the rows.
    #[error("rows {start}..{end} of {height} do not fit a buffer of {buffer} pixels")]
    Rows {
        /// First row.
        start: u32,
        /// One past the last row.
        end: u32,
        /// Rows of the plane.
        height: u32,
        /// Length of the buffer.
        buffer: usize,
    },
    /// No pixel receives light, so no exposure time gives an image.
    #[error("no pixel receives any light, so there is no exposure time to choose")]
    NoLight,
}

/// A time \[s\] in words.
pub fn time_in_words(time: f64) -> String {
    if time < 1e-3 { format!("{} us", Number(1e6 * time)) } else { format!("{} s", Number(time)) }
}

/// Checks that a value lies in `low..=high`.
pub(crate) fn in_range(
    field: &'static str,
    value: f64,
    low: f64,
    high: f64,
    allowed: &'static str,
) -> Result<(), SensorError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(SensorError::OutOfRange { field, value, allowed }) }
}
