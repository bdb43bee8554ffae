//! Any bytes as an OBJ file; those after the first zero byte are the material library `scene.mtl` beside it.
#![no_main]

use dunkelfeld_fuzz::{Scratch, build, options, target};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    let (obj, rest) = data.split_at(end);
    SCRATCH.write("scene.mtl", rest.get(1..).unwrap_or_default());
    let path = SCRATCH.write("scene.obj", obj);
    match dunkelfeld_io::obj::load_obj(&path, &options()) {
        Ok(imported) => build(imported),
        Err(e) => drop((e.to_string(), e.caret())),
    }
});
