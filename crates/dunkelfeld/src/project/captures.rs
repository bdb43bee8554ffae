//! Captures: images of one render, each with factors on lights and its own exposure.

use super::Project;
use super::open::seconds_of;
use dunkelfeld_render::{Capture, Error, RenderSettings, SensorChoice, validate};
use dunkelfeld_scene::LightGroups;
use std::collections::BTreeMap;

impl Project {
    /// Names of the captures of the job, in its order.
    pub fn capture_names(&self) -> Vec<String> {
        self.job.captures.iter().map(|capture| capture.name.clone()).collect()
    }

    /// Settings of a render for the captures of the job: lights with the same factors in all captures are one group.
    ///
    /// # Errors
    /// A name that no light has; an exposure of its own where the samples are those of one exposure.
    pub(crate) fn captured(&self, mut settings: RenderSettings) -> Result<RenderSettings, Error> {
        let lights = self.scene.light_names();
        let factors = self.job.capture_factors(&lights)?;
        let mut groups: BTreeMap<Vec<u64>, Vec<String>> = BTreeMap::new();
        for (light, name) in lights.iter().enumerate() {
            let of_light: Vec<u64> = factors.iter().map(|of_capture| of_capture[light].to_bits()).collect();
            if of_light.iter().any(|bits| f64::from_bits(*bits) > 0.0) {
                groups.entry(of_light).or_default().push(name.clone());
            }
        }
        let own = match &settings.sensor {
            SensorChoice::Emva { exposure, .. } => *exposure,
            SensorChoice::None => None,
        };
        for (number, capture) in self.job.captures.iter().enumerate() {
            if let (Some(timed), Some(_)) = (self.timed_exposure(), capture.exposure) {
                let problem = format!("{} for one exposure, and a capture has another", timed.reason);
                return Err(Error::setting("capture", problem, "remove `exposure` in [[capture]]"));
            }
            settings.run.captures.push(Capture {
                name: capture.name.clone(),
                factors: groups.keys().map(|of_light| f64::from_bits(of_light[number])).collect(),
                exposure: capture.exposure.map_or(Ok(own), seconds_of)?,
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
