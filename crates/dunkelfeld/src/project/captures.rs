//! Captures: images of one render, each with factors on lights and its own exposure.

use super::Project;
use super::open::seconds_of;
use dunkelfeld_io::job;
use dunkelfeld_render::{Capture, CaptureRows, Error, RenderSettings, SensorChoice, validate};
use dunkelfeld_scene::{LightGroups, Shutter};
use std::collections::BTreeMap;

/// The fault of a setting that is for one image, and its help.
const CAPTURES: (&str, &str) =
    ("it is for one image, and the job has captures", "remove [[capture]], and set the lights of one image");

impl Project {
    /// Names of the captures of the job in its order: all, or those of a camera.
    pub fn capture_names(&self, camera: Option<&str>) -> Vec<String> {
        let captures = self.job.captures.iter().filter(|capture| camera.is_none() || is_of(capture, camera));
        captures.map(|capture| capture.name.clone()).collect()
    }

    /// Settings of a render for the captures of the job with the camera of the settings: lights with the same factors in all
    /// captures are one group. A job without captures has the same settings.
    ///
    /// # Errors
    /// A name that no light has; no capture of this camera; a checkpoint or a part of the samples; an exposure of its own where the samples are those of one
    /// exposure.
    pub(crate) fn captured(&self, mut settings: RenderSettings) -> Result<RenderSettings, Error> {
        let run = &settings.run;
        let of_one = [("checkpoint", run.checkpoint.is_some()), ("samples", run.samples.is_some())];
        if let Some((name, _)) = of_one.iter().find(|(_, is_set)| *is_set && !self.job.captures.is_empty()) {
            return Err(Error::setting(*name, CAPTURES.0, CAPTURES.1));
        }
        let lights = self.scene.light_names();
        let camera = settings.run.view.as_ref().map(|view| view.name.as_str());
        let all = self.job.captures.iter().zip(self.job.capture_factors(&lights)?);
        let (captures, factors): (Vec<_>, Vec<_>) = all.filter(|(capture, _)| is_of(capture, camera)).unzip();
        if captures.is_empty() && !self.job.captures.is_empty() {
            let problem = format!("no capture is of the camera \"{}\"", camera.unwrap_or_default());
            return Err(Error::setting("camera", problem, "select a camera that a [[capture]] names"));
        }
        let mut groups: BTreeMap<Vec<u64>, Vec<String>> = BTreeMap::new();
        // Captures of all light need no film of a group.
        let has_groups = factors.iter().flatten().any(|factor| *factor != 1.0);
        for (light, name) in lights.iter().enumerate().filter(|_| has_groups) {
            let of_light: Vec<u64> = factors.iter().map(|of_capture| of_capture[light].to_bits()).collect();
            if of_light.iter().any(|bits| f64::from_bits(*bits) > 0.0) {
                groups.entry(of_light).or_default().push(name.clone());
            }
        }
        let own = match &settings.sensor {
            SensorChoice::Emva { exposure, .. } => *exposure,
            SensorChoice::None => None,
        };
        let step = match self.scene.shutter() {
            Some(Shutter::Lines(lines)) => lines.in_turn,
            _ => 1,
        };
        for (number, capture) in captures.into_iter().enumerate() {
            if let (Some(timed), Some(_)) = (self.timed_exposure(), capture.exposure) {
                let problem = format!("{} for one exposure, and a capture has another", timed.reason);
                return Err(Error::setting("capture", problem, "remove `exposure` in [[capture]]"));
            }
            settings.run.captures.push(Capture {
                name: capture.name.clone(),
                factors: groups.keys().map(|of_light| f64::from_bits(of_light[number])).collect(),
                exposure: capture.exposure.map_or(Ok(own), seconds_of)?,
                rows: if step > 1 { CaptureRows { first: number as u32, step } } else { CaptureRows::ALL },
            });
        }
        if groups.len() >= LightGroups::MAX {
            let problem = format!("there are {} sets of lights with different factors", groups.len());
            return Err(Error::setting("capture", problem, format!("use at most {}", LightGroups::MAX - 1)));
        }
        settings.run.light_groups = groups.into_values().collect();
        settings.run.captures.iter().try_for_each(|capture| validate(&settings.of_capture(capture)))?;
        Ok(settings)
    }
}

fn is_of(capture: &job::Capture, camera: Option<&str>) -> bool {
    capture.camera.as_deref().is_none_or(|own| Some(own) == camera)
}
