//! The JSON of an asset with the types of `gltf::json`, and the data that these types do not contain.

use super::animation;
use super::extensions::Untyped;
use crate::error::InputError;
use gltf::json;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::Path;

/// Limit of the values in a JSON text per object: nodes with matrices have 16.
const VALUES_PER_OBJECT: usize = 32;

/// A document.
pub(super) struct Document {
    /// The data typed by `gltf::json`.
    pub(super) root: json::Root,
    /// The data that its types do not contain.
    pub(super) untyped: Untyped,
    /// Animations.
    pub(super) animations: Vec<json::Animation>,
}

impl Document {
    /// Parses a JSON text with at most `objects` objects.
    pub(super) fn read(json: &[u8], path: &Path, objects: usize) -> Result<Self, InputError> {
        check_size(json, path, objects)?;
        let mut members: Map<String, Value> = serde_json::from_slice(json).map_err(|e| syntax_error(path, &e))?;
        check_version(&members, path)?;
        let animations = animation::read(members.remove("animations"));
        // Blender writes an empty scene without the list of its nodes.
        for scene in members.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
            if let Some(scene) = scene.as_object_mut() {
                scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
            }
        }
        let members = Value::Object(members);
        Ok(Self { root: typed(&members, path)?, untyped: typed(&members, path)?, animations })
    }
}

/// A value with its type; a fault has its place.
fn typed<'de, T: Deserialize<'de>>(value: &'de Value, path: &Path) -> Result<T, InputError> {
    serde_path_to_error::deserialize(value)
        .map_err(|e| json_error(path, &e.path().to_string(), plain(&e.inner().to_string())))
}

/// Clear descriptions of expected values, where those of the types are hard to understand.
fn plain(problem: &str) -> String {
    let problem = problem.replace("index into child of root", "an index: a whole number that is not negative");
    match problem.split_once(", expected struct ") {
        Some((found, _)) => format!("{found}, expected an object"),
        None => problem,
    }
}

/// A parsed object needs some hundred bytes; "{}" in the file has three.
fn check_size(json: &[u8], path: &Path, objects: usize) -> Result<(), InputError> {
    let fail = |problem: String| {
        Err(InputError::new(path, "JSON", problem, "merge meshes and nodes on export, or raise the import limits"))
    };
    let (mut braces, mut commas) = (0_usize, 0_usize);
    for byte in json {
        braces += usize::from(*byte == b'{');
        commas += usize::from(*byte == b',');
    }
    let values = objects.saturating_mul(VALUES_PER_OBJECT);
    if braces > objects {
        return fail(format!("the file has {braces} objects, more than the {objects} allowed"));
    }
    if commas > values {
        return fail(format!("the file has {commas} values, more than the {values} allowed"));
    }
    Ok(())
}

/// Refuses versions other than 2.0 before other data is parsed.
fn check_version(members: &Map<String, Value>, path: &Path) -> Result<(), InputError> {
    // The types of the crate find other faults of the asset.
    let Some(asset) = members.get("asset") else { return Ok(()) };
    let Some(version) = asset.get("version").and_then(Value::as_str) else { return Ok(()) };
    if version.split('.').next() != Some("2") {
        return Err(old_version(path, "asset.version", version));
    }
    if let Some(least) = asset.get("minVersion").and_then(Value::as_str).filter(|v| *v != "2.0") {
        return Err(InputError::new(
            path,
            "asset.minVersion",
            format!("the file needs glTF {least}, this program reads 2.0"),
            "export as glTF 2.0",
        ));
    }
    Ok(())
}

pub(super) fn old_version(path: &Path, place: &str, version: &str) -> InputError {
    InputError::new(
        path,
        place,
        format!("this is glTF version \"{version}\", but only 2.0 is read"),
        "export the scene as glTF 2.0",
    )
}

fn syntax_error(path: &Path, e: &serde_json::Error) -> InputError {
    let text = e.to_string();
    let problem = text.split(" at line ").next().unwrap_or(&text).to_owned();
    json_error(path, &format!("line {}, column {}", e.line().max(1), e.column()), problem)
}

fn json_error(path: &Path, place: &str, problem: String) -> InputError {
    InputError::new(path, format!("JSON, {place}"), problem, "correct the JSON, or export the file again")
}
