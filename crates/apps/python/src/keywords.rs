//! Keywords of Python that are keys of a job: rows of [`KEYS`](dunkelfeld::io::KEYS).

use crate::errors::setting;
use crate::sensor::{Sensor, given_sensor};
use dunkelfeld::io::{Key, Kind};
use dunkelfeld::{ExposeOptions, GivenSensor, RenderOptions};
use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};
use std::path::PathBuf;

/// The keys that keywords set, as lines of a job, and a sensor that is no key.
#[derive(Default)]
pub(crate) struct Keywords {
    pub(crate) keys: String,
    pub(crate) sensor: Option<GivenSensor>,
}

impl Keywords {
    /// The keywords of a function. `None` as a value leaves the key as it is. `flags` are those of the
    /// command that does the same.
    ///
    /// # Errors
    /// A keyword that is no key, and a value that the job may not have.
    pub(crate) fn new(function: &str, given: Option<&Bound<'_, PyDict>>, flags: &[&str]) -> PyResult<Self> {
        let mut keywords = Self::default();
        for (name, value) in given.into_iter().flat_map(|given| given.iter()) {
            let name: String = name.extract()?;
            keywords.add(function, &name, &value, flags)?;
        }
        Ok(keywords)
    }

    /// The keywords of an exposure, and its first two arguments.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn of_exposure(
        function: &str,
        (sensor, exposure): (Option<&Bound<'_, PyAny>>, Option<&Bound<'_, PyAny>>),
        given: Option<&Bound<'_, PyDict>>,
        flags: &[&str],
    ) -> PyResult<Self> {
        let mut keywords = Self::new(function, given, flags)?;
        for (name, value) in [("sensor", sensor), ("exposure", exposure)] {
            value.map_or(Ok(()), |value| keywords.add(function, name, value, flags))?;
        }
        Ok(keywords)
    }

    fn add(&mut self, function: &str, name: &str, value: &Bound<'_, PyAny>, flags: &[&str]) -> PyResult<()> {
        let Some(key) = Key::of_keyword(name, flags) else {
            return Err(PyTypeError::new_err(format!("{function}() has no keyword \"{name}\"")));
        };
        if value.is_none() {
            return Ok(());
        }
        if let Ok(sensor) = value.cast::<Sensor>()
            && key.kind == Kind::Sensor
        {
            self.sensor = Some(given_sensor(sensor.get()));
            return Ok(());
        }
        let text = text_of(key, value)?;
        let line = key.line(&text).map_err(|e| setting(key.keyword, e.problem, &e.help))?;
        self.keys += &line;
        Ok(())
    }

    /// As options of a render.
    pub(crate) fn options(self) -> RenderOptions {
        let mut options = RenderOptions::default().with_keys(self.keys);
        options.sensor = self.sensor;
        options
    }

    /// As options of an exposure.
    pub(crate) fn exposure(self) -> ExposeOptions {
        let mut options = ExposeOptions::default().with_keys(self.keys);
        options.sensor = self.sensor;
        options
    }

    /// Are there none?
    pub(crate) fn is_empty(&self) -> bool {
        self.keys.is_empty() && self.sensor.is_none()
    }
}

/// A value as it is written on the command line: numbers are in SI units.
fn text_of(key: &Key, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let refused = |takes: &str| {
        let kind = value.get_type().name().map_or_else(|_| "value".into(), |name| name.to_string());
        PyTypeError::new_err(format!("{} takes {takes}, and no {kind}", key.keyword))
    };
    let number = || value.extract::<f64>().map(|number| number.to_string());
    if value.is_instance_of::<PyBool>() {
        return Err(refused("no truth value"));
    }
    match key.kind {
        Kind::Whole => whole(key, value).unwrap_or_else(|| Err(refused("a whole number"))),
        Kind::Length => {
            value.extract().or_else(|_: PyErr| number()).map_err(|_| refused("metres, or a text such as \"12mm\""))
        }
        Kind::Real => number().map_err(|_| refused("a number")),
        Kind::Time | Kind::Exposure => {
            value.extract().or_else(|_: PyErr| number()).map_err(|_| refused("seconds, or a text such as \"5ms\""))
        }
        Kind::Memory => match value.extract() {
            Ok(text) => Ok(text),
            Err(_) => {
                let bytes = whole(key, value).unwrap_or_else(|| Err(refused("bytes, or a text such as \"6GB\"")));
                bytes.map(|bytes| bytes + "B")
            }
        },
        Kind::Name(_) => value.extract().map_err(|_| refused("a name")),
        Kind::Sensor | Kind::Psf | Kind::Input | Kind::Output => {
            let path: PathBuf = value.extract().map_err(|_| refused("a name or a path"))?;
            let text = path.into_os_string().into_string();
            text.map_err(|_| PyErr::from(setting(key.keyword, "is not UTF-8", "rename the file")))
        }
    }
}

/// A whole number from 0 on; `None` for a value that is no whole number.
fn whole(key: &Key, value: &Bound<'_, PyAny>) -> Option<PyResult<String>> {
    match value.extract::<u64>() {
        Ok(number) => Some(Ok(number.to_string())),
        Err(e) if e.is_instance_of::<PyOverflowError>(value.py()) => {
            let problem = format!("{value} is out of range");
            Some(Err(setting(key.keyword, problem, "pass whole numbers from 0 on").into()))
        }
        Err(_) => None,
    }
}
