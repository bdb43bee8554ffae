//! Any bytes as a frame of grey values: PNG, TIFF or BMP, within the limits.
#![no_main]

use dunkelfeld_fuzz::{Scratch, options, target};
use dunkelfeld_io::gray::read_gray;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    match read_gray(&SCRATCH.write("frame.png", data), &options().limits) {
        Ok(frame) => {
            assert!(frame.stored_bits == 8 || frame.stored_bits == 16);
            assert!(frame.stored_bits == 16 || frame.values.data().iter().all(|v| *v < 256));
        }
        Err(e) => drop((e.to_string(), e.caret())),
    }
});
