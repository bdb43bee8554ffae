//! Keys of a job from Python: a text of TOML, or dictionaries.

use crate::errors::{Failure, setting};
use dunkelfeld::io::toml_text;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyMapping, PyString};
use serde_json::{Map, Number, Value};

/// Deepest nesting of dictionaries and lists.
const DEEPEST: usize = 32;
/// Largest number of items of a list.
const MOST_ITEMS: usize = 1 << 20;

/// The TOML text of a job: the text itself, or the text of a dictionary.
pub(crate) fn job_text(job: &Bound<'_, PyAny>) -> Result<String, Failure> {
    if let Ok(text) = job.cast::<PyString>() {
        return Ok(text.to_string());
    }
    let Ok(dictionary) = job.cast::<PyMapping>() else {
        let kind = job.get_type().name()?.to_string();
        return Err(setting("job", format!("a {kind} is neither a text nor a dictionary"), "pass TOML or a dict"));
    };
    let table = table_of(dictionary, "", 0)?;
    toml_text(&table).map_err(|e| setting("job", e, "pass keys and values of a job file"))
}

/// The TOML text of overrides, with more keys as keywords.
pub(crate) fn overrides_text(
    py: Python<'_>,
    overrides: Option<&Bound<'_, PyAny>>,
    keys: Option<&Bound<'_, PyDict>>,
) -> Result<String, Failure> {
    let keys = keys.filter(|keys| !keys.is_empty());
    match (overrides, keys) {
        (Some(overrides), None) => job_text(overrides),
        (None, None) => job_text(PyDict::new(py).as_any()),
        (None, Some(keys)) => job_text(keys.as_any()),
        (Some(overrides), Some(keys)) => {
            let help = "pass a dictionary, or keywords alone";
            let Ok(all) = overrides.cast::<PyDict>() else {
                return Err(setting("overrides", "keywords can be beside a dictionary only", help));
            };
            let all = all.copy()?;
            for (key, value) in keys.iter() {
                if all.contains(&key)? {
                    return Err(setting(&key.to_string(), "is in the dictionary and a keyword", "pass it once"));
                }
                all.set_item(key, value)?;
            }
            job_text(all.as_any())
        }
    }
}

fn table_of(dictionary: &Bound<'_, PyMapping>, place: &str, depth: usize) -> Result<Map<String, Value>, Failure> {
    let mut table = Map::new();
    for item in dictionary.items()?.iter() {
        let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let Ok(key) = key.cast::<PyString>() else {
            return Err(setting(place, "a key is not a text", "name keys as in a job file"));
        };
        let key = key.to_string();
        let at = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
        // A key without a value is left out.
        if !value.is_none() {
            table.insert(key, value_of(&value, &at, depth + 1)?);
        }
    }
    Ok(table)
}

fn value_of(value: &Bound<'_, PyAny>, place: &str, depth: usize) -> Result<Value, Failure> {
    if depth > DEEPEST {
        return Err(setting(place, "is nested too deeply", "pass keys and values of a job file"));
    }
    if let Ok(dictionary) = value.cast::<PyMapping>() {
        return Ok(Value::Object(table_of(dictionary, place, depth)?));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(Value::String(text.to_string()));
    }
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Bool(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        let whole: Result<i64, _> = value.extract();
        let whole = whole.map_err(|_| {
            let problem = format!("is no whole number from {} to {} (signed, 64 bits)", i64::MIN, i64::MAX);
            setting(place, problem, "pass a smaller number; a larger seed is the keyword `seed` of `render`")
        })?;
        return Ok(Value::Number(whole.into()));
    }
    if value.is_instance_of::<PyFloat>() {
        let number = Number::from_f64(value.extract()?);
        return Ok(Value::Number(number.ok_or_else(|| setting(place, "is not a finite number", "pass a number"))?));
    }
    // Scalars and arrays of numpy have a list of Python; so have tuples and other iterables.
    if value.hasattr("tolist")? {
        return value_of(&value.call_method0("tolist")?, place, depth + 1);
    }
    if value.hasattr("__fspath__")? {
        return Ok(Value::String(value.call_method0("__fspath__")?.extract()?));
    }
    let is_bytes = value.is_instance_of::<PyBytes>() || value.is_instance_of::<PyByteArray>();
    if is_bytes || !value.hasattr("__iter__")? {
        let kind = value.get_type().name()?.to_string();
        return Err(setting(place, format!("a {kind} is no value of a job"), "pass numbers, texts, lists or dicts"));
    }
    let items = value
        .try_iter()?
        .take(MOST_ITEMS + 1)
        .enumerate()
        .map(|(i, item)| value_of(&item?, &format!("{place}[{i}]"), depth + 1));
    let items = items.collect::<Result<Vec<_>, Failure>>()?;
    if items.len() > MOST_ITEMS {
        return Err(setting(place, "has too many items", "pass the values of a job file"));
    }
    Ok(Value::Array(items))
}
