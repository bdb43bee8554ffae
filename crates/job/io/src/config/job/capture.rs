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
/// Most captures whose lights flash in turn: rows of a tile of the film, so that each has one in it.
const MAX_IN_TURN: u32 = 16;

/// `[[capture]]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// Name, the suffix of its files: letters, digits, `-` and `_`.
    #[serde(deserialize_with = "name")]
    pub name: String,
    /// The lights that are on, by names or patterns, each with a factor on its strength. A list has the factors 1.
    /// Default: all lights.
    #[serde(default = "all_lights", deserialize_with = "factors")]
    pub lights: BTreeMap<String, f64>,
    /// The camera whose image it is. Default: each camera that is rendered.
    pub camera: Option<String>,
    /// The exposure; by default that of the sensor.
    pub exposure: Option<Exposure>,
}

fn all_lights() -> BTreeMap<String, f64> {
    BTreeMap::from([("*".into(), 1.0)])
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
    /// Checks without a scene: names that are there twice, and cameras that the job does not select.
    pub(super) fn check_captures(&self, file: &TomlFile) -> Result<(), InputError> {
        for (i, capture) in self.captures.iter().enumerate() {
            if self.captures[..i].iter().any(|other| other.name.eq_ignore_ascii_case(&capture.name)) {
                let problem = format!("there are two captures named \"{}\"", capture.name);
                let path = ["capture", &i.to_string(), "name"];
                return Err(file.error_at_key(&path, problem, "write another name"));
            }
            if let (Some(selected), Some(camera)) = (&self.camera.selected, &capture.camera)
                && selected != camera
            {
                let problem = format!("the job selects the camera \"{selected}\", so that no render has this capture");
                let help = "define the cameras by [[camera]] instead, with a `name` alone for one of the scene file";
                return Err(file.error_at_key(&["capture", &i.to_string(), "camera"], problem, help));
            }
        }
        Ok(())
    }

    /// The number of captures whose lights flash in turn, line by line, on a film of `rows` lines; 1 without `alternate`.
    ///
    /// # Errors
    /// Captures that no line-scan camera takes in turn.
    pub(super) fn lines_in_turn(&self, rows: u32) -> Result<u32, InputError> {
        let Some(lines) = self.line_scan.filter(|lines| lines.alternate) else { return Ok(1) };
        let count = self.captures.len() as u32;
        let (problem, help) = if !(2..=MAX_IN_TURN).contains(&count) {
            (format!("the job has {count} captures"), "write 2 to 16 [[capture]], whose lights flash in turn")
        } else if self.captures.iter().any(|capture| capture.camera.is_some()) {
            ("the captures of alternating lines are of the same camera".into(), "remove `camera` in [[capture]]")
        } else if lines.tdi_stages > 1 {
            ("the stages of a line are exposed one after the other, in different lights".into(), "remove `tdi_stages`")
        } else if !rows.is_multiple_of(count) {
            let problem = format!("the film has {rows} lines, which is no multiple of the {count} captures");
            (problem, "write another `height` in [film]")
        } else {
            return Ok(count);
        };
        Err(self.source.error_at_key(&["line_scan", "alternate"], problem, help))
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
