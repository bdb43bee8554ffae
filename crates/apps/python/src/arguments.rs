//! Arguments of Python with a closed set of values, or with a unit.

use crate::errors::{Failure, setting};
use dunkelfeld::DenoiseMethod;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::commands::removable_effects;
use dunkelfeld::io::{Length, Memory, QuantityError};
use dunkelfeld::scene::Effect;
use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyBool;
use std::path::PathBuf;

/// Largest number of threads.
const MOST_THREADS: usize = dunkelfeld::limits::MAX_THREADS;

/// The value with a name.
pub(crate) fn named<T: Copy>(what: &str, name: &str, all: &[(&str, T)]) -> Result<T, Failure> {
    let found = all.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        setting(what, format!("unknown value \"{name}\""), &format!("write one of {}", names.join(", ")))
    })
}

/// A strategy by its name.
pub(crate) fn strategy_of(what: &str, name: &str) -> Result<Strategy, Failure> {
    named(what, name, &Strategy::ALL.map(|s| (s.name(), s)))
}

/// A denoiser by its name.
pub(crate) fn method_of(name: &str) -> Result<DenoiseMethod, Failure> {
    named("denoise", name, &DenoiseMethod::ALL.map(|m| (m.name(), m)))
}

/// An effect by its name.
pub(crate) fn effect_of(name: &str) -> Result<Effect, Failure> {
    let all: Vec<(&str, Effect)> = Effect::ALL.into_iter().map(|e| (e.name(), e)).collect();
    named("effects", name, &all)
}

/// An effect that a scene can be rendered without, by its name.
pub(crate) fn effect_left_out(name: &str) -> Result<Effect, Failure> {
    let all: Vec<(&str, Effect)> = removable_effects().into_iter().map(|e| (e.name(), e)).collect();
    named("without", name, &all)
}

/// A number of threads; 0 means one per core.
pub(crate) fn checked_threads(threads: Option<usize>) -> Result<Option<usize>, Failure> {
    match threads {
        Some(n) if n > MOST_THREADS => {
            let help = format!("use at most {MOST_THREADS}; 0 means one for each core");
            Err(setting("threads", format!("{n} threads are too many"), &help))
        }
        threads => Ok(threads),
    }
}

/// Whole numbers from 0 on. One below 0, or beyond any use, is the error of its argument.
fn natural<T>(what: &str, value: &Bound<'_, PyAny>, extracted: PyResult<T>) -> PyResult<T> {
    extracted.map_err(|e| match e.is_instance_of::<PyOverflowError>(value.py()) {
        true => setting(what, format!("{value} is out of range"), "pass whole numbers from 0 on").into(),
        false => e,
    })
}

/// The argument `threads`.
pub(crate) fn threads_of(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    natural("threads", value, value.extract())
}

/// The argument `threads`, which may be None.
pub(crate) fn some_threads_of(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    natural("threads", value, value.extract())
}

/// The argument `jobs`, which may be None.
pub(crate) fn jobs_of(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    let jobs: Option<usize> = natural("jobs", value, value.extract())?;
    match jobs {
        Some(n) if !(1..=MOST_THREADS).contains(&n) => {
            let help = format!("use 1 to {MOST_THREADS}; None means one for each core");
            Err(setting("jobs", format!("{n} is out of range"), &help).into())
        }
        jobs => Ok(jobs),
    }
}

/// The argument `index`.
pub(crate) fn index_of(value: &Bound<'_, PyAny>) -> PyResult<u64> {
    natural("index", value, value.extract())
}

/// The argument `indices`, which may be None.
pub(crate) fn indices_of(value: &Bound<'_, PyAny>) -> PyResult<Option<Vec<u64>>> {
    natural("indices", value, value.extract())
}

/// A limit of memory: bytes, or a text such as "6GB".
pub(crate) enum MemoryArgument {
    Bytes(u64),
    Text(String),
}

impl<'py> FromPyObject<'_, 'py> for MemoryArgument {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(text) = value.extract() {
            return Ok(Self::Text(text));
        }
        if value.is_instance_of::<PyBool>() {
            return Err(PyTypeError::new_err("memory: pass bytes, or a text such as \"6GB\""));
        }
        Ok(Self::Bytes(value.extract()?))
    }
}

impl MemoryArgument {
    pub(crate) fn bytes(self) -> Result<u64, Failure> {
        let bytes = match self {
            Self::Bytes(bytes) => Some(bytes).filter(|b| *b > 0),
            Self::Text(text) => {
                let size: Memory = text
                    .parse()
                    .map_err(|e: QuantityError| setting("memory", e.to_string(), "write a size such as 6GB"))?;
                size.whole()
            }
        };
        bytes.ok_or_else(|| setting("memory", "is no size above zero", "pass bytes, or a text such as \"6GB\""))
    }
}

/// A length: metres, or a text such as "3.45um".
#[derive(FromPyObject)]
pub(crate) enum LengthArgument {
    Metres(f64),
    Text(String),
}

impl LengthArgument {
    pub(crate) fn metres(self, what: &str) -> Result<f64, Failure> {
        match self {
            Self::Metres(metres) => Ok(metres),
            Self::Text(text) => {
                let fault =
                    |e: QuantityError| setting(what, e.to_string(), "pass metres, or a text such as \"3.45um\"");
                Ok(text.parse::<Length>().map_err(fault)?.0)
            }
        }
    }
}

/// One path, or several.
#[derive(FromPyObject)]
pub(crate) enum PathsArgument {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

impl PathsArgument {
    pub(crate) fn list(self) -> Vec<PathBuf> {
        match self {
            Self::One(path) => vec![path],
            Self::Several(paths) => paths,
        }
    }
}

/// One name, or several.
#[derive(FromPyObject)]
pub(crate) enum NamesArgument {
    One(String),
    Several(Vec<String>),
}

impl NamesArgument {
    /// The values with these names.
    pub(crate) fn each<T>(self, value: impl Fn(&str) -> Result<T, Failure>) -> Result<Vec<T>, Failure> {
        match self {
            Self::One(name) => Ok(vec![value(&name)?]),
            Self::Several(names) => names.iter().map(|name| value(name)).collect(),
        }
    }
}
