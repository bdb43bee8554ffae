//! Hazards of a sensor in the light of a scene.

use dunkelfeld_radiometry::Number;
use dunkelfeld_render::SensorChoice;
use dunkelfeld_scene::{Finding, Severity};
use dunkelfeld_sensor::{BANDS, Bands};

/// A curve counts as known up to this distance below its first point \[nm\].
const BELOW_FIRST: f64 = 150.0;

/// A lower transmission of the filter of the lens blocks a lamp.
const BLOCKED: f64 = 1e-3;

/// Reports lamps whose light the filter of the lens blocks, and wavelengths of lamps beyond the curve of the quantum efficiency, which is constant there.
pub(crate) fn sensor_hazards(sensor: &SensorChoice, bands: &Bands) -> Vec<Finding> {
    let SensorChoice::Emva { model, .. } = sensor else { return Vec::new() };
    let curves = model.spec().quantum_efficiency.curves();
    let ends = curves.iter().filter_map(|curve| Some((curve.points().first()?.0.0, curve.points().last()?.0.0)));
    let Some((first, last)) = ends.reduce(|a, b| (a.0.max(b.0), a.1.min(b.1))) else { return Vec::new() };
    let channels = bands.wavelengths.iter().zip(BANDS).zip(&bands.transmission);
    let of_lamps =
        channels.map(|((used, default), t)| (used, default, t)).filter(|(used, default, _)| **used != *default);
    let hazard = |message: String| Finding {
        severity: Severity::Hazard,
        place: format!("sensor {:?}", model.spec().name),
        message,
    };
    let beyond = of_lamps.clone().filter(|(used, ..)| used.0 > last || used.0 < first - BELOW_FIRST);
    let beyond = beyond.map(|(used, ..)| {
        let [used, first, last] = [used.0, first, last].map(Number);
        hazard(format!(
            "light of {used} nm counts with the quantum efficiency at the end of the curve, which goes from {first} nm to \
             {last} nm; add points to quantum_efficiency in a sensor file"
        ))
    });
    let blocked = of_lamps.filter(|(.., transmission)| **transmission < BLOCKED).map(|(used, ..)| {
        let used = Number(used.0);
        hazard(format!(
            "the filter of the lens blocks light of {used} nm; change `filter` of the lens or `wavelength` of the lamp"
        ))
    });
    beyond.chain(blocked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_radiometry::Nanometres;
    use dunkelfeld_sensor::{Optics, QuantumEfficiency, SensorModel};

    fn hazards(points: &[(f64, f64)], red: f64) -> usize {
        let mut spec = dunkelfeld_io::sensor_file::preset("imx250").expect("a preset").spec().clone();
        let points = points.iter().map(|(nm, eta)| (Nanometres(*nm), *eta)).collect();
        spec.quantum_efficiency = QuantumEfficiency::new(points).expect("a curve").into();
        let model = Box::new(SensorModel::new(spec).expect("a sensor"));
        let optics = Optics::new(4.0, 0.9, 0.0).expect("a lens");
        let bands = Bands { wavelengths: [Nanometres(red), BANDS[1], BANDS[2]], ..Bands::default() };
        sensor_hazards(&SensorChoice::Emva { model, optics, exposure: None }, &bands).len()
    }

    #[test]
    fn a_filter_that_blocks_a_lamp_is_reported() {
        let model = Box::new(dunkelfeld_io::sensor_file::preset("imx250").expect("a preset"));
        let optics = Optics::new(4.0, 0.9, 0.0).expect("a lens");
        let lamp = Bands { wavelengths: [Nanometres(625.0), BANDS[1], BANDS[2]], ..Bands::default() };
        let sensor = SensorChoice::Emva { model, optics, exposure: None };
        let count = |center| sensor_hazards(&sensor, &lamp.through(center, 40.0, 0.9, [true, false, false])).len();
        assert_eq!((count(625.0), count(850.0)), (0, 1));
    }

    /// Silicon absorbs little infrared light. Up to 610 nm the presets have one value, as their sources.
    #[test]
    fn monochrome_presets_detect_less_infrared_light() {
        for (name, _) in dunkelfeld_sensor::PRESETS {
            let model = dunkelfeld_io::sensor_file::preset(name).expect("a preset");
            if model.spec().quantum_efficiency.filter().is_some() {
                continue;
            }
            let curve = &model.spec().quantum_efficiency.curves()[0];
            let relative = |nm: f64| curve.at(Nanometres(nm)) / curve.peak().1;
            assert!(BANDS.iter().all(|nm| relative(nm.0) == 1.0), "{name}");
            assert!((0.2..0.3).contains(&relative(850.0)) && relative(1100.0) < 0.005, "{name}");
        }
    }

    #[test]
    fn lamps_beyond_the_curve_are_reported() {
        assert_eq!(hazards(&[(545.0, 0.7)], 850.0), 1);
        assert_eq!(hazards(&[(545.0, 0.7)], BANDS[0].0), 0, "white light");
        assert_eq!(hazards(&[(400.0, 0.5), (1000.0, 0.1)], 850.0), 0);
        assert_eq!(hazards(&[(400.0, 0.5), (1000.0, 0.1)], 200.0), 1);
    }
}
