//! Refusals of jobs as a reader sees them. `refusals.txt` has keys of a job, and under them the message, each line of which
//! begins with `>`. After an intended change of messages, `UPDATE_REFUSALS=1 cargo test -p dunkelfeld-io --test it refusals::`
//! writes the file again.
#![allow(clippy::expect_used, clippy::unwrap_used)]

use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_io::job::Job;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::cuboid;
use dunkelfeld_scene::{Material, PunctualKind, PunctualLight, SceneBuilder};

/// A box "part" below a camera "above", a box "glow" that emits, and a light of each kind without extent.
fn scene() -> SceneBuilder {
    let mut scene = SceneBuilder::default();
    let paint = scene.add_material(Material { name: "paint".into(), ..Material::default() });
    scene.add_object("part", cuboid(Vec3::splat(-0.01), Vec3::splat(0.01)), paint);
    let glow = scene.add_material(Material { name: "glow".into(), emission: Rgb::WHITE.into(), ..Material::default() });
    scene.add_object("glow", cuboid(Vec3::splat(1.0), Vec3::splat(1.1)), glow);
    scene.add_camera("above", DVec3::new(0.0, 0.5, 0.0), DVec3::ZERO, 0.3);
    for (name, kind) in [
        ("bulb", PunctualKind::Point { intensity: Rgb::WHITE }),
        ("cone", PunctualKind::Spot { intensity: Rgb::WHITE, inner: 0.4, outer: 0.5 }),
        ("window", PunctualKind::Directional { irradiance: Rgb::WHITE }),
    ] {
        scene.lights.push(PunctualLight { name: name.into(), to_world: DAffine3::IDENTITY, kind });
    }
    scene
}

/// The message for a job with these keys, as lines that begin with `>`.
fn refusal(keys: &str) -> String {
    let scene_key = if keys.starts_with("scene") { "" } else { "scene = \"a.glb\"\n" };
    let applied = Job::from_text("job.toml", format!("{scene_key}{keys}\n")).and_then(|job| {
        let mut scene = scene();
        job.apply_overrides(&mut scene)?;
        job.camera_index(&scene)?;
        job.shutter(&scene, 8)?;
        job.bands()
    });
    match applied {
        Ok(_) => "> no refusal\n".into(),
        Err(error) => error
            .to_string()
            .lines()
            .chain(error.caret().lines().skip(1))
            .fold(String::new(), |all, line| format!("{all}> {}\n", line.trim_end())),
    }
}

#[test]
fn refusals_are_as_they_are_written_down() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/refusals.txt");
    let written = std::fs::read_to_string(path).expect("the list of refusals");
    let cases = written.split("\n\n").map(|case| {
        let keys: Vec<&str> = case.trim().lines().filter(|line| !line.starts_with('>')).collect();
        keys.join("\n")
    });
    let found: Vec<String> = cases.map(|keys| format!("{keys}\n{}", refusal(&keys))).collect();
    let found = found.join("\n");
    if std::env::var_os("UPDATE_REFUSALS").is_some() {
        std::fs::write(path, &found).expect("a file that can be written");
    } else {
        let written = written.replace("\r\n", "\n");
        let other = found.split("\n\n").zip(written.split("\n\n")).find(|(found, written)| found != written);
        assert!(found == written, "a refusal differs: found and written\n{other:#?}");
    }
}
