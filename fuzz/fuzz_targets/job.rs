//! Any bytes as a job; one that can be read changes a small scene, and every refusal can show its line.
#![no_main]

use dunkelfeld_fuzz::{Scratch, target};
use dunkelfeld_io::InputError;
use dunkelfeld_io::job::Job;
use dunkelfeld_scene::{Material, PunctualKind, PunctualLight, SceneBuilder, shapes};
use std::sync::LazyLock;

static SCRATCH: LazyLock<Scratch> = LazyLock::new(Scratch::new);

target!(|data| {
    if let Err(e) = change(data) {
        drop((e.to_string(), e.caret()));
    }
});

fn change(data: &[u8]) -> Result<(), InputError> {
    let job = Job::from_file(&SCRATCH.write("job.toml", data))?;
    let mut scene = scene();
    job.apply_overrides(&mut scene)?;
    job.apply_intrinsics(&mut scene, [64, 48]);
    job.camera_index(&scene)?;
    Ok(())
}

/// An object `o` of the material `m`, and a point light `p`.
fn scene() -> SceneBuilder {
    let mut scene = SceneBuilder::default();
    let material = scene.add_material(Material { name: "m".into(), ..Material::default() });
    scene.add_object("o", shapes::rectangle([0.0; 3].into(), [1.0, 0.0, 0.0].into(), [0.0, 1.0, 0.0].into()), material);
    scene.lights.push(PunctualLight {
        name: "p".into(),
        to_world: Default::default(),
        kind: PunctualKind::Point { intensity: Default::default() },
    });
    scene
}
