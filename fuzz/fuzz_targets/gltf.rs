//! Any bytes as a glTF file, binary or JSON: read and built, or refused, never a panic, a hang, or much memory.
#![no_main]

use dunkelfeld_fuzz::{Scratch, build, options, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    let path = SCRATCH.write("scene.glb", data);
    match dunkelfeld_io::gltf::load_gltf(&path, &options()) {
        Ok(imported) => build(imported),
        Err(e) => drop((e.to_string(), e.caret())),
    }
});
