//! Exposure of a merged render: the settings that a merge needs beside the sums. With them it needs neither scene nor
//! job.

use crate::settings::{RenderSettings, RunSettings, SensorChoice};
use dunkelfeld_film::NO_ID;
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{ExposureNoise, Readout};
use serde::{Deserialize, Serialize};

/// The settings on which no sample depends, but on which the outputs depend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ExposureRecipe {
    seed: u64,
    frame: u32,
    sensor: SensorChoice,
    #[serde(default)]
    readout: Readout,
    #[serde(default)]
    is_timed: bool,
    exposure_noise: ExposureNoise,
    without: Vec<String>,
    /// Does the lens darken the image towards its corners?
    pub(crate) is_vignetted: bool,
    /// Are the samples of a pixel spread over its neighbours?
    pub(crate) is_spread: bool,
    pub(crate) object_names: Vec<String>,
    #[serde(default)]
    pub(crate) material_names: Vec<String>,
    #[serde(default)]
    pub(crate) training_paths: u32,
    /// Does a given plan determine the samples?
    pub(crate) is_replay: bool,
}

impl ExposureRecipe {
    /// The settings of a render, and the names of objects and materials.
    pub(crate) fn new(settings: &RenderSettings, [is_vignetted, is_spread]: [bool; 2], names: [&[String]; 2]) -> Self {
        Self {
            seed: settings.seed,
            frame: settings.frame,
            sensor: settings.sensor.clone(),
            readout: settings.readout,
            is_timed: settings.is_timed,
            exposure_noise: settings.exposure_noise,
            without: settings.run.without.iter().map(|e| e.name().to_string()).collect(),
            is_vignetted,
            is_spread,
            object_names: names[0].to_vec(),
            material_names: names[1].to_vec(),
            training_paths: settings.training_paths(),
            is_replay: settings.run.replay.is_some(),
        }
    }

    /// Settings that expose a film of that size as the render would have.
    pub(crate) fn settings(&self, width: u32, height: u32) -> RenderSettings {
        RenderSettings {
            width,
            height,
            seed: self.seed,
            frame: self.frame,
            sensor: self.sensor.clone(),
            readout: self.readout,
            is_timed: self.is_timed,
            exposure_noise: self.exposure_noise,
            run: RunSettings {
                training_paths: Some(self.training_paths),
                without: self
                    .without
                    .iter()
                    .filter_map(|name| Effect::ALL.into_iter().find(|e| e.name() == name))
                    .collect(),
                ..RunSettings::default()
            },
            ..RenderSettings::without_sensor()
        }
    }

    /// The first difference, as a phrase; `None` if there is none.
    pub(crate) fn difference(&self, other: &Self) -> Option<&'static str> {
        [
            ((&self.sensor, self.readout) != (&other.sensor, other.readout), "sensor, lens or exposure"),
            (self.exposure_noise != other.exposure_noise, "exposure noise"),
            (self.is_vignetted != other.is_vignetted, "vignetting"),
            (self != other, "names of objects or materials, or choice of effects left out"),
        ]
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
    }
}

/// Pixel ids as two planes of numbers: objects and materials, [`NO_ID`] where no surface is hit.
pub(crate) fn numbers_of(labels: &Plane<Option<PixelIds>>) -> [Plane<u32>; 2] {
    [labels.map(|l| l.map_or(NO_ID, |l| l.object())), labels.map(|l| l.map_or(NO_ID, |l| l.material()))]
}

/// The pixel ids that the numbers represent; both planes have one size.
pub(crate) fn labels_of(objects: &Plane<u32>, materials: &Plane<u32>) -> Plane<Option<PixelIds>> {
    Plane::from_fn(objects.width(), objects.height(), |x, y| {
        let (object, material) = (*objects.at(x, y), *materials.at(x, y));
        (object != NO_ID).then(|| PixelIds::new(object, material))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::sensor_file::find_sensor;
    use dunkelfeld_radiometry::Seconds;
    use dunkelfeld_sensor::{Exposure, Optics};

    /// A sensor with every value that a sensor can have.
    const COLOUR: &str = r#"
        name = "colour"
        source = "made up"
        bit_depth = 10
        pixel_pitch_um = 3.45
        full_well_e = 10000
        dark_noise_e = 4.1
        row_noise_e = 0.3
        gain_e_per_dn = 10.7
        offset_dn = 20
        dsnu_e = 1.1
        dsnu_row_e = 0.2
        dsnu_column_e = 0.3
        prnu_percent = 0.7
        prnu_row_percent = 0.1
        prnu_column_percent = 0.3
        [color_filter]
        pattern = "gbrg"
        red = [[610, 0.41]]
        green = [[530, 0.53], [600, 0.1]]
        blue = [[465, 0.47]]
        white_balance = false
        [dark_current]
        e_per_s = 3
        at_c = 35
        doubling_k = 7
        [defects]
        hot_per_million = 33
        hot_dark_current_factor = 77
        dead_per_million = 11
        [published]
        threshold_p = 8.1
        prnu_percent = 0.6
    "#;

    #[test]
    fn every_sensor_is_restored_bit_for_bit_from_a_checkpoint() {
        let text = dunkelfeld_io::toml_file::TomlFile::from_text("colour.toml", COLOUR);
        let colour = dunkelfeld_io::sensor_file::parse_sensor(&text).expect("valid");
        let presets = dunkelfeld_io::sensor_file::preset_names().map(|name| find_sensor(name).expect("a preset"));
        for model in presets.chain([colour]) {
            let optics = Optics::new(2.8, 0.1 + 0.2, 1.0 / 3.0).expect("in range");
            let exposure = Some(Exposure::new(Seconds(0.1 / 7.0)).expect("in range"));
            let sensor = SensorChoice::Emva { model: Box::new(model), optics, exposure };
            let (seed, frame, run) = (u64::MAX, 3, RunSettings::default().with_training_paths(768));
            let readout = Readout { binning: 2, line_scan_stages: 4 };
            let settings = RenderSettings { sensor, readout, seed, frame, run, ..RenderSettings::without_sensor() };
            let text = serde_json::to_string(&ExposureRecipe::new(&settings, [true, false], [&["a".into()], &[]]))
                .expect("plain data");
            let recipe: ExposureRecipe = serde_json::from_str(&text).expect("the text that was written");
            let back = recipe.settings(settings.width, settings.height);
            assert_eq!(format!("{back:?}"), format!("{settings:?}"));
        }
    }

    #[test]
    fn pixel_ids_are_restored() {
        let labels = Plane::from_fn(3, 2, |x, y| (x != y).then(|| PixelIds::new(x, 7 * y)));
        let [objects, materials] = numbers_of(&labels);
        assert_eq!(labels_of(&objects, &materials), labels);
    }
}
