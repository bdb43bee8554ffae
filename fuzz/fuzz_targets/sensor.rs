//! Any bytes as a sensor file; one that can be read has figures that are numbers, and every refusal can show its line.
#![no_main]

use dunkelfeld_fuzz::Scratch;
use dunkelfeld_io::sensor_file::load_sensor;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(|data: &[u8]| {
    match load_sensor(&SCRATCH.write("sensor.toml", data)) {
        Ok(model) => {
            let sheet = dunkelfeld_sensor::data_sheet(&model);
            assert!(sheet.dynamic_range_db.is_finite() && sheet.snr_max_db.is_finite(), "{sheet:?}");
        }
        Err(e) => {
            let _ = (e.to_string(), e.caret());
        }
    }
});
