//! Any bytes as an OBJ file; what follows the first zero byte is the material library `scene.mtl` beside it.
#![no_main]

use dunkelfeld_fuzz::{Scratch, options};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(|data: &[u8]| {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    let (obj, rest) = data.split_at(end);
    SCRATCH.write("scene.mtl", rest.get(1..).unwrap_or_default());
    let path = SCRATCH.write("scene.obj", obj);
    let _ = dunkelfeld_io::obj::load_obj(&path, &options());
});
