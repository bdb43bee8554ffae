//! Motion blur and a line scan of one moving part: a frame camera exposes it at once, and a line-scan camera row by row.
//! Run: `cargo run --release --example motion -- [FRAME.png] [SCAN.png]`.

use dunkelfeld::geometry::{DVec3, RigidMotion, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{
    Camera, Environment, EnvironmentSource, LineScan, Material, Projection, SceneBuilder, Shutter, look_at, shapes,
};
use dunkelfeld::{Budget, SensorChoice, Session, default_settings, develop_film, render, save_picture};

/// Film: 256 x 256 pixels of 0.1 mm on the object.
const SIZE: u32 = 256;
const PIXEL: f64 = 1e-4;
/// Speed of the part \[m/s\].
const SPEED: f64 = 0.5;

fn main() -> Result<(), dunkelfeld::Error> {
    let mut arguments = std::env::args().skip(1);
    let frame = arguments.next().unwrap_or_else(|| "motion-frame.png".into());
    let scan = arguments.next().unwrap_or_else(|| "motion-scan.png".into());
    // The exposure of the frame blurs the part by 20 pixels.
    save(Shutter::Frame { exposure: 20.0 * PIXEL / SPEED }, &frame)?;
    // In a line period the part moves by one pixel. Four stages collect the light of four lines.
    let period = PIXEL / SPEED;
    let lines = LineScan { period, exposure: 0.5 * period, stages: 4, jitter: 0.0, line: 0.5, rows: SIZE, in_turn: 1 };
    save(Shutter::Lines(lines), &scan)
}

/// Renders the part with a shutter, and writes the image.
fn save(shutter: Shutter, path: &str) -> Result<(), dunkelfeld::Error> {
    let mut builder = SceneBuilder::default();
    let grey = builder.add_material(Material {
        base_color: Rgb::splat(0.5).into(),
        roughness: 0.4.into(),
        ..Material::default()
    });
    let dark = builder.add_material(Material { base_color: Rgb::splat(0.05).into(), ..Material::default() });
    builder.add_object("belt", shapes::rectangle(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), dark);
    for i in 0..5 {
        let low = Vec3::new(-0.01 + 0.004 * i as f32, -0.008 + 0.003 * i as f32, 0.0001);
        let part = builder.add_object("part", shapes::cuboid(low, low + Vec3::new(0.002, 0.004, 0.001)), grey);
        builder.instances[part].motion = RigidMotion::linear(DVec3::new(0.0, SPEED, 0.0));
    }
    builder.shutter = Some(shutter);
    builder.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(0.8)), rotation: 0.0 });
    let half = (0.5 * f64::from(SIZE) * PIXEL) as f32;
    builder.cameras.push(Camera {
        name: "above".into(),
        to_world: look_at(DVec3::Z * 0.1, DVec3::ZERO, DVec3::Y),
        projection: Projection::Orthographic { half_width: half, half_height: half },
        ..Camera::default()
    });
    let (scene, _) = builder.build()?;
    let settings = default_settings()
        .with_width(SIZE)
        .with_height(SIZE)
        .with_sensor(SensorChoice::None)
        .with_budget(Budget::default().with_spp(64.0));
    let session = Session::new(settings.run.threads)?;
    let rendering = render(&scene, &settings, &session)?;
    let frame = session.install(|| develop_film(&rendering.film, &settings))?;
    save_picture(&frame, path.as_ref())
}
