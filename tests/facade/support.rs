//! Helpers of the cross-crate tests: small scenes, and means with standard errors.

use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, LocalDir, Mesh, Vec3};
use dunkelfeld::radiometry::{Rgb, Seconds};
use dunkelfeld::scene::{
    Camera, Environment, EnvironmentSource, Material, Projection, PunctualKind, PunctualLight, Scene, SceneBuilder,
    Specular, Surface, Volume, look_at,
};
use dunkelfeld::sensor::{Exposure, Optics};
use dunkelfeld::{Budget, RenderSettings, Rendering, SensorChoice, Session, find_sensor, render};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_bsdf::{Bsdf, Principled, PrincipledParams};
use dunkelfeld_testkit::{Claim, SampleMoments};
use std::sync::Arc;

/// False-alarm rate of one statistical check that is not a `Claim`. The suite makes fewer than 500 of them: 5e-7 in all.
pub(crate) const RATE: f64 = 1e-9;

/// Adds an object with a material of its own.
pub(crate) trait Add {
    fn add(&mut self, name: &str, mesh: impl Into<Arc<Mesh>>, material: Material);
}

impl Add for SceneBuilder {
    fn add(&mut self, name: &str, mesh: impl Into<Arc<Mesh>>, material: Material) {
        let material = self.add_material(material);
        self.add_object(name, mesh, material);
    }
}

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
    b.add("lamp", square(1.2, 0.8, true), emitter(24.0));
    b.add_camera("camera", DVec3::new(1.1, -2.0, 1.1), DVec3::new(0.0, 0.0, 0.1), 0.7);
    build(b)
}

/// A smooth clear solid without absorption.
pub(crate) fn clear(ior: f32) -> Material {
    absorbing(ior, 1.0, f32::INFINITY)
}

/// A smooth clear solid that leaves `color` of the light after `distance` \[m\].
pub(crate) fn absorbing(ior: f32, color: f32, distance: f32) -> Material {
    let volume = Volume { attenuation_color: Rgb::splat(color), attenuation_distance: distance, ..Volume::default() };
    Material {
        ior,
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        surface: Surface::Solid(volume),
        ..Material::default()
    }
}

/// A rough grey plastic.
pub(crate) fn plastic() -> Material {
    Material { base_color: Rgb::splat(0.6).into(), roughness: 0.4.into(), ..Material::default() }
}

/// The BSDF of [`plastic`].
pub(crate) fn plastic_bsdf() -> Bsdf {
    let params = PrincipledParams { base_color: Rgb::splat(0.6), roughness: 0.4, eta: 1.5, ..Default::default() };
    Bsdf::Principled(Principled::new(&params))
}

/// `f cos` of a BSDF on a surface with unit normal `n`, green channel.
pub(crate) fn f_cos(bsdf: &Bsdf, n: DVec3, wo: DVec3, wi: DVec3) -> f64 {
    let to_local = DQuat::from_rotation_arc(n, DVec3::Z);
    let local = |d: DVec3| LocalDir((to_local * d).as_vec3());
    f64::from(bsdf.eval_pdf(local(wo), local(wi)).0.g)
}

/// Midpoint rule on the unit square.
pub(crate) fn integrate(n: usize, f: impl Fn(f64, f64) -> f64) -> f64 {
    let at = |i: usize| (i as f64 + 0.5) / n as f64;
    (0..n * n).map(|k| f(at(k % n), at(k / n))).sum::<f64>() / (n * n) as f64
}

/// Where the cameras of floors stand: 45 degrees above the floor.
pub(crate) fn view() -> DVec3 {
    DVec3::new(0.6, 0.36, 0.7).normalize()
}

/// A plastic floor of side `side` in the plane z = 0.
pub(crate) fn floor(side: f32) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    b.add("floor", square(0.0, side, false), plastic());
    b
}

/// What a plastic point at the origin sends toward `wo` under a parallelogram of radiance `l` that faces it.
pub(crate) fn lit_by_panel(wo: DVec3, corner: DVec3, u: DVec3, v: DVec3, l: f64, steps: usize) -> f64 {
    let (bsdf, area) = (plastic_bsdf(), u.cross(v));
    integrate(steps, |s, t| {
        let p = corner + s * u + t * v;
        let (d2, wi) = (p.length_squared(), p.normalize());
        if wi.z > 0.0 { l * area.dot(wi).abs() / d2 * f_cos(&bsdf, DVec3::Z, wo, wi) } else { 0.0 }
    })
}

/// An environment of the same radiance everywhere.
pub(crate) fn sky(radiance: f32) -> Option<Environment> {
    Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(radiance)), rotation: 0.0 })
}

/// Parallel light from a direction, with irradiance 1 on a surface that faces it.
pub(crate) fn sun(b: &mut SceneBuilder, from: DVec3) {
    b.lights.push(PunctualLight {
        name: "sun".into(),
        to_world: DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::NEG_Z, -from.normalize())),
        kind: PunctualKind::Directional { irradiance: Rgb::WHITE },
    });
}

/// A square of side `side` around the origin's height `z`, facing +z (or -z if turned), in the xy plane.
pub(crate) fn square(z: f32, side: f32, turned: bool) -> Mesh {
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

/// One of the program's sensors behind a lens at f/4, exposed for so many milliseconds or automatically.
pub(crate) fn sensor(name: &str, milliseconds: Option<f64>) -> SensorChoice {
    let optics = Optics::new(4.0, 0.9, 0.0).expect("in range");
    let exposure = milliseconds.map(|ms| Exposure::new(Seconds(1e-3 * ms)).expect("in range"));
    SensorChoice::Emva { model: Box::new(find_sensor(name).expect("a preset")), optics, exposure }
}

pub(crate) fn rendered(scene: &Scene, settings: &RenderSettings) -> Rendering {
    render(scene, settings, &Session::new(settings.run.threads).expect("threads")).expect("the settings are valid")
}

pub(crate) fn film(scene: &Scene, settings: &RenderSettings) -> Film {
    rendered(scene, settings).film.sums
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
