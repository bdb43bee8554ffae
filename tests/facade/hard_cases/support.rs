//! Rendering a hard case and judging it: the mean of 256 pixels with its standard error, four of which are allowed.

pub(crate) use crate::support::{
    absorbing, clear, f_cos, floor, integrate, lit_by_panel, plastic, plastic_bsdf, sky, spot_camera as spot, sun, view,
};
use crate::support::{film, settings};
use dunkelfeld::RenderSettings;
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DAffine3, DVec3, Mesh};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Environment, EnvironmentSource, Image, ImageId, Scene, SceneBuilder, Texels};
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

/// Moves everything in a scene: objects, lights and cameras.
pub(crate) fn place(b: &mut SceneBuilder, to_world: DAffine3) {
    b.instances.iter_mut().for_each(|i| i.to_world = to_world * i.to_world);
    b.lights.iter_mut().for_each(|l| l.to_world = to_world * l.to_world);
    b.cameras.iter_mut().for_each(|c| c.to_world = to_world * c.to_world);
}

/// An environment of one radiance above the horizon (+y) and another below. Adds its image.
pub(crate) fn two_halves(b: &mut SceneBuilder, above: f32, below: f32) {
    let image = ImageId(b.images.len() as u32);
    let texels = Texels::RgbF32(vec![[above; 3], [below; 3]]);
    b.images.push(Image { name: "halves".into(), width: 1, height: 2, texels: texels.into() });
    b.environment = Some(Environment { source: EnvironmentSource::Image { image, scale: Rgb::WHITE }, rotation: 0.0 });
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
