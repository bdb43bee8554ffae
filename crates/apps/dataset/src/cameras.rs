//! The cameras of a job that a study changes.

use crate::distribution::Fault;
use toml::Value;

/// Changes the cameras of a job by those of a study, key by key as for lights and objects. A camera of the study changes
/// the one of its name, and a `[camera]` without a name the only one of the job. Gives the cameras that the job does not
/// have.
pub(crate) fn change_cameras(list: &mut [Value], changes: &[Value], is_list: bool) -> Result<Vec<Value>, Fault> {
    let name_of = |camera: &Value| camera.get("name").and_then(Value::as_str).map(str::to_owned);
    let names: Vec<String> = list.iter().filter_map(name_of).collect();
    let mut added = Vec::new();
    for (number, change) in changes.iter().enumerate() {
        let Value::Table(keys) = change else { return Ok(changes.to_vec()) };
        let name = name_of(change);
        let found = match (&name, is_list) {
            (None, false) if list.len() == 1 => list.first_mut(),
            (None, false) => {
                let help = format!("write `name`; the cameras of the job are {}", names.join(", "));
                return Err(Fault::new("the job has several cameras, and this one has no name", help).below("camera"));
            }
            (None, true) => None,
            (Some(_), _) => list.iter_mut().find(|camera| name_of(camera) == name),
        };
        match found {
            Some(Value::Table(camera)) => dunkelfeld_io::toml_file::merge(camera, keys.clone()),
            _ if is_list && name.is_some_and(|name| !names.contains(&name)) => added.push(change.clone()),
            _ => {
                let help = format!("write the name of one of {}, or [[camera]] for a new one", names.join(", "));
                let fault = Fault::new("the job has no camera of this name", help);
                let fault = if is_list { fault.below(number.to_string()) } else { fault };
                return Err(fault.below("camera"));
            }
        }
    }
    Ok(added)
}
