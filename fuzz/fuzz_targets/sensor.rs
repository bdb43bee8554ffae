//! Any bytes as a sensor file; one that can be read has figures that are numbers, and every refusal can show its line.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_io::sensor_file::load_sensor;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    match load_sensor(&SCRATCH.write("sensor.toml", data)) {
        Ok(model) => {
            let sheet = dunkelfeld_sensor::data_sheet(&model);
            assert!(sheet.dynamic_range_db.is_finite() && sheet.snr_max_db.is_finite(), "{sheet:?}");
        }
        Err(e) => {
            drop((e.to_string(), e.caret()));
        }
    }
});
