//! Helpers of the cross-crate tests: small scenes, and means with standard errors.

use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Camera, Material, Projection, Scene, SceneBuilder, Specular, look_at};
use dunkelfeld::{Budget, RenderSettings, Session, render};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_testkit::{Claim, SampleMoments};

/// False-alarm rate of one statistical check that is not a `Claim`. The suite makes fewer than 500 of them: 5e-7 in all.
pub(crate) const RATE: f64 = 1e-9;

/// A material that only emits, on its front, with the given radiance in every channel.
pub(crate) fn emitter(radiance: f32) -> Material {
    Material { name: "emitter".into(), emission: Rgb::splat(radiance).into(), ..black() }
}

/// A material that reflects nothing: no diffuse part, and no specular part either.
pub(crate) fn black() -> Material {
    Material { name: "black".into(), base_color: Rgb::BLACK.into(), specular: Specular::NONE, ..Material::default() }
}

/// A floor under a lamp with a post with a soft shadow: a wide range of light, and noise from the unknown visible part of the lamp.
pub(crate) fn shadow() -> Scene {
    let mut b = SceneBuilder::default();
    let floor = b.add_material(Material { base_color: Rgb::splat(0.5).into(), ..Material::default() });
    b.add_object("floor", square(0.0, 2.4, false), floor);
    b.add_object(
        "post",
        dunkelfeld::scene::shapes::cuboid(Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.1, 0.1, 0.5)),
        floor,
    );
    let lamp = b.add_material(emitter(24.0));
    b.add_object("lamp", square(1.2, 0.8, true), lamp);
    b.add_camera("camera", DVec3::new(1.1, -2.0, 1.1), DVec3::new(0.0, 0.0, 0.1), 0.7);
    build(b)
}

/// A square of side `side` around the origin's height `z`, facing +z (or -z if turned), in the xy plane.
pub(crate) fn square(z: f32, side: f32, turned: bool) -> dunkelfeld::geometry::Mesh {
    let (h, s) = (0.5 * side, side);
    if turned {
        dunkelfeld::scene::shapes::rectangle(Vec3::new(-h, h, z), Vec3::X * s, Vec3::NEG_Y * s)
    } else {
        dunkelfeld::scene::shapes::rectangle(Vec3::new(-h, -h, z), Vec3::X * s, Vec3::Y * s)
    }
}

/// Adds a camera with parallel rays that sees a spot of the given half-width around `target` from `eye`.
pub(crate) fn spot_camera(builder: &mut SceneBuilder, eye: DVec3, target: DVec3, half: f32) {
    builder.cameras.push(Camera {
        name: "spot".into(),
        to_world: look_at(eye, target, DVec3::new(0.1, 1.0, 0.2)),
        projection: Projection::Orthographic { half_width: half, half_height: half },
        ..Camera::default()
    });
}

/// Builds, and fails the test on an error.
pub(crate) fn build(builder: SceneBuilder) -> Scene {
    builder.build().expect("the scene is valid").0
}

/// Uniform settings without a sensor.
pub(crate) fn settings(width: u32, height: u32, spp: f64, seed: u64) -> RenderSettings {
    RenderSettings::without_sensor()
        .with_width(width)
        .with_height(height)
        .with_budget(Budget::default().with_spp(spp))
        .with_strategy(Strategy::Uniform)
        .with_seed(seed)
}

/// The film of a uniform render.
pub(crate) fn film(scene: &Scene, settings: &RenderSettings) -> Film {
    render(scene, settings, &Session::new(settings.run.threads).expect("threads"))
        .expect("the settings are valid")
        .film
        .sums
}

/// Moments of the pixel means of a film whose pixels all have the same expectation: green channel.
pub(crate) fn pixel_moments(film: &Film) -> SampleMoments {
    let mut moments = SampleMoments::default();
    for p in film.sums().data() {
        moments.push(p.mean()[1]);
    }
    moments
}

/// Renders 16 x 16 pixels that all show one radiance, and holds the mean of one channel to `expected`: four standard errors
/// and five millionths for the rounding of f32 along the path. No case may be noisier than a twentieth of its value.
#[track_caller]
pub(crate) fn must_be(scene: &Scene, spp: f64, seed: u64, channel: usize, expected: f64, what: &str) {
    let claim = Claim { expected, tolerance: 5e-6 * expected.abs(), sure: 0.05 * expected.abs() };
    claim.assert(what, |look| {
        let film = film(scene, &settings(16, 16, spp * f64::from(1 << (2 * look)), seed + 1000 * u64::from(look)));
        assert_eq!(film.invalid_samples(), 0, "{what}: samples that are not finite or negative");
        film.sums().data().iter().map(|p| p.mean()[channel]).collect::<SampleMoments>().into()
    });
}
