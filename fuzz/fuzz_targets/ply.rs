//! Any bytes as a PLY file, text or binary: read and built, or refused, never a panic, a hang, or much memory.
#![no_main]

use dunkelfeld_fuzz::{Scratch, build, options, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    let path = SCRATCH.write("scene.ply", data);
    match dunkelfeld_io::import::load_scene(&path, &options()) {
        Ok(imported) => build(imported),
        Err(e) => drop((e.to_string(), e.caret())),
    }
});
