//! The same stages one by one: a scene built in code, a progress callback, a switch to cancel, and every result in hand.
//! Run: `cargo run --release --example unrolled -- [OUT.png]`.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example talks to its reader")]

use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Material, SceneBuilder, Surface, Volume, shapes};
use dunkelfeld::sensor::Optics;
use dunkelfeld::{
    Budget, Cancel, Progress, ProgressState, SensorChoice, Session, default_settings, develop_film, render,
};
use std::time::Instant;

/// Prints each tenth of the way.
struct Tenths(std::sync::atomic::AtomicU32);

impl Progress for Tenths {
    fn update(&self, s: &ProgressState) {
        let tenth = (s.fraction * 10.0) as u32;
        if self.0.fetch_max(tenth, std::sync::atomic::Ordering::Relaxed) < tenth {
            eprintln!("{:>7}: {} % after {:.1} s", s.stage.name(), 10 * tenth, s.elapsed);
        }
    }
}

fn main() -> Result<(), dunkelfeld::Error> {
    let started = Instant::now();
    let output = std::env::args().nth(1).unwrap_or_else(|| "unrolled.png".into());

    // A scene: a glass ball and a brass box on a dark table, one ring-like pair of lights at grazing angles.
    let mut builder = SceneBuilder::default();
    let table = builder.add_material(Material {
        base_color: Rgb::splat(0.03).into(),
        roughness: 0.35.into(),
        ..Material::default()
    });
    let brass = builder.add_material(Material {
        base_color: Rgb::new(0.89, 0.69, 0.35).into(),
        metallic: 1.0.into(),
        roughness: 0.25.into(),
        ..Material::default()
    });
    let glass = builder.add_material(Material {
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        ior: 1.49,
        surface: Surface::Solid(Volume {
            attenuation_color: Rgb::new(0.9, 0.95, 0.92),
            attenuation_distance: 0.05,
            ..Volume::default()
        }),
        ..Material::default()
    });
    let lamp = builder.add_material(Material {
        base_color: Rgb::BLACK.into(),
        emission: Rgb::splat(40.0).into(),
        ..Material::default()
    });
    builder.add_object("table", shapes::rectangle(Vec3::new(-0.5, 0.0, 0.5), Vec3::X, Vec3::NEG_Z), table);
    builder.add_object("box", shapes::cuboid(Vec3::new(-0.08, 0.0001, -0.03), Vec3::new(-0.02, 0.05, 0.03)), brass);
    builder.add_object("ball", shapes::sphere(Vec3::new(0.04, 0.0301, 0.01), 0.03, 48, true), glass);
    for side in [-1.0f32, 1.0] {
        let corner = Vec3::new(0.3 * side, 0.05, 0.1 * side);
        builder.add_object("lamp", shapes::rectangle(corner, Vec3::NEG_Z * (0.2 * side), Vec3::Y * 0.06), lamp);
    }
    builder.add_camera("camera", DVec3::new(0.0, 0.22, 0.3), DVec3::new(0.0, 0.02, 0.0), 0.5);

    // Building checks it, and returns its findings.
    let (scene, report) = builder.build()?;
    for finding in &report.findings {
        println!("{:?}: {}: {}", finding.severity, finding.place, finding.message);
    }

    // Two seconds; samples go to the pixels in which a real sensor behind an f/8 lens does not hide the noise.
    let sensor = dunkelfeld_io::sensor_file::preset("imx250")?;
    let settings = default_settings()
        .with_width(256)
        .with_height(256)
        .with_budget(Budget::default().with_seconds(2.0))
        .with_sensor(SensorChoice::Emva {
            model: Box::new(sensor),
            optics: Optics::new(8.0, 0.9, 0.0)?,
            exposure: None,
        });

    // The switch could be thrown from any thread: a signal handler, a user interface.
    let cancel = Cancel::new();
    let progress = Tenths(0.into());
    let session = Session::new(settings.run.threads)?.with_start(started).with_progress(&progress).with_cancel(&cancel);
    let rendering = render(&scene, &settings, &session)?;
    println!(
        "{} samples, {} of them invalid",
        rendering.film.sums.total_samples(),
        rendering.film.sums.invalid_samples()
    );

    // The film holds exact sums; what the sensor makes of them is another step.
    let frame = session.install(|| develop_film(&rendering.film, &settings))?;
    if let Some(sensor) = &frame.sensor {
        let brightest = sensor.electrons.data().iter().copied().fold(0.0, f32::max);
        println!(
            "exposed for {:.3} ms; the brightest pixel expects {brightest:.0} electrons",
            sensor.exposure.time().0 * 1e3
        );
    }
    dunkelfeld::save_picture(&frame, output.as_ref())
}
