//! Values of JSON as objects of Python.

use crate::errors::{Failure, setting};
use pyo3::prelude::*;
use serde::Serialize;

/// Dictionaries, lists and numbers of a value. Numbers that are not finite become None.
pub(crate) fn loaded<'py>(py: Python<'py>, value: &impl Serialize) -> Result<Bound<'py, PyAny>, Failure> {
    let text = serde_json::to_string(value).map_err(|e| setting("json", e.to_string(), "report it"))?;
    Ok(py.import("json")?.call_method1("loads", (text,))?)
}
