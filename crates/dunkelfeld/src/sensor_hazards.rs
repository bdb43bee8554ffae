//! Hazards of a sensor in the light of a scene.

use dunkelfeld_radiometry::Number;
use dunkelfeld_render::SensorChoice;
use dunkelfeld_scene::{Finding, Severity};
use dunkelfeld_sensor::{BANDS, Bands};

/// A curve counts as known up to this distance below its first point \[nm\].
const BELOW_FIRST: f64 = 150.0;

/// Reports wavelengths of lamps beyond the curve of the quantum efficiency, which is constant there.
pub(crate) fn sensor_hazards(sensor: &SensorChoice, bands: &Bands) -> Vec<Finding> {
    let SensorChoice::Emva { model, .. } = sensor else { return Vec::new() };
    let curves = model.spec().quantum_efficiency.curves();
    let ends = curves.iter().filter_map(|curve| Some((curve.points().first()?.0.0, curve.points().last()?.0.0)));
    let Some((first, last)) = ends.reduce(|a, b| (a.0.max(b.0), a.1.min(b.1))) else { return Vec::new() };
    let of_lamps = bands.wavelengths.iter().zip(BANDS).filter(|(used, default)| **used != *default);
    let beyond = of_lamps.filter(|(used, _)| used.0 > last || used.0 < first - BELOW_FIRST);
    beyond
        .map(|(used, _)| Finding {
            severity: Severity::Hazard,
            place: format!("sensor {:?}", model.spec().name),
            message: format!(
                "light of {} nm counts with the quantum efficiency at the end of the curve, which goes from {} nm to {} nm; \
                 add points to quantum_efficiency in a sensor file",
                Number(used.0),
                Number(first),
                Number(last)
            ),
        })
        .collect()
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

    /// Silicon absorbs little infrared light. Up to 610 nm the presets have one value, as their sources.
    #[test]
    fn presets_detect_less_infrared_light() {
        for (name, _) in dunkelfeld_sensor::PRESETS {
            let model = dunkelfeld_io::sensor_file::preset(name).expect("a preset");
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
