//! The keys of the tables of a job, from the types that read them. So no list of keys can differ from the reader.

use crate::errors::{Failure, setting};
use dunkelfeld_io::job::{CameraSettings, LensSettings, light_keys, material_keys, object_keys};
use dunkelfeld_io::names::suggestion;
use dunkelfeld_io::toml_keys::keys_of;
use pyo3::prelude::*;

/// The keys of a table of the job file: "camera", "lens", "light", "material" or "object".
#[pyfunction]
pub(crate) fn job_keys(table: &str) -> Result<Vec<&'static str>, Failure> {
    let keys = match table {
        "camera" => keys_of::<CameraSettings>().to_vec(),
        "lens" => keys_of::<LensSettings>().to_vec(),
        "light" => light_keys(),
        "material" => material_keys(),
        "object" => object_keys(),
        other => {
            let problem = format!("unknown value \"{other}\"");
            return Err(setting("table", problem, "camera, lens, light, material or object"));
        }
    };
    Ok(keys)
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
