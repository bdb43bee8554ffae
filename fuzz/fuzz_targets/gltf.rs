//! Any bytes as a glTF file, binary or JSON: read or refused, never a panic, a hang, or much memory.
#![no_main]

use dunkelfeld_fuzz::{Scratch, options};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(|data: &[u8]| {
    let path = SCRATCH.write("scene.glb", data);
    let _ = dunkelfeld_io::gltf::load_gltf(&path, &options());
});
