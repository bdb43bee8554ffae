//! `[[capture]]`: images of one render, each with factors on lights and its own exposure.

use super::patterns::matches;
use super::{Exposure, Job};
use crate::error::InputError;
use crate::names::suggestion;
use crate::toml_file::TomlFile;
use serde::Deserialize;
use serde::de::{Deserializer, Error};
use std::collections::BTreeMap;

/// Largest factor on a light.
const MAX_FACTOR: f64 = 1e6;

/// `[[capture]]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// Name, the suffix of its files: letters, digits, `-` and `_`.
    #[serde(deserialize_with = "name")]
    pub name: String,
    /// The lights that are on, by names or patterns, each with a factor on its strength. A list has the factors 1.
    #[serde(deserialize_with = "factors")]
    pub lights: BTreeMap<String, f64>,
    /// The exposure; by default that of the sensor.
    pub exposure: Option<Exposure>,
}

fn name<'de, D: Deserializer<'de>>(d: D) -> Result<String, D::Error> {
    let name = String::deserialize(d)?;
    if !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c)) {
        return Ok(name);
    }
    Err(D::Error::custom(format!("\"{name}\" is not a suffix of files; write letters, digits, `-` and `_`")))
}

fn factors<'de, D: Deserializer<'de>>(d: D) -> Result<BTreeMap<String, f64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "write names of lights as [\"left\", \"right\"], or with factors as { left = 1, right = 0.5 }"
    )]
    enum Written {
        List(Vec<String>),
        Table(BTreeMap<String, f64>),
    }
    let factors = match Written::deserialize(d)? {
        Written::List(names) => names.into_iter().map(|name| (name, 1.0)).collect(),
        Written::Table(factors) => factors,
    };
    if let Some((name, factor)) = factors.iter().find(|(_, factor)| !(0.0..=MAX_FACTOR).contains(*factor)) {
        return Err(D::Error::custom(format!(
            "the factor {factor} of \"{name}\" is out of range; write 0 to {MAX_FACTOR}"
        )));
    }
    if factors.values().all(|factor| *factor == 0.0) {
        return Err(D::Error::custom("no light is on; name a light with a factor above 0"));
    }
    Ok(factors)
}

impl Job {
    /// Checks without a scene: names that are there twice.
    pub(super) fn check_captures(&self, file: &TomlFile) -> Result<(), InputError> {
        for (i, capture) in self.captures.iter().enumerate() {
            if self.captures[..i].iter().any(|other| other.name.eq_ignore_ascii_case(&capture.name)) {
                let problem = format!("there are two captures named \"{}\"", capture.name);
                let path = ["capture", &i.to_string(), "name"];
                return Err(file.error_at_key(&path, problem, "write another name"));
            }
        }
        Ok(())
    }

    /// The factor of each light of a scene, by its name, for each capture. Of several patterns that match a light the last in the
    /// order of their letters has the factor; a name is before all patterns.
    ///
    /// # Errors
    /// A name that no light has.
    pub fn capture_factors(&self, lights: &[String]) -> Result<Vec<Vec<f64>>, InputError> {
        let of_capture = |(i, capture): (usize, &Capture)| {
            let is_unknown = |name: &&String| !lights.iter().any(|light| matches(name, light));
            if let Some(name) = capture.lights.keys().find(is_unknown) {
                let problem = format!("the scene has no light named \"{name}\"");
                let path = ["capture", &i.to_string(), "lights"];
                let known: Vec<&str> = lights.iter().map(String::as_str).collect();
                return Err(self.source.error_at_key(&path, problem, suggestion(name, "lights", &known)));
            }
            let factor = |light: &String| {
                let patterns = capture.lights.iter().filter(|(pattern, _)| matches(pattern, light));
                capture.lights.get(light).or(patterns.map(|(_, factor)| factor).next_back()).copied().unwrap_or(0.0)
            };
            Ok(lights.iter().map(factor).collect())
        };
        self.captures.iter().enumerate().map(of_capture).collect()
    }
}
