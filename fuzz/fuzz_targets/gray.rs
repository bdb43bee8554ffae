//! Any bytes as a frame of grey values: PNG, TIFF or BMP, within the limits; and as a map of the pixels of a sensor.
#![no_main]

use dunkelfeld_fuzz::{Scratch, options, target};
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::tiff::read_map;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    let path = SCRATCH.write("frame.png", data);
    match read_map(&path, &mut InputFiles::new()) {
        Ok(map) => assert!(map.values().data().iter().all(|v| v.is_finite())),
        Err(e) => drop((e.to_string(), e.caret())),
    }
    match read_gray(&path, &options().limits) {
        Ok(frame) => {
            assert!(frame.stored_bits == 8 || frame.stored_bits == 16);
            assert!(frame.stored_bits == 16 || frame.values.data().iter().all(|v| *v < 256));
        }
        Err(e) => drop((e.to_string(), e.caret())),
    }
});
