//! Exposure of a merged render: the settings that a merge needs beside the sums. With them it needs neither scene nor
//! job.

use crate::error::Error;
use crate::settings::{RenderSettings, SensorChoice};
use dunkelfeld_film::NO_ID;
use dunkelfeld_film::Plane;
use dunkelfeld_integrator::Label;
use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Seconds};
use dunkelfeld_scene::Effect;
use dunkelfeld_sensor::{
    BayerPattern, ColorFilter, DarkCurrent, Defects, Efficiency, Exposure, ExposureNoise, FixedPattern, Optics,
    Published, QuantumEfficiency, SensorModel, SensorSpec,
};
use serde::{Deserialize, Serialize};

/// The settings on which no sample depends, but on which the outputs depend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ExposureRecipe {
    seed: u64,
    frame: u32,
    sensor: Option<StoredSensor>,
    is_matched: bool,
    without: Vec<String>,
    /// Does the lens darken the image towards its corners?
    pub(crate) is_vignetted: bool,
    pub(crate) object_names: Vec<String>,
    /// Does a given plan determine the samples?
    pub(crate) is_replay: bool,
}

/// A sensor, its lens and its exposure, as stored values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredSensor {
    name: String,
    source: String,
    derived: Vec<String>,
    assumed: Vec<String>,
    pixel_pitch: f64,
    /// One curve, or those of red, green and blue.
    quantum_efficiency: Vec<Vec<[f64; 2]>>,
    /// Pattern and white balance of a colour sensor.
    color_filter: Option<(String, bool)>,
    full_well: f64,
    dark_noise: f64,
    row_noise: f64,
    dark_current: [f64; 3],
    temperature: f64,
    system_gain: f64,
    offset: f64,
    bit_depth: u32,
    /// Total, rows, columns.
    dsnu: [f64; 3],
    prnu: [f64; 3],
    /// Hot, factor, dead.
    defects: [f64; 3],
    published: [Option<f64>; 11],
    f_number: f64,
    transmission: f64,
    magnification: f64,
    /// Exposure time \[s\]; `None` for the automatic exposure.
    exposure: Option<f64>,
}

impl ExposureRecipe {
    pub(crate) fn new(settings: &RenderSettings, is_vignetted: bool, object_names: &[String]) -> Self {
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
            is_vignetted,
            object_names: object_names.to_vec(),
            is_replay: settings.replay.is_some(),
        }
    }

    /// Settings that expose a film of that size as the render would have.
    ///
    /// # Errors
    /// A sensor whose stored values are out of range.
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

    /// The first difference, as a phrase; `None` if there is none.
    pub(crate) fn difference(&self, other: &Self) -> Option<&'static str> {
        [
            (self.sensor != other.sensor, "sensor, lens or exposure"),
            (self.is_matched != other.is_matched, "exposure noise"),
            (self.is_vignetted != other.is_vignetted, "vignetting"),
            (self != other, "names of objects, or choice of effects left out"),
        ]
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
    }
}

impl StoredSensor {
    fn new(spec: &SensorSpec, optics: &Optics, exposure: Option<Exposure>) -> Self {
        // No `..`: each new field of a sensor must be added here.
        let SensorSpec {
            name,
            source,
            derived,
            assumed,
            pixel_pitch,
            quantum_efficiency,
            full_well,
            dark_noise,
            row_noise,
            dark_current: DarkCurrent { rate, reference, doubling },
            temperature,
            system_gain,
            offset,
            bit_depth,
            fixed_pattern: FixedPattern { dsnu, dsnu_row, dsnu_column, prnu, prnu_row, prnu_column },
            defects: Defects { hot, hot_factor, dead },
            published,
        } = spec.clone();
        let points = |curve: &QuantumEfficiency| curve.points().iter().map(|&(nm, eta)| [nm.0, eta]).collect();
        Self {
            name,
            source,
            derived,
            assumed,
            pixel_pitch: pixel_pitch.0,
            quantum_efficiency: quantum_efficiency.curves().iter().map(points).collect(),
            color_filter: quantum_efficiency.filter().map(|f| (f.pattern.name().into(), f.white_balance)),
            full_well: full_well.0,
            dark_noise: dark_noise.0,
            row_noise: row_noise.0,
            dark_current: [rate, reference.0, doubling],
            temperature: temperature.0,
            system_gain,
            offset: offset.0,
            bit_depth,
            dsnu: [dsnu.0, dsnu_row.0, dsnu_column.0],
            prnu: [prnu, prnu_row, prnu_column],
            defects: [hot, hot_factor, dead],
            published: published.figures().map(|(_, figure)| figure),
            f_number: optics.f_number(),
            transmission: optics.transmission(),
            magnification: optics.magnification(),
            exposure: exposure.map(|e| e.time().0),
        }
    }

    fn efficiency(&self) -> Result<Efficiency, Error> {
        let curve = |points: &Vec<[f64; 2]>| {
            QuantumEfficiency::new(points.iter().map(|&[nm, eta]| (Nanometres(nm), eta)).collect())
        };
        let curves = self.quantum_efficiency.iter().map(curve).collect::<Result<Vec<_>, _>>()?;
        let damaged = || Error::setting("checkpoint", "its sensor cannot be read", "render it anew");
        let Some((name, white_balance)) = &self.color_filter else {
            return curves.into_iter().next().map(Efficiency::Mono).ok_or_else(damaged);
        };
        let pattern = BayerPattern::ALL.into_iter().find(|p| p.name() == name).ok_or_else(damaged)?;
        let curves = curves.try_into().map_err(|_| damaged())?;
        Ok(Efficiency::Mosaic(ColorFilter { pattern, curves, white_balance: *white_balance }))
    }

    fn choice(&self) -> Result<SensorChoice, Error> {
        let s = self.clone();
        let [dsnu, dsnu_row, dsnu_column] = s.dsnu.map(Electrons);
        let [prnu, prnu_row, prnu_column] = s.prnu;
        let [hot, hot_factor, dead] = s.defects;
        let quantum_efficiency = self.efficiency()?;
        let [rate, reference, doubling] = s.dark_current;
        let spec = SensorSpec {
            name: s.name,
            source: s.source,
            derived: s.derived,
            assumed: s.assumed,
            pixel_pitch: Metres(s.pixel_pitch),
            quantum_efficiency,
            full_well: Electrons(s.full_well),
            dark_noise: Electrons(s.dark_noise),
            row_noise: Electrons(s.row_noise),
            dark_current: DarkCurrent { rate, reference: Celsius(reference), doubling },
            temperature: Celsius(s.temperature),
            system_gain: s.system_gain,
            offset: DigitalNumber(s.offset),
            bit_depth: s.bit_depth,
            fixed_pattern: FixedPattern { dsnu, dsnu_row, dsnu_column, prnu, prnu_row, prnu_column },
            defects: Defects { hot, hot_factor, dead },
            published: Published::from_figures(s.published),
        };
        Ok(SensorChoice::Emva {
            model: Box::new(SensorModel::new(spec)?),
            optics: Optics::new(s.f_number, s.transmission, s.magnification)?,
            exposure: s.exposure.map(|t| Exposure::new(Seconds(t))).transpose()?,
        })
    }
}

/// Pixel ids as two planes of numbers: objects and materials, [`NO_ID`] where no surface is hit.
pub(crate) fn numbers_of(labels: &Plane<Option<Label>>) -> [Plane<u32>; 2] {
    [labels.map(|l| l.map_or(NO_ID, |l| l.object())), labels.map(|l| l.map_or(NO_ID, |l| l.material()))]
}

/// The pixel ids that the numbers represent; both planes have one size.
pub(crate) fn labels_of(objects: &Plane<u32>, materials: &Plane<u32>) -> Plane<Option<Label>> {
    Plane::from_fn(objects.width(), objects.height(), |x, y| {
        let (object, material) = (*objects.at(x, y), *materials.at(x, y));
        (object != NO_ID).then(|| Label::new(object, material))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_io::sensor_file::find_sensor;

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
    fn every_sensor_comes_back_to_the_last_bit_through_the_text_of_a_checkpoint() {
        let text = dunkelfeld_io::toml_file::TomlFile::from_text("colour.toml", COLOUR);
        let colour = dunkelfeld_io::sensor_file::parse_sensor(&text).expect("valid");
        let presets = dunkelfeld_io::sensor_file::preset_names().map(|name| find_sensor(name).expect("a preset"));
        for model in presets.chain([colour]) {
            let optics = Optics::new(2.8, 0.1 + 0.2, 1.0 / 3.0).expect("in range");
            let exposure = Some(Exposure::new(Seconds(0.1 / 7.0)).expect("in range"));
            let sensor = SensorChoice::Emva { model: Box::new(model), optics, exposure };
            let settings = RenderSettings { sensor, seed: u64::MAX, frame: 3, ..RenderSettings::default() };
            let text = serde_json::to_string(&ExposureRecipe::new(&settings, true, &["a".into()])).expect("plain data");
            let look: ExposureRecipe = serde_json::from_str(&text).expect("what was written");
            let back = look.settings(settings.width, settings.height).expect("a sensor");
            assert_eq!(format!("{back:?}"), format!("{settings:?}"));
        }
    }

    #[test]
    fn labels_come_back() {
        let labels = Plane::from_fn(3, 2, |x, y| (x != y).then(|| Label::new(x, 7 * y)));
        let [objects, materials] = numbers_of(&labels);
        assert_eq!(labels_of(&objects, &materials), labels);
    }
}
