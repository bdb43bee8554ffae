//! The sensor of the tests of frames.

use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres};
use dunkelfeld_sensor::{DarkCurrent, Defects, FixedPattern, Published, QuantumEfficiency, SensorSpec};

/// Monochrome, 12 bits, 20 000 electrons at 0.25 DN each, without pattern and defects.
pub(crate) fn spec() -> SensorSpec {
    SensorSpec {
        name: "test".into(),
        source: "made up".into(),
        derived: vec![],
        assumed: vec![],
        pixel_pitch: Metres::from_micrometres(3.45),
        resolution: None,
        quantum_efficiency: QuantumEfficiency::new(vec![(Nanometres(530.0), 0.65)]).expect("a curve").into(),
        full_well: Electrons(20_000.0),
        dark_noise: Electrons(4.0),
        row_noise: Electrons(0.0),
        dark_current: DarkCurrent { rate: 100.0, reference: Celsius(25.0), doubling: 7.0 },
        temperature: Celsius(25.0),
        min_exposure: None,
        max_exposure: None,
        system_gain: 0.25,
        offset: DigitalNumber(40.0),
        bit_depth: 12,
        fixed_pattern: FixedPattern::default(),
        defects: Defects::default(),
        published: Published::default(),
    }
}
