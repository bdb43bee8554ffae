//! Rendering a hard case and judging it: the mean of 256 pixels with its standard error, four of which are allowed.

use crate::support::{film, settings};
use dunkelfeld::RenderSettings;
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, LocalDir, Mesh};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{
    Camera, Environment, EnvironmentSource, Image, ImageId, Material, Projection, PunctualKind, PunctualLight, Scene,
    SceneBuilder, Surface, Texels, Volume, look_at,
};
use dunkelfeld_bsdf::{Bsdf, Principled, PrincipledParams};
use dunkelfeld_testkit::{Claim, Estimate, SampleMoments};

/// Pixels along the side of the image of a case. All of them show the same radiance, so that their means are independent
/// samples of one number.
const SIDE: u32 = 16;
/// Samples and precision of a case.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Terms {
    /// Samples per pixel of the first render, 256 pixels.
    pub(crate) spp: f64,
    /// Bound on the standard error, relative to the expectation.
    pub(crate) sure: f64,
    /// What the rounding of f32 may do beside it, relative to the expectation.
    pub(crate) rounding: f64,
}

impl Terms {
    fn claim(&self, expected: f64) -> Claim {
        Claim { expected, tolerance: self.rounding * expected.abs(), sure: self.sure * expected.abs() }
    }
}

/// Terms where rounding can do nothing worth mentioning: a dozen roundings along the path.
pub(crate) const fn terms(spp: f64, sure: f64) -> Terms {
    Terms { spp, sure, rounding: 2e-6 }
}

/// A film without a sample that is not finite, negative or out of range.
#[track_caller]
pub(crate) fn healthy_film(scene: &Scene, settings: &RenderSettings, what: &str) -> Film {
    // The tests of a binary run side by side: one thread each.
    let film = film(scene, &settings.clone().running(|run| run.with_threads(1)));
    assert_eq!(film.invalid_samples(), 0, "{what}: samples that are not finite or negative");
    assert!(film.mean().data().iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{what}: pixels out of range");
    film
}

/// Pixel means of the scene's first camera, green channel.
#[track_caller]
pub(crate) fn pixel_means(scene: &Scene, spp: f64, seed: u64, what: &str) -> SampleMoments {
    crate::support::pixel_moments(&healthy_film(scene, &settings(SIDE, SIDE, spp, seed), what))
}

/// The scene's radiance must be `expected`.
#[track_caller]
pub(crate) fn gives(scene: &Scene, expected: f64, terms: Terms, what: &str) {
    terms
        .claim(expected)
        .assert(what, |k| pixel_means(scene, terms.spp * f64::from(1 << (2 * k)), 11 + u64::from(k), what).into());
}

/// Two scenes must have the same radiance: the ratio is one.
#[track_caller]
pub(crate) fn same(a: &Scene, b: &Scene, terms: Terms, what: &str) {
    terms.claim(1.0).assert(what, |k| {
        let spp = terms.spp * f64::from(1 << (2 * k));
        let [a, b] = [(a, 21), (b, 31)].map(|(s, seed)| Estimate::from(pixel_means(s, spp, seed + u64::from(k), what)));
        let value = a.value / b.value;
        Estimate { value, standard_error: value * (a.standard_error / a.value).hypot(b.standard_error / b.value) }
    });
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
    let m = b.add_material(plastic());
    b.add_object("floor", crate::support::square(0.0, side, false), m);
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

/// A camera with parallel rays at `eye` that sees a spot of half-width `half` around `target`.
pub(crate) fn spot(b: &mut SceneBuilder, eye: DVec3, target: DVec3, half: f32) {
    b.cameras.push(Camera {
        name: "spot".into(),
        to_world: look_at(eye, target, DVec3::new(0.1, 1.0, 0.2)),
        projection: Projection::Orthographic { half_width: half, half_height: half },
        ..Camera::default()
    });
}

/// Moves everything in a scene: objects, lights and cameras.
pub(crate) fn place(b: &mut SceneBuilder, to_world: DAffine3) {
    b.instances.iter_mut().for_each(|i| i.to_world = to_world * i.to_world);
    b.lights.iter_mut().for_each(|l| l.to_world = to_world * l.to_world);
    b.cameras.iter_mut().for_each(|c| c.to_world = to_world * c.to_world);
}

/// An environment of the same radiance everywhere.
pub(crate) fn sky(radiance: f32) -> Option<Environment> {
    Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(radiance)), rotation: 0.0 })
}

/// An environment of one radiance above the horizon (+y) and another below. Adds its image.
pub(crate) fn two_halves(b: &mut SceneBuilder, above: f32, below: f32) {
    let image = ImageId(b.images.len() as u32);
    let texels = Texels::RgbF32(vec![[above; 3], [below; 3]]);
    b.images.push(Image { name: "halves".into(), width: 1, height: 2, texels: texels.into() });
    b.environment = Some(Environment { source: EnvironmentSource::Image { image, scale: Rgb::WHITE }, rotation: 0.0 });
}

/// Parallel light from a direction, with irradiance 1 on a surface that faces it.
pub(crate) fn sun(b: &mut SceneBuilder, from: DVec3) {
    b.lights.push(PunctualLight {
        name: "sun".into(),
        to_world: DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::NEG_Z, -from.normalize())),
        kind: PunctualKind::Directional { irradiance: Rgb::WHITE },
    });
}

/// Fresnel's reflectance of unpolarised light at the angle of incidence `angle` \[rad\] (Born and Wolf 1999, section 1.5.2).
pub(crate) fn fresnel(angle: f64, ior: f64) -> f64 {
    let sin_t = angle.sin() / ior;
    if sin_t >= 1.0 {
        return 1.0;
    }
    let (ci, ct) = (angle.cos(), (1.0 - sin_t * sin_t).sqrt());
    let (s, p) = ((ci - ior * ct) / (ci + ior * ct), (ior * ci - ct) / (ior * ci + ct));
    0.5 * (s * s + p * p)
}

/// Transmission of a stack of `faces` lossless faces of reflectance `r`, all internal reflections included: each face adds
/// `r / (1 - r)` to the ratio of reflected to transmitted light (Stokes 1862).
pub(crate) fn through_faces(faces: f64, r: f64) -> f64 {
    (1.0 - r) / (1.0 + (faces - 1.0) * r)
}

/// A mesh with every corner moved.
pub(crate) fn moved(mut mesh: Mesh, by: DVec3) -> Mesh {
    mesh.positions.iter_mut().for_each(|p| *p = (p.as_dvec3() + by).as_vec3());
    mesh
}
