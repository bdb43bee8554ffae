//! The keys of the tables of a job, from the types that read them. So no list of keys can differ from the reader.

use crate::errors::{Failure, setting};
use dunkelfeld_io::job::{CameraSettings, LensSettings, LightSettings, MaterialOverride, ObjectOverride};
use dunkelfeld_io::names::suggestion;
use pyo3::prelude::*;
use serde::de::value::Error as NoValue;
use serde::de::{Deserializer, Error, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};

/// A deserializer that stores the names of the fields of a struct and contains no value.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = NoValue;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, NoValue> {
        Err(NoValue::custom("no struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, NoValue> {
        *self.0 = fields;
        Err(NoValue::custom("no value"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

fn fields_of<'de, T: Deserialize<'de>>() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    // The deserializer always ends with an error, after it has stored the names.
    let _ = T::deserialize(FieldNames(&mut names));
    names
}

/// The keys of a table of the job file: "camera", "lens", "light", "material" or "object".
#[pyfunction]
pub(crate) fn job_keys(table: &str) -> Result<Vec<&'static str>, Failure> {
    let keys = match table {
        "camera" => fields_of::<CameraSettings>(),
        "lens" => fields_of::<LensSettings>(),
        "light" => fields_of::<LightSettings>(),
        "material" => fields_of::<MaterialOverride>(),
        "object" => fields_of::<ObjectOverride>(),
        other => {
            let problem = format!("unknown value \"{other}\"");
            return Err(setting("table", problem, "camera, lens, light, material or object"));
        }
    };
    Ok(keys.to_vec())
}

/// Refuses a key that a table of the job file does not have, and a table without one of the `required` keys.
#[pyfunction]
pub(crate) fn check_job_keys(table: &str, keys: Vec<String>, required: Vec<String>) -> Result<(), Failure> {
    let known = job_keys(table)?;
    if let Some(key) = required.iter().find(|key| !keys.contains(key)) {
        let problem = format!("a {table} needs the key \"{key}\"");
        return Err(setting(&format!("{table}.{key}"), problem, &format!("pass {key}=...")));
    }
    match keys.iter().find(|key| !known.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => {
            let near = suggestion(key, "keys", &known);
            let near = if near.starts_with("did you") { format!("{near} ") } else { String::new() };
            let help = format!("{near}the keys are {}", known.join(", "));
            Err(setting(&format!("{table}.{key}"), format!("a {table} has no key \"{key}\""), &help))
        }
    }
}
