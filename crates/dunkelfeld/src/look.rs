//! How a part of a render is to be looked at once all parts are together: what a merge has to know beside the sums, so that it
//! needs neither scene nor job.

use crate::error::Error;
use crate::outputs::NO_ID;
use crate::settings::{RenderSettings, SensorChoice};
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::Label;
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Seconds};
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{
    DarkCurrent, Exposure, ExposureNoise, FixedPattern, Optics, Published, QuantumEfficiency, SensorModel, SensorSpec,
};
use serde::{Deserialize, Serialize};

/// The part of the settings that no sample depends on, but what is written does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Look {
    seed: u64,
    frame: u32,
    sensor: Option<StoredSensor>,
    is_matched: bool,
    without: Vec<String>,
    pub(crate) object_names: Vec<String>,
    /// Does a plan say which samples there are?
    pub(crate) is_replay: bool,
}

/// A sensor, its lens and its exposure, by their numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredSensor {
    name: String,
    source: String,
    derived: Vec<String>,
    assumed: Vec<String>,
    pixel_pitch: f64,
    quantum_efficiency: Vec<[f64; 2]>,
    full_well: f64,
    dark_noise: f64,
    dark_current: [f64; 3],
    temperature: f64,
    system_gain: f64,
    offset: f64,
    bit_depth: u32,
    dsnu: f64,
    prnu: f64,
    dynamic_range_db: Option<f64>,
    snr_max_db: Option<f64>,
    f_number: f64,
    transmission: f64,
    magnification: f64,
    /// Seconds; nothing for the automatic one.
    exposure: Option<f64>,
}

impl Look {
    pub(crate) fn new(settings: &RenderSettings, object_names: &[String]) -> Self {
        let sensor = match &settings.sensor {
            SensorChoice::None => None,
            SensorChoice::Emva { model, optics, exposure } => Some(StoredSensor::new(model.spec(), optics, *exposure)),
        };
        Self {
            seed: settings.seed,
            frame: settings.frame,
            sensor,
            is_matched: settings.exposure_noise == ExposureNoise::Matched,
            without: settings.without.iter().map(|e| e.name().to_string()).collect(),
            object_names: object_names.to_vec(),
            is_replay: settings.replay.is_some(),
        }
    }

    /// Settings that look at a film of that size as the render would have.
    ///
    /// # Errors
    /// A sensor whose numbers do not make sense.
    pub(crate) fn settings(&self, width: u32, height: u32) -> Result<RenderSettings, Error> {
        Ok(RenderSettings {
            width,
            height,
            seed: self.seed,
            frame: self.frame,
            sensor: self.sensor.as_ref().map_or(Ok(SensorChoice::None), StoredSensor::choice)?,
            exposure_noise: if self.is_matched { ExposureNoise::Matched } else { ExposureNoise::Plain },
            without: self
                .without
                .iter()
                .filter_map(|name| Effect::ALL.into_iter().find(|e| e.name() == name))
                .collect(),
            ..RenderSettings::default()
        })
    }

    /// The first thing that differs, in words.
    pub(crate) fn difference(&self, other: &Self) -> Option<&'static str> {
        [
            (self.sensor != other.sensor, "sensor, lens or exposure"),
            (self.is_matched != other.is_matched, "exposure noise"),
            (self != other, "names of objects, or choice of effects left out"),
        ]
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
    }
}

impl StoredSensor {
    fn new(spec: &SensorSpec, optics: &Optics, exposure: Option<Exposure>) -> Self {
        // No `..`: a new number of a sensor belongs in here.
        let SensorSpec {
            name,
            source,
            derived,
            assumed,
            pixel_pitch,
            quantum_efficiency,
            full_well,
            dark_noise,
            dark_current: DarkCurrent { rate, reference, doubling },
            temperature,
            system_gain,
            offset,
            bit_depth,
            fixed_pattern: FixedPattern { dsnu, prnu },
            published: Published { dynamic_range_db, snr_max_db },
        } = spec.clone();
        Self {
            name,
            source,
            derived,
            assumed,
            pixel_pitch: pixel_pitch.0,
            quantum_efficiency: quantum_efficiency.points().iter().map(|&(nm, eta)| [nm.0, eta]).collect(),
            full_well: full_well.0,
            dark_noise: dark_noise.0,
            dark_current: [rate, reference.0, doubling],
            temperature: temperature.0,
            system_gain,
            offset: offset.0,
            bit_depth,
            dsnu: dsnu.0,
            prnu,
            dynamic_range_db,
            snr_max_db,
            f_number: optics.f_number(),
            transmission: optics.transmission(),
            magnification: optics.magnification(),
            exposure: exposure.map(|e| e.time().0),
        }
    }

    fn choice(&self) -> Result<SensorChoice, Error> {
        let s = self.clone();
        let points = s.quantum_efficiency.into_iter().map(|[nm, eta]| (Nanometres(nm), eta)).collect();
        let [rate, reference, doubling] = s.dark_current;
        let spec = SensorSpec {
            name: s.name,
            source: s.source,
            derived: s.derived,
            assumed: s.assumed,
            pixel_pitch: Metres(s.pixel_pitch),
            quantum_efficiency: QuantumEfficiency::new(points)?,
            full_well: Electrons(s.full_well),
            dark_noise: Electrons(s.dark_noise),
            dark_current: DarkCurrent { rate, reference: Celsius(reference), doubling },
            temperature: Celsius(s.temperature),
            system_gain: s.system_gain,
            offset: DigitalNumber(s.offset),
            bit_depth: s.bit_depth,
            fixed_pattern: FixedPattern { dsnu: Electrons(s.dsnu), prnu: s.prnu },
            published: Published { dynamic_range_db: s.dynamic_range_db, snr_max_db: s.snr_max_db },
        };
        Ok(SensorChoice::Emva {
            model: Box::new(SensorModel::new(spec)?),
            optics: Optics::new(s.f_number, s.transmission, s.magnification)?,
            exposure: s.exposure.map(|t| Exposure::new(Seconds(t))).transpose()?,
        })
    }
}

/// Labels as two planes of numbers: objects and materials, [`NO_ID`] where there is nothing.
pub(crate) fn numbers_of(labels: &Plane<Option<Label>>) -> [Plane<u32>; 2] {
    [labels.map(|l| l.map_or(NO_ID, |l| l.object)), labels.map(|l| l.map_or(NO_ID, |l| l.material))]
}

/// The labels that the numbers stand for; planes of one size.
pub(crate) fn labels_of(objects: &Plane<u32>, materials: &Plane<u32>) -> Plane<Option<Label>> {
    Plane::from_fn(objects.width(), objects.height(), |x, y| {
        let (object, material) = (*objects.at(x, y), *materials.at(x, y));
        (object != NO_ID).then_some(Label { object, material })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_comes_back_to_the_last_bit_through_the_text_of_a_checkpoint() {
        for name in dunkelfeld_io::sensor_file::preset_names() {
            let model = Box::new(dunkelfeld_io::sensor_file::preset(name).expect("a preset"));
            let optics = Optics::new(2.8, 0.1 + 0.2, 1.0 / 3.0).expect("in range");
            let exposure = Some(Exposure::new(Seconds(0.1 / 7.0)).expect("in range"));
            let sensor = SensorChoice::Emva { model, optics, exposure };
            let settings = RenderSettings { sensor, seed: u64::MAX, frame: 3, ..RenderSettings::default() };
            let text = serde_json::to_string(&Look::new(&settings, &["a".into()])).expect("plain data");
            let look: Look = serde_json::from_str(&text).expect("what was written");
            let back = look.settings(settings.width, settings.height).expect("a sensor");
            assert_eq!(format!("{back:?}"), format!("{settings:?}"));
        }
    }

    #[test]
    fn labels_come_back() {
        let labels = Plane::from_fn(3, 2, |x, y| (x != y).then_some(Label { object: x, material: 7 * y }));
        let [objects, materials] = numbers_of(&labels);
        assert_eq!(labels_of(&objects, &materials), labels);
    }
}
